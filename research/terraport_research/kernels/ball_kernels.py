"""Kernels of :mod:`~terraport_research.kernels.ball_pivoting`: samples and balls.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numba
import numpy as np

from terraport_payload.types import Float64, Int64

__all__ = ["PointGrid", "agrees", "grid_points", "is_empty", "points_around", "rest_ball"]


_TOUCH: Final = 1e-6
"""Share of the squared radius within which a sample counts as on the ball, not in it."""


class PointGrid(NamedTuple):
    """Points sorted by the cells of a regular grid: those of a cell are one run of `order`."""

    cells: Int64
    """Keys of the cells that hold any, ascending."""
    starts: Int64
    """Where each one's points begin in `order`."""
    order: Int64
    shape: Int64
    """Cells along each axis."""
    low: Float64
    """The first cell's corner."""


def grid_points(points: Float64, cell_m: float) -> PointGrid:
    """Sort points into the cells of a grid over their bounding box."""
    low = points.min(axis=0, initial=np.inf) - cell_m
    cell = ((points - low) / cell_m).astype(np.int64)
    shape = cell.max(axis=0, initial=0) + 2
    key = (cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2]
    order = np.argsort(key, kind="stable").astype(np.int64)
    cells, starts = np.unique(key[order], return_index=True)
    return PointGrid(cells, np.append(starts, len(points)).astype(np.int64), order, shape, low)


@numba.njit(cache=True)
def points_around(
    x: float, y: float, z: float, reach: float, points: Float64, grid: PointGrid, out: Int64
) -> int:  # pragma: no cover - compiled
    """Collect the points within `reach` (at most a cell) of a place; returns how many."""
    # Cells are as wide as `reach`, so all points within it lie in the 27 cells around the place.
    cx, cy, cz = (
        int((x - grid.low[0]) / reach),
        int((y - grid.low[1]) / reach),
        int((z - grid.low[2]) / reach),
    )
    count = 0
    for ix in range(max(cx - 1, 0), min(cx + 2, grid.shape[0])):
        for iy in range(max(cy - 1, 0), min(cy + 2, grid.shape[1])):
            # Cells along z have consecutive keys: three of them are one search and one run.
            first = (ix * grid.shape[1] + iy) * grid.shape[2] + max(cz - 1, 0)
            last = (ix * grid.shape[1] + iy) * grid.shape[2] + min(cz + 1, grid.shape[2] - 1)
            slot = np.searchsorted(grid.cells, first)
            while slot < len(grid.cells) and grid.cells[slot] <= last:
                for row in range(grid.starts[slot], grid.starts[slot + 1]):
                    point = grid.order[row]
                    dx, dy, dz = (
                        points[point, 0] - x, points[point, 1] - y, points[point, 2] - z,
                    )  # fmt: skip
                    if dx * dx + dy * dy + dz * dz <= reach * reach and count < len(out):
                        out[count] = point
                        count += 1
                slot += 1
    return count


@numba.njit(cache=True, inline="always")
def _sides(
    points: Float64, a: int, b: int, c: int
) -> tuple[float, float, float, float, float, float]:  # pragma: no cover - compiled
    """Edge vectors from a to b and from a to c, as six scalars."""
    return (
        points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2],
        points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2],
    )  # fmt: skip


@numba.njit(cache=True)
def rest_ball(
    points: Float64, a: int, b: int, c: int, radius: float, centre: Float64
) -> bool:  # pragma: no cover - compiled
    """Centre of the ball that rests on a, b, c, on the side that sees them counter-clockwise."""
    ux, uy, uz, vx, vy, vz = _sides(points, a, b, c)
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    squared = nx * nx + ny * ny + nz * nz
    uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    if squared <= 1e-12 * uu * vv:
        return False
    # Circumcentre about a: (|u|^2 (v x n) ... ) / 2 n^2.
    ox = (uu * (vy * nz - vz * ny) + vv * (ny * uz - nz * uy)) / (2 * squared)
    oy = (uu * (vz * nx - vx * nz) + vv * (nz * ux - nx * uz)) / (2 * squared)
    oz = (uu * (vx * ny - vy * nx) + vv * (nx * uy - ny * ux)) / (2 * squared)
    rise = radius * radius - (ox * ox + oy * oy + oz * oz)
    if rise < 0.0:
        return False
    lift = np.sqrt(rise / squared)
    centre[0] = points[a, 0] + ox + lift * nx
    centre[1] = points[a, 1] + oy + lift * ny
    centre[2] = points[a, 2] + oz + lift * nz
    return True


@numba.njit(cache=True)
def agrees(
    points: Float64, normals: Float64, a: int, b: int, c: int
) -> bool:  # pragma: no cover - compiled
    """Whether the face's normal is on the side of all three samples' normals."""
    ux, uy, uz, vx, vy, vz = _sides(points, a, b, c)
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    for corner in (a, b, c):
        if nx * normals[corner, 0] + ny * normals[corner, 1] + nz * normals[corner, 2] <= 0.0:
            return False
    return True


@numba.njit(cache=True)
def is_empty(
    points: Float64,
    centre: Float64,
    radius: float,
    near: Int64,
    count: int,
    a: int,
    b: int,
    c: int,
) -> bool:  # pragma: no cover - compiled
    """Whether no sample of `near` but the three lies in the ball."""
    limit = radius * radius * (1.0 - _TOUCH)
    for slot in range(count):
        point = near[slot]
        if point in (a, b, c):
            continue
        dx = points[point, 0] - centre[0]
        dy = points[point, 1] - centre[1]
        dz = points[point, 2] - centre[2]
        if dx * dx + dy * dy + dz * dz < limit:
            return False
    return True
