"""What segmentation begins with, whatever was given: a surface, and what is known of its source."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from terraport_payload.types import Float32, Float64, UInt8
from terraport_pipeline.engines.mesh_texels import MeshTexels
from terraport_pipeline.model import Crs
from terraport_pipeline.stages.survey_change import SurveyChange
from terraport_pipeline.workflow.reconstruct_step import Surface
from terraport_pipeline.workflow.workdir import StageRecord
from terraport_store.manifest import SurveyUnits

__all__ = ["Brought"]


@dataclass(frozen=True, slots=True, eq=False)
class Brought:
    """A surface, reconstructed from a survey or brought as a mesh."""

    surface: Surface
    source: StageRecord
    """Survey or mesh as read: what the scene was built from."""
    worked_on: str
    """Name of the result that the next build over the scene is compared with."""
    origin: Float64
    """(3,) easting, northing, height of the scene's origin."""
    crs: Crs | None
    units: SurveyUnits | None
    points: int
    """Points that the surface rests on; of a mesh its vertices."""
    samples: Float32
    """(N, 3) some of them, scene frame: what cameras are tried on."""
    sample_colours: UInt8 | None
    """(N, 3) theirs; None where the source has none."""
    recorded: Mapping[str, Any]
    """What the manifest records beside the options."""
    inputs: Mapping[str, Any]
    """Files, for ``build.json``: see :func:`.read_step.inputs_of`."""
    change: SurveyChange | None = None
    texels: Callable[[int], MeshTexels] | None = None
    """Opens the images of a textured mesh; takes the bytes of decoded ones that it may keep."""
