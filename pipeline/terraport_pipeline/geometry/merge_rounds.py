"""Mutual-best rounds: all pairs of units that are each other's first choice are united at once.

A round is a linear pass over the graph, and nothing in it depends on the order of the pass: first
choices follow a strict order (``merge_order.py``), and mutual pairs have no unit in common.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from terraport_pipeline.geometry.merge_order import merge_cost, scramble

__all__ = [
    "contract_rows",
    "mutual_partners",
    "pairs_of_rows",
    "row_sums",
    "rows_of_pairs",
    "unite_partners",
]

_Float64 = npt.NDArray[np.float64]
_Int32 = npt.NDArray[np.int32]
_Int64 = npt.NDArray[np.int64]


@numba.njit(cache=True)
def rows_of_pairs(count: int, pairs: _Int32, weight: _Int64) -> tuple[_Int64, _Int32, _Int64]:
    """Neighbours of every unit as CSR rows from pairs that each occur once."""
    offsets = np.zeros(count + 1, np.int64)
    for i in range(len(pairs)):
        offsets[pairs[i, 0] + 1] += 1
        offsets[pairs[i, 1] + 1] += 1
    for u in range(count):
        offsets[u + 1] += offsets[u]
    neighbours = np.empty(offsets[count], np.int32)
    border = np.empty(offsets[count], np.int64)
    cursor = offsets[:-1].copy()
    for i in range(len(pairs)):
        a, b = pairs[i, 0], pairs[i, 1]
        neighbours[cursor[a]] = b
        border[cursor[a]] = weight[i]
        cursor[a] += 1
        neighbours[cursor[b]] = a
        border[cursor[b]] = weight[i]
        cursor[b] += 1
    return offsets, neighbours, border


@numba.njit(cache=True)
def pairs_of_rows(offsets: _Int64, neighbours: _Int32, border: _Int64) -> tuple[_Int32, _Int64]:
    """Every pair of neighbours once, lower unit first, and its border."""
    pairs = np.empty((len(neighbours) // 2, 2), np.int32)
    weight = np.empty(len(neighbours) // 2, np.int64)
    write = 0
    for u in range(len(offsets) - 1):
        for e in range(offsets[u], offsets[u + 1]):
            if neighbours[e] > u:
                pairs[write, 0] = u
                pairs[write, 1] = neighbours[e]
                weight[write] = border[e]
                write += 1
    return pairs, weight


@numba.njit(cache=True)
def row_sums(offsets: _Int64, border: _Int64) -> _Int64:
    """Perimeter of every unit."""
    perimeter = np.zeros(len(offsets) - 1, np.int64)
    for u in range(len(perimeter)):
        for e in range(offsets[u], offsets[u + 1]):
            perimeter[u] += border[e]
    return perimeter


@numba.njit(cache=True)
def mutual_partners(
    offsets: _Int64,
    neighbours: _Int32,
    border: _Int64,
    perimeter: _Int64,
    area: _Int64,
    faces: _Int32,
    name: _Int32,
    most_faces: int,
) -> tuple[_Int32, _Float64]:
    """First choice of every unit where it is mutual, else -1; and the cost of that merge.

    Only unions of at most ``most_faces`` faces are considered.
    """
    count = len(offsets) - 1
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
    partner = np.full(count, -1, np.int32)
    for u in range(count):
        if choice[u] >= 0 and choice[choice[u]] == u:
            partner[u] = choice[u]
    return partner, cost


@numba.njit(cache=True)
def unite_partners(
    partner: _Int32,
    cost: _Float64,
    node: _Int32,
    area: _Int64,
    faces: _Int32,
    name: _Int32,
    children: _Int32,
    paid: _Float64,
    n_faces: int,
    done: int,
) -> tuple[_Int32, _Int32, _Int64, _Int32, _Int32]:
    """Unite mutual partners; merge ``done`` and the next are written to ``children`` and ``paid``.

    Returns the union of every unit, numbered by lowest unit, and every union's node, area, faces
    and name. Merges of one round are numbered by their lower unit.
    """
    count = 0
    for u in range(len(partner)):
        if partner[u] < 0 or partner[u] > u:
            count += 1
    nodes = np.empty(len(partner), np.int32)
    new_node = np.empty(count, np.int32)
    new_area = np.empty(count, np.int64)
    new_faces = np.empty(count, np.int32)
    new_name = np.empty(count, np.int32)
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


@numba.njit(cache=True)
def contract_rows(
    offsets: _Int64, neighbours: _Int32, border: _Int64, nodes: _Int32, count: int
) -> tuple[_Int64, _Int32, _Int64]:
    """Rows between unions: ``nodes[u]`` is the union of unit u; borders of like pairs are added."""
    n_units = len(offsets) - 1
    first = np.zeros(count + 1, np.int64)
    for u in range(n_units):
        first[nodes[u] + 1] += 1
    for n in range(count):
        first[n + 1] += first[n]
    members = np.empty(n_units, np.int32)
    cursor = first[:-1].copy()
    for u in range(n_units):
        members[cursor[nodes[u]]] = u
        cursor[nodes[u]] += 1
    new = np.zeros(count + 1, np.int64)
    kept = np.empty(len(neighbours), np.int32)
    weight = np.empty(len(neighbours), np.int64)
    place = np.full(count, -1, np.int64)  # where this row already has a neighbour
    write = 0
    for n in range(count):
        start = write
        for m in range(first[n], first[n + 1]):
            u = members[m]
            for e in range(offsets[u], offsets[u + 1]):
                v = nodes[neighbours[e]]
                if v == n:
                    continue
                if place[v] >= start:
                    weight[place[v]] += border[e]
                else:
                    place[v] = write
                    kept[write] = v
                    weight[write] = border[e]
                    write += 1
        new[n + 1] = write
    return new, kept[:write].copy(), weight[:write].copy()
