"""Any triangle mesh cut by any engine: what ``terraport segment`` does, without its files.

A build cuts its own detail, coloured ground, by a few options (:mod:`.region_engine`); here a mesh
may be a closed body, bare of colour, or cut by numbers from elsewhere, and engines show all that
they have.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from terraport_payload.types import Float32, Float64, Int32
from terraport_pipeline.engines.body_parts import BodySegmenter
from terraport_pipeline.engines.mesh_files.read_mesh import FileMesh
from terraport_pipeline.engines.shape_diameter import shape_diameter
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.borders.border_segmenter import BorderSegmenter
from terraport_pipeline.geometry.graph.graph_options import (
    BODY_GRAPH,
    COLOUR_GRAPH,
)
from terraport_pipeline.geometry.graph.graph_segmenter import GraphSegmenter
from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.geometry.regions.mean_colour import MeanColourSegmenter
from terraport_pipeline.geometry.regions.segmenter import (
    Segmenter,
    SegmenterMesh,
    TriangleSegmenter,
)
from terraport_pipeline.geometry.regions.shape_index import shape_index
from terraport_pipeline.options.mesh_segments import MeshSegmentOptions
from terraport_pipeline.options.regions import (
    COLOUR,
    Engine,
    EngineOptions,
    RegionOptions,
)
from terraport_pipeline.stages.region_engine import SHAPE, given, is_closed, make_segmenter

__all__ = ["MeshSegments", "segment_mesh"]


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
