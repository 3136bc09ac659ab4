"""The last step of the Triangle Pool Algorithm: small pools join large ones (thesis, 3.6).

The rule and its ties are stated in ``triangle_pool.py``.

PURE: no I/O, no clock. Time is linear in the contacts between pools; peak about 12 bytes per
contact.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import AnyFloat, AnyInt, Bool, Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.clouds.near_filter import may_be_near
from terraport_pipeline.geometry.mesh.face_measures import face_centres, label_sums
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = ["join_nearest", "number_by_first", "refine_pools"]


_TIE: Final = 1.0 + 1e-9
"""Distances within this ratio are compared again, exactly."""
_SAMPLE: Final = 2**16
"""Faces that a first, rough search for the nearest looks at."""


def refine_pools(
    labels: Int32,
    count: int,
    pairs: Int32,
    similarity: Float32,
    smallest: float,
    pair_labels: Int32 | None = None,
) -> tuple[Int32, Bool]:
    """Merge small level 3 pools.

    Parameters
    ----------
    labels : ndarray of shape (F,), int32
        Level 3 pool of every face, 0..count-1.
    count : int
        Number of pools.
    pairs : ndarray of shape (P, 2), int32
        Neighbouring faces.
    similarity : ndarray of shape (F,), float32
        Similarity index s.
    smallest : float
        Pools with fewer faces are small.
    pair_labels : ndarray of shape (F,), int32, optional
        Pool of every face as `pairs` numbers them, where that is another order.

    Returns
    -------
    groups : ndarray of shape (F,), int32
        Merged pool of every face, 0..
    unreached : ndarray of shape (groups,), bool
        Whether the merged pool is small still, because it could reach no large one.
    """
    size, total = label_sums(labels, count, similarity)
    mean = total / size
    offsets, neighbours = _pool_graph(
        labels if pair_labels is None else pair_labels, as_kernel_input(pairs, np.int32), count
    )
    group = np.arange(count, dtype=np.int32)  # pool -> node of the current graph
    while True:
        large = size >= smallest
        target = _flood(offsets, neighbours, mean, size, large)
        loose = target < 0
        if not loose.any():
            break
        joined, moved = _join_most_similar(offsets, neighbours, mean, size, loose)
        if not moved:
            break
        # The loose pools were united among themselves: contract them, and look for large ones
        # again. Pools that a flood reached keep out of it: no loose pool touches them, or the flood
        # would have gone on.
        nodes, n_nodes = number_by_first(joined)
        node_size = np.zeros(n_nodes, np.int64)
        np.add.at(node_size, nodes, size)
        weighted = np.bincount(nodes, weights=mean * size, minlength=n_nodes)
        offsets, neighbours = _contract(offsets, neighbours, nodes, n_nodes)
        group = nodes[group]
        size, mean = node_size, weighted / node_size
    target = np.where(target < 0, np.arange(len(target), dtype=np.int32), target)
    merged, n_groups = number_by_first(target)
    unreached = np.zeros(n_groups, np.bool_)
    unreached[merged[loose]] = True
    return merged[group][labels], unreached


def join_nearest(
    vertices: AnyFloat,
    faces: AnyInt,
    groups: Int32,
    unreached: Bool,
    *,
    threads: int = 1,
) -> Int32:
    """Give each unreached group the group of the nearest face that was reached, centre to centre.

    Parameters
    ----------
    vertices, faces
        The mesh.
    groups : ndarray of shape (F,), int32
        Merged pools.
    unreached : ndarray of shape (G,), bool
        Groups to give away; at least one is and one is not.
    threads : int
        Threads at most; they change nothing but the time.

    Returns
    -------
    ndarray of shape (F,), int32
        Groups, with gaps in the numbering. Ties in distance: the lowest face of the group decides,
        and of faces equally near to it the lowest.
    """
    centres = face_centres(vertices, faces, threads=threads)
    lost = unreached[groups]
    kept_faces = np.flatnonzero(~lost)
    lost_faces = np.flatnonzero(lost)
    # The nearest of a sample bounds each group's distance; nothing farther need be in the tree.
    sample = kept_faces[:: len(kept_faces) // _SAMPLE + 1]
    bound, _ = _tree(centres[sample]).query(centres[lost_faces], workers=threads)
    group_bound = np.full(len(unreached), np.inf)
    np.minimum.at(group_bound, groups[lost_faces], bound)
    radius = group_bound[groups[lost_faces]] * _TIE
    near_lost = may_be_near(centres, centres[lost_faces], radius, threads=threads)
    kept_faces = kept_faces[near_lost[kept_faces]]
    tree = _tree(centres[kept_faces])
    k = min(2, len(kept_faces))
    distance, near = tree.query(centres[lost_faces], k=k, workers=threads)
    distance, near = distance.reshape(-1, k), near.reshape(-1, k)
    order = np.lexsort((lost_faces, distance[:, 0], groups[lost_faces]))
    owner = groups[lost_faces][order]
    chosen = order[np.concatenate([[True], owner[1:] != owner[:-1]])]
    mapping = np.arange(len(unreached), dtype=np.int32)
    mapping[groups[lost_faces[chosen]]] = groups[kept_faces[near[chosen, 0]]]
    # Equally near faces (to rounding) are rare: only these are searched for the lowest.
    tied = chosen[distance[chosen, -1] <= distance[chosen, 0] * _TIE]
    around = tree.query_ball_point(
        centres[lost_faces[tied]], distance[tied, 0] * _TIE, workers=threads
    )
    for face, nearby in zip(lost_faces[tied], around, strict=True):
        candidates = kept_faces[np.sort(nearby)]
        gap = centres[candidates] - centres[face]
        mapping[groups[face]] = groups[candidates[np.argmin((gap * gap).sum(axis=1))]]
    return np.take(mapping, groups)


def _tree(points: Float64) -> cKDTree:
    """Search tree by sliding midpoints.

    Medians take ten times as long on positions that share coordinates (grids).
    """
    return cKDTree(points, balanced_tree=False, compact_nodes=False)


def number_by_first(labels: Int32) -> tuple[Int32, int]:
    """Renumber labels to 0.. in order of first appearance; returns them and their count."""
    numbered, count = _renumber(labels, int(labels.max()) + 1 if len(labels) else 0)
    return numbered, int(count)


@numba.njit(cache=True, nogil=True)
def _pool_graph(labels: Int32, pairs: Int32, count: int) -> tuple[Int64, Int32]:
    """Neighbouring pools as CSR; a neighbour appears once per shared edge."""
    # (1) Count neighbours; then, as running sums, where each row begins.
    offsets = np.zeros(count + 1, np.int64)
    for i in range(len(pairs)):
        a, b = labels[pairs[i, 0]], labels[pairs[i, 1]]
        if a != b:
            offsets[a + 1] += 1
            offsets[b + 1] += 1
    for i in range(count):
        offsets[i + 1] += offsets[i]
    # (2) Fill the rows in order of the pairs.
    neighbours = np.empty(offsets[count], np.int32)
    cursor = offsets[:-1].copy()
    for i in range(len(pairs)):
        a, b = labels[pairs[i, 0]], labels[pairs[i, 1]]
        if a != b:
            neighbours[cursor[a]] = b
            cursor[a] += 1
            neighbours[cursor[b]] = a
            cursor[b] += 1
    return offsets, neighbours


@numba.njit(cache=True, nogil=True)
def _contract(offsets: Int64, neighbours: Int32, nodes: Int32, n_nodes: int) -> tuple[Int64, Int32]:
    """Build the same graph between groups of nodes."""
    new = np.zeros(n_nodes + 1, np.int64)
    for i in range(len(offsets) - 1):
        for e in range(offsets[i], offsets[i + 1]):
            if nodes[neighbours[e]] != nodes[i]:
                new[nodes[i] + 1] += 1
    for i in range(n_nodes):
        new[i + 1] += new[i]
    kept = np.empty(new[n_nodes], np.int32)
    cursor = new[:-1].copy()
    for i in range(len(offsets) - 1):
        for e in range(offsets[i], offsets[i + 1]):
            if nodes[neighbours[e]] != nodes[i]:
                kept[cursor[nodes[i]]] = nodes[neighbours[e]]
                cursor[nodes[i]] += 1
    return new, kept


@numba.njit(cache=True, nogil=True)
def _better(
    difference: float, size: int, number: int, best_difference: float, best_size: int, best: int
) -> bool:
    """Tie rule of all joins: nearer mean, then more faces, then lower number."""
    if best < 0 or difference < best_difference:
        return True
    if difference > best_difference:
        return False
    return size > best_size or (size == best_size and number < best)


@numba.njit(cache=True, nogil=True)
def _flood(
    offsets: Int64,
    neighbours: Int32,
    mean: Float64,
    size: Int64,
    large: Bool,
) -> Int32:
    """Large pool that each pool joins (itself for large ones), -1 where none can be reached.

    Rounds are breadth-first levels: a pool joins in the first round in which it touches a settled
    pool, so every contact is looked at twice and no more.
    """
    # (1) The first front: everything that touches a large pool.
    count = len(mean)
    target = np.full(count, -1, np.int32)
    queued = large.copy()
    front = np.empty(count, np.int32)
    choice = np.empty(count, np.int32)
    begin = end = 0
    for p in range(count):
        if large[p]:
            target[p] = p
            for e in range(offsets[p], offsets[p + 1]):
                q = neighbours[e]
                if not queued[q]:
                    queued[q] = True
                    front[end] = q
                    end += 1
    # (2) Rounds. Invariant: front[begin:end] are the pools of this round, each queued once;
    # targets of earlier rounds are final. All choose before any joins, so the order within a
    # round changes nothing.
    while begin < end:
        for i in range(begin, end):
            p = front[i]
            best, best_difference, best_size = -1, np.inf, 0
            for e in range(offsets[p], offsets[p + 1]):
                t = target[neighbours[e]]
                if t < 0 or t == best:
                    continue
                difference = abs(mean[t] - mean[p])
                if _better(difference, size[t], t, best_difference, best_size, best):
                    best, best_difference, best_size = t, difference, size[t]
            choice[i] = best
        stop = end
        for i in range(begin, stop):
            target[front[i]] = choice[i]
        for i in range(begin, stop):
            for e in range(offsets[front[i]], offsets[front[i] + 1]):
                q = neighbours[e]
                if not queued[q]:
                    queued[q] = True
                    front[end] = q
                    end += 1
        begin = stop
    return target


@numba.njit(cache=True, nogil=True)
def _join_most_similar(
    offsets: Int64,
    neighbours: Int32,
    mean: Float64,
    size: Int64,
    loose: Bool,
) -> tuple[Int32, bool]:
    """Unite every loose pool with its most similar loose neighbour, named by the lowest number."""
    count = len(mean)
    parent = np.arange(count).astype(np.int32)
    moved = False
    for p in range(count):
        if not loose[p]:
            continue
        # (1) The most similar loose neighbour, by means as they were at the start of the round.
        best, best_difference, best_size = -1, np.inf, 0
        for e in range(offsets[p], offsets[p + 1]):
            q = neighbours[e]
            if not loose[q] or q == best:
                continue
            difference = abs(mean[q] - mean[p])
            if _better(difference, size[q], q, best_difference, best_size, best):
                best, best_difference, best_size = q, difference, size[q]
        # (2) Unite. Invariant: a root is the lowest pool of its tree.
        if best >= 0:
            moved = True
            a, b = p, best
            while parent[a] != a:
                parent[a] = parent[parent[a]]
                a = parent[a]
            while parent[b] != b:
                parent[b] = parent[parent[b]]
                b = parent[b]
            parent[max(a, b)] = min(a, b)
    for p in range(count):  # roots are the lowest of their union, so one ascending pass flattens
        parent[p] = parent[parent[p]]
    return parent, moved


@numba.njit(cache=True, nogil=True)
def _renumber(labels: Int32, limit: int) -> tuple[Int32, int]:
    number = np.full(limit, -1, np.int32)
    numbered = np.empty(len(labels), np.int32)
    count = 0
    for i in range(len(labels)):
        if number[labels[i]] < 0:
            number[labels[i]] = count
            count += 1
        numbered[i] = number[labels[i]]
    return numbered, count
