"""Mutual-best rounds: all pairs of units that are each other's first choice are united at once.

A round is a linear pass over the graph, and nothing in it depends on the order of the pass: first
choices follow a strict order (``merge_order.py``), and mutual pairs have no unit in common.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numba
import numpy as np

from terraport_payload.types import Float64, Int32, Int64
from terraport_pipeline.geometry.regions.merge_order import merge_cost, scramble

__all__ = [
    "mutual_partners",
    "unite_partners",
]


@numba.njit(cache=True)
def mutual_partners(
    offsets: Int64,
    neighbours: Int32,
    border: Int64,
    perimeter: Int64,
    area: Int64,
    faces: Int32,
    name: Int32,
    most_faces: int,
) -> tuple[Int32, Float64]:
    """First choice of every unit where it is mutual, else -1; and the cost of that merge.

    Only unions of at most ``most_faces`` faces are considered.
    """
    count = len(offsets) - 1
    # (1) Every unit's cheapest merge; of equal ones that with the lower scrambled name.
    choice = np.full(count, -1, np.int32)
    cost = np.full(count, np.inf)
    for u in range(count):
        for e in range(offsets[u], offsets[u + 1]):
            v = neighbours[e]
            if faces[u] + faces[v] > most_faces:
                continue
            d = merge_cost(perimeter[u], area[u], perimeter[v], area[v], border[e])
            if d < cost[u] or (
                d == cost[u] and scramble(name[u], name[v]) < scramble(name[u], name[choice[u]])
            ):
                choice[u] = v
                cost[u] = d
    # (2) Mutual choices. Any order of merging them gives the same result: they are disjoint
    # pairs.
    partner = np.full(count, -1, np.int32)
    for u in range(count):
        if choice[u] >= 0 and choice[choice[u]] == u:
            partner[u] = choice[u]
    return partner, cost


@numba.njit(cache=True)
def unite_partners(
    partner: Int32,
    cost: Float64,
    node: Int32,
    area: Int64,
    faces: Int32,
    name: Int32,
    children: Int32,
    paid: Float64,
    n_faces: int,
    done: int,
) -> tuple[Int32, Int32, Int64, Int32, Int32]:
    """Unite mutual partners; merge ``done`` and the next are written to ``children`` and ``paid``.

    Parameters
    ----------
    partner, cost : ndarray of shape (U,)
        As :func:`mutual_partners` returns them.
    node, area, faces, name : ndarray of shape (U,)
        Node of the tree, area, number of faces and lowest face of every unit.
    children, paid : ndarray of shape (M, 2), (M,)
        The tree's merges and their costs; written from ``done`` on.
    n_faces : int
        Leaves of the tree: merge m is node ``n_faces + m``.
    done : int
        Merges before this round.

    Returns
    -------
    tuple
        The union of every unit, numbered by lowest unit, and every union's node, area, faces and
        name. Merges of one round are numbered by their lower unit.
    """
    # (1) How many units are left: a pair counts at its lower unit.
    count = 0
    for u in range(len(partner)):
        if partner[u] < 0 or partner[u] > u:
            count += 1
    nodes = np.empty(len(partner), np.int32)
    new_node = np.empty(count, np.int32)
    new_area = np.empty(count, np.int64)
    new_faces = np.empty(count, np.int32)
    new_name = np.empty(count, np.int32)
    # (2) Write them in order of their lower unit. Invariant: the unions of units 0..u-1 are
    # numbered 0..n-1, and merges before `done` are written. A partner is always read after the
    # unit it joined, since that one has the lower number.
    n = 0
    for u in range(len(partner)):
        v = partner[u]
        if 0 <= v < u:
            nodes[u] = nodes[v]
            continue
        nodes[u] = n
        new_node[n] = node[u]
        new_area[n] = area[u]
        new_faces[n] = faces[u]
        new_name[n] = name[u]
        if v >= 0:
            children[done, 0] = node[u]
            children[done, 1] = node[v]
            paid[done] = cost[u]
            new_node[n] = n_faces + done
            new_area[n] += area[v]
            new_faces[n] += faces[v]
            new_name[n] = min(name[u], name[v])
            done += 1
        n += 1
    return nodes, new_node, new_area, new_faces, new_name
