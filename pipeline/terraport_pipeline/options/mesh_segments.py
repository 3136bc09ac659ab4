"""Options of ``terraport segment``: what a mesh is cut by, by which engine, and how finely."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Literal

from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.graph.graph_options import (
    BODY_GRAPH,
    COLOUR_GRAPH,
    OPEN_SHAPE_GRAPH,
    SHAPE_GRAPH,
)
from terraport_pipeline.geometry.regions.engine_options import (
    FELZENSZWALB_SHARE,
    MEANS_LEAK,
    MEANS_LIGHTNESS,
    MEANS_SMALL_SHARE,
    REGION_POOLS,
)
from terraport_pipeline.option import Option, check_options
from terraport_pipeline.options.regions import MOST_SCALE, OF_ENGINES, Engine, EngineOptions

__all__ = ["MeshSegmentOptions"]

_MORE: Final = "Of one engine each, for researchers"


@dataclass(frozen=True, slots=True)
class MeshSegmentOptions(EngineOptions):
    """What a mesh is cut by, by which engine, and all that engines can be told."""

    by: Annotated[str | None, Option(unset="colour where the mesh has it, else shape")] = None
    """What the surface is cut by: colour (of vertices, faces or a texture); shape (graph: how the
    surface folds; other engines: the shape diameter, how thick a closed body is); an attribute of
    the mesh by its name; or a file with a number for each face or vertex (.npy, else text)."""
    engine: Annotated[Engine | None, Option(unset="means; by shape graph")] = None
    """What cuts. means: mean colours of whole pieces. borders: where colour, texture or slope
    change along a line, with --region-size in the unit of the mesh. graph: borders weighed by
    length, fold and colour; also cuts by shape alone. tpa: the thesis's Triangle Pool Algorithm.
    felzenszwalb, grid: to compare with."""
    k: Annotated[int | None, Option(least=1, unset="as many as there seem to be")] = None
    """graph, borders: this many segments, if the surface hangs together; separate pieces stay
    apart."""
    graph_cut_drop: Annotated[
        float | None,
        Option(
            heading=OF_ENGINES,
            above=0,
            most=MOST_SCALE,
            unset=f"{COLOUR_GRAPH.threshold:g}; by shape {OPEN_SHAPE_GRAPH.threshold:g}; a closed "
            "body's parts are united as people would",
        ),
    ] = None
    """graph: regions merge while that lowers the normalised cut by more than this (no unit: the
    same for a stone and a quarry). Higher tells more apart. Of a closed body by shape a stated
    value takes the place of what people would do; 5 is one to begin with."""
    small_region_share: Annotated[
        float | None,
        Option(
            least=0,
            below=1,
            unset=f"means {MEANS_SMALL_SHARE:g}, graph "
            f"{COLOUR_GRAPH.small_share:g} (of a closed body by shape {BODY_GRAPH.small_share:g}, "
            f"with --graph-cut-drop {SHAPE_GRAPH.small_share:g}), tpa "
            f"{REGION_POOLS.small_threshold:g}, felzenszwalb "
            f"{FELZENSZWALB_SHARE:g}",
        ),
    ] = None
    """Regions below this share of the surface (graph: of its area, else of its faces) join a
    neighbour; borders and grid know none."""
    means_difference: Annotated[
        float | None, Option(heading=_MORE, above=0, most=1000, unset="from the spread")
    ] = None
    """means: how far mean colours are apart, CIELAB units, in place of a share of the spread."""
    means_lightness: Annotated[
        float | None,
        Option(heading=_MORE, least=0, most=10, unset=f"{MEANS_LIGHTNESS:g}"),
    ] = None
    """means: weight of lightness against hue. Lower ignores shadows."""
    means_leak: Annotated[
        float | None,
        Option(heading=_MORE, least=0, most=2, unset=f"{MEANS_LEAK:g}"),
    ] = None
    """means: power of perimeter over common border; 0 ignores how far two pieces touch."""
    graph_concavity: Annotated[
        float | None,
        Option(
            heading=_MORE,
            least=0,
            most=100,
            unset=f"{COLOUR_GRAPH.weights.concavity:g}; by shape {SHAPE_GRAPH.weights.concavity:g}",
        ),
    ] = None
    """graph: exponent by which inward folds make borders; 0 leaves shape out."""
    graph_colour_scale: Annotated[
        float | None,
        Option(
            heading=_MORE,
            least=0,
            most=1000,
            unset=f"{COLOUR_GRAPH.weights.colour_scale:g}; by shape 0",
        ),
    ] = None
    """graph: CIELAB difference at which a border weighs 1/e; 0 leaves colour out."""
    graph_lightness: Annotated[
        float | None,
        Option(heading=_MORE, least=0, most=10, unset=f"{COLOUR_GRAPH.weights.lightness:g}"),
    ] = None
    """graph: weight of lightness against hue. Lower makes shadows fainter borders."""
    graph_smooth_rounds: Annotated[
        int | None,
        Option(heading=_MORE, least=0, most=64, unset=f"{COLOUR_GRAPH.smooth_rounds}"),
    ] = None
    """graph: times that colours are averaged with the neighbours' first, against noise."""
    graph_seed_faces: Annotated[int | None, Option(heading=_MORE, least=1, unset="by the mesh")] = (
        None
    )
    """graph: most faces of a seed; 1 starts from single faces."""
    tpa_mu: Annotated[
        float | None, Option(heading=_MORE, least=0, unset=f"{REGION_POOLS.mu:g}")
    ] = None
    """tpa: weight of colour, shape or attribute in the similarity s."""
    tpa_tau: Annotated[
        float | None, Option(heading=_MORE, least=0, unset=f"{REGION_POOLS.tau:g}")
    ] = None
    """tpa: weight of the place in s."""
    tpa_normalise: Annotated[
        Literal["minmax", "max", "raw"] | None, Option(heading=_MORE, unset=REGION_POOLS.normalise)
    ] = None
    """tpa: what is compared is scaled by its least and largest value, by its largest, or not."""
    tpa_range: Annotated[
        float | None,
        Option(heading=_MORE, above=0, unset=f"{REGION_POOLS.attribute_range:g}; by shape 2"),
    ] = None
    """tpa: upper end of what is compared, once scaled."""
    tpa_origin: Annotated[
        Literal["min_corner", "first", "centroid"] | None,
        Option(heading=_MORE, unset=REGION_POOLS.origin),
    ] = None
    """tpa: where places are measured from; first (face) is the thesis's."""
    tpa_contiguity: Annotated[
        Literal["edge", "vertex"] | None, Option(heading=_MORE, unset=REGION_POOLS.contiguity)
    ] = None
    """tpa: faces are neighbours over an edge, or over a vertex."""
    tpa_islands: Annotated[
        Literal["nearest", "stay"] | None, Option(heading=_MORE, unset=REGION_POOLS.islands)
    ] = None
    """tpa: small pools that touch no large one join the nearest, or stay."""

    def __post_init__(self) -> None:
        check_options(self)
        if self.engine is not None:
            self._check_all(self.engine)

    def _check_all(self, engine: str) -> None:
        self.check_engine(engine)
        if self.k is not None and engine not in ("graph", "borders"):
            raise OptionError(
                f"--k {self.k} with engine {engine}, which finds the number itself; expected "
                "--engine graph or borders"
            )
