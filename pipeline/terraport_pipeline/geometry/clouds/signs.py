"""Which way normals face, for a surface that is terrain but may overhang.

1. A point is *certain* when its normal is not steep and nothing stands above it that its own
   tangent plane does not explain: then it faces up. Steep points, undersides of overhangs and the
   ground beneath them are not certain.
2. A steep point on a free face *leans* to the side where the ground falls away: that counts as much
   as a few neighbours do.
3. Signs spread from the certain points over the neighbour graph. Every point with a sign gives each
   neighbour a vote, the stronger the more parallel the normals are and the more the link lies in
   both tangent planes; the point whose votes agree best comes next. So a sign walks round a lip
   with many samples and does not jump from an underside to the ground below it by one link.
4. Points that nothing reaches face up.

Spreading follows Hoppe, DeRose, Duchamp, McDonald and Stuetzle, "Surface reconstruction from
unorganized points", SIGGRAPH 1992, with the in-plane term of König and Gumhold, "Consistent
propagation of normal orientations in point clouds", VMV 2009. Departures: many seeds instead of
one; and all links from settled points count, as in the sum that Schertler, Savchynskyy and
Gumhold, "Towards globally optimal normal orientations for large point clouds", CGF 2017, minimise,
where a spanning tree takes the cheapest alone. One wrong link over the sharp edge at the back of a
notch turned whole faces inside out in one tile and not in the next: of the samples of a highwall
with overhangs 10,817 of 1.5 M were turned by the tree, 950 are by votes and leanings.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from terraport_payload.types import Bool, Float32, Float64, Int32, Int64

__all__ = ["SkySigns", "sky_signs", "spread_signs"]

_Heap = list[tuple[np.float32, np.int32]]

_CELL_SPACINGS = 1.5
"""Side of the columns in which :func:`sky_signs` looks up, in areal spacings.

Three by three of them are looked at: about twenty samples, so that a gap between the samples of a
roof does not open the sky to what lies below it.
"""

_ROOF_SPACINGS = 2.0
"""A point is under a roof when something stands this far above its tangent plane."""

_STEEPEST = 0.5
"""Least vertical component of a normal that is not steep: a slope of 60 degrees."""

_FRONT_CELLS = (1.0, 2.0, 3.0, 4.0, 6.0)
"""Where in front of a free face nothing may stand higher than the point, in columns.

Fewer take the wall under a brow for a free face: with 2 alone 2,668 of 218,605 leanings were wrong
in the survey of the module's text, with these 4 of 156,850.
"""

_BEHIND_CELLS = (1.0, 2.0, 3.0)
"""Where behind a free face nothing may lie lower than the point."""

_FALL_CELLS = 4.0
"""What lies farthest in front is this much lower than what lies farthest behind, in columns."""

_LEANING_VOTES = 2.0
"""What a leaning counts, in votes of neighbours with parallel normals.

Measured .5, 2, 8, 100: with .5 notches stay turned that 2 mends, and from 8 on wrong leanings win
where their neighbours know better.
"""


@dataclass(frozen=True, slots=True)
class SkySigns:
    """What is seen from above says about the signs of upward normals."""

    certain: Bool
    """(N,) points that face up for certain."""
    leaning: Float32
    """(N,) votes for facing up (positive) or down; 0 where the sky says nothing."""


def sky_signs(
    points: Float32,
    normals: Float32,
    *,
    spacing_m: float,
    grid_origin_m: tuple[float, float] | None = None,
    above: Float32 | None = None,
) -> SkySigns:
    """Judge signs by what can be seen from above.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float32
        Metres, scene frame (Y up).
    normals : ndarray of shape (N, 3), float32
        Unit, none facing down.
    spacing_m : float
        Areal spacing.
    grid_origin_m : (x, z), optional
        A corner of the columns that are looked up in; the points' lowest x and z by default.
        Overlapping parts of one cloud decide alike when they give the same corner.
    above : ndarray of shape (R, 3), float32, optional
        Places of what else hides the sky, of a part of a cloud: the rest of it above this part.
    """
    if above is None:
        above = np.zeros((0, 3), dtype=np.float32)
    columns = _Columns.over(points, above, _CELL_SPACINGS * spacing_m, grid_origin_m)
    tolerance_m = _ROOF_SPACINGS * spacing_m
    steep = normals[:, 1] < _STEEPEST
    certain = _open_to_sky(points, normals, columns, tolerance_m) & ~steep
    leaning = np.zeros(len(points), dtype=np.float32)
    leaning[steep] = _LEANING_VOTES * _downhill(points[steep], normals[steep], columns, tolerance_m)
    return SkySigns(certain, leaning)


def spread_signs(points: Float32, normals: Float32, sky: SkySigns, graph: Int32) -> Bool:
    """Spread signs from the certain points; turns `normals` in place.

    Parameters
    ----------
    points, normals : ndarray of shape (N, 3), float32
    sky : SkySigns
    graph : ndarray of shape (N, k), int32
        Neighbours of every point.

    Returns
    -------
    ndarray of shape (N,), bool
        Points that have a sign.
    """
    starts, links = _reverse_graph(graph)
    return _spread(points, normals, sky.certain, sky.leaning, graph, starts, links)


@dataclass(frozen=True, slots=True)
class _Columns:
    """A cloud as seen from above: the highest place of every column that has one."""

    cells: Int64
    """Keys of occupied columns, ascending."""
    column: Int64
    """Per point of the cloud, the row of its column in `cells`."""
    roof_m: Float32
    """(C, 3) highest place of every column."""
    width: int
    corner_m: Float64
    cell_m: float

    @classmethod
    def over(
        cls, points: Float32, above: Float32, cell_m: float, corner_m: tuple[float, float] | None
    ) -> _Columns:
        if corner_m is None:
            x, z = points[:, ::2].min(axis=0).astype(np.float64)
            corner_m = float(x), float(z)
        places = np.concatenate([points, above])
        index = np.floor((places[:, ::2] - np.array(corner_m)) / cell_m).astype(np.int64)
        low = index.min(axis=0) - 1
        index -= low
        # One empty column on each side: steps to neighbours stay in the row.
        width = int(index[:, 0].max()) + 2
        cells, column = np.unique(index[:, 1] * width + index[:, 0], return_inverse=True)
        roof = _highest_of_cell(places[:, 1], column, len(cells))
        corner = np.array(corner_m) + low * cell_m
        return cls(cells, column[: len(points)], places[roof], width, corner, cell_m)

    def heights(self, places_m: Float64) -> Float32:
        """Highest point over each place (P, 2), x and z; NaN where there is none."""
        index = np.floor((places_m - self.corner_m) / self.cell_m).astype(np.int64)
        inside = (index[:, 0] >= 0) & (index[:, 0] < self.width)
        key = index[:, 1] * self.width + index[:, 0]
        rows = np.minimum(np.searchsorted(self.cells, key), len(self.cells) - 1)
        occupied = inside & (self.cells[rows] == key)
        return np.where(occupied, self.roof_m[rows, 1], np.float32(np.nan))


def _open_to_sky(points: Float32, normals: Float32, columns: _Columns, tolerance_m: float) -> Bool:
    """Mark points over whose tangent plane nothing stands, in three by three columns, (N,)."""
    # Rise of the tangent plane per metre along x and z.
    rise = -normals[:, ::2] / np.maximum(normals[:, 1], 1e-3)[:, None]
    is_open: Bool = np.ones(len(points), dtype=np.bool_)
    cells, width = columns.cells, columns.width
    for step in (-width - 1, -width, -width + 1, -1, 0, 1, width - 1, width, width + 1):
        index = np.minimum(np.searchsorted(cells, cells + step), len(cells) - 1)
        occupied = (cells[index] == cells + step)[columns.column]
        offset = columns.roof_m[index][columns.column] - points
        above = offset[:, 1] - (offset[:, ::2] * rise).sum(axis=1)
        is_open &= ~occupied | (above <= tolerance_m)
    return is_open


def _downhill(points: Float32, normals: Float32, columns: _Columns, tolerance_m: float) -> Float32:
    """Which way the ground falls away from steep points: 1 along the normal, -1 against it, 0.

    A free face, also one that leans out, has nothing higher in front and nothing lower behind, as
    seen from above. Under a brow, in a cleft, on a thin wall, and where samples are missing,
    neither side does.
    """
    step = normals[:, ::2].astype(np.float64)
    step *= columns.cell_m / np.linalg.norm(step, axis=1, keepdims=True)

    def falls(side: float) -> Bool:
        # A place without samples is NaN and compares as neither.
        free: Bool = np.ones(len(points), dtype=np.bool_)
        for cells in _FRONT_CELLS:
            front = columns.heights(points[:, ::2] + side * cells * step)
            free &= front - points[:, 1] <= tolerance_m
        for cells in _BEHIND_CELLS:
            behind = columns.heights(points[:, ::2] - side * cells * step)
            free &= behind - points[:, 1] >= -tolerance_m
        return free & (behind - front > _FALL_CELLS * columns.cell_m)

    return falls(1.0).astype(np.float32) - falls(-1.0)


def _highest_of_cell(height_m: Float32, cell: Int64, count: int) -> Int64:
    """Find the highest point of every cell; the last in order where several are equal."""
    order = np.lexsort((height_m, cell))
    last = np.searchsorted(cell[order], np.arange(count), side="right") - 1
    return order[last]


@numba.njit(cache=True)
def _reverse_graph(graph: Int32) -> tuple[Int64, Int32]:  # pragma: no cover
    """Who has me as neighbour, as CSR: signs must spread against the direction of kNN edges too."""
    count, k = graph.shape
    starts = np.zeros(count + 1, dtype=np.int64)
    for point in range(count):
        for rank in range(k):
            starts[graph[point, rank] + 1] += 1
    for point in range(count):
        starts[point + 1] += starts[point]
    fill = starts[:-1].copy()
    links = np.empty(count * k, dtype=np.int32)
    for point in range(count):
        for rank in range(k):
            other = graph[point, rank]
            links[fill[other]] = point
            fill[other] += 1
    return starts, links


@numba.njit(cache=True)
def _spread(
    points: Float32,
    normals: Float32,
    certain: Bool,
    leaning: Float32,
    graph: Int32,
    starts: Int64,
    links: Int32,
) -> Bool:  # pragma: no cover - compiled
    """Best-agreed first; turns `normals` in place and returns which points have a sign."""
    count = len(points)
    settled = certain.copy()
    votes = leaning.copy()
    heap = [(np.float32(0.0), np.int32(-1))]
    heap.pop()
    # (1) Points whose sign is certain begin; one entry for all their votes keeps the heap small.
    for point in range(count):
        if certain[point]:
            _vote(point, points, normals, settled, graph, starts, links, votes, heap, False)
    for point in range(count):
        if not certain[point] and votes[point] != 0.0:
            _push(heap, -abs(votes[point]), np.int32(point))
    # (2) The point whose votes agree best comes next, of equal ones the lower. Invariant: settled
    # points have their final sign; `votes[p]` is the sum over p's settled neighbours, and entries
    # of another sum are stale.
    while len(heap) > 0:
        sum_, nearest = _pop(heap)
        # To numba, int() leaves 32 bits as they are, and a second _vote would be compiled.
        point = int(nearest) + 0
        if settled[point] or -sum_ != abs(votes[point]):
            continue
        if votes[point] < 0.0:
            for axis in range(3):
                normals[point, axis] = -normals[point, axis]
        settled[point] = True
        _vote(point, points, normals, settled, graph, starts, links, votes, heap, True)
    return settled


@numba.njit(cache=True)
def _vote(
    point: int,
    points: Float32,
    normals: Float32,
    settled: Bool,
    graph: Int32,
    starts: Int64,
    links: Int32,
    votes: Float32,
    heap: _Heap,
    queued: bool,
) -> None:  # pragma: no cover - compiled
    """Give every neighbour that lacks a sign a settled point's vote.

    Parameters
    ----------
    point : int
        Settled.
    points, normals : ndarray of shape (N, 3), float32
    settled : ndarray of shape (N,), bool
    graph : ndarray of shape (N, k), int32
        Neighbours of every point.
    starts, links : ndarray of shape (N + 1,), (N k,)
        The reverse graph as CSR: points that have a point as neighbour.
    votes : ndarray of shape (N,)
        For every point's normal as it is (positive) or turned; written.
    heap : list
        Points by the size of their votes; written.
    queued : bool
        Whether the neighbours enter the heap.
    """
    # (1) Neighbours of the point, and the points it is a neighbour of: the graph is used both
    # ways.
    k = graph.shape[1]
    incoming = starts[point + 1] - starts[point]
    for link in range(k + incoming):
        other = graph[point, link] if link < k else links[starts[point] + link - k]
        if settled[other]:
            continue
        # (2) Weight of the vote: less for normals that differ, and for a step that leaves either's
        # plane.
        dot = 0.0
        along = 0.0
        across = 0.0
        length = 0.0
        for axis in range(3):
            step = points[other, axis] - points[point, axis]
            dot += normals[point, axis] * normals[other, axis]
            along += step * normals[point, axis]
            across += step * normals[other, axis]
            length += step * step
        lift = 0.5 * (abs(along) + abs(across)) / np.sqrt(length) if length > 0.0 else 0.0
        weight = np.float32(max(0.0, abs(dot) - lift))
        # (3) An entry that was bettered stays in the heap and is passed over when it comes up.
        votes[other] += weight if dot > 0.0 else -weight
        if queued:
            _push(heap, -abs(votes[other]), np.int32(other))


@numba.njit(cache=True)
def _push(heap: _Heap, cost: np.float32, point: np.int32) -> None:  # pragma: no cover - compiled
    """Binary heap ordered by (cost, point), so that ties have one order."""
    heap.append((cost, point))
    child = len(heap) - 1
    while child > 0:
        up = (child - 1) >> 1
        if heap[up] <= heap[child]:
            break
        heap[up], heap[child] = heap[child], heap[up]
        child = up


@numba.njit(cache=True)
def _pop(heap: _Heap) -> tuple[np.float32, np.int32]:  # pragma: no cover - compiled
    """Remove the entry of least cost and return it; the heap must not be empty."""
    first = heap[0]
    last = heap.pop()
    size = len(heap)
    if size == 0:
        return first
    heap[0] = last
    node = 0
    # Invariant: every entry is at most its children but for `node`, which sinks.
    while True:
        child = 2 * node + 1
        if child >= size:
            break
        if child + 1 < size and heap[child + 1] < heap[child]:
            child += 1
        if heap[node] <= heap[child]:
            break
        heap[node], heap[child] = heap[child], heap[node]
        node = child
    return first
