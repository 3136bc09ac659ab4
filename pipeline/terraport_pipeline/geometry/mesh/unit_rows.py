"""Neighbours of pieces as CSR rows: made from pairs, contracted, summed.

Three arrays make the rows: ``offsets`` (U+1,) int64 row starts, ``neighbours`` (E,) int32, and
``border`` (E,) int64, the border with each neighbour in whole steps. Every contact stands in both
rows. Whole numbers make sums exact, so that nothing depends on the order of summation.

PURE: no I/O, no clock. Everything is linear in the contacts.
"""

from __future__ import annotations

import numba
import numpy as np

from terraport_payload.types import Int32, Int64
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input

__all__ = [
    "combine_rows",
    "contract_rows",
    "pairs_of_rows",
    "row_sums",
    "rows_of_labels",
    "rows_of_pairs",
]


def rows_of_pairs(count: int, pairs: Int32, weight: Int64) -> tuple[Int64, Int32, Int64]:
    """Rows of ``count`` pieces from pairs that each occur once."""
    return rows_of_labels(np.arange(count, dtype=np.int32), count, pairs, weight)


def contract_rows(
    offsets: Int64, neighbours: Int32, border: Int64, nodes: Int32, count: int
) -> tuple[Int64, Int32, Int64]:
    """Rows between unions: ``nodes[u]`` is the union of unit u; borders of like pairs are added.

    Each neighbour stands once, ascending.
    """
    rows: tuple[Int64, Int32, Int64] = combine_rows(
        *_rows_of_unions(offsets, neighbours, border, nodes, count)
    )
    return rows


def rows_of_labels(
    labels: Int32, count: int, pairs: Int32, lengths: Int64
) -> tuple[Int64, Int32, Int64]:
    """Rows of labelled pieces from pairs of items; a neighbour stands once per pair."""
    rows: tuple[Int64, Int32, Int64] = _rows_of_labels(
        labels, count, as_kernel_input(pairs, np.int32), lengths
    )
    return rows


@numba.njit(cache=True, nogil=True)
def _rows_of_labels(
    labels: Int32, count: int, pairs: Int32, lengths: Int64
) -> tuple[Int64, Int32, Int64]:
    offsets = np.zeros(count + 1, np.int64)
    for i in range(len(pairs)):
        a, b = labels[pairs[i, 0]], labels[pairs[i, 1]]
        if a != b:
            offsets[a + 1] += 1
            offsets[b + 1] += 1
    for u in range(count):
        offsets[u + 1] += offsets[u]
    neighbours = np.empty(offsets[count], np.int32)
    border = np.empty(offsets[count], np.int64)
    cursor = offsets[:-1].copy()
    for i in range(len(pairs)):
        a, b = labels[pairs[i, 0]], labels[pairs[i, 1]]
        if a != b:
            neighbours[cursor[a]] = b
            border[cursor[a]] = lengths[i]
            cursor[a] += 1
            neighbours[cursor[b]] = a
            border[cursor[b]] = lengths[i]
            cursor[b] += 1
    return offsets, neighbours, border


@numba.njit(cache=True, nogil=True)
def _rows_of_unions(
    offsets: Int64, neighbours: Int32, border: Int64, nodes: Int32, count: int
) -> tuple[Int64, Int32, Int64]:
    new = np.zeros(count + 1, np.int64)
    for u in range(len(offsets) - 1):
        for e in range(offsets[u], offsets[u + 1]):
            if nodes[neighbours[e]] != nodes[u]:
                new[nodes[u] + 1] += 1
    for u in range(count):
        new[u + 1] += new[u]
    kept = np.empty(new[count], np.int32)
    weight = np.empty(new[count], np.int64)
    cursor = new[:-1].copy()
    for u in range(len(offsets) - 1):
        node = nodes[u]
        for e in range(offsets[u], offsets[u + 1]):
            if nodes[neighbours[e]] != node:
                kept[cursor[node]] = nodes[neighbours[e]]
                weight[cursor[node]] = border[e]
                cursor[node] += 1
    return new, kept, weight


@numba.njit(cache=True, nogil=True)
def combine_rows(offsets: Int64, neighbours: Int32, border: Int64) -> tuple[Int64, Int32, Int64]:
    """Sort every row by neighbour and add the borders of equal neighbours.

    The graph is symmetric, so writing it out transposed gives the same graph; and rows of a
    transposed graph come out sorted, because the source rows are gone through in order.
    """
    count = len(offsets) - 1
    new = np.zeros(count + 1, np.int64)
    kept = np.empty(len(neighbours), np.int32)
    weight = np.empty(len(neighbours), np.int64)
    cursor = offsets[:-1].copy()
    for u in range(count):
        for e in range(offsets[u], offsets[u + 1]):
            v = neighbours[e]
            if cursor[v] > offsets[v] and kept[cursor[v] - 1] == u:
                weight[cursor[v] - 1] += border[e]
            else:
                kept[cursor[v]] = u
                weight[cursor[v]] = border[e]
                cursor[v] += 1
    write = 0
    for u in range(count):  # close the gaps that equal neighbours left
        for e in range(offsets[u], cursor[u]):
            kept[write] = kept[e]
            weight[write] = weight[e]
            write += 1
        new[u + 1] = write
    return new, kept[:write].copy(), weight[:write].copy()


@numba.njit(cache=True, nogil=True)
def pairs_of_rows(offsets: Int64, neighbours: Int32, border: Int64) -> tuple[Int32, Int64]:
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


@numba.njit(cache=True, nogil=True)
def row_sums(offsets: Int64, border: Int64) -> Int64:
    """Sum up the borders of every unit: its perimeter, in steps."""
    perimeter = np.zeros(len(offsets) - 1, np.int64)
    for u in range(len(perimeter)):
        for e in range(offsets[u], offsets[u + 1]):
            perimeter[u] += border[e]
    return perimeter
