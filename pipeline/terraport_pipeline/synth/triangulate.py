"""Triangulations whose edges are short on the surface, not only in its parameters.

Longest-first edge splitting with templates: every edge longer than the bound is cut in its middle,
and each triangle is replaced by 2, 3 or 4 according to which of its edges were cut. Marks belong to
edges, so neighbours always agree and no T-junction arises (red-green refinement; Bank, Sherman and
Weiser, "Refinement algorithms and data structures", 1983, without the green repair: triangles of
the last round may be thin). PURE.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from terraport_payload.types import Bool, Float64, Int64

__all__ = ["grid_triangles", "icosphere", "refine"]


_MAX_ROUNDS: Final = 12
"""Each round halves an edge; a wall 1,000 times steeper than its grid needs ten."""


def grid_triangles(half_x: float, half_y: float, step: float) -> tuple[Float64, Int64]:
    """Triangulate a rectangle about the origin.

    Parameters
    ----------
    half_x, half_y : float
        Half sides.
    step : float
        Longest wanted side of a cell.

    Returns
    -------
    parameters : ndarray of shape (V, 2), float64
    faces : ndarray of shape (F, 3), int64
        Counter-clockwise seen from +z.
    """
    nx, ny = int(np.ceil(2 * half_x / step)) + 1, int(np.ceil(2 * half_y / step)) + 1
    u, v = np.meshgrid(np.linspace(-half_x, half_x, nx), np.linspace(-half_y, half_y, ny))
    index = np.arange(nx * ny).reshape(ny, nx)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    # Alternate the diagonal, or every slope would show the same grain.
    odd = ((a % nx) + (a // nx)) % 2 == 1
    first = np.stack([a, b, np.where(odd, c, d)], axis=1)
    second = np.stack([np.where(odd, b, a), d, c], axis=1)
    return np.stack([u.ravel(), v.ravel()], axis=1), np.concatenate([first, second])


def icosphere(rounds: int) -> tuple[Float64, Int64]:
    """Return unit directions and faces of an icosahedron split `rounds` times."""
    g = (1.0 + 5.0**0.5) / 2.0
    corners = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    corners += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4)]
    faces += [(11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8)]
    faces += [(3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    unit = np.array(corners, dtype=np.float64)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    triangles = np.array(faces, dtype=np.int64)
    for _ in range(rounds):
        unit, triangles = _split(unit, triangles, np.ones((len(triangles), 3), dtype=bool))
        unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return unit, triangles


def refine(
    parameters: Float64,
    faces: Int64,
    to_surface: Callable[[Float64], Float64],
    longest: float,
) -> tuple[Float64, Float64, Int64]:
    """Split edges until none is longer than `longest` on the surface.

    Parameters
    ----------
    parameters : ndarray of shape (V, D), float64
    faces : ndarray of shape (F, 3), int64
    to_surface : callable
        (K, D) parameters -> (K, 3) positions.
    longest : float
        Bound on every edge, in the unit of the positions.

    Returns
    -------
    parameters : ndarray of shape (V', D), float64
        The old ones first, in their order.
    positions : ndarray of shape (V', 3), float64
    faces : ndarray of shape (F', 3), int64
        Same winding.
    """
    positions = to_surface(parameters)
    done: list[Int64] = []
    for _ in range(_MAX_ROUNDS):
        ends = positions[faces]
        spans = ends - ends[:, [1, 2, 0]]
        cut = np.einsum("ijk,ijk->ij", spans, spans) > longest * longest
        whole = ~cut.any(axis=1)
        done.append(faces[whole])
        faces, cut = faces[~whole], cut[~whole]
        if len(faces) == 0:
            break
        count = len(parameters)
        parameters, faces = _split(parameters, faces, cut)
        positions = np.concatenate([positions, to_surface(parameters[count:])])
    return parameters, positions, np.concatenate([*done, faces])


def _split(parameters: Float64, faces: Int64, cut: Bool) -> tuple[Float64, Int64]:
    """Cut the marked edges; edge k of a face runs from its corner k to corner k + 1."""
    edges = np.stack([faces, faces[:, [1, 2, 0]]], axis=2)
    low, high = edges.min(axis=2), edges.max(axis=2)
    keys = (low * len(parameters) + high)[cut]
    unique, inverse = np.unique(keys, return_inverse=True)
    a, b = unique // len(parameters), unique % len(parameters)
    middles = 0.5 * (parameters[a] + parameters[b])
    middle = np.full(faces.shape, -1, dtype=np.int64)
    middle[cut] = len(parameters) + inverse
    return np.concatenate([parameters, middles]), _templates(faces, middle, cut)


def _templates(faces: Int64, middle: Int64, cut: Bool) -> Int64:
    count = cut.sum(axis=1)
    pieces = []
    three = count == 3
    f, m = faces[three], middle[three]
    pieces += [
        np.stack([f[:, 0], m[:, 0], m[:, 2]], axis=1),
        np.stack([m[:, 0], f[:, 1], m[:, 1]], axis=1),
        np.stack([m[:, 2], m[:, 1], f[:, 2]], axis=1),
        m,
    ]
    # Turn the others so that, with one cut, edge 0 is cut; with two, edge 2 is whole.
    for number in (1, 2):
        some = count == number
        turn = cut[some].argmax(axis=1) if number == 1 else (~cut[some]).argmax(axis=1) + 1
        order = (turn[:, None] + np.arange(3)) % 3
        f = np.take_along_axis(faces[some], order, axis=1)
        m = np.take_along_axis(middle[some], order, axis=1)
        if number == 1:
            pieces.append(np.stack([f[:, 0], m[:, 0], f[:, 2]], axis=1))
            pieces.append(np.stack([m[:, 0], f[:, 1], f[:, 2]], axis=1))
        else:
            pieces.append(np.stack([m[:, 0], f[:, 1], m[:, 1]], axis=1))
            pieces.append(np.stack([f[:, 0], m[:, 0], m[:, 1]], axis=1))
            pieces.append(np.stack([f[:, 0], m[:, 1], f[:, 2]], axis=1))
    return np.concatenate(pieces)
