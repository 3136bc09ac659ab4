"""Which faces touch: pairs over shared edges or shared vertices, and connected components.

Faces are *contiguous* when they share an edge (thesis, section 3.5.5.2). Where more than two faces
share one edge all of them are mutual neighbours. Half-edges are put in rows by their lower vertex
with one counting sort, and the short rows are sorted where they lie; runs of vertices go to several
threads. For 12 M faces: two counting sorts 2.5 s, this 1.3 s on one core; an argsort of edge keys
twice that and twice the memory.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import AnyInt, Int32, Int64
from terraport_pipeline.geometry.mesh.chunks import CHUNK, in_chunks
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = ["MAX_FACES_PER_EDGE", "as_kernel_input", "components", "face_pairs", "vertex_pairs"]

MAX_FACES_PER_EDGE: Final = 64
"""All faces of an edge (or vertex) are mutual neighbours up to this many; beyond it each is paired
with the next 63 in face order. Keeps the pairs linear in the faces (a fan of 10^5 faces would make
5 x 10^9) and loses no connection. Real meshes have 2 per edge and about 6 per vertex."""

_INSERTION: Final = 16
"""Entries that insertion sorts; longer rows are merged from such pieces."""


def face_pairs(faces: AnyInt, n_vertices: int, *, threads: int = 1) -> tuple[Int32, Int32]:
    """Find every pair of faces that share an edge.

    Parameters
    ----------
    faces : ndarray of shape (F, 3), integer
        Vertex indices. Repeated faces and faces with a repeated corner are allowed; a corner pair
        with two equal vertices is no edge.
    n_vertices : int
        Number of vertices; every index must be below it.
    threads : int
        Threads at most; they change nothing but the time.

    Returns
    -------
    pairs : ndarray of shape (P, 2), int32
        Each pair once, lower face first, even where two faces share several edges. Sorted by the
        shared edge.
    edges : ndarray of shape (P, 2), int32
        Vertices of the shared edge, lower first; the lowest edge where a pair shares several.

    Raises
    ------
    ValueError
        Wrong shape, or an index outside 0..n_vertices-1.

    Notes
    -----
    Time and memory are linear in F; peak about 60 bytes per face, result included.

    Examples
    --------
    Two triangles of a square share the edge (1, 2).

    >>> pairs, edges = face_pairs(np.array([[0, 1, 2], [2, 1, 3]]), 4)
    >>> pairs.tolist(), edges.tolist()
    ([[0, 1]], [[1, 2]])
    """
    checked = _validate_faces(faces, n_vertices)
    starts, rows = _bucket_half_edges(checked, n_vertices)
    counts = in_chunks(
        lambda begin, end: _sort_and_count(checked, starts, rows, begin, end),
        n_vertices, threads=threads,
    )  # fmt: skip
    first = dict(zip(range(0, n_vertices, CHUNK), np.cumsum([0, *counts])[:-1], strict=True))
    pairs = np.empty((sum(counts), 2), dtype=np.int32)
    edges = np.empty((sum(counts), 2), dtype=np.int32)
    in_chunks(
        lambda begin, end: _emit_pairs(
            checked, starts, rows, pairs, edges, first[begin], begin, end
        ),
        n_vertices, threads=threads,
    )  # fmt: skip
    return pairs, edges


def vertex_pairs(faces: AnyInt, n_vertices: int) -> Int32:
    """Find every pair of faces that share at least one vertex.

    Parameters
    ----------
    faces : ndarray of shape (F, 3), integer
        Vertex indices.
    n_vertices : int
        Number of vertices.

    Returns
    -------
    ndarray of shape (P, 2), int32
        Each pair once, lower face first; about six times as many as faces on a usual mesh.

    Raises
    ------
    ValueError
        Wrong shape, or an index outside 0..n_vertices-1.
    """
    checked = _validate_faces(faces, n_vertices)
    starts, face = _bucket_corners(checked, n_vertices)
    count = _emit_vertex_pairs(checked, starts, face, np.empty((0, 2), np.int32))
    pairs = np.zeros((count, 2), dtype=np.int32)
    if count:
        _emit_vertex_pairs(checked, starts, face, pairs)
    return pairs


def components(
    n_items: int,
    pairs: Int32,
    *,
    labels: AnyInt | None = None,
    also: AnyInt | None = None,
) -> tuple[Int32, int]:
    """Find connected components of a graph, optionally only over pairs with equal labels.

    Parameters
    ----------
    n_items : int
        Number of items (faces).
    pairs : ndarray of shape (P, 2), int32
        Undirected connections.
    labels : ndarray of shape (n_items,), integer, optional
        Where given, a pair connects only items of equal label.
    also : ndarray of shape (n_items,), integer, optional
        A second label that must be equal too.

    Returns
    -------
    component : ndarray of shape (n_items,), int32
        Numbered 0.. in the order of each component's first item.
    count : int
        Number of components.
    """
    for name, given in (("labels", labels), ("also", also)):
        if given is not None and len(given) != n_items:
            msg = f"{name} has {len(given)} entries, expected one per item ({n_items})"
            raise ValueError(msg)
    none = np.zeros(0, np.int32)
    component, count = _components(
        n_items,
        as_kernel_input(pairs, np.int32),
        as_kernel_input(none if labels is None else labels, np.int32),
        as_kernel_input(none if also is None else also, np.int32),
    )
    return component, int(count)


def _validate_faces(faces: AnyInt, n_vertices: int) -> Int32:
    """Contiguous int32 copy (or view) of checked faces."""
    if faces.ndim != 2 or faces.shape[1] != 3:
        msg = f"faces have shape {faces.shape}, expected (F, 3)"
        raise ValueError(msg)
    if len(faces) and (int(faces.min()) < 0 or int(faces.max()) >= n_vertices):
        bad = int(np.flatnonzero(((faces < 0) | (faces >= n_vertices)).any(axis=1))[0])
        msg = f"face {bad} is {faces[bad].tolist()}, expected indices in 0..{n_vertices - 1}"
        raise ValueError(msg)
    return as_kernel_input(faces, np.int32)


@numba.njit(cache=True, nogil=True)
def _is_repeated(faces: Int32, f: int, c: int) -> bool:
    """Whether the face's edge c is the same as one before it (faces with a repeated corner)."""
    if c == 1:
        return bool(faces[f, 2] == faces[f, 0])
    return c == 2 and (faces[f, 2] == faces[f, 1] or faces[f, 0] == faces[f, 1])


@numba.njit(cache=True, nogil=True)
def _bucket_half_edges(faces: Int32, n_vertices: int) -> tuple[Int64, Int32]:
    """Half-edges (higher vertex, face) in rows by lower vertex, in face order within a row."""
    starts = np.zeros(n_vertices + 2, np.int64)
    for f in range(len(faces)):
        for c in range(3):
            a, b = faces[f, c], faces[f, (c + 1) % 3]
            if a != b and not _is_repeated(faces, f, c):
                starts[min(a, b) + 2] += 1
    for v in range(n_vertices):
        starts[v + 2] += starts[v + 1]
    # starts[v + 1] is now where row v begins, and becomes where it ends: row v + 1's beginning
    rows = np.empty((starts[n_vertices + 1], 2), np.int32)
    for f in range(len(faces)):
        for c in range(3):
            a, b = faces[f, c], faces[f, (c + 1) % 3]
            if a != b and not _is_repeated(faces, f, c):
                at = starts[min(a, b) + 1]
                rows[at, 0] = max(a, b)
                rows[at, 1] = f
                starts[min(a, b) + 1] = at + 1
    return starts, rows


@numba.njit(cache=True, nogil=True)
def _sort_row(rows: Int32, start: int, end: int) -> None:
    """Sort one row by higher vertex, faces staying in order: insertion, and merging if it is long.

    Rows have about three entries; a fan of any size still takes n log n.
    """
    # (1) Short runs by insertion. Only strictly higher entries move, so equal ones keep their
    # order.
    for low in range(start, end, _INSERTION):
        for i in range(low + 1, min(low + _INSERTION, end)):
            high, face = rows[i, 0], rows[i, 1]
            j = i
            while j > low and rows[j - 1, 0] > high:
                rows[j, 0], rows[j, 1] = rows[j - 1, 0], rows[j - 1, 1]
                j -= 1
            rows[j, 0], rows[j, 1] = high, face
    # (2) Merge runs of doubled width; of equal entries the left run's comes first: stable as
    # well.
    width = _INSERTION
    while width < end - start:
        spare = rows[start:end].copy()
        n = end - start
        for low in range(0, n, 2 * width):
            i, middle = low, min(low + width, n)
            j, last = middle, min(low + 2 * width, n)
            for k in range(low, last):
                if j >= last or (i < middle and spare[i, 0] <= spare[j, 0]):
                    rows[start + k, 0], rows[start + k, 1] = spare[i, 0], spare[i, 1]
                    i += 1
                else:
                    rows[start + k, 0], rows[start + k, 1] = spare[j, 0], spare[j, 1]
                    j += 1
        width *= 2


@numba.njit(cache=True, nogil=True)
def _opposite(faces: Int32, f: int, low: int, high: int) -> int:
    """Third corner of a face across one of its edges; the face may have a repeated corner."""
    third: int = np.int64(faces[f, 0]) + faces[f, 1] + faces[f, 2] - low - high
    return third


@numba.njit(cache=True, nogil=True)
def _share_lower_edge(faces: Int32, f: int, g: int, low: int, high: int) -> bool:
    """Whether faces f and g, which share the edge (low, high), share one that sorts before it too.

    Then they have three corners in common: the third is the same, and it makes a lower edge with
    ``low`` when it lies below ``high``. (A third corner equal to ``low`` is a repeated one.)
    """
    third = _opposite(faces, f, low, high)
    return third < high and third != low and third == _opposite(faces, g, low, high)


@numba.njit(cache=True, nogil=True)
def _sort_and_count(faces: Int32, starts: Int64, rows: Int32, begin: int, end: int) -> int:
    """Sort the rows of some vertices and count their pairs."""
    count = 0
    for v in range(begin, end):
        _sort_row(rows, starts[v], starts[v + 1])
        for x in range(starts[v], starts[v + 1]):
            last = min(starts[v + 1], x + MAX_FACES_PER_EDGE)
            for y in range(x + 1, last):
                if rows[y, 0] != rows[x, 0]:
                    break
                if not _share_lower_edge(faces, rows[x, 1], rows[y, 1], v, rows[x, 0]):
                    count += 1
    return count


@numba.njit(cache=True, nogil=True)
def _emit_pairs(
    faces: Int32,
    starts: Int64,
    rows: Int32,
    pairs: Int32,
    edges: Int32,
    first: int,
    begin: int,
    end: int,
) -> None:
    """Write the pairs of some vertices from number ``first`` on."""
    at = first
    for v in range(begin, end):
        for x in range(starts[v], starts[v + 1]):
            last = min(starts[v + 1], x + MAX_FACES_PER_EDGE)
            for y in range(x + 1, last):
                if rows[y, 0] != rows[x, 0]:
                    break
                if not _share_lower_edge(faces, rows[x, 1], rows[y, 1], v, rows[x, 0]):
                    pairs[at, 0], pairs[at, 1] = rows[x, 1], rows[y, 1]
                    edges[at, 0], edges[at, 1] = v, rows[x, 0]
                    at += 1


@numba.njit(cache=True, nogil=True)
def _bucket_corners(faces: Int32, n_vertices: int) -> tuple[Int64, Int32]:
    """Faces around every vertex, ascending, each once."""
    starts = np.zeros(n_vertices + 1, np.int64)
    for f in range(len(faces)):
        for c in range(3):
            v = faces[f, c]
            if (c < 1 or v != faces[f, 0]) and (c < 2 or v != faces[f, 1]):
                starts[v + 1] += 1
    for v in range(n_vertices):
        starts[v + 1] += starts[v]
    face = np.empty(starts[n_vertices], np.int32)
    cursor = starts[:-1].copy()
    for f in range(len(faces)):
        for c in range(3):
            v = faces[f, c]
            if (c < 1 or v != faces[f, 0]) and (c < 2 or v != faces[f, 1]):
                face[cursor[v]] = f
                cursor[v] += 1
    return starts, face


@numba.njit(cache=True, nogil=True)
def _emit_vertex_pairs(faces: Int32, starts: Int64, face: Int32, pairs: Int32) -> int:
    """Count the pairs; write them too where ``pairs`` has room."""
    write = len(pairs) > 0
    count = 0
    for v in range(len(starts) - 1):
        # Pairs of this vertex's faces, up to a bound: a fan of n faces would give n^2 / 2 of
        # them.
        for x in range(starts[v], starts[v + 1]):
            for y in range(x + 1, min(starts[v + 1], x + MAX_FACES_PER_EDGE)):
                f, g = face[x], face[y]
                lower = False  # the pair belongs to the lowest vertex that both have
                for c in range(3):
                    u = faces[f, c]
                    if u < v and (u == faces[g, 0] or u == faces[g, 1] or u == faces[g, 2]):
                        lower = True
                if lower:
                    continue
                if write:
                    pairs[count, 0] = f
                    pairs[count, 1] = g
                count += 1
    return count


@numba.njit(cache=True, nogil=True)
def _find(parent: Int32, item: int) -> int:
    while parent[item] != item:
        parent[item] = parent[parent[item]]
        item = parent[item]
    return item


@numba.njit(cache=True, nogil=True)
def _components(n_items: int, pairs: Int32, labels: Int32, also: Int32) -> tuple[Int32, int]:
    """Union-find whose root is always the lowest item, so numbering follows the first item."""
    # (1) Unite. Invariant: `parent[i] <= i`, so the root of a tree is its lowest item.
    parent = np.empty(n_items, np.int32)
    for i in range(n_items):
        parent[i] = i
    check, check_also = len(labels) > 0, len(also) > 0
    for i in range(len(pairs)):
        a, b = pairs[i, 0], pairs[i, 1]
        if check and labels[a] != labels[b]:
            continue
        if check_also and also[a] != also[b]:
            continue
        a, b = _find(parent, a), _find(parent, b)
        if a < b:
            parent[b] = a
        elif b < a:
            parent[a] = b
    # (2) Number the roots ascending; a root is met before all others of its tree.
    component = np.empty(n_items, np.int32)
    count = 0
    for i in range(n_items):
        root = _find(parent, i)
        if root == i:
            component[i] = count
            count += 1
        else:
            component[i] = component[root]
    return component, count
