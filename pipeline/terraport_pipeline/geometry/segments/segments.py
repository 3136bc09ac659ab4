"""Streamable segments: pools merged until none is too small, split until none is too big.

``segmentation.md``, section 3. The steps:

1. units = connected pieces of (fine pool, region);
2. small units join the neighbour of most similar mean s in their region, in rounds, until each has
   ``min_faces``; a whole region piece below ``min_faces`` joins a neighbour of another region;
3. units over a bound are cut in space (``segment_split.py``); a cut that is not edge-connected
   falls into pieces;
4. pieces below ``min_faces`` join a neighbour where both bounds hold; one that cannot is joined
   anyway, the union is cut again, and step 4 repeated; then neighbours of other regions count too;
5. debris (small units that touch nothing) joins the nearest segment within reach where the bounds
   hold, else its likes nearby;
6. segments are numbered along the Morton curve of their boxes' centres.

``max_faces`` always holds. ``max_extent_m`` holds except for single faces that are wider.
``min_faces`` gives way to both, and every exception is counted.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float32, Int32, Int64
from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.geometry.mesh.curve import morton_codes
from terraport_pipeline.geometry.mesh.face_measures import (
    automatic_extent,
    dense_labels,
    edge_steps,
    face_boxes,
    first_faces,
    label_boxes,
    label_sums,
    main_labels,
)
from terraport_pipeline.geometry.segments.segment_debris import DebrisCounts, join_debris
from terraport_pipeline.geometry.segments.segment_split import split_units
from terraport_pipeline.geometry.segments.unit_graph import (
    UnitGraph,
    Units,
    contract,
    join_small,
    join_within_bounds,
    merge_units,
    unit_graph,
)

__all__ = ["SegmentExceptions", "SegmentOptions", "Segments", "build_segments"]


_REPAIR_ROUNDS: Final = 4
"""Times step 4 joins over the bounds and cuts again; after four nothing was left on any mesh
tried."""


@dataclass(frozen=True, slots=True)
class SegmentOptions:
    """Bounds on the faces and extent of streamable segments."""

    min_faces: int = 2000
    """Fewer faces only as a counted exception: below it, request and draw call cost more than the
    triangles. >= 1."""
    max_faces: int = 20000
    """Never more faces: bounds the payload, and the hitch of one upload on a headset. >=
    min_faces."""
    max_extent_m: float | None = None
    """Longest side of a segment's box, metres. None: 1.2 times the side of the square that
    ``max_faces`` faces of mean area fill. Larger gives fewer segments, smaller wastes less at the
    rim of a landing."""
    units: Literal["segments", "pools"] = "segments"
    """``"pools"``: each fine pool is its own segment, nothing merged or split (the thesis's literal
    behaviour)."""

    def __post_init__(self) -> None:
        """Refuse bounds that contradict each other before any work."""
        if not 1 <= self.min_faces <= self.max_faces:
            msg = f"min_faces is {self.min_faces}, expected 1..max_faces ({self.max_faces})"
            raise ValueError(msg)
        if self.max_extent_m is not None and not 0.0 < self.max_extent_m < np.inf:
            msg = f"max_extent_m is {self.max_extent_m}, expected a finite length above 0 or None"
            raise ValueError(msg)
        if self.units not in ("segments", "pools"):
            msg = f"units is {self.units!r}, expected 'segments' or 'pools'"
            raise ValueError(msg)


@dataclass(frozen=True, slots=True)
class SegmentExceptions:
    """How many segments depart from the bounds, and why faces lie where they do."""

    below_min_faces: int = 0
    """Segments with fewer than ``min_faces`` faces."""
    above_max_faces: int = 0
    """Segments with more than ``max_faces`` faces (only with ``units="pools"``)."""
    above_max_extent: int = 0
    """Segments wider than ``max_extent_m`` (single wide faces, or ``units="pools"``)."""
    across_regions: int = 0
    """Segments with faces of more than one region."""
    disconnected: int = 0
    """Segments that are not one edge-connected piece (they hold debris)."""
    debris_joined: int = 0
    """Pieces touching nothing that joined a segment or each other."""
    debris_alone: int = 0
    """Pieces touching nothing, below ``min_faces``, that are a segment of their own."""


@dataclass(frozen=True, slots=True, eq=False)
class Segments:
    """The segmentation into streamable pieces."""

    labels: Int32
    """(F,) segment of every face, 0..count-1 along the Morton curve."""
    count: int
    """Number of segments."""
    face_counts: Int32
    """(S,) faces of every segment."""
    bounds: Float32
    """(S, 6) least and greatest corner of every segment's box: min xyz, max xyz, metres, the
    vertices' frame."""
    main_region: Int32
    """(S,) region that most of the segment's faces have (tie: lowest number)."""
    region_counts: Int32
    """(S,) number of regions in every segment."""
    max_extent_m: float
    """The bound that was used."""
    exceptions: SegmentExceptions
    """Counted departures from the bounds."""


def build_segments(
    vertices: AnyFloat,
    faces: AnyInt,
    pools_fine: Int32,
    similarity: Float32,
    regions: Int32,
    options: SegmentOptions | None = None,
    *,
    pairs: tuple[Int32, Int32] | None = None,
    threads: int = 1,
) -> Segments:
    """Build streamable segments from fine pools and regions.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Metres, scene frame; finite.
    faces : ndarray of shape (F, 3), integer
        Vertex indices. F may be 0.
    pools_fine : ndarray of shape (F,), int32
        Fine pool of every face (Th = 0.2, sTh = 0).
    similarity : ndarray of shape (F,), float32
        Similarity index s of every face.
    regions : ndarray of shape (F,), int32
        Region of every face, >= 0.
    options : SegmentOptions, optional
        Bounds; None for the defaults.
    pairs : pair of ndarray of shape (P, 2), int32, optional
        Result of :func:`face_pairs` where the caller has it already.
    threads : int
        Threads at most; they change nothing but the time.

    Returns
    -------
    Segments
        Every face in exactly one segment; the same input gives the same bytes. Renumbering vertices
        and moving the mesh change nothing but rounding; turning it changes where units are cut,
        because boxes lie along the axes.

    Raises
    ------
    ValueError
        Arrays whose lengths differ, or negative regions.
    """
    # (1) Bounds and boxes of all faces.
    options = SegmentOptions() if options is None else options
    _validate_inputs(vertices, faces, pools_fine, similarity, regions)
    if len(faces) == 0:
        empty = np.zeros(0, np.int32)
        return Segments(
            empty, 0, empty, np.zeros((0, 6), np.float32), empty, empty,
            options.max_extent_m or 0.0, SegmentExceptions(),
        )  # fmt: skip
    low, high = face_boxes(vertices, faces, threads=threads)
    extent_m = options.max_extent_m or automatic_extent(
        vertices, faces, options.max_faces, threads=threads
    )
    if pairs is None:
        pairs = face_pairs(faces, len(vertices), threads=threads)
    # (2) Units: pools as they are, or merged, cut, repaired, and their debris gathered.
    neighbours, shared = pairs
    if options.units == "pools":
        labels, debris = dense_labels(pools_fine), DebrisCounts()
    else:
        mesh = _MeshFacts(
            neighbours, edge_steps(vertices, shared, threads=threads), similarity, regions, low,
            high, options.min_faces, options.max_faces, extent_m, threads,
        )  # fmt: skip
        state = _merge_pools(mesh, pools_fine)
        state = _cut_and_repair(mesh, state)
        labels, debris = join_debris(
            state.labels, state.units, np.diff(state.graph.offsets) > 0, low, high,
            min_faces=options.min_faces, max_faces=options.max_faces, max_extent_m=extent_m,
            threads=threads,
        )  # fmt: skip
    return _finish(labels, neighbours, regions, low, high, options, extent_m, debris)


@dataclass(frozen=True, slots=True, eq=False)
class _MeshFacts:
    """Per-face facts and bounds that every step reads and none changes."""

    pairs: Int32
    lengths: Int64
    similarity: Float32
    regions: Int32
    low: Float32
    high: Float32
    min_faces: int
    max_faces: int
    max_extent_m: float
    threads: int


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """Labels of the faces, and the graph and facts of their units, after some step."""

    labels: Int32
    graph: UnitGraph
    units: Units


def _validate_inputs(
    vertices: AnyFloat,
    faces: AnyInt,
    pools_fine: Int32,
    similarity: Float32,
    regions: Int32,
) -> None:
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        msg = f"vertices {vertices.shape} and faces {faces.shape}, expected (V, 3) and (F, 3)"
        raise ValueError(msg)
    for name, values in (
        ("pools_fine", pools_fine),
        ("similarity", similarity),
        ("regions", regions),
    ):
        if values.shape != (len(faces),):
            msg = f"{name} has shape {values.shape}, expected ({len(faces)},)"
            raise ValueError(msg)
    if len(faces) and (int(regions.min()) < 0 or int(pools_fine.min()) < 0):
        msg = f"least region {regions.min()}, least pool {pools_fine.min()}, expected 0 or more"
        raise ValueError(msg)
    if not np.isfinite(vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
        msg = f"vertex {bad} is {vertices[bad].tolist()}, expected finite coordinates"
        raise ValueError(msg)


def _measure(mesh: _MeshFacts, labels: Int32, count: int, region: Int32) -> Units:
    """Sum up the facts of units from those of their faces."""
    size, total = label_sums(labels, count, mesh.similarity)
    low, high = label_boxes(labels, size, mesh.low, mesh.high)
    return Units(size, total, region, low, high)


def _merged(state: _State, parent: Int32) -> _State:
    """State after unions; ``parent`` names each unit's union by its lowest unit."""
    roots, nodes = np.unique(parent, return_inverse=True)
    numbered: Int32 = nodes.astype(np.int32)
    return _State(
        np.take(numbered, state.labels),
        contract(state.graph, numbered, len(roots)),
        merge_units(state.units, numbered, len(roots)),
    )


def _moved(parent: Int32) -> bool:
    return bool((parent != np.arange(len(parent))).any())


def _merge_pools(mesh: _MeshFacts, pools: Int32) -> _State:
    """Merge fine pools: steps 1 and 2 of the module's list."""
    labels, count = components(len(pools), mesh.pairs, labels=pools, also=mesh.regions)
    region = mesh.regions[first_faces(labels, count)]
    graph = unit_graph(labels, count, mesh.pairs, mesh.lengths)
    state = _State(labels, graph, _measure(mesh, labels, count, region))
    for across in (False, True):
        while True:
            parent = join_small(state.graph, state.units, mesh.min_faces, across_regions=across)
            if not _moved(parent):
                break
            state = _merged(state, parent)
    return state


def _join_in_bounds(mesh: _MeshFacts, state: _State, *, across_regions: bool) -> _State:
    while True:
        parent = join_within_bounds(
            state.graph, state.units, mesh.min_faces, mesh.max_faces, mesh.max_extent_m,
            across_regions=across_regions,
        )  # fmt: skip
        if not _moved(parent):
            return state
        state = _merged(state, parent)


def _cut_and_repair(mesh: _MeshFacts, state: _State) -> _State:
    """Split large units and mend what that leaves: steps 3 and 4 of the module's list."""
    for attempt in range(_REPAIR_ROUNDS):
        pieces, _ = split_units(
            state.labels,
            len(state.units.size),
            mesh.low,
            mesh.high,
            mesh.max_faces,
            mesh.max_extent_m,
            threads=mesh.threads,
        )
        labels, count = components(len(pieces), mesh.pairs, labels=pieces)
        region = state.units.region[state.labels[first_faces(labels, count)]]
        graph = unit_graph(labels, count, mesh.pairs, mesh.lengths)
        state = _State(labels, graph, _measure(mesh, labels, count, region))
        state = _join_in_bounds(mesh, state, across_regions=False)
        if attempt + 1 < _REPAIR_ROUNDS:
            parent = join_small(state.graph, state.units, mesh.min_faces, across_regions=False)
            if not _moved(parent):
                break
            state = _merged(state, parent)
    return _join_in_bounds(mesh, state, across_regions=True)


def _finish(
    labels: Int32,
    pairs: Int32,
    regions: Int32,
    low: Float32,
    high: Float32,
    options: SegmentOptions,
    extent_m: float,
    debris: DebrisCounts,
) -> Segments:
    """Order the segments along a curve (step 6) and measure every one."""
    # (1) Number the segments along a Morton curve: neighbours in space are neighbours on disk.
    size = np.bincount(labels).astype(np.int64)
    count = len(size)
    least, most = label_boxes(labels, size, low, high)
    first = first_faces(labels, count)
    order = np.lexsort((first, morton_codes((least + most) * np.float32(0.5))))
    number = np.empty(count, np.int32)
    number[order] = np.arange(count, dtype=np.int32)
    labels = number[labels]
    size, least, most = size[order], least[order], most[order]
    # (2) Main region of each, and what breaks a bound all the same.
    main, region_counts = main_labels(labels, count, regions)
    pieces, n_pieces = components(len(labels), pairs, labels=labels)
    n_components = np.bincount(labels[first_faces(pieces, n_pieces)], minlength=count)
    exceptions = SegmentExceptions(
        below_min_faces=int(np.count_nonzero(size < options.min_faces)),
        above_max_faces=int(np.count_nonzero(size > options.max_faces)),
        above_max_extent=int(np.count_nonzero((most - least).max(axis=1) > extent_m)),
        across_regions=int(np.count_nonzero(region_counts > 1)),
        disconnected=int(np.count_nonzero(n_components > 1)),
        debris_joined=debris.joined,
        debris_alone=debris.alone,
    )
    return Segments(
        labels, count, size.astype(np.int32), np.concatenate([least, most], axis=1),
        main, region_counts, float(extent_m), exceptions,
    )  # fmt: skip
