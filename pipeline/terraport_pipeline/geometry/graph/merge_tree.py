"""The merge tree: which pieces were united, in what order and at what cost.

Leaves are faces, inner nodes are unions of two nodes. A *cut* keeps some unions and undoes the
rest; its regions are the largest unions kept. Any granularity is such a cut, read off in linear
time, and cuts are nested: what a finer one unites, a coarser one unites too.

For that the order must be monotone, which costs are not: two pieces that cost little to unite can
form one that fits its neighbour better than either did. A node's *height* is therefore the largest
cost in its subtree, its own included; heights never fall from child to parent.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from terraport_payload.types import Bool, Float64, Int32, Int64
from terraport_pipeline.geometry.regions.pool_refine import number_by_first

__all__ = ["MergeTree", "merge_tree"]


@dataclass(frozen=True, slots=True, eq=False)
class MergeTree:
    """A forest over F faces: node n < F is a face, node F + m the union of merge m.

    There is one root per edge-connected piece of the surface.
    """

    leaf_count: int
    """Number of leaves, F: the faces."""
    children: Int32
    """(M, 2) nodes united by every merge, the one with the lowest face first; M <= F - 1. Both are
    below F + m: a merge unites what is there."""
    parents: Int32
    """(F + M,) union that every node is part of; -1 for roots."""
    cost: Float64
    """(M,) what every merge cost."""
    height: Float64
    """(M,) largest cost in the subtree; never above the parent's."""
    faces: Int32
    """(F + M,) faces under every node."""
    area: Int64
    """(F + M,) area under every node, in the steps of ``face_graph.py``."""

    @property
    def root_count(self) -> int:
        """Number of edge-connected pieces."""
        return self.leaf_count - len(self.children)

    def cut_by_cost(self, most: float) -> tuple[Int32, int]:
        """Keep unions of height at most ``most``.

        Returns
        -------
        labels : ndarray of shape (F,), int32
            Region of every face, numbered by first face.
        count : int
            Number of regions.
        """
        return self.cut(self.height <= most)

    def cut_by_count(self, count: int) -> tuple[Int32, int]:
        """Keep the cheapest unions, so many that ``count`` regions are left.

        Unions are taken by height, of equal heights the earlier merge first. Pieces that touch
        nothing stay apart, so there are never fewer regions than roots, nor more than faces.

        Returns
        -------
        labels, count
            As of :meth:`cut_by_cost`.
        """
        if count < 1 and self.leaf_count:
            msg = f"count is {count}, expected 1 or more"
            raise ValueError(msg)
        kept = np.zeros(len(self.children), np.bool_)
        kept[np.argsort(self.height, kind="stable")[: max(self.leaf_count - count, 0)]] = True
        return self.cut(kept)

    def cut_by_size(self, most_faces: int, most: float = np.inf) -> tuple[Int32, int]:
        """Keep unions of at most ``most_faces`` faces and of height at most ``most``.

        Returns
        -------
        labels, count
            As of :meth:`cut_by_cost`. Every region lies within one of ``cut_by_cost(most)``.
        """
        kept = (self.faces[self.leaf_count :] <= most_faces) & (self.height <= most)
        return self.cut(kept)

    def cut(self, kept: Bool) -> tuple[Int32, int]:
        """Cut where ``kept`` says so.

        Parameters
        ----------
        kept : ndarray of shape (M,), bool
            Unions to keep. What lies under a kept union is united, whether kept itself or not.

        Returns
        -------
        labels, count
            As of :meth:`cut_by_cost`.
        """
        if len(kept) != len(self.children):
            msg = f"received {len(kept)} choices, expected one per merge ({len(self.children)})"
            raise ValueError(msg)
        labels, count = number_by_first(_tops(self.leaf_count, self.parents, kept))
        return labels, int(count)


def merge_tree(leaf_count: int, children: Int32, cost: Float64, area: Int64) -> MergeTree:
    """Complete a tree from its merges.

    Parameters
    ----------
    leaf_count : int
        F.
    children : ndarray of shape (M, 2), int32
        Nodes united by every merge.
    cost : ndarray of shape (M,), float64
    area : ndarray of shape (F,), int64
        Area of every face in steps.

    Returns
    -------
    MergeTree
    """
    parents, height, faces, whole = _complete(leaf_count, children, cost, area)
    return MergeTree(leaf_count, children, parents, cost, height, faces, whole)


@numba.njit(cache=True)
def _complete(
    leaf_count: int, children: Int32, cost: Float64, area: Int64
) -> tuple[Int32, Float64, Int32, Int64]:
    n_nodes = leaf_count + len(children)
    parents = np.full(n_nodes, -1, np.int32)
    height = cost.copy()
    faces = np.ones(n_nodes, np.int32)
    whole = np.empty(n_nodes, np.int64)
    whole[:leaf_count] = area
    # Children come before parents. Invariant: height[m] is at least that of everything below it,
    # so cutting the tree at a height gives whole subtrees.
    for m in range(len(children)):
        node = leaf_count + m
        a, b = children[m, 0], children[m, 1]
        parents[a] = node
        parents[b] = node
        faces[node] = faces[a] + faces[b]
        whole[node] = whole[a] + whole[b]
        if a >= leaf_count:
            height[m] = max(height[m], height[a - leaf_count])
        if b >= leaf_count:
            height[m] = max(height[m], height[b - leaf_count])
    return parents, height, faces, whole


@numba.njit(cache=True)
def _tops(leaf_count: int, parents: Int32, kept: Bool) -> Int32:
    """Highest kept union over every face, itself where there is none."""
    top = np.arange(len(parents)).astype(np.int32)
    for node in range(len(parents) - 1, -1, -1):
        above = parents[node]
        if above >= 0 and (kept[above - leaf_count] or top[above] != above):
            top[node] = top[above]
    return top[:leaf_count].copy()
