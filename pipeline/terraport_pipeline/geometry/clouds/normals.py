"""Normals of a cloud, consistently oriented out of the ground.

Direction: principal component analysis of each point's k nearest neighbours (the eigenvector of
the smallest eigenvalue).

Sign, for a surface that is terrain but may overhang:

1. A point is *certain* when its normal is not steep and nothing stands above it that its own
tangent plane does not
   explain: then it faces up. Undersides of overhangs and the ground beneath them are not certain.
2. The signs spread from the certain points best-first over the neighbour graph. The cost of an
edge is small where the
   two normals are parallel and the edge lies in both tangent planes, so the sign walks round a lip
   and does not jump from an underside to the ground below it.
3. Points that nothing reaches face up.

The spreading follows Hoppe, DeRose, Duchamp, McDonald and Stuetzle, "Surface reconstruction from
unorganized points", SIGGRAPH 1992, with the in-plane term of König and Gumhold, "Consistent
propagation of normal orientations in point clouds", VMV 2009, and many seeds instead of one.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numba
import numpy as np

from terraport_payload.types import Bool, Float32, Int32, Int64
from terraport_pipeline.geometry.clouds.spacing import Neighbours
from terraport_pipeline.geometry.mesh.chunks import in_chunks

__all__ = ["certain_mask", "estimate_normals", "orient_normals"]

_Heap = list[tuple[np.float32, np.int32]]

_SWEEPS = 12
"""Jacobi sweeps at most; three by three matrices converge to float64 in five or six."""

_CELL_SPACINGS = 1.5
"""Side of the columns in which :func:`certain_mask` looks up, in areal spacings.

Three by three of them are looked at: about twenty samples, so that a gap between the samples of a
roof does not open the sky to what lies below it.
"""


_CHUNK = 2**14
"""Points that a thread fits planes to at once: some 30 ms."""

_ROOF_SPACINGS = 2.0
"""A point is under a roof when something stands this far above its tangent plane."""


def estimate_normals(
    points: Float32, neighbours: Neighbours, *, k: int = 16, threads: int = 1
) -> tuple[Float32, Float32]:
    """Estimate the tangent plane at every point.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float32
        Metres.
    neighbours : Neighbours
        Of all points; the first `k` of each are used, with the point itself.
    k : int
    threads : int

    Returns
    -------
    normals : ndarray of shape (N, 3), float32
        Unit, sign arbitrary.
    curvature : ndarray of shape (N,), float32
        Smallest eigenvalue over the sum of the three, 0 (plane) to 1/3 (no surface at all).
    """
    k = min(k, neighbours.indices.shape[1])
    normals = np.empty((len(points), 3), dtype=np.float32)
    curvature = np.empty(len(points), dtype=np.float32)
    indices = np.ascontiguousarray(neighbours.indices[:, :k])
    in_chunks(
        lambda begin, end: _fit_planes(points, indices, normals, curvature, begin, end),
        len(points),
        threads=threads,
        chunk=_CHUNK,
    )
    return normals, curvature


def certain_mask(
    points: Float32,
    normals: Float32,
    *,
    spacing_m: float,
    steepest: float = 0.5,
    grid_origin_m: tuple[float, float] | None = None,
) -> Bool:
    """Mark the points that must face up: not steep, and open to the sky.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float32
        Metres, scene frame (Y up).
    normals : ndarray of shape (N, 3), float32
        Unit, sign ignored.
    spacing_m : float
        Areal spacing.
    steepest : float
        Smallest vertical component of a certain normal (0.5 is a slope of 60 degrees).
    grid_origin_m : (x, z), optional
        A corner of the columns that are looked up in; the points' lowest x and z by default.
        Overlapping parts of one cloud decide alike when they give the same corner.

    Returns
    -------
    ndarray of shape (N,), bool
    """
    cell_m = _CELL_SPACINGS * spacing_m
    if grid_origin_m is None:
        column = ((points[:, ::2] - points.min(axis=0)[::2]) / cell_m).astype(np.int64) + 1
    else:
        column = np.floor((points[:, ::2] - np.array(grid_origin_m)) / cell_m).astype(np.int64)
        column -= column.min(axis=0) - 1
    width = int(column[:, 0].max()) + 2
    key = column[:, 1] * width + column[:, 0]
    cells, cell = np.unique(key, return_inverse=True)
    roof = _highest_of_cell(points[:, 1], cell, len(cells))
    upright = np.abs(normals[:, 1])
    certain: Bool = upright >= steepest
    # Rise of the tangent plane per metre along x and z.
    rise = -normals[:, ::2] / np.where(upright > 1e-3, normals[:, 1], 1e-3)[:, None]
    tolerance_m = _ROOF_SPACINGS * spacing_m
    for step in (-width - 1, -width, -width + 1, -1, 0, 1, width - 1, width, width + 1):
        index = np.minimum(np.searchsorted(cells, cells + step), len(cells) - 1)
        there = (cells[index] == cells + step)[cell]
        offset = points[roof[index]][cell] - points
        above = offset[:, 1] - (offset[:, ::2] * rise).sum(axis=1)
        certain &= ~there | (above <= tolerance_m)
    return certain


def orient_normals(
    points: Float32,
    normals: Float32,
    neighbours: Neighbours,
    *,
    spacing_m: float,
    k: int = 10,
    grid_origin_m: tuple[float, float] | None = None,
) -> tuple[Float32, int, int]:
    """Turn normals out of the ground; see the module's text for the rule.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float32
        Metres, scene frame (Y up).
    normals : ndarray of shape (N, 3), float32
        Unit, sign arbitrary; not modified.
    neighbours : Neighbours
        Of all points; signs spread over the first `k`.
    spacing_m : float
        Areal spacing.
    k : int
    grid_origin_m : (x, z), optional
        See :func:`certain_mask`.

    Returns
    -------
    normals : ndarray of shape (N, 3), float32
    spread : int
        Points that got their sign from a neighbour.
    guessed : int
        Points that nothing reached; they face up.
    """
    k = min(k, neighbours.indices.shape[1])
    certain = certain_mask(points, normals, spacing_m=spacing_m, grid_origin_m=grid_origin_m)
    oriented = np.where((normals[:, 1] < 0)[:, None], -normals, normals)
    graph = np.ascontiguousarray(neighbours.indices[:, :k])
    starts, links = _reverse_graph(graph)
    reached = _spread_signs(points, oriented, certain, graph, starts, links)
    guessed = int((~reached).sum())
    return oriented, int(len(points) - certain.sum() - guessed), guessed


def _highest_of_cell(height_m: Float32, cell: Int64, count: int) -> Int64:
    """Find the highest point of every cell; the last in order where several are equal."""
    order = np.lexsort((height_m, cell))
    last = np.searchsorted(cell[order], np.arange(count), side="right") - 1
    return order[last]


@numba.njit(cache=True, nogil=True)
def _fit_planes(
    points: Float32, indices: Int32, normals: Float32, curvature: Float32, begin: int, end: int
) -> None:  # pragma: no cover - compiled
    """Covariance of each neighbourhood and its smallest eigenvector by Jacobi rotations."""
    k = indices.shape[1]
    mean, offset = np.empty(3), np.empty(3)
    matrix, vectors = np.empty((3, 3)), np.empty((3, 3))
    for point in range(begin, end):
        # (1) Covariance, up to a factor.
        # Offsets from the point itself: it adds nothing to the sums, only to the count.
        mean[:] = 0.0
        matrix[:] = 0.0
        for rank in range(k):
            for axis in range(3):
                offset[axis] = points[indices[point, rank], axis] - points[point, axis]
                mean[axis] += offset[axis] / (k + 1)
            for row in range(3):
                for col in range(row, 3):
                    matrix[row, col] += offset[row] * offset[col]
        for row in range(3):
            for col in range(row, 3):
                matrix[row, col] -= (k + 1) * mean[row] * mean[col]
        matrix[1, 0], matrix[2, 0], matrix[2, 1] = matrix[0, 1], matrix[0, 2], matrix[1, 2]
        # (2) Jacobi rotations until nothing is left beside the diagonal. Invariant: vectors *
        # matrix * vectors^T is the covariance, and the columns of `vectors` are orthonormal.
        for row in range(3):
            for col in range(3):
                vectors[row, col] = 1.0 if row == col else 0.0
        for _ in range(_SWEEPS):
            off = matrix[0, 1] ** 2 + matrix[0, 2] ** 2 + matrix[1, 2] ** 2
            scale = matrix[0, 0] ** 2 + matrix[1, 1] ** 2 + matrix[2, 2] ** 2
            if off <= 1e-28 * scale or scale == 0.0:
                break
            for p in range(2):
                for q in range(p + 1, 3):
                    if matrix[p, q] == 0.0:
                        continue
                    theta = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
                    t = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
                    if theta < 0.0:
                        t = -t
                    c = 1.0 / np.sqrt(t * t + 1.0)
                    s = t * c
                    for row in range(3):
                        left, right = matrix[row, p], matrix[row, q]
                        matrix[row, p], matrix[row, q] = c * left - s * right, s * left + c * right
                    for col in range(3):
                        left, right = matrix[p, col], matrix[q, col]
                        matrix[p, col], matrix[q, col] = c * left - s * right, s * left + c * right
                    for row in range(3):
                        left, right = vectors[row, p], vectors[row, q]
                        vectors[row, p], vectors[row, q] = (
                            c * left - s * right,
                            s * left + c * right,
                        )
        # (3) The normal is the vector of the smallest eigenvalue; its share of the sum is the
        # curvature.
        small = 0
        for axis in range(1, 3):
            if matrix[axis, axis] < matrix[small, small]:
                small = axis
        length = np.sqrt(vectors[0, small] ** 2 + vectors[1, small] ** 2 + vectors[2, small] ** 2)
        for axis in range(3):
            normals[point, axis] = vectors[axis, small] / length
        total = matrix[0, 0] + matrix[1, 1] + matrix[2, 2]
        curvature[point] = max(matrix[small, small], 0.0) / total if total > 0.0 else 0.0


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
def _spread_signs(
    points: Float32,
    normals: Float32,
    certain: Bool,
    graph: Int32,
    starts: Int64,
    links: Int32,
) -> Bool:  # pragma: no cover - compiled
    """Best-first spreading; turns `normals` in place and returns which points have a sign."""
    count = len(points)
    settled = certain.copy()
    best = np.full(count, np.inf, dtype=np.float32)
    parent = np.full(count, -1, dtype=np.int32)
    heap = [(np.float32(0.0), np.int32(-1))]
    heap.pop()
    # (1) Points whose sign is certain begin.
    for point in range(count):
        if certain[point]:
            _offer(point, points, normals, settled, graph, starts, links, best, parent, heap)
    # (2) The cheapest link first, as in Prim's minimum spanning tree. Invariant: settled points
    # have their final sign; `best[p]` is the cheapest link from a settled point to p, and entries
    # of another cost are stale.
    while len(heap) > 0:
        cost, nearest = _pop(heap)
        # To numba, int() leaves 32 bits as they are, and a second _offer would be compiled.
        point = int(nearest) + 0
        if settled[point] or cost != best[point]:
            continue
        dot = 0.0
        for axis in range(3):
            dot += normals[point, axis] * normals[parent[point], axis]
        if dot < 0.0:
            for axis in range(3):
                normals[point, axis] = -normals[point, axis]
        settled[point] = True
        _offer(point, points, normals, settled, graph, starts, links, best, parent, heap)
    return settled


@numba.njit(cache=True)
def _offer(
    point: int,
    points: Float32,
    normals: Float32,
    settled: Bool,
    graph: Int32,
    starts: Int64,
    links: Int32,
    best: Float32,
    parent: Int32,
    heap: _Heap,
) -> None:  # pragma: no cover - compiled
    """Offer a settled point's sign to the neighbours that still lack one.

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
    best, parent : ndarray of shape (N,)
        Cheapest link to every point so far, and where it comes from; written.
    heap : list
        Links by cost; written.
    """
    # (1) Neighbours of the point, and the points it is a neighbour of: the graph is used both
    # ways.
    k = graph.shape[1]
    incoming = starts[point + 1] - starts[point]
    for link in range(k + incoming):
        other = graph[point, link] if link < k else links[starts[point] + link - k]
        if settled[other]:
            continue
        # (2) Cost of the link: normals that differ, and a step that leaves either's plane.
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
        cost = np.float32(1.0 - abs(dot) + lift)
        # (3) The cheapest link counts, of equal ones the lower point. An offer that was bettered
        # stays in the heap and is passed over when it comes up.
        if cost < best[other] or (cost == best[other] and point < parent[other]):
            best[other] = cost
            parent[other] = point
            _push(heap, cost, np.int32(other))


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
