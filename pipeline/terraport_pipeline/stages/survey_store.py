"""A survey as the read stage leaves it in a work directory."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from terraport_pipeline.model import Crs, Survey
from terraport_pipeline.stages.contract import Facts, Stored

__all__ = ["NAME", "facts_of", "restore", "store"]

NAME: Final = "read"


def facts_of(survey: Survey) -> Facts:
    """Report points, colour, attributes and CRS of a survey as read."""
    counts = {
        "points": len(survey.points),
        "has_colour": survey.colours is not None,
        "attributes": len(survey.attributes),
        "format": survey.format,
        "crs": survey.crs.name if survey.crs else None,
    }
    return Facts(counts, survey.warnings)


def store(survey: Survey) -> Stored:
    """Turn a survey into arrays and values."""
    arrays: dict[str, npt.NDArray[np.generic]] = {"points": survey.points}
    arrays |= {f"attribute-{i}": values for i, values in enumerate(survey.attributes.values())}
    if survey.colours is not None:
        arrays["colours"] = survey.colours
    crs = survey.crs
    values = {
        "attributes": list(survey.attributes),
        "crs": {"name": crs.name, "wkt": crs.wkt, "epsg": crs.epsg} if crs else None,
        "format": survey.format,
    }
    return Stored(arrays, values)


def restore(stored: Stored, facts: Facts) -> Survey:
    """Turn arrays and values back into a survey."""
    arrays, values = stored.arrays, stored.values
    return Survey(
        points=np.asarray(arrays["points"], dtype=np.float64),
        colours=np.asarray(arrays["colours"], dtype=np.uint8) if "colours" in arrays else None,
        attributes={name: arrays[f"attribute-{i}"] for i, name in enumerate(values["attributes"])},
        crs=Crs(**values["crs"]) if values["crs"] else None,
        format=values["format"],
        warnings=facts.warnings,
    )
