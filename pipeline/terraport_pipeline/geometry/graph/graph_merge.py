"""From faces to the whole merge tree: rounds at the bottom, exact greedy order above.

1. Borders between faces are weighed (``face_graph.py``).
2. *Seeds.* Rounds of mutual-best merges unite faces to pieces of at most ``seed_faces`` faces.
3. Borders between the pieces are weighed anew, by the mean normals and colours of whole pieces:
   noise of single faces is averaged away. Steps 2 and 3 repeat for every entry of ``seed_faces``.
4. The pieces are merged by a heap, always the first in the order, until only pieces are left that
   touch nothing.

Why rounds: on 5 M faces the heap alone would do some 40 M updates that each miss the cache, where a
round is a linear pass. ``seed_faces=()`` leaves the rounds out; ``docs/topics/segmentation.md`` has
what the two cost and how little they differ.

PURE: no I/O, no clock. Time O(F + S log S) for S seeds; peak about 250 bytes per face.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Int32
from terraport_pipeline.geometry.graph.border_weights import border_weights
from terraport_pipeline.geometry.graph.face_graph import (
    FaceGraph,
    sum_areas,
    sum_facts,
)
from terraport_pipeline.geometry.graph.graph_options import EdgeWeights
from terraport_pipeline.geometry.graph.merge_heap import merge_by_heap, record_merges, unite_units
from terraport_pipeline.geometry.graph.merge_rounds import mutual_partners, unite_partners
from terraport_pipeline.geometry.graph.merge_tree import MergeTree, merge_tree
from terraport_pipeline.geometry.mesh.unit_rows import (
    contract_rows,
    pairs_of_rows,
    row_sums,
    rows_of_pairs,
)
from terraport_pipeline.geometry.regions.pool_refine import number_by_first

__all__ = ["MergedGraph", "join_small", "merge_faces"]


_WORTHWHILE: Final = 32
"""Rounds end when one unites fewer than one unit in this many: what is left is the heap's."""


@dataclass(frozen=True, slots=True, eq=False)
class MergedGraph:
    """The tree, and what was measured while it grew."""

    tree: MergeTree
    seed_count: int
    """Units that the heap began with."""
    colour_scale: float
    """CIELAB difference at which the heap's borders weighed 1/e; 0 without colour."""


def merge_faces(
    graph: FaceGraph, weights: EdgeWeights, seed_faces: tuple[int, ...] = ()
) -> MergedGraph:
    """Merge all faces that hang together.

    Parameters
    ----------
    graph : FaceGraph
    weights : EdgeWeights
        How borders are weighed.
    seed_faces : tuple of int
        Most faces of a seed at every level, ascending; empty: the heap from the faces on.

    Returns
    -------
    MergedGraph
        Costs are scale-free: in units of one over the root of the whole area.
    """
    n_faces = len(graph.area)
    children = np.empty((max(n_faces - 1, 0), 2), np.int32)
    cost = np.empty(max(n_faces - 1, 0), np.float64)
    done = 0
    area, name, facts = graph.area, np.arange(n_faces, dtype=np.int32), graph.facts
    node = np.arange(n_faces, dtype=np.int32)  # the tree's node of every unit
    pairs, length = graph.pairs, graph.length
    # Invariant of all steps: the first `done` rows of `children` and `cost` are merges in their
    # order; every unit is one node of the tree, and pairs, length, area, facts and name describe
    # exactly the units that are left.
    # (1) rounds, level by level
    for most_faces in seed_faces:
        border, _ = border_weights(pairs, length, facts, weights)
        rows = rows_of_pairs(len(area), pairs, border)
        unit = np.arange(len(area), dtype=np.int32)  # where every unit of this level has gone
        level = (len(area), facts)
        perimeter = row_sums(rows[0], rows[2])
        faces = facts.faces
        while True:
            partner, paid = mutual_partners(*rows, perimeter, area, faces, name, most_faces)
            united = int(np.count_nonzero(partner >= 0)) // 2
            if united == 0:
                break
            nodes, node, area, faces, name = unite_partners(
                partner, paid, node, area, faces, name, children, cost, n_faces, done
            )
            done += united
            rows = contract_rows(*rows, nodes, len(area))
            perimeter = row_sums(rows[0], rows[2])
            unit = nodes[unit]
            if united * _WORTHWHILE < len(nodes):
                break
        facts = sum_facts(level[1], unit, len(area))
        # Colours and normals count anew at every level: within one, borders keep the weights of
        # its start.
        # lengths between the new units
        lengths = contract_rows(*rows_of_pairs(level[0], pairs, length), unit, len(area))
        pairs, length = pairs_of_rows(*lengths)
    # (2) heap
    border, colour_scale = border_weights(pairs, length, facts, weights)
    seed_count = len(area)
    offsets, _, both = rows_of_pairs(seed_count, pairs, border)
    perimeter = row_sums(offsets, both)
    merged, paid = merge_by_heap(
        pairs.reshape(-1).copy(), border, perimeter, area.copy(), name.copy(),
        np.iinfo(np.int64).max,
    )  # fmt: skip
    last = done + len(merged)
    cost[done:last] = paid
    record_merges(merged, node.copy(), children[done:last], n_faces + done)
    tree = merge_tree(n_faces, children[:last], cost[:last] * graph.scale, graph.area)
    return MergedGraph(tree, seed_count, colour_scale)


def join_small(
    graph: FaceGraph, weights: EdgeWeights, labels: Int32, count: int, small_share: float
) -> tuple[Int32, int]:
    """Let regions below a share of the whole area join a neighbour.

    Merges between regions in the usual order, only those in which one is small, until no small
    region touches another: the share is a lower bound, but for pieces that touch nothing.

    Parameters
    ----------
    graph, weights
        As for :func:`merge_faces`; borders are weighed between whole regions.
    labels : ndarray of shape (F,), int32
        Region of every face, 0..count-1, numbered by first face.
    count : int
    small_share : float
        0..1.

    Returns
    -------
    labels, count
        Numbered by first face; every region given lies within one returned.
    """
    small_area = int(np.ceil(small_share * float(graph.area.sum())))
    if count < 2 or small_area <= 1:
        return labels, count
    rows = contract_rows(
        *rows_of_pairs(len(labels), graph.pairs, graph.length),
        labels, count,
    )  # fmt: skip
    pairs, length = pairs_of_rows(*rows)
    border, _ = border_weights(pairs, length, sum_facts(graph.facts, labels, count), weights)
    offsets, _, both = rows_of_pairs(count, pairs, border)
    area = sum_areas(graph.area, labels, count)
    name = np.arange(count, dtype=np.int32)
    merged, _ = merge_by_heap(
        pairs.reshape(-1).copy(), border, row_sums(offsets, both), area, name, small_area
    )
    union = np.arange(count, dtype=np.int32)
    unite_units(merged, union)
    joined, left = number_by_first(union[labels])
    return joined, left
