"""Any triangle mesh cut by any engine: what ``terraport segment`` does, without its files.

A build cuts its own detail, coloured ground, by a few options (:mod:`.region_engine`); here a mesh
may be a closed body, bare of colour, or cut by numbers from elsewhere, and engines show all that
they have.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, Final, Literal

import numpy as np

from terraport_payload.types import Float32, Float64, Int32
from terraport_pipeline.engines.body_parts import BODY_GRAPH, BodySegmenter
from terraport_pipeline.engines.mesh_files.read_mesh import FileMesh
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
from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.geometry.regions.mean_colour import MeanColourSegmenter
from terraport_pipeline.geometry.regions.segmenter import (
    Segmenter,
    SegmenterMesh,
    TriangleSegmenter,
)
from terraport_pipeline.geometry.regions.shape_index import shape_index
from terraport_pipeline.geometry.regions.triangle_pool import REGION_POOLS
from terraport_pipeline.option import Option, check_options
from terraport_pipeline.stages.region_engine import (
    COLOUR,
    MOST_SCALE,
    OF_ENGINES,
    SHAPE,
    Engine,
    EngineOptions,
    RegionOptions,
    given,
    is_closed,
    make_segmenter,
)

__all__ = ["MeshSegmentOptions", "MeshSegments", "segment_mesh"]

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
            unset=f"means {MeanColourSegmenter().small_share:g}, graph "
            f"{COLOUR_GRAPH.small_share:g} (of a closed body by shape {BODY_GRAPH.small_share:g}, "
            f"with --graph-cut-drop {SHAPE_GRAPH.small_share:g}), tpa "
            f"{REGION_POOLS.small_threshold:g}, felzenszwalb "
            f"{FelzenszwalbSegmenter().region_share:g}",
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
        Option(heading=_MORE, least=0, most=10, unset=f"{MeanColourSegmenter().lightness:g}"),
    ] = None
    """means: weight of lightness against hue. Lower ignores shadows."""
    means_leak: Annotated[
        float | None,
        Option(heading=_MORE, least=0, most=2, unset=f"{MeanColourSegmenter().leak:g}"),
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


@dataclass(frozen=True, slots=True, eq=False)
class MeshSegments:
    """Segments of a mesh, and what was chosen."""

    labels: Int32
    """(F,) segment of every face, numbered by first face."""
    count: int
    pieces: int
    """Parts of the surface that touch nothing."""
    closed: bool
    engine: str
    by: str
    facts: dict[str, int | float]
    """The engine's own."""


def segment_mesh(
    mesh: FileMesh,
    options: MeshSegmentOptions,
    *,
    values: Float64 | None = None,
    y_up: bool = False,
    threads: int = 1,
) -> MeshSegments:
    """Cut a mesh into segments.

    Parameters
    ----------
    mesh : FileMesh
    options : MeshSegmentOptions
    values : ndarray of shape (F,) or (V,), float64, optional
        What the mesh is cut by, in place of ``options.by``. Finite. As many as faces where both
        counts are the same.
    y_up : bool
        Which axis points up, y or z; grid alone asks.
    threads : int
        At most; the result does not depend on it.

    Returns
    -------
    MeshSegments

    Raises
    ------
    OptionError
        The mesh has not what it shall be cut by, or an option is of another engine.
    """
    # (1) What is compared, by which engine.
    by = options.by or (COLOUR if mesh.colours is not None or values is not None else SHAPE)
    engine: Engine = options.engine or ("graph" if by == SHAPE and values is None else "means")
    options._check_all(engine)  # noqa: SLF001  the engine is known only now
    # (2) About the middle: 32 bits are enough.
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    vertices = (mesh.vertices - middle).astype(np.float32)
    if not y_up and engine == "grid":
        vertices = np.stack([vertices[:, 0], vertices[:, 2], -vertices[:, 1]], axis=1)
    pairs = face_pairs(mesh.faces, len(vertices), threads=threads)
    closed = is_closed(vertices, mesh.faces)
    scalar, colours = None, None
    if values is not None:
        scalar = _per_face(values, mesh, options.by or "the file")
    elif by == COLOUR:
        if mesh.colours is None:
            raise OptionError(
                f"by colour, and the mesh has none; expected --by shape{_or_attribute(mesh)}"
            )
        colours = mesh.colours
    elif by == SHAPE:
        scalar = None if engine == "graph" else _thickness(vertices, mesh.faces, pairs[0], threads)
    elif by in mesh.attributes:
        scalar = _per_face(mesh.attributes[by], mesh, by)
    else:
        choices = [COLOUR, SHAPE, *sorted(mesh.attributes)]
        raise OptionError(
            f"by {by!r}; this mesh has {', '.join(choices)}, and no file has the name"
        )
    # (3) The engine with all its options.
    segmenter = _segmenter(options, engine, by if values is None else "file", closed, threads)
    cut = segmenter.segment(SegmenterMesh(vertices, mesh.faces, colours, scalar, pairs))
    _, pieces = components(len(mesh.faces), pairs[0])
    named = options.by if values is not None and options.by else by
    return MeshSegments(
        cut.regions, cut.region_count, pieces, closed, engine, named, dict(cut.facts)
    )


def _or_attribute(mesh: FileMesh) -> str:
    return f" or one of its attributes: {', '.join(sorted(mesh.attributes))}" * bool(
        mesh.attributes
    )


def _per_face(values: Float64, mesh: FileMesh, name: str) -> Float64:
    """Check values and give one for each face: of vertices the mean over the corners."""
    n_faces, n_vertices = len(mesh.faces), len(mesh.vertices)
    if len(values) not in (n_faces, n_vertices):
        raise OptionError(
            f"by {name}: {len(values)} values; expected one for each of {n_faces} faces or "
            f"{n_vertices} vertices (those at one place count once)"
        )
    if not np.isfinite(values).all():
        bad = int(np.count_nonzero(~np.isfinite(values)))
        raise OptionError(f"by {name}: {bad} of {len(values)} values are not finite numbers")
    return values if len(values) == n_faces else values[mesh.faces].mean(axis=1)


def _thickness(vertices: Float32, faces: Int32, pairs: Int32, threads: int) -> Float64:
    diameter = shape_diameter(vertices, faces, threads=threads)
    if not np.isfinite(diameter).any():
        raise OptionError(
            "by shape: no ray from any face met the other side; the shape diameter is for closed "
            "bodies whose faces look outwards: use --engine graph, or --by colour"
        )
    return shape_index(diameter, pairs)


def _segmenter(
    options: MeshSegmentOptions, engine: Engine, by: str, closed: bool, threads: int
) -> Segmenter:
    """Make the engine as a build does, then tell it what only researchers do."""
    common = {field.name: getattr(options, field.name) for field in fields(EngineOptions)}
    region_by = SHAPE if by == SHAPE else COLOUR
    segmenter = make_segmenter(
        RegionOptions(**common, engine=engine, segment_by=region_by),
        is_closed_body=closed,
        threads=threads,
    )
    stated = _stated(options, engine)
    if isinstance(segmenter, BorderSegmenter):
        return replace(segmenter, count=options.k)
    if isinstance(segmenter, MeanColourSegmenter):
        return replace(segmenter, **stated)
    if isinstance(segmenter, GraphSegmenter):
        graph = segmenter.options or COLOUR_GRAPH
        # A closed body's parts are united as people would, or, told a drop, by the cut alone.
        united = by == SHAPE and closed and options.graph_cut_drop is None
        if united:
            least_share = given(options.small_region_share, BODY_GRAPH.small_share)
            graph = replace(BODY_GRAPH, small_share=least_share)
        weighed = {key: stated.pop(key) for key in ("concavity", "colour_scale", "lightness")
                   if key in stated}  # fmt: skip
        graph = replace(graph, weights=replace(graph.weights, **weighed), **stated)
        if united:
            return BodySegmenter(graph, options.k, threads)
        return GraphSegmenter(graph, options.k)
    if isinstance(segmenter, TriangleSegmenter):
        if "range" in stated:
            stated["attribute_range"] = stated.pop("range")
        return replace(
            segmenter,
            regions=replace(segmenter.regions, **stated),
            fine=replace(segmenter.fine, **stated),
        )
    return segmenter


def _stated(options: MeshSegmentOptions, engine: str) -> dict[str, Any]:
    """Give what was stated of an engine beyond what a build takes, by its fields' names."""
    of_builds = {field.name for field in fields(EngineOptions)}
    prefix = f"{engine}_"
    values = {
        field.name.removeprefix(prefix): getattr(options, field.name)
        for field in fields(options)
        if field.name.startswith(prefix) and field.name not in of_builds
    }
    return {name: value for name, value in values.items() if value is not None}
