"""The nearest place on a triangle mesh, exactly, however long or uneven its triangles are.

Triangles are put along a Morton curve, four to a leaf, under a complete binary tree of boxes: built
by NumPy alone, and searched depth first, nearer child first. :mod:`.deviation` looks only at the
faces with the nearest centres, which is right for the even meshes of a reconstruction and wrong for
a Delaunay sheet with triangles as long as the scene.

Memory: 100 bytes a face. Measured on one core: 400,000 faces built in 0.4 s, 10 us a point.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from terraport_payload.types import AnyFloat, Float32, Float64, Int32
from terraport_pipeline.geometry.mesh.curve import morton_order

__all__ = ["Closest", "TriangleTree"]

_LEAF = 4
"""Triangles per leaf: fewer boxes than with one each, and the same time."""

_STACK = 64
"""Nodes that wait at most: the tree is at most 31 levels deep."""


@dataclass(frozen=True, slots=True, eq=False)
class Closest:
    """The nearest place on the mesh of each of P points."""

    distance_m: Float32
    """(P,) metres."""
    face: Int32
    """(P,) face that the place lies on."""
    weights: Float32
    """(P, 3) barycentric weights of the face's corners, not negative, sum 1."""

    def interpolate(self, faces: Int32, values: npt.NDArray[np.generic]) -> Float32:
        """Interpolate values of vertices, (V, K), at the places; (P, K)."""
        corners = values[faces[self.face]].astype(np.float32)
        mixed: Float32 = np.einsum("pc,pck->pk", self.weights, corners)
        return mixed


class TriangleTree:
    """A mesh to ask for the nearest place on it.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Metres.
    faces : ndarray of shape (F, 3), int32
        Vertex indices; F >= 1.

    Raises
    ------
    ValueError
        For a mesh without faces.

    Examples
    --------
    >>> flat = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0]], np.float32)
    >>> tree = TriangleTree(flat, np.array([[0, 1, 2]], np.int32))
    >>> tree.nearest(np.array([[1.0, 1.0, 2.0], [-3.0, 0.0, 4.0]])).distance_m.tolist()
    [2.0, 5.0]
    """

    def __init__(self, vertices: AnyFloat, faces: Int32) -> None:
        if len(faces) == 0:
            raise ValueError("received a mesh without faces; there is no nearest place on it")
        corners = np.ascontiguousarray(vertices, dtype=np.float64)[faces]
        order = morton_order(corners.mean(axis=1).astype(np.float32))
        self._order = order.astype(np.int32)
        self._corners = np.ascontiguousarray(corners[order])
        self._low, self._high = _boxes(self._corners)

    def nearest(self, points: AnyFloat) -> Closest:
        """Find the nearest place on the mesh.

        Parameters
        ----------
        points : ndarray of shape (P, 3), float
            Metres, finite.

        Returns
        -------
        Closest
            Of several faces at the same distance the first along the curve.
        """
        wanted = np.ascontiguousarray(points, dtype=np.float64)
        distance = np.empty(len(wanted), np.float32)
        face = np.empty(len(wanted), np.int32)
        weights = np.empty((len(wanted), 3), np.float32)
        _search(wanted, self._corners, self._low, self._high, distance, face, weights)
        return Closest(distance, self._order[face], weights)


def _boxes(corners: Float64) -> tuple[Float64, Float64]:
    """Boxes of a complete tree: node n has the children 2n + 1 and 2n + 2, leaves come last."""
    leaves = 1 << max(0, int(np.ceil(np.log2(-(-len(corners) // _LEAF)))))
    low = np.full((leaves * _LEAF, 3), np.inf)
    high = np.full((leaves * _LEAF, 3), -np.inf)
    low[: len(corners)], high[: len(corners)] = corners.min(axis=1), corners.max(axis=1)
    lows = [low.reshape(leaves, _LEAF, 3).min(axis=1)]
    highs = [high.reshape(leaves, _LEAF, 3).max(axis=1)]
    while len(lows[-1]) > 1:
        lows.append(lows[-1].reshape(-1, 2, 3).min(axis=1))
        highs.append(highs[-1].reshape(-1, 2, 3).max(axis=1))
    return np.concatenate(lows[::-1]), np.concatenate(highs[::-1])


@numba.njit(cache=True)
def _to_box(
    point: Float64, low: Float64, high: Float64, node: int
) -> float:  # pragma: no cover - compiled
    """Squared distance of a point to a box; 0 inside, infinite to an empty box."""
    total = 0.0
    for axis in range(3):
        out = max(low[node, axis] - point[axis], point[axis] - high[node, axis], 0.0)
        total += out * out
    return total


@numba.njit(cache=True)
def _on_triangle(
    point: Float64, corners: Float64, triangle: int
) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Squared distance to a triangle, and the weights of its second and third corner there.

    C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.5; scalars, because small arrays
    cost an allocation each.
    """
    # (1) Edges from the first corner, the point seen from there, and their products: d1..d6 are
    # the projections of the point on both edges from each of the three corners.
    ab_x = corners[triangle, 1, 0] - corners[triangle, 0, 0]
    ab_y = corners[triangle, 1, 1] - corners[triangle, 0, 1]
    ab_z = corners[triangle, 1, 2] - corners[triangle, 0, 2]
    ac_x = corners[triangle, 2, 0] - corners[triangle, 0, 0]
    ac_y = corners[triangle, 2, 1] - corners[triangle, 0, 1]
    ac_z = corners[triangle, 2, 2] - corners[triangle, 0, 2]
    ap_x = point[0] - corners[triangle, 0, 0]
    ap_y = point[1] - corners[triangle, 0, 1]
    ap_z = point[2] - corners[triangle, 0, 2]
    bb = ab_x * ab_x + ab_y * ab_y + ab_z * ab_z
    bc = ab_x * ac_x + ab_y * ac_y + ab_z * ac_z
    cc = ac_x * ac_x + ac_y * ac_y + ac_z * ac_z
    d1 = ab_x * ap_x + ab_y * ap_y + ab_z * ap_z
    d2 = ac_x * ap_x + ac_y * ap_y + ac_z * ap_z
    d3, d4, d5, d6 = d1 - bb, d2 - bc, d1 - bc, d2 - cc
    vc, vb, va = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    # (2) Which of seven regions of the plane holds the projection: corners a, b, c, edges ab, ac,
    # bc, the inside. Exactly one branch is taken; `v`, `w` stay within the triangle in each, even
    # where it has no area.
    v, w = 0.0, 0.0
    if d1 <= 0.0 and d2 <= 0.0:
        pass
    elif d3 >= 0.0 and d4 <= d3:
        v = 1.0
    elif d6 >= 0.0 and d5 <= d6:
        w = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3) if d1 > d3 else 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6) if d2 > d6 else 0.0
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        whole = (d4 - d3) + (d5 - d6)
        w = (d4 - d3) / whole if whole > 0.0 else 0.0
        v = 1.0 - w
    else:
        whole = va + vb + vc
        if whole > 0.0:
            v, w = vb / whole, vc / whole
    # (3) Distance to that point.
    x = ap_x - v * ab_x - w * ac_x
    y = ap_y - v * ab_y - w * ac_y
    z = ap_z - v * ab_z - w * ac_z
    return x * x + y * y + z * z, v, w


@numba.njit(parallel=True, cache=True)
def _search(
    points: Float64,
    corners: Float64,
    low: Float64,
    high: Float64,
    distance: Float32,
    face: Int32,
    weights: Float32,
) -> None:  # pragma: no cover - compiled
    # The boxes are a complete binary tree in an array: node n has children 2 n + 1 and 2 n + 2,
    # the last `leaves` nodes hold _LEAF triangles each.
    leaves = (len(low) + 1) // 2
    for row in numba.prange(len(points)):
        point = points[row]
        best = np.inf
        second, third = 0.0, 0.0
        chosen = 0
        stack = np.empty(_STACK, np.int64)
        reach = np.empty(_STACK)
        stack[0], reach[0] = 0, 0.0
        waiting = 1
        # Depth first, nearer child first. Invariant: any triangle nearer than `best` lies under a
        # node on the stack; a node whose box is no nearer can be dropped.
        while waiting > 0:
            waiting -= 1
            node = stack[waiting]
            if reach[waiting] >= best:
                continue
            # (1) A leaf: every triangle in it.
            if node >= leaves - 1:
                start = (node - leaves + 1) * _LEAF
                for triangle in range(start, min(start + _LEAF, len(corners))):
                    squared, v, w = _on_triangle(point, corners, triangle)
                    if squared < best:
                        best, chosen, second, third = squared, triangle, v, w
                continue
            # (2) An inner node: the farther child goes on the stack first and so waits longer.
            left, right = 2 * node + 1, 2 * node + 2
            to_left = _to_box(point, low, high, left)
            to_right = _to_box(point, low, high, right)
            near, far, to_near, to_far = left, right, to_left, to_right
            if to_right < to_left:
                near, far, to_near, to_far = right, left, to_right, to_left
            if to_far < best:
                stack[waiting], reach[waiting] = far, to_far
                waiting += 1
            if to_near < best:
                stack[waiting], reach[waiting] = near, to_near
                waiting += 1
        distance[row] = np.sqrt(best)
        face[row] = chosen
        weights[row, 0], weights[row, 1], weights[row, 2] = 1.0 - second - third, second, third
