"""Cut a closed Poisson surface back to where samples support it.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numba
import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Bool, Float32, Int32
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = ["close_small_gaps", "compact", "island_mask", "near_mask", "support_mask"]


_CHUNK = 500_000
"""Vertices per nearest-neighbour query; bounds its scratch to 8 MB."""

_DENSITY_SPAN = 3.0
"""Local spacings count up to this factor above the cloud's, so that a hole's rim cannot bridge the
hole."""


def support_mask(
    vertices: Float32,
    faces: Int32,
    tree: cKDTree,
    local_spacing_m: Float32,
    *,
    spacings: float = 4.0,
    workers: int = -1,
) -> Bool:
    """Mark the faces whose three vertices all lie near a sample.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres, scene frame.
    faces : ndarray of shape (F, 3), int32
    tree : cKDTree
        Over the N samples, metres, scene frame.
    local_spacing_m : ndarray of shape (N,), float32
        Areal spacing around each sample.
    spacings : float
        A vertex is supported within this many spacings of its nearest sample.
    workers : int
        Threads; the result does not depend on it.

    Returns
    -------
    ndarray of shape (F,), bool
        True for supported faces.
    """
    middle_m = float(np.median(local_spacing_m))
    reach_m = spacings * np.clip(local_spacing_m, middle_m, _DENSITY_SPAN * middle_m)
    supported = np.empty(len(vertices), dtype=bool)
    for begin in range(0, len(vertices), _CHUNK):
        here = slice(begin, begin + _CHUNK)
        distance_m, index = tree.query(vertices[here], workers=workers)
        supported[here] = distance_m <= reach_m[index]
    a, b, c = faces.T
    whole: Bool = supported[a] & supported[b] & supported[c]
    return whole


def near_mask(
    vertices: Float32,
    faces: Int32,
    tree: cKDTree,
    *,
    margin_m: float,
    workers: int = -1,
) -> Bool:
    """Mark the faces that come within a margin of any of the points.

    Conservative: a face is kept when its centre lies within ``margin_m`` plus its own radius of a
    point.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres.
    faces : ndarray of shape (F, 3), int32
    tree : cKDTree
        Over the points to be covered (the detail mesh's vertices), metres.
    margin_m : float
    workers : int
        Threads; the result does not depend on it.

    Returns
    -------
    ndarray of shape (F,), bool
    """
    near = np.empty(len(faces), dtype=bool)
    for begin in range(0, len(faces), _CHUNK):
        here = slice(begin, begin + _CHUNK)
        corners = vertices[faces[here]]
        centre = corners.mean(axis=1)
        radius_m = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
        limit_m = margin_m + radius_m
        distance_m, _ = tree.query(
            centre, distance_upper_bound=float(limit_m.max()) * 1.001 + 1e-9, workers=workers
        )
        near[here] = distance_m <= limit_m
    return near


def island_mask(faces: Int32, vertex_count: int, *, min_faces: int) -> tuple[Bool, int]:
    """Mark the faces of connected pieces that are large enough.

    Parameters
    ----------
    faces : ndarray of shape (F, 3), int32
    vertex_count : int
    min_faces : int
        Pieces (connected by shared vertices) below this are islands. The largest piece always
        stays.

    Returns
    -------
    keep : ndarray of shape (F,), bool
    dropped : int
        Number of islands.
    """
    if not len(faces):
        return np.zeros(0, dtype=bool), 0
    piece = _pieces(faces, vertex_count)
    sizes = np.bincount(piece)
    large = sizes >= min_faces
    large[int(sizes.argmax())] = True
    return large[piece], int(((sizes > 0) & ~large).sum())


def close_small_gaps(vertices: Float32, faces: Int32, keep: Bool, *, max_extent_m: float) -> Bool:
    """Take back removed pieces that are small seen from above.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres, scene frame (Y up).
    faces : ndarray of shape (F, 3), int32
    keep : ndarray of shape (F,), bool
        Faces that stay; not modified.
    max_extent_m : float
        Removed pieces (connected by shared vertices) whose box is at most this wide along x and z
        come back if they touch a face that stays.

    Returns
    -------
    ndarray of shape (F,), bool
    """
    removed = np.flatnonzero(~keep)
    if not len(removed):
        return keep.copy()
    label = _pieces(faces[removed], len(vertices))
    count = int(label.max()) + 1
    low = np.full((count, 2), np.inf)
    high = np.full((count, 2), -np.inf)
    stays = np.zeros(len(vertices), dtype=bool)
    stays[faces[keep].ravel()] = True
    touches = np.zeros(count, dtype=bool)
    for corner in range(3):
        vertex = faces[removed, corner]
        np.minimum.at(low, label, vertices[vertex][:, ::2])
        np.maximum.at(high, label, vertices[vertex][:, ::2])
        touches[label[stays[vertex]]] = True
    back = touches & ((high - low).max(axis=1) <= max_extent_m)
    result = keep.copy()
    result[removed[back[label]]] = True
    return result


def compact(vertices: Float32, faces: Int32, keep: Bool) -> tuple[Float32, Int32]:
    """Keep some faces and only the vertices that they use, both in their old order.

    Returns
    -------
    vertices : ndarray of shape (V', 3), float32
    faces : ndarray of shape (F', 3), int32
    """
    kept = faces[keep]
    used = np.zeros(len(vertices), dtype=bool)
    used[kept.ravel()] = True
    renumbered = np.cumsum(used, dtype=np.int64) - 1
    return vertices[used], renumbered[kept].astype(np.int32)


def _pieces(faces: Int32, vertex_count: int) -> Int32:
    """Find the connected piece of every face, numbered from 0; pieces share no vertex."""
    root = _roots(as_kernel_input(faces, np.int32), vertex_count)
    first = root[faces[:, 0]]
    is_root = np.zeros(vertex_count, dtype=bool)
    is_root[first] = True
    number = np.cumsum(is_root, dtype=np.int32) - np.int32(1)
    pieces: Int32 = number[first]
    return pieces


@numba.njit(cache=True, nogil=True)
def _roots(faces: Int32, vertex_count: int) -> Int32:
    """Lowest vertex of every vertex's piece, by union-find with path halving.

    A tenth of the time that SciPy's connected components take over the same links.
    """
    parent = np.arange(vertex_count).astype(np.int32)
    # Invariant: a parent is never above its child, so roots are the lowest of their pieces.
    for f in range(len(faces)):
        a = faces[f, 0]
        while parent[a] != a:
            parent[a] = parent[parent[a]]
            a = parent[a]
        for corner in range(1, 3):
            b = faces[f, corner]
            while parent[b] != b:
                parent[b] = parent[parent[b]]
                b = parent[b]
            if a < b:
                parent[b] = a
            elif b < a:
                parent[a] = b
                a = b
    for v in range(vertex_count):
        parent[v] = parent[parent[v]]  # parents are lower: theirs are final already
    return parent
