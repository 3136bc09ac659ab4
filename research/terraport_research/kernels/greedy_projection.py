"""Greedy projection: each sample joined to its neighbours in its own tangent plane.

One sample after the other, along the front of what is there: its neighbours of like normal are laid
into its tangent plane and ordered around it. Those that a border edge hides are left out, and those
that are no neighbours in the plane's Delaunay triangulation. Of two that follow each other the
three make a face, unless it would be too wide, a third one at an edge, or lie over another.

A face is never changed again: that is what is greedy, and leaves holes where samples are uneven.

Memory: 250 bytes a sample.

PURE: no I/O, no clock.

References
----------
M. Gopi, S. Krishnan, "A fast and efficient projection based approach for surface reconstruction",
2000. Z. C. Marton, R. B. Rusu, M. Beetz, "On fast surface reconstruction methods for large and
noisy point clouds", ICRA 2009 (the distance by the nearest neighbour, the limits on angles).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numba
import numpy as np

from terraport_payload.types import Float32, Float64, Int32, Int64
from terraport_research.kernels.ball_kernels import PointGrid, agrees, grid_points, points_around

__all__ = ["project_greedily"]

_MOST_NEIGHBOURS: Final = 100
_LEAST_COSINE: Final = float(np.cos(np.radians(45.0)))
"""Of normals that belong to one surface."""
_WIDEST: Final = float(np.radians(120.0))
_NARROWEST: Final = float(np.radians(10.0))
"""Of a face's angle at the sample that it is made at."""
_PASSES: Final = 2
"""What is at the front when a sample's turn comes is not all; the second pass closes the rest."""


class _Surface(NamedTuple):
    """What has grown; rows beyond the counts are unused."""

    faces: Int32
    edges: Int64
    """Lower end, upper end, next edge at the lower end, next at the upper."""
    across: Int64
    """Third corner of the face on the left, seen from lower to upper, and on the right; -1."""
    heads: Int64
    """Each sample's first edge, -1 for none."""
    counts: Int64
    """(2,) faces and edges so far."""


def project_greedily(
    points: Float32, normals: Float32, radius_m: float, nearest_times: float
) -> Int32:
    """Triangulate a cloud.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float32
        Metres.
    normals : ndarray of shape (N, 3), float32
        Unit, out of the surface.
    radius_m : float
        No neighbour is farther. Positive.
    nearest_times : float
        Nor farther than this many times the nearest one. At least 1.

    Returns
    -------
    ndarray of shape (F, 3), int32
        Samples of each face, counter-clockwise seen from where the normals point. No edge has more
        than two faces. Equal input gives equal faces.

    Raises
    ------
    ValueError
        For a radius that is not positive.
    """
    if not radius_m > 0:
        raise ValueError(f"received a radius of {radius_m} m, expected a positive one")
    centred = np.ascontiguousarray(points, np.float64)
    if len(centred) == 0:
        return np.zeros((0, 3), np.int32)
    centred = centred - centred.mean(axis=0)
    sides = np.ascontiguousarray(normals, np.float64)
    room = 4 * len(centred) + 16
    surface = _Surface(
        np.empty((room, 3), np.int32),
        np.empty((3 * room, 4), np.int64),
        np.full((3 * room, 2), -1, np.int64),
        np.full(len(centred), -1, np.int64),
        np.zeros(2, np.int64),
    )
    grid = grid_points(centred, radius_m)
    for _ in range(_PASSES):
        _grow(centred, sides, radius_m, nearest_times, grid, surface)
    return surface.faces[: surface.counts[0]].copy()


@numba.njit(cache=True)
def _find_edge(surface: _Surface, a: int, b: int) -> int:  # pragma: no cover - compiled
    edge: int = surface.heads[a]
    while edge >= 0:
        lower = surface.edges[edge, 0]
        if lower == b or surface.edges[edge, 1] == b:
            return edge
        edge = surface.edges[edge, 2] if lower == a else surface.edges[edge, 3]
    return -1


@numba.njit(cache=True)
def _left_of(surface: _Surface, a: int, b: int) -> int:  # pragma: no cover - compiled
    """Third corner of the face on the left, seen from a to b; -1 where there is none."""
    edge = _find_edge(surface, a, b)
    if edge < 0:
        return -1
    third: int = surface.across[edge, 0 if a < b else 1]
    return third


@numba.njit(cache=True)
def _set_left(surface: _Surface, a: int, b: int, third: int) -> None:  # pragma: no cover - compiled
    edge = _find_edge(surface, a, b)
    if edge < 0:
        edge = surface.counts[1]
        surface.counts[1] += 1
        lower, upper = min(a, b), max(a, b)
        surface.edges[edge, 0], surface.edges[edge, 1] = lower, upper
        surface.edges[edge, 2], surface.edges[edge, 3] = surface.heads[lower], surface.heads[upper]
        surface.heads[lower] = edge
        surface.heads[upper] = edge
    surface.across[edge, 0 if a < b else 1] = third


@numba.njit(cache=True)
def _turn(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float
) -> float:  # pragma: no cover - compiled
    """Twice the area of a triangle, positive where it is counter-clockwise."""
    turn: float = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    return turn


@numba.njit(cache=True)
def _crosses(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float
) -> bool:  # pragma: no cover - compiled
    """Whether the segments ab and cd meet inside both."""
    first = _turn(ax, ay, bx, by, cx, cy) * _turn(ax, ay, bx, by, dx, dy)
    second = _turn(cx, cy, dx, dy, ax, ay) * _turn(cx, cy, dx, dy, bx, by)
    return first < 0.0 and second < 0.0


@numba.njit(cache=True)
def _grow(
    points: Float64,
    normals: Float64,
    radius: float,
    times: float,
    grid: PointGrid,
    surface: _Surface,
) -> None:  # pragma: no cover - compiled
    """Give every sample its turn: those at the front first, as they got there."""
    n = len(points)
    queue = np.empty(n, np.int64)
    queued = np.zeros(n, np.bool_)
    for seed in range(n):
        if queued[seed]:
            continue
        queue[0], first, last = seed, 0, 1
        queued[seed] = True
        while first < last:
            sample = queue[first]
            first += 1
            _join(points, normals, radius, times, grid, surface, sample)
            edge = surface.heads[sample]
            while edge >= 0:
                lower = surface.edges[edge, 0]
                other = surface.edges[edge, 1] if lower == sample else lower
                if not queued[other]:
                    queued[other] = True
                    queue[last] = other
                    last += 1
                edge = surface.edges[edge, 2] if lower == sample else surface.edges[edge, 3]


@numba.njit(cache=True)
def _join(
    points: Float64,
    normals: Float64,
    radius: float,
    times: float,
    grid: PointGrid,
    surface: _Surface,
    p: int,
) -> None:  # pragma: no cover - compiled
    """Make the faces around one sample that are still missing."""
    near = np.empty(4096, np.int64)
    count = points_around(points[p, 0], points[p, 1], points[p, 2], radius, points, grid, near)
    # (1) Neighbours of like normal, nearest first, no farther than `times` the nearest.
    away = np.empty(count)
    for slot in range(count):
        away[slot] = 0.0
        for axis in range(3):
            away[slot] += (points[near[slot], axis] - points[p, axis]) ** 2
    order = np.argsort(away, kind="mergesort")
    # axes of the tangent plane: right-handed with the normal
    nx, ny, nz = normals[p, 0], normals[p, 1], normals[p, 2]
    if abs(nx) < 0.6:
        ux, uy, uz = 0.0, nz, -ny
    else:
        ux, uy, uz = -nz, 0.0, nx
    size = np.sqrt(ux * ux + uy * uy + uz * uz)
    if size == 0.0:
        return
    ux, uy, uz = ux / size, uy / size, uz / size
    vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    who = np.empty(_MOST_NEIGHBOURS, np.int64)
    x, y = np.empty(_MOST_NEIGHBOURS), np.empty(_MOST_NEIGHBOURS)
    held, limit = 0, np.inf
    for slot in order:
        q = near[slot]
        if q == p or away[slot] == 0.0 or held == _MOST_NEIGHBOURS:
            continue
        is_linked = _find_edge(surface, p, q) >= 0
        cosine = nx * normals[q, 0] + ny * normals[q, 1] + nz * normals[q, 2]
        if not is_linked and (cosine < _LEAST_COSINE or away[slot] > limit):
            continue
        if limit == np.inf:
            limit = away[slot] * times * times
        dx, dy, dz = (
            points[q, 0] - points[p, 0], points[q, 1] - points[p, 1], points[q, 2] - points[p, 2],
        )  # fmt: skip
        who[held] = q
        x[held], y[held] = dx * ux + dy * uy + dz * uz, dx * vx + dy * vy + dz * vz
        held += 1
    if held < 2:
        return
    # (2) Ordered around the sample. Those that have an edge with it stay, whatever follows.
    angle = np.arctan2(y[:held], x[:held])
    around = np.argsort(angle, kind="mergesort")
    who, x, y, angle = who[:held][around], x[:held][around], y[:held][around], angle[around]
    linked = np.zeros(held, np.bool_)
    kept = np.ones(held, np.bool_)
    for i in range(held):
        linked[i] = _find_edge(surface, p, who[i]) >= 0
    # (3) Hidden ones go: inside a face that is there, behind an edge that has one face alone.
    for i in range(held):
        if not linked[i]:
            continue
        third = _left_of(surface, p, who[i])
        if third < 0:
            continue
        j = (i + 1) % held
        while j != i and who[j] != third:
            kept[j] = kept[j] and linked[j]
            j = (j + 1) % held
    for i in range(held):
        q = who[i]
        edge = surface.heads[q]
        while edge >= 0:
            lower, upper = surface.edges[edge, 0], surface.edges[edge, 1]
            other = upper if lower == q else lower
            alone = surface.across[edge, 0] < 0 or surface.across[edge, 1] < 0
            if alone and other != p and q < other:
                j = -1
                for k in range(held):
                    if who[k] == other:
                        j = k
                for k in range(held):
                    if j >= 0 and k not in (i, j) and not linked[k]:
                        hidden = _crosses(0.0, 0.0, x[k], y[k], x[i], y[i], x[j], y[j])
                        kept[k] = kept[k] and not hidden
            edge = surface.edges[edge, 2] if lower == q else surface.edges[edge, 3]
    # (4) Not Delaunay neighbours: the two angles over the edge to one sum to more than 180 degrees.
    changed = True
    while changed:
        changed = False
        for i in range(held):
            if not kept[i] or linked[i]:
                continue
            before, after = _next_kept(kept, i, -1), _next_kept(kept, i, 1)
            if before in (i, after):
                continue
            gap = (angle[after] - angle[before]) % (2 * np.pi)
            if gap >= np.pi:
                continue
            opposite = _corner(x, y, before, i) + _corner(x, y, after, i)
            if opposite > np.pi + 1e-9:
                kept[i] = False
                changed = True
    # (5) Faces of neighbours that follow each other.
    for i in range(held):
        if not kept[i]:
            continue
        j = _next_kept(kept, i, 1)
        gap = (angle[j] - angle[i]) % (2 * np.pi)
        if j == i or not _NARROWEST <= gap <= _WIDEST:
            continue
        a, b = who[i], who[j]
        if (
            _left_of(surface, p, a) >= 0
            or _left_of(surface, a, b) >= 0
            or _left_of(surface, b, p) >= 0
            or not agrees(points, normals, p, a, b)
            or surface.counts[0] >= len(surface.faces)
        ):
            continue
        if _is_over(surface, who, x, y, i, j):
            continue
        face = surface.counts[0]
        surface.counts[0] += 1
        surface.faces[face, 0], surface.faces[face, 1], surface.faces[face, 2] = p, a, b
        _set_left(surface, p, a, b)
        _set_left(surface, a, b, p)
        _set_left(surface, b, p, a)


@numba.njit(cache=True)
def _next_kept(kept: np.ndarray, i: int, step: int) -> int:  # pragma: no cover - compiled
    j = (i + step) % len(kept)
    while j != i and not kept[j]:
        j = (j + step) % len(kept)
    return j


@numba.njit(cache=True)
def _corner(x: Float64, y: Float64, at: int, to: int) -> float:  # pragma: no cover - compiled
    """Angle at a neighbour between the way to the sample (0, 0) and to another neighbour."""
    ax, ay, bx, by = -x[at], -y[at], x[to] - x[at], y[to] - y[at]
    angle: float = np.arctan2(abs(ax * by - ay * bx), ax * bx + ay * by)
    return angle


@numba.njit(cache=True)
def _is_over(
    surface: _Surface, who: Int64, x: Float64, y: Float64, i: int, j: int
) -> bool:  # pragma: no cover - compiled
    """Whether the far edge of a new face crosses an edge between neighbours."""
    for k in range(len(who)):
        edge = surface.heads[who[k]]
        while edge >= 0:
            lower, upper = surface.edges[edge, 0], surface.edges[edge, 1]
            other = upper if lower == who[k] else lower
            if who[k] < other:
                for m in range(len(who)):
                    if (
                        who[m] == other
                        and k not in (i, j)
                        and m not in (i, j)
                        and _crosses(x[i], y[i], x[j], y[j], x[k], y[k], x[m], y[m])
                    ):
                        return True
            edge = surface.edges[edge, 2] if lower == who[k] else surface.edges[edge, 3]
    return False
