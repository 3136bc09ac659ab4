"""How to cut the detail into regions and streamable segments: the options, and what bounds them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Literal

from terraport_pipeline.errors import OptionError
from terraport_pipeline.option import Option
from terraport_pipeline.stages.region_engine import COLOUR, RegionOptions

__all__ = ["MAX_REGIONS", "NAME", "SMALLEST_TOLERANCE_M", "Options"]

NAME: Final = "segment"


MAX_REGIONS: Final = 65535
"""Feature ids travel as 16-bit numbers."""

SMALLEST_TOLERANCE_M: Final = 1e-3
"""Base and detail can coincide (a cloud so small that both are the same): the cover needs a
length."""


@dataclass(frozen=True, slots=True)
class Options(RegionOptions):
    """How to cut the surface into regions and segments."""

    min_faces: Annotated[int, Option(least=1)] = 2000
    """Segments with fewer faces are merged. Higher: fewer draw calls, coarser landings."""
    max_faces: Annotated[int, Option(least=1)] = 20000
    """Segments with more faces are cut."""
    max_extent_m: Annotated[
        float | None, Option(above=0, unit="m", unset="by the density of the faces")
    ] = None
    """Segments wider than this, metres, are cut."""
    units: Annotated[Literal["segments", "pools"], Option(flags=("--streamed",))] = "segments"
    """What is streamed as one piece. pools: each pool of the thesis as it is, to compare."""

    def __post_init__(self) -> None:
        RegionOptions.__post_init__(self)  # a slotted dataclass has no super() without arguments
        if self.min_faces > self.max_faces:
            raise OptionError(
                f"segments of {self.min_faces} to {self.max_faces} faces; expected the smaller "
                "bound first"
            )

    @property
    def in_one_piece(self) -> str | None:
        """What of these options needs the whole surface at once; None where tiles will do."""
        if self.engine not in ("borders", "means"):
            return f"engine {self.engine}"
        if self.segment_by != COLOUR:
            return f"segments by {self.segment_by}"
        return None if self.units == "segments" else f"streamed {self.units}"
