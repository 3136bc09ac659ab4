"""K-means on the faces of a mesh.

Two neighbouring faces are as far apart as the way between their centres over the middle of their
edge, and as they fold, each over its mean (``delta`` weighs the two); faces farther apart as the
shortest way over the dual graph. Seeds begin as far from each other as can be; then, in turns, all
faces go to the nearest seed, and each cluster's seed becomes the face with the least sum of
distances to the cluster's.

References
----------
S. Shlafman, A. Tal, S. Katz, "Metamorphosis of polyhedral surfaces using decomposition", Computer
Graphics Forum 21(3), 2002. S. Katz, A. Tal, "Hierarchical mesh decomposition using fuzzy clustering
and cuts", 2003 (the means that distances are divided by). Chen et al. 2009, section 5 (seeds).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Float64, Int32, Int64
from terraport_research.cutters.contract import Body, Cut, Cutter
from terraport_research.kernels.nearest_source import nearest_source, rows_of_edges

__all__ = ["K_MEANS", "farthest_seeds"]

_DELTA: Final = 0.5
"""Weight of the way against the fold."""
_ROUNDS: Final = 12
_CANDIDATES: Final = 4
"""Faces of each cluster tried as its seed in a round, beside the one that it has: the nearest to
the cluster's centroid, and others by lot."""

_Rows = tuple[Int64, Int32, Float64]


def _prepare(body: Body) -> Cut:
    rows = _dual(body)

    def cut(k: int) -> Int32:
        rng = np.random.default_rng([body.seed, k])
        seeds = farthest_seeds(rows, len(body.faces), k)
        _, labels = nearest_source(*rows, seeds)
        for _ in range(_ROUNDS):
            moved = _better_seeds(body, rows, labels, seeds, rng)
            if np.array_equal(moved, seeds):
                break
            seeds = moved
            _, labels = nearest_source(*rows, seeds)
        return np.maximum(labels, 0)  # what no seed reaches

    return cut


def _dual(body: Body) -> _Rows:
    pairs, edges = body.neighbours
    middle = (body.vertices[edges[:, 0]] + body.vertices[edges[:, 1]]) / 2
    way = np.zeros(len(pairs))
    for side in range(2):
        step = body.centres[pairs[:, side]] - middle
        way += np.sqrt((step * step).sum(axis=1))
    fold = np.sin(body.folds) ** 2  # 1 - cos^2, as printed
    tiny = np.finfo(np.float64).tiny
    length = _DELTA * way / max(float(way.mean()), tiny)
    length += (1.0 - _DELTA) * fold / max(float(fold.mean()), tiny)
    return rows_of_edges(len(body.faces), pairs, length)


def farthest_seeds(rows: _Rows, n: int, k: int) -> Int32:
    """Choose seeds one after the other, each the face farthest from those before; at most n."""
    distance, _ = nearest_source(*rows, np.zeros(1, np.int32))
    seeds = [_farthest(distance)]
    while len(seeds) < min(k, n):
        distance, _ = nearest_source(*rows, np.array(seeds, np.int32))
        seeds.append(_farthest(distance))
    return np.array(seeds, np.int32)


def _farthest(distance: Float64) -> int:
    """Of pieces that no seed has reached, their first face."""
    return int(np.argmax(distance))


def _better_seeds(
    body: Body, rows: _Rows, labels: Int32, seeds: Int32, rng: np.random.Generator
) -> Int32:
    """Try several faces of every cluster at once: ways stay within a cluster."""
    k = len(seeds)
    count = np.maximum(np.bincount(labels[labels >= 0], minlength=k), 1)
    held = np.maximum(labels, 0)
    centroid = np.stack(
        [np.bincount(held, body.centres[:, axis], k) / count for axis in range(3)], axis=1
    )
    away = ((body.centres - centroid[held]) ** 2).sum(axis=1)
    best, least = seeds, _sums(rows, labels, seeds, k)
    lots = [away, *(rng.random(len(labels)) for _ in range(_CANDIDATES - 1))]
    for lot in lots:
        # The first of every cluster in the order of the lot.
        order = np.lexsort((lot, labels))
        first = np.searchsorted(labels[order], np.arange(k))
        tried = order[np.minimum(first, len(order) - 1)].astype(np.int32)
        tried = np.where(labels[tried] == np.arange(k), tried, seeds).astype(np.int32)
        sums = _sums(rows, labels, tried, k)
        best = np.where(sums < least, tried, best).astype(np.int32)
        least = np.minimum(sums, least)
    return best


def _sums(rows: _Rows, labels: Int32, seeds: Int32, k: int) -> Float64:
    distance, source = nearest_source(*rows, seeds, labels)
    there = source >= 0
    return np.bincount(source[there], distance[there], k).astype(np.float64)


K_MEANS: Final = Cutter(
    "k-means",
    "K-means",
    "Shlafman, Tal, Katz 2002",
    takes_k=True,
    prepare=_prepare,
    thesis="KM",
    departs="A cluster's new seed is the best of five faces, not of all.",
)
