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

__all__ = [
    "MAX_FACES_PER_EDGE",
    "as_kernel_input",
    "components",
    "face_pairs",
    "order_of_scattered",
    "vertex_pairs",
]

MAX_FACES_PER_EDGE: Final = 64
"""All faces of an edge (or vertex) are mutual neighbours up to this many; beyond it each is paired
with the next 63 in face order. Keeps the pairs linear in the faces (a fan of 10^5 faces would make
5 x 10^9) and loses no connection. Real meshes have 2 per edge and about 6 per vertex."""

_INSERTION: Final = 16
"""Entries that insertion sorts; longer rows are merged from such pieces."""

_MANY_VERTICES: Final = 200_000
"""Below it the processor's cache holds what faces in any order ask for."""

_SAMPLED: Final = 4096
_FAR_SHARE: Final = 100
"""Faces that follow each other by more than this part of all vertices are far apart."""


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
    Time and memory are linear in F; peak about 75 bytes per face, result included. Where
    neighbours stand far apart in the list, faces are ordered by their lowest vertex first: a pass
    that waits for memory instead of three.

    Examples
    --------
    Two triangles of a square share the edge (1, 2).

    >>> pairs, edges = face_pairs(np.array([[0, 1, 2], [2, 1, 3]]), 4)
    >>> pairs.tolist(), edges.tolist()
    ([[0, 1]], [[1, 2]])
    """
    checked = _validate_faces(faces, n_vertices)
    order = order_of_scattered(checked, n_vertices)
    if order is not None:
        starts, rows = _bucket_half_edges(checked[order], order, n_vertices)
    else:
        starts, rows = _bucket_half_edges(checked, np.zeros(0, np.int32), n_vertices)
    counts = in_chunks(
        lambda begin, end: _sort_and_count(starts, rows, begin, end),
        n_vertices, threads=threads,
    )  # fmt: skip
    first = dict(zip(range(0, n_vertices, CHUNK), np.cumsum([0, *counts])[:-1], strict=True))
    pairs = np.empty((sum(counts), 2), dtype=np.int32)
    edges = np.empty((sum(counts), 2), dtype=np.int32)
    in_chunks(
        lambda begin, end: _emit_pairs(starts, rows, pairs, edges, first[begin], begin, end),
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


def order_of_scattered(faces: Int32, n_vertices: int) -> Int32 | None:
    """Give an order in which neighbours stand near each other, where they do not by themselves.

    Returns
    -------
    ndarray of shape (F,), int32, or None
        Faces by their lowest vertex, then by number. None where the order of the file is good, or
        the mesh is small: then no order is any faster.
    """
    return _order_by_vertex(faces, n_vertices) if _is_scattered(faces, n_vertices) else None


def _is_scattered(faces: Int32, n_vertices: int) -> bool:
    """Whether faces that follow each other are mostly far apart, by a sample of them."""
    if n_vertices < _MANY_VERTICES or len(faces) < 2:
        return False  # all of them are in the processor's cache
    at = np.linspace(0, len(faces) - 2, _SAMPLED).astype(np.int64)
    jump = np.abs(faces[at + 1, 0].astype(np.int64) - faces[at, 0])
    return bool(np.median(jump) > n_vertices // _FAR_SHARE)


@numba.njit(cache=True, nogil=True)
def _order_by_vertex(faces: Int32, n_vertices: int) -> Int32:
    """Faces in order of their lowest vertex, and of their number: one counting sort."""
    starts = np.zeros(n_vertices + 1, np.int32)
    for f in range(len(faces)):
        starts[min(faces[f, 0], faces[f, 1], faces[f, 2]) + 1] += 1
    for v in range(n_vertices):
        starts[v + 1] += starts[v]
    order = np.empty(len(faces), np.int32)
    for f in range(len(faces)):
        v = min(faces[f, 0], faces[f, 1], faces[f, 2])
        order[starts[v]] = f
        starts[v] += 1
    return order


@numba.njit(cache=True, nogil=True)
def _bucket_half_edges(faces: Int32, number: Int32, n_vertices: int) -> tuple[Int64, Int32]:
    """Half-edges (higher vertex, face, third corner) in rows by lower vertex.

    `number` is that of every face where they stand in another order; empty where they do not.
    """
    starts = np.zeros(n_vertices + 2, np.int64)
    for f in range(len(faces)):
        for c in range(3):
            a, b = faces[f, c], faces[f, (c + 1) % 3]
            if a != b and not _is_repeated(faces, f, c):
                starts[min(a, b) + 2] += 1
    for v in range(n_vertices):
        starts[v + 2] += starts[v + 1]
    # starts[v + 1] is now where row v begins, and becomes where it ends: row v + 1's beginning
    rows = np.empty((starts[n_vertices + 1], 3), np.int32)
    for f in range(len(faces)):
        for c in range(3):
            a, b = faces[f, c], faces[f, (c + 1) % 3]
            if a != b and not _is_repeated(faces, f, c):
                at = starts[min(a, b) + 1]
                rows[at, 0] = max(a, b)
                rows[at, 1] = number[f] if len(number) else f
                rows[at, 2] = faces[f, (c + 2) % 3]
                starts[min(a, b) + 1] = at + 1
    return starts, rows


@numba.njit(cache=True, nogil=True)
def _is_before(rows: Int32, i: int, j: int) -> bool:
    """Whether half-edge i goes before j: by higher vertex, then by face."""
    if rows[i, 0] != rows[j, 0]:
        return bool(rows[i, 0] < rows[j, 0])
    return bool(rows[i, 1] <= rows[j, 1])


@numba.njit(cache=True, nogil=True)
def _sort_row(rows: Int32, start: int, end: int) -> None:
    """Sort one row by higher vertex and face: insertion, and merging if it is long.

    Rows have about three entries; a fan of any size still takes n log n.
    """
    # (1) Short runs by insertion.
    for low in range(start, end, _INSERTION):
        for i in range(low + 1, min(low + _INSERTION, end)):
            high, face, third = rows[i, 0], rows[i, 1], rows[i, 2]
            j = i
            while j > low and (
                high < rows[j - 1, 0] or (high == rows[j - 1, 0] and face < rows[j - 1, 1])
            ):
                for k in range(3):
                    rows[j, k] = rows[j - 1, k]
                j -= 1
            rows[j, 0], rows[j, 1], rows[j, 2] = high, face, third
    # (2) Merge runs of doubled width.
    width = _INSERTION
    while width < end - start:
        spare = rows[start:end].copy()
        n = end - start
        for low in range(0, n, 2 * width):
            i, middle = low, min(low + width, n)
            j, last = middle, min(low + 2 * width, n)
            for k in range(low, last):
                if j >= last or (i < middle and _is_before(spare, i, j)):
                    rows[start + k] = spare[i]
                    i += 1
                else:
                    rows[start + k] = spare[j]
                    j += 1
        width *= 2


@numba.njit(cache=True, nogil=True)
def _share_lower_edge(rows: Int32, x: int, y: int, low: int) -> bool:
    """Whether the faces of half-edges x and y of one edge share one that sorts before it too.

    Then they have three corners in common: the third is the same, and it makes a lower edge with
    ``low`` when it lies below the higher vertex. (A third corner equal to ``low`` is a repeated
    one.)
    """
    third: int = rows[x, 2]
    return third < rows[x, 0] and third != low and third == rows[y, 2]


@numba.njit(cache=True, nogil=True)
def _sort_and_count(starts: Int64, rows: Int32, begin: int, end: int) -> int:
    """Sort the rows of some vertices and count their pairs."""
    count = 0
    for v in range(begin, end):
        _sort_row(rows, starts[v], starts[v + 1])
        for x in range(starts[v], starts[v + 1]):
            last = min(starts[v + 1], x + MAX_FACES_PER_EDGE)
            for y in range(x + 1, last):
                if rows[y, 0] != rows[x, 0]:
                    break
                if not _share_lower_edge(rows, x, y, v):
                    count += 1
    return count


@numba.njit(cache=True, nogil=True)
def _emit_pairs(
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
                if not _share_lower_edge(rows, x, y, v):
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
