"""Which engine cuts the surface into regions, by what, and how it is set."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated, Final, Literal, TypeVar, get_args

import numpy as np

from terraport_payload.types import AnyArray, Float64, Int32
from terraport_pipeline.engines.shape_diameter import shape_diameter
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.borders.border_segmenter import BorderSegmenter
from terraport_pipeline.geometry.graph.felzenszwalb import FelzenszwalbSegmenter
from terraport_pipeline.geometry.graph.graph_segmenter import (
    COLOUR_GRAPH,
    OPEN_SHAPE_GRAPH,
    SHAPE_GRAPH,
    GraphSegmenter,
)
from terraport_pipeline.geometry.regions.grid_segmenter import GridSegmenter
from terraport_pipeline.geometry.regions.mean_colour import MeanColourSegmenter
from terraport_pipeline.geometry.regions.segmenter import (
    Segmenter,
    SegmenterMesh,
    TriangleSegmenter,
)
from terraport_pipeline.geometry.regions.shape_index import shape_index
from terraport_pipeline.geometry.regions.triangle_pool import FINE_POOLS, REGION_POOLS
from terraport_pipeline.model import Mesh
from terraport_pipeline.option import LENGTH, Option, check_options, option_fields

__all__ = [
    "COLOUR",
    "ENGINES",
    "MOST_SCALE",
    "OF_ENGINES",
    "SHAPE",
    "Engine",
    "EngineOptions",
    "RegionOptions",
    "border_segmenter",
    "check_segment_by",
    "given",
    "is_closed",
    "make_segmenter",
    "means_segmenter",
    "segmenter_mesh",
    "sized",
]

Engine = Literal["borders", "means", "graph", "tpa", "felzenszwalb", "grid"]

ENGINES: Final = get_args(Engine)
"""Engines that a build may be asked for; the last two are there to compare with."""

COLOUR: Final = "colour"
SHAPE: Final = "shape"
_OPEN: Final = 0.1
"""Faces of a closed surface look to all sides alike: their area vectors sum to nothing. A hill, or
a body with a wall missing, leaves more than this share of its area."""
_SHAPE_RANGE: Final = 2.0
"""Upper end of the shape index with tpa: it gives the thesis's row on Princeton's models."""


OF_ENGINES: Final = "Regions: of one engine each"
"""Heading of the options that one engine alone has."""

_SIZES_ACROSS: Final = 8.0
"""A scene not this many of the default region size wide is a small thing looked at closely."""
_MOST_SIZES_ACROSS: Final = 100.0
"""One wider than this many has larger regions: all its cells are united at once, and of these
there are 4 million at most, 3 GB. It depends on the scene alone, not on the machine's memory."""
_LEAST_SIZE_M: Final = 0.05
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
            least=_LEAST_SIZE_M,
            most=1e4,
            unit="m",
            unset=f"{BorderSegmenter().region_size_m:g}; of a scene less than "
            f"{_SIZES_ACROSS * BorderSegmenter().region_size_m:g} m wide an eighth of its width, "
            f"of one over {_MOST_SIZES_ACROSS * BorderSegmenter().region_size_m / 1000:g} km a "
            "hundredth",
        ),
    ] = None
    """borders: width of the ground that a region is looked for on, as 15m (or cm, km, ft), however
    large the survey is. Regions below about a third of its square join a neighbour. Lower tells
    more apart."""
    means_spread: Annotated[
        float | None,
        Option(heading=OF_ENGINES, above=0, most=100, unset=f"{MeanColourSegmenter().spread:g}"),
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
            unset=f"{FelzenszwalbSegmenter().region_scale:g}",
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
            unset=f"means {MeanColourSegmenter().small_share:g}, graph "
            f"{COLOUR_GRAPH.small_share:g} (of a closed body by shape "
            f"{SHAPE_GRAPH.small_share:g}), tpa {REGION_POOLS.small_threshold:g}, felzenszwalb "
            f"{FelzenszwalbSegmenter().region_share:g}",
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


def make_segmenter(
    options: RegionOptions, *, is_closed_body: bool = False, threads: int
) -> Segmenter:
    """Make the engine that was asked for.

    Parameters
    ----------
    options : RegionOptions
    is_closed_body : bool
        Whether the surface is a body's, as :func:`is_closed` says: by shape such are cut by other
        defaults than open ground.
    threads : int
        At most; the result does not depend on it.
    """
    small_share = options.small_region_share
    by_shape = options.segment_by == SHAPE
    if options.engine == "borders":
        return border_segmenter(options)
    if options.engine == "graph":
        of_shape = SHAPE_GRAPH if is_closed_body else OPEN_SHAPE_GRAPH
        graph = of_shape if by_shape else COLOUR_GRAPH
        return GraphSegmenter(
            replace(
                graph,
                threshold=given(options.graph_cut_drop, graph.threshold),
                small_share=given(small_share, graph.small_share),
            )
        )
    if options.engine == "felzenszwalb":
        edges = FelzenszwalbSegmenter()
        return replace(
            edges,
            region_scale=given(options.felzenszwalb_scale, edges.region_scale),
            region_share=given(small_share, edges.region_share),
        )
    if options.engine == "grid":
        return GridSegmenter(region_cell_m=options.grid_cell_m)
    if options.engine == "means":
        return means_segmenter(options, threads=threads)
    value_range = _SHAPE_RANGE if by_shape else REGION_POOLS.attribute_range
    return TriangleSegmenter(
        regions=replace(
            REGION_POOLS,
            attribute_range=value_range,
            threshold=given(options.tpa_region_threshold, REGION_POOLS.threshold),
            small_threshold=given(small_share, REGION_POOLS.small_threshold),
        ),
        fine=replace(
            FINE_POOLS,
            attribute_range=value_range,
            threshold=given(options.tpa_segment_threshold, FINE_POOLS.threshold),
        ),
        threads=threads,
    )


def border_segmenter(options: RegionOptions) -> BorderSegmenter:
    """Make the engine of borders, which also works tile by tile."""
    return BorderSegmenter(given(options.borders_size_m, BorderSegmenter().region_size_m))


_Sized = TypeVar("_Sized", bound=RegionOptions)


def sized(options: _Sized, width_m: float) -> _Sized:
    """Return options with a region size, where none is stated, that suits a scene so wide.

    `width_m` is the root of its surface's area.
    """
    if options.engine != "borders" or options.borders_size_m is not None:
        return options
    usual = BorderSegmenter().region_size_m
    size_m = max(min(usual, width_m / _SIZES_ACROSS), width_m / _MOST_SIZES_ACROSS, _LEAST_SIZE_M)
    return replace(options, borders_size_m=size_m)


def is_closed(vertices: AnyArray, faces: Int32) -> bool:
    """Tell a body from ground: whether the faces' area vectors sum to nearly nothing."""
    a, b, c = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))
    vectors = np.cross(b - a, c - a)
    total = float(np.linalg.norm(vectors, axis=1).sum())
    return total > 0.0 and float(np.linalg.norm(vectors.sum(axis=0))) < _OPEN * total


def means_segmenter(options: RegionOptions, *, threads: int = 1) -> MeanColourSegmenter:
    """Make the engine of mean colours, the one that also works tile by tile."""
    means = MeanColourSegmenter()
    return replace(
        means,
        spread=given(options.means_spread, means.spread),
        small_share=given(options.small_region_share, means.small_share),
        threads=threads,
    )


def segmenter_mesh(
    detail: Mesh, pairs: tuple[Int32, Int32], options: RegionOptions, *, threads: int
) -> SegmenterMesh:
    """Give the engine the detail with what it compares: colours, shape or an attribute.

    Parameters
    ----------
    detail : Mesh
    pairs : pair of ndarray
        ``face_pairs`` of the detail.
    options : RegionOptions
    threads : int
        At most.

    Raises
    ------
    OptionError
        No attribute has the name, or some of its values are not numbers; the shape diameter of a
        surface that is open everywhere.
    """
    mesh = SegmenterMesh(detail.vertices, detail.faces, detail.colours, pairs=pairs)
    if options.segment_by == COLOUR:
        return mesh
    if options.segment_by == SHAPE and options.engine == "graph":
        return replace(mesh, colours=None)  # the graph sees shape itself
    if options.segment_by == SHAPE:
        diameter = shape_diameter(detail.vertices, detail.faces, threads=threads)
        if not np.isfinite(diameter).any():
            raise OptionError(
                "segments by shape: no ray from any face met the other side; the shape diameter "
                "is for closed bodies, and this surface is open: use --engine graph, or colour"
            )
        return replace(mesh, scalar=shape_index(diameter, pairs[0]))
    return replace(mesh, scalar=_attribute_of_faces(detail, options.segment_by))


def check_segment_by(segment_by: str, attributes: Iterable[str]) -> None:
    """Refuse to compare by what a survey does not have.

    Parameters
    ----------
    segment_by : str
    attributes : iterable of str
        Names of the survey's attributes.

    Raises
    ------
    OptionError
        It is none of them, nor colour, nor shape.
    """
    choices = [COLOUR, SHAPE, *sorted(attributes)]
    if segment_by not in choices:
        raise OptionError(f"segments by {segment_by!r}; this survey has {', '.join(choices)}")


def _attribute_of_faces(detail: Mesh, name: str) -> Float64:
    """Mean of the attribute over every face's corners."""
    check_segment_by(name, detail.attributes)
    values = detail.attributes[name].astype(np.float64)
    if not np.isfinite(values).all():
        bad = int(np.count_nonzero(~np.isfinite(values)))
        raise OptionError(
            f"segments by {name!r}: {bad} of {len(values)} values are not finite numbers"
        )
    total = values[detail.faces[:, 0]] + values[detail.faces[:, 1]]
    total += values[detail.faces[:, 2]]
    return np.asarray(total / 3.0, dtype=np.float64)


def given(value: float | None, default: float) -> float:
    """Return what was stated, else the default; 0 is stated."""
    return default if value is None else value
