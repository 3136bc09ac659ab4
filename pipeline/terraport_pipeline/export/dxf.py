"""DXF drawings: empty ones in the survey's unit, and how they are saved."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from ezdxf.document import Drawing
from ezdxf.filemanagement import new
from ezdxf.zoom import extents

from terraport_pipeline.export.frame import SurveyFrame

__all__ = ["new_drawing", "save_drawing"]

_VERSION: Final = "R2010"
"""What every CAD program of the last fifteen years opens."""

_UNITS: Final = {"m": 6, "ft": 2, "us-ft": 21}
"""Codes of $INSUNITS; 0, unitless, for others."""


def new_drawing(frame: SurveyFrame) -> Drawing:
    """Make an empty drawing whose unit is the survey's."""
    drawing = new(_VERSION)
    drawing.header["$INSUNITS"] = _UNITS.get(frame.unit_name, 0)
    drawing.header["$MEASUREMENT"] = 1 if frame.unit_name == "m" else 0
    if frame.crs is not None:
        drawing.header.custom_vars.append("CRS", frame.crs.name)
    return drawing


def save_drawing(drawing: Drawing, path: Path) -> None:
    """Save a drawing with the view on all of it."""
    extents(drawing.modelspace())
    drawing.saveas(path)
