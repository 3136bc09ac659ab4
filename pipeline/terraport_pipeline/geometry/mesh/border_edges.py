"""The border of a surface: the edges that one face alone has.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numba
import numpy as np

from terraport_payload.types import Bool, Int32, Int64
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = ["border_edges", "open_edges"]


def border_edges(faces: Int32, n_vertices: int) -> Int32:
    """Find the edges that one face alone has.

    Parameters
    ----------
    faces : ndarray of shape (F, 3), int32
        Wound consistently.
    n_vertices : int

    Returns
    -------
    ndarray of shape (E, 2), int32
        Directed as in their face, sorted by first and second vertex.

    Notes
    -----
    Around a vertex inside the surface every neighbour follows it once and precedes it once. One
    pass over the faces sums the neighbours that follow less those that precede, by hashes of their
    numbers: where the sum is not 0 there is border. Edges are compared only there. (Sums of the
    numbers themselves are 0 by chance where two fans meet in a vertex: ``+1 -2 +4 -3``.)
    """
    triangles = as_kernel_input(faces, np.int32)
    open_vertex = _unbalanced(triangles, n_vertices)
    some = triangles[open_vertex[triangles].sum(axis=1) >= 2].astype(np.int64)
    start = some.ravel()
    end = some[:, [1, 2, 0]].ravel()
    forth = np.sort((start << 32) | end)
    back = np.sort((end << 32) | start)
    alone = forth[~_is_in_sorted(forth, back)]
    return np.stack([alone >> 32, alone & 0xFFFFFFFF], axis=1).astype(np.int32)


def open_edges(faces: Int32, n_vertices: int) -> Int32:
    """Find the edges that one face alone has, and no others; as :func:`border_edges`.

    Beside a border more than one face wide that also gives edges that lead inwards from it, whose
    other face it leaves out. Thinning a base is tuned to these (the share of faces that its skirt
    keeps), so they stay there: without them the base of a piece of the sample scene had 8,657 faces
    instead of 6,494, and 8,247 were asked.
    """
    edges = border_edges(faces, n_vertices).astype(np.int64)
    at_edge = np.zeros(n_vertices, np.bool_)
    at_edge[edges.ravel()] = True
    some = faces[at_edge[faces].sum(axis=1) >= 2].astype(np.int64)
    back = np.sort((some[:, [1, 2, 0]].ravel() << 32) | some.ravel())
    there: Int32 = edges[~_is_in_sorted((edges[:, 0] << 32) | edges[:, 1], back)].astype(np.int32)
    return there


def _is_in_sorted(values: Int64, among: Int64) -> Bool:
    if not len(among):
        return np.zeros(len(values), dtype=bool)
    index = np.minimum(np.searchsorted(among, values), len(among) - 1)
    present: Bool = among[index] == values
    return present


@numba.njit(cache=True, nogil=True)
def _unbalanced(faces: Int32, n_vertices: int) -> Bool:
    balance = np.zeros(n_vertices, np.uint64)
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        hash_a, hash_b, hash_c = _mixed(a), _mixed(b), _mixed(c)
        balance[a] += hash_b - hash_c
        balance[b] += hash_c - hash_a
        balance[c] += hash_a - hash_b
    unbalanced: Bool = balance != 0
    return unbalanced


@numba.njit(cache=True, nogil=True)
def _mixed(number: int) -> np.uint64:
    """Hash of a vertex number: splitmix64's finaliser (Steele, Lea, Flood 2014)."""
    z = np.uint64(number) + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))
