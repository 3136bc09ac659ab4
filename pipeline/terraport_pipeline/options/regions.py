"""Options of regions and segments: which engine cuts the surface, by what, and how finely."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Literal, get_args

from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.graph.graph_options import (
    COLOUR_GRAPH,
    OPEN_SHAPE_GRAPH,
    SHAPE_GRAPH,
)
from terraport_pipeline.geometry.regions.engine_options import (
    BORDERS_SIZE_M,
    FELZENSZWALB_SCALE,
    FELZENSZWALB_SHARE,
    FINE_POOLS,
    MEANS_SMALL_SHARE,
    MEANS_SPREAD,
    REGION_POOLS,
)
from terraport_pipeline.option import LENGTH, Option, check_options, option_fields

__all__ = [
    "COLOUR",
    "ENGINES",
    "LEAST_SIZE_M",
    "MAX_REGIONS",
    "MOST_SCALE",
    "MOST_SIZES_ACROSS",
    "NAME",
    "OF_ENGINES",
    "SIZES_ACROSS",
    "SMALLEST_TOLERANCE_M",
    "Engine",
    "EngineOptions",
    "Options",
    "RegionOptions",
]

NAME: Final = "segment"

Engine = Literal["borders", "means", "graph", "tpa", "felzenszwalb", "grid"]

ENGINES: Final = get_args(Engine)
"""Engines that a build may be asked for; the last two are there to compare with."""

COLOUR: Final = "colour"

OF_ENGINES: Final = "Regions: of one engine each"
"""Heading of the options that only one engine has."""

MAX_REGIONS: Final = 65535
"""Feature ids travel as 16-bit numbers."""

SMALLEST_TOLERANCE_M: Final = 1e-3
"""Base and detail can coincide (a cloud so small that both are the same): the cover needs a
length."""

SIZES_ACROSS: Final = 8.0
"""A scene narrower than this many default region sizes is a small thing looked at closely."""
MOST_SIZES_ACROSS: Final = 100.0
"""A scene wider than this many has larger regions: all its cells are united at once, and of these
there are 4 million at most, 3 GB. It depends on the scene alone, not on the machine's memory."""
LEAST_SIZE_M: Final = 0.05
"""Cells of a twentieth of it are finer than any survey."""
MOST_SCALE: Final = 1e6
"""Of what has no unit or a wide one: k of felzenszwalb means something up to 30,000."""


@dataclass(frozen=True, slots=True)
class EngineOptions:
    """How finely an engine cuts; ``ENGINE_...`` is of that engine alone."""

    borders_size_m: Annotated[
        float | None,
        Option(
            flags=("--region-size",),
            heading=OF_ENGINES,
            notation=LENGTH,
            least=LEAST_SIZE_M,
            most=1e4,
            unit="m",
            unset=f"{BORDERS_SIZE_M:g}; of a scene less than "
            f"{SIZES_ACROSS * BORDERS_SIZE_M:g} m wide an eighth of its width, "
            f"of one over {MOST_SIZES_ACROSS * BORDERS_SIZE_M / 1000:g} km a "
            "hundredth",
        ),
    ] = None
    """borders: width of the ground that a region is looked for on, as 15m (or cm, km, ft), however
    large the survey is. Regions below about a third of its square join a neighbour. Lower tells
    more apart."""
    means_spread: Annotated[
        float | None,
        Option(heading=OF_ENGINES, above=0, most=100, unset=f"{MEANS_SPREAD:g}"),
    ] = None
    """means: how far the mean colours of two regions are apart, as a share of how far all the
    scene's colours spread (no unit). Lower tells more apart."""
    graph_cut_drop: Annotated[
        float | None,
        Option(
            heading=OF_ENGINES,
            above=0,
            most=MOST_SCALE,
            unset=f"{COLOUR_GRAPH.threshold:g}; by shape {OPEN_SHAPE_GRAPH.threshold:g}, of a "
            f"closed body {SHAPE_GRAPH.threshold:g}",
        ),
    ] = None
    """graph: regions merge while that lowers the normalised cut by more than this (no unit: the
    same for a stone and a quarry). Higher tells more apart."""
    tpa_region_threshold: Annotated[
        float | None,
        Option(heading=OF_ENGINES, above=0, most=MOST_SCALE, unset=f"{REGION_POOLS.threshold:g}"),
    ] = None
    """tpa: Th of the pools that are regions, the width of a bin of the similarity s (no unit, about
    0 to 1). Lower tells more apart."""
    tpa_segment_threshold: Annotated[
        float | None,
        Option(heading=OF_ENGINES, above=0, most=MOST_SCALE, unset=f"{FINE_POOLS.threshold:g}"),
    ] = None
    """tpa: Th of the finer pools that segments are made of, as --tpa-region-threshold."""
    felzenszwalb_scale: Annotated[
        float | None,
        Option(
            heading=OF_ENGINES,
            above=0,
            most=MOST_SCALE,
            unset=f"{FELZENSZWALB_SCALE:g}",
        ),
    ] = None
    """felzenszwalb: the scale k, CIELAB units times faces. Lower tells more apart."""
    grid_cell_m: Annotated[
        float | None,
        Option(
            heading=OF_ENGINES,
            above=0,
            most=MOST_SCALE,
            unit="m",
            unset="a twentieth of the ground",
        ),
    ] = None
    """grid: side of a cell, metres."""
    small_region_share: Annotated[
        float | None,
        Option(
            least=0,
            below=1,
            unset=f"means {MEANS_SMALL_SHARE:g}, graph "
            f"{COLOUR_GRAPH.small_share:g} (of a closed body by shape "
            f"{SHAPE_GRAPH.small_share:g}), tpa {REGION_POOLS.small_threshold:g}, felzenszwalb "
            f"{FELZENSZWALB_SHARE:g}",
        ),
    ] = None
    """Regions below this share of the surface (graph: of its area, else of its faces) join a
    neighbour; borders and grid know none."""

    def check_engine(self, engine: str) -> None:
        """Refuse what is stated of another engine.

        Raises
        ------
        OptionError
            Names the option and the engine that has it.
        """
        for field in option_fields(type(self)):
            value, owner = getattr(self, field.name), field.name.partition("_")[0]
            is_of_others = owner in ENGINES and owner != engine
            if engine in ("borders", "grid") and field.name == "small_region_share":
                is_of_others, owner = True, "means, graph, tpa or felzenszwalb"
            if is_of_others and value is not None:
                raise OptionError(
                    f"{field.stated(value)} with engine {engine}; expected engine {owner}: "
                    f"leave out {field.flags[0]}, or change --engine"
                )


@dataclass(frozen=True, slots=True)
class RegionOptions(EngineOptions):
    """Which engine, by what, and how finely."""

    engine: Annotated[Engine, Option()] = "borders"
    """What cuts the surface into regions. borders: where colour or texture change along a line that
    stands out from what lies around; sizes in metres whatever else was flown, and regions last from
    survey to survey. means: mean colours of whole pieces, against the whole scene's. graph: borders
    weighed by length, fold and colour; also cuts by shape alone. tpa: the thesis's Triangle Pool
    Algorithm, one number per face; blind to hue. felzenszwalb, grid: to compare with."""
    segment_by: Annotated[str, Option()] = "colour"
    """What the surface is cut by: colour; shape (the thickness of closed bodies, or with graph how
    the surface folds); or the name of an attribute of the points."""

    def __post_init__(self) -> None:
        check_options(self)
        if not self.segment_by:
            raise OptionError("segment by ''; expected colour, shape or an attribute's name")
        self.check_engine(self.engine)


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
