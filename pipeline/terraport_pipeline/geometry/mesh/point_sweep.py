"""Distances of a sample of points to a mesh that passes by in pieces, exact and signed.

The usual way round, a tree over the faces, costs time and memory for every face of a scene, and
wants them all at once. Here the few points lie in columns of a grid, and every face looks only at
those near it: 16 million faces pass 200,000 points in about a second, on one core, in any order and
number of pieces. What no face came near waits for :meth:`PointSweep.farther`, with a longer reach
and far fewer points.

The sign is that of the nearest face's side. Where several faces are equally near, at an edge or a
corner, the one that faces the point most decides (J. A. Baerentzen and H. Aanaes, "Signed distance
computation using the angle weighted pseudonormal", IEEE TVCG 11(3), 2005, shows why any other may
be wrong).

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Bool, Float32, Float64, Int32, Int64

# A kernel of that module's: renamed, it would make every build that used it stale.
from terraport_pipeline.geometry.mesh.closest_point import _on_triangle
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = ["PointSweep"]

_POINTS_PER_COLUMN: Final = 1.0
"""Mean over the box: with fewer a face looks into more columns, with more at more points."""

_MAX_COLUMNS: Final = 1 << 22

_TIE: Final = 1e-6
"""Share by which squared distances may differ that count as equal."""

_FARTHER: Final = 8.0
"""Growth of the reach from pass to pass."""


class PointSweep:
    """Points that are looked for from the faces of a mesh.

    Parameters
    ----------
    points : ndarray of shape (P, 3), float
        Metres, finite.
    reach_m : float
        Distance within which the first pass measures; some spacings of the survey.

    Examples
    --------
    >>> flat = np.array([[0, 0, 0], [0, 0, 9], [9, 0, 0]], np.float32)
    >>> sweep = PointSweep(np.array([[1.0, 2.0, 1.0], [1.0, -0.5, 1.0], [1.0, 40.0, 1.0]]), 3.0)
    >>> sweep.pass_by(flat, np.array([[0, 1, 2]], np.int32))
    >>> sweep.distance_m.tolist()
    [2.0, -0.5, inf]
    """

    def __init__(self, points: AnyFloat, reach_m: float) -> None:
        self._points = np.ascontiguousarray(points, dtype=np.float32)
        count = len(self._points)
        self._squared = np.full(count, np.inf)
        self._side = np.zeros(count)
        self._wanted = np.arange(count)
        self._reach_m = reach_m
        self._sort()

    @property
    def measured(self) -> Bool:
        """(P,) whether a face came within reach."""
        met: Bool = np.isfinite(self._squared)
        return met

    @property
    def distance_m(self) -> Float64:
        """(P,) metres, positive on the side that the face's corners turn left around.

        Infinite where no face came within reach.
        """
        sign = np.where(self._side < 0.0, -1.0, 1.0)
        lengths: Float64 = sign * np.sqrt(self._squared)
        lengths[~self.measured] = np.inf
        return lengths

    def pass_by(self, vertices: AnyFloat, faces: AnyInt) -> None:
        """Let a piece of the mesh pass: distances of the points near it may become less.

        Parameters
        ----------
        vertices : ndarray of shape (V, 3), float
            Metres.
        faces : ndarray of shape (F, 3), int
            Counter-clockwise seen from the side that counts as positive.
        """
        if len(self._wanted) and len(faces):
            _pass_by(
                as_kernel_input(vertices, np.float32), as_kernel_input(faces, np.int32),
                self._sorted, self._order, self._starts, self._corner, self._side_m, self._reach_m,
                self._squared, self._side,
            )  # fmt: skip

    def farther(self) -> bool:
        """Look for what no face came near with a longer reach; False where nothing is left."""
        self._wanted = np.flatnonzero(~self.measured)
        if len(self._wanted):
            self._reach_m *= _FARTHER
            self._sort()
        return len(self._wanted) > 0

    def _sort(self) -> None:
        """Put the points that are looked for into columns of a grid over x and z."""
        points = self._points[self._wanted]
        flat = points[:, [0, 2]].astype(np.float64)
        low = flat.min(axis=0) if len(flat) else np.zeros(2)
        size = np.maximum(flat.max(axis=0) - low, 1e-6) if len(flat) else np.ones(2)
        area_m2 = float(size.prod())
        side_m = max(
            float(np.sqrt(area_m2 * _POINTS_PER_COLUMN / max(len(flat), 1))), self._reach_m
        )
        while np.prod(np.floor(size / side_m) + 1) > _MAX_COLUMNS:
            side_m *= 2.0
        columns = np.floor((flat - low) / side_m).astype(np.int64)
        shape = np.floor(size / side_m).astype(np.int64) + 1
        key = columns[:, 1] * shape[0] + columns[:, 0]
        order = np.argsort(key, kind="stable")
        counts = np.bincount(key, minlength=int(shape.prod()))
        self._starts = np.concatenate([[0], np.cumsum(counts)]).reshape(-1)
        self._shape = shape
        self._corner = np.array([low[0], low[1], float(shape[0]), float(shape[1])])
        self._side_m = side_m
        self._sorted = np.ascontiguousarray(points[order])
        self._order = self._wanted[order]


@numba.njit(cache=True, nogil=True)
def _pass_by(
    vertices: Float32,
    faces: Int32,
    points: Float32,
    order: Int64,
    starts: Int64,
    corner: Float64,
    side_m: float,
    reach_m: float,
    squared: Float64,
    facing: Float64,
) -> None:  # pragma: no cover - compiled
    """Lower the distances of the points within reach of each face.

    `points` stand column by column, `starts` says where each begins, `order` which row of the
    results they are. Invariant: `squared` is the least over the faces so far; `facing` the cosine
    at which the nearest of them faces the point, the steepest of equals.
    """
    width, depth = int(corner[2]), int(corner[3])
    triangle, point = np.empty((1, 3, 3)), np.empty(3)
    low, high = np.empty(3), np.empty(3)
    for face in range(len(faces)):
        # (1) The face's box, wider by the reach, and the columns that it touches.
        for axis in range(3):
            first = vertices[faces[face, 0], axis]
            second = vertices[faces[face, 1], axis]
            third = vertices[faces[face, 2], axis]
            low[axis] = min(first, second, third) - reach_m
            high[axis] = max(first, second, third) + reach_m
        from_x = max(int(np.floor((low[0] - corner[0]) / side_m)), 0)
        to_x = min(int(np.floor((high[0] - corner[0]) / side_m)), width - 1)
        from_z = max(int(np.floor((low[2] - corner[1]) / side_m)), 0)
        to_z = min(int(np.floor((high[2] - corner[1]) / side_m)), depth - 1)
        is_read = False
        for row in range(from_z, to_z + 1):
            begin = starts[row * width + from_x] if to_x >= from_x else 0
            end = starts[row * width + to_x + 1] if to_x >= from_x else 0
            for index in range(begin, end):
                # (2) Most points are out of the box, or nearer to a face that passed before.
                away = 0.0
                for axis in range(3):
                    value = points[index, axis]
                    out = max(low[axis] + reach_m - value, value - high[axis] + reach_m, 0.0)
                    away += out * out
                target = order[index]
                best = min(squared[target], reach_m * reach_m)
                if away > best * (1.0 + _TIE):
                    continue
                if not is_read:
                    for k in range(3):
                        for axis in range(3):
                            triangle[0, k, axis] = vertices[faces[face, k], axis]
                    is_read = True
                for axis in range(3):
                    point[axis] = points[index, axis]
                # (3) The exact distance, and the side.
                least, v, w = _on_triangle(point, triangle, 0)
                if least > best * (1.0 + _TIE):
                    continue
                cosine = _facing(point, triangle, v, w, least)
                is_nearer = least < best * (1.0 - _TIE)
                if is_nearer or abs(cosine) > abs(facing[target]):
                    facing[target] = cosine
                squared[target] = min(least, squared[target])


@numba.njit(cache=True, nogil=True)
def _facing(
    point: Float64, triangle: Float64, v: float, w: float, least: float
) -> float:  # pragma: no cover - compiled
    """Cosine between a face's normal and the way from the nearest place on it to the point."""
    ab_x = triangle[0, 1, 0] - triangle[0, 0, 0]
    ab_y = triangle[0, 1, 1] - triangle[0, 0, 1]
    ab_z = triangle[0, 1, 2] - triangle[0, 0, 2]
    ac_x = triangle[0, 2, 0] - triangle[0, 0, 0]
    ac_y = triangle[0, 2, 1] - triangle[0, 0, 1]
    ac_z = triangle[0, 2, 2] - triangle[0, 0, 2]
    n_x = ab_y * ac_z - ab_z * ac_y
    n_y = ab_z * ac_x - ab_x * ac_z
    n_z = ab_x * ac_y - ab_y * ac_x
    x = point[0] - triangle[0, 0, 0] - v * ab_x - w * ac_x
    y = point[1] - triangle[0, 0, 1] - v * ab_y - w * ac_y
    z = point[2] - triangle[0, 0, 2] - v * ab_z - w * ac_z
    length = np.sqrt((n_x * n_x + n_y * n_y + n_z * n_z) * least)
    return (n_x * x + n_y * y + n_z * z) / length if length > 0.0 else 0.0
