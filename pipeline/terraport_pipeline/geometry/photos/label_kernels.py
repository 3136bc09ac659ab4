"""Kernels of :mod:`terraport_pipeline.geometry.photos.view_labels`, which states the model.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float32, Int8, Int16, Int32, Int64, UInt16
from terraport_pipeline.geometry.mesh.face_vector import face_vector
from terraport_pipeline.geometry.photos.view_candidates import QUALITY_STEPS, SLOTS
from terraport_pipeline.geometry.photos.view_kernels import index_of_view

__all__ = ["best_slots", "common_slots", "costs", "energy", "neighbour_rows", "solve_piece"]

_MAX_CELL_VIEWS: Final = 64
"""Views weighed per cell; further ones cannot become the cell's."""

_UNIT: Final = 65535.0
"""Costs are kept as 16-bit parts of this."""


@numba.njit(cache=True, nogil=True)
def neighbour_rows(
    vertices: Float32, faces: Int32, pairs: Int32, edges: Int32
) -> tuple[Int32, Float32, Float32]:
    """Put neighbours, edge lengths and areas in rows by face."""
    n_faces = len(faces)
    rows = np.full((n_faces, 3), -1, np.int32)
    length = np.zeros((n_faces, 3), np.float32)
    area = np.empty(n_faces, np.float32)
    total = 0.0
    # (1) Rows of at most three neighbours. Invariant: g stands in the row of f if and only if f
    # stands in the row of g, also where more than two faces share an edge.
    for p in range(len(pairs)):
        a, b = edges[p, 0], edges[p, 1]
        square = 0.0
        for k in range(3):
            square += (np.float64(vertices[a, k]) - vertices[b, k]) ** 2
        edge = np.sqrt(square)
        total += edge
        f, g = pairs[p, 0], pairs[p, 1]
        if rows[f, 2] >= 0 or rows[g, 2] >= 0:
            continue  # both must know of each other, or neither
        for s in range(3):
            if rows[f, s] < 0:
                rows[f, s], length[f, s] = g, edge
                break
        for s in range(3):
            if rows[g, s] < 0:
                rows[g, s], length[g, s] = f, edge
                break
    # (2) Lengths and areas relative to their means: the weights do not depend on the mesh's unit.
    scale = len(pairs) / total if total > 0.0 else 1.0
    whole = 0.0
    for f in range(n_faces):
        nx, ny, nz = face_vector(vertices, faces, f)
        area[f] = np.sqrt(nx * nx + ny * ny + nz * nz)
        whole += area[f]
        for s in range(3):
            length[f, s] *= scale
    scale = n_faces / whole if whole > 0.0 else 1.0
    for f in range(n_faces):
        area[f] *= scale
    return rows, length, area


@numba.njit(cache=True, nogil=True)
def costs(views: Int16, values: UInt16, begin: int, end: int) -> None:
    """Turn qualities of faces begin..end into costs, in place."""
    for f in range(begin, end):
        best = 0
        for s in range(SLOTS):
            if views[f, s] >= 0:
                best = max(best, int(values[f, s]))
        for s in range(SLOTS):
            if views[f, s] < 0:
                values[f, s] = 65535
            else:
                below = best - int(values[f, s])
                values[f, s] = int(_UNIT * (1.0 - np.exp2(-below / QUALITY_STEPS)) + 0.5)


@numba.njit(cache=True, nogil=True)
def best_slots(views: Int16, costs: UInt16, slot: Int8, begin: int, end: int) -> None:
    """Give every face the place of least cost, the first of equal ones."""
    for f in range(begin, end):
        best = -1
        for s in range(SLOTS):
            if views[f, s] >= 0 and (best < 0 or costs[f, s] < costs[f, best]):
                best = s
        slot[f] = best


@numba.njit(cache=True, nogil=True)
def common_slots(
    views: Int16,
    costs: UInt16,
    area: Float32,
    order: Int32,
    starts: Int64,
    slot: Int8,
    begin: int,
    end: int,
) -> None:
    """Give the faces of every cell the view that saves most, where they have it."""
    seen = np.empty(_MAX_CELL_VIEWS, np.int64)
    saved = np.empty(_MAX_CELL_VIEWS)
    for cell in range(begin, end):
        n = 0
        # (1) What each view would save in the cell: area times what its cost is below the
        # highest.
        for i in range(starts[cell], starts[cell + 1]):
            f = order[i]
            for s in range(SLOTS):
                if views[f, s] < 0:
                    break
                index = index_of_view(seen, n, views[f, s])
                if index == n:
                    if n == _MAX_CELL_VIEWS:
                        continue
                    seen[n], saved[n] = views[f, s], 0.0
                    n += 1
                saved[index] += area[f] * (1.0 - costs[f, s] / _UNIT)
        if n == 0:
            continue
        # (2) The best view, where a face has it; the others keep their own.
        best = np.argmax(saved[:n])
        for i in range(starts[cell], starts[cell + 1]):
            f = order[i]
            for s in range(SLOTS):
                if views[f, s] == seen[best]:
                    slot[f] = s


@numba.njit(cache=True, nogil=True)
def energy(
    views: Int16,
    costs: UInt16,
    neighbour: Int32,
    length: Float32,
    area: Float32,
    slot: Int8,
    smoothness: float,
    begin: int,
    end: int,
) -> float:
    """Sum costs and seams of faces begin..end; an edge counts at its lower face.

    Parameters
    ----------
    views, costs : ndarray of shape (F, SLOTS)
        Candidates of every face and their costs, in units of 1 / ``_UNIT``.
    neighbour, length, area
        As :func:`neighbour_rows` returns them.
    slot : ndarray of shape (F,), int8
        Chosen slot, -1 none.
    smoothness : float
        Cost of a seam as long as the mean edge.
    begin, end : int
        Faces.
    """
    total = 0.0
    for f in range(begin, end):
        if slot[f] < 0:
            continue
        # (1) What the face's own view costs.
        total += area[f] * (costs[f, slot[f]] / _UNIT)
        # (2) Seams to neighbours of another view; the lower face pays for both, so chunks add up.
        mine = views[f, slot[f]]
        for s in range(3):
            g = neighbour[f, s]
            if g > f and slot[g] >= 0 and views[g, slot[g]] != mine:
                total += smoothness * length[f, s]
    return total


@numba.njit(cache=True, nogil=True)
def _grow_forest(
    slot: Int8, neighbour: Int32, round_number: int, first: int, last: int
) -> tuple[Int32, Int32]:
    """Pick faces of a piece that form a forest: parents before children, and each one's parent.

    A face is taken when exactly one of its neighbours is (its parent), or none and it begins a
    tree; a face that meets two would close a ring, and rests.
    """
    # (1) Faces without a view rest, and so do those with a neighbour outside the piece that has
    # one: pieces solved at the same time must not both change at a border.
    count = last - first
    state = np.zeros(count, np.uint8)  # 0 not seen, 1 taken, 2 rests
    for i in range(count):
        if slot[first + i] < 0:
            state[i] = 2
            continue
        for s in range(3):
            g = neighbour[first + i, s]
            if g >= 0 and not first <= g < last and slot[g] >= 0:
                state[i] = 2
    order = np.empty(count, np.int32)
    parent = np.empty(count, np.int32)
    queue = np.empty(3 * count + 1, np.int32)
    n = 0
    # (2) Trees, breadth first. Invariant: the taken faces form a forest, and a face's parent
    # stands before it in `order`.
    # each round begins elsewhere and turns the other way, so that other faces rest
    begin = (round_number * 7919) % count
    for k in range(count):
        seed = (begin + k) % count if round_number % 2 == 0 else (begin - k) % count
        if state[seed] != 0:
            continue
        head, tail = 0, 1
        queue[0] = seed
        while head < tail:
            i = queue[head]
            head += 1
            if state[i] != 0:
                continue
            above, met = -1, 0
            for s in range(3):
                g = neighbour[first + i, s] - first
                if 0 <= g < count and state[g] == 1:
                    above = g
                    met += 1
            if met > 1:
                state[i] = 2
                continue
            state[i] = 1
            order[n], parent[n] = i, above
            n += 1
            for t in range(3):
                s = (t + round_number) % 3
                g = neighbour[first + i, s] - first
                if 0 <= g < count and state[g] == 0:
                    queue[tail] = g
                    tail += 1
    return order[:n], parent[:n]


@numba.njit(cache=True, nogil=True)
def _edge_between(neighbour: Int32, length: Float32, f: int, g: int) -> float:
    total = 0.0
    for s in range(3):
        if neighbour[f, s] == g:
            total += length[f, s]
    return total


@numba.njit(cache=True, nogil=True)
def solve_piece(
    views: Int16,
    costs: UInt16,
    neighbour: Int32,
    length: Float32,
    area: Float32,
    old: Int8,
    slot: Int8,
    smoothness: float,
    round_number: int,
    first: int,
    last: int,
) -> None:
    """Best labels of a forest in faces first..last, the labels of all other faces given.

    Parameters
    ----------
    views, costs, neighbour, length, area, smoothness
        As for :func:`energy`.
    old : ndarray of shape (F,), int8
        Slots before the round; all that is read of other pieces.
    slot : ndarray of shape (F,), int8
        Slots after it; written in first..last only.
    round_number : int
        Chooses the forest.
    first, last : int
        Faces of the piece.
    """
    # Exact on the forest by dynamic programming: no labels of these faces, all others given, have
    # less energy. Invariant of (1): when face i is reached, total[i] holds the messages of all
    # its children, because children stand after their parents in `order`.
    order, parent = _grow_forest(old, neighbour, round_number, first, last)
    taken = np.zeros(last - first, np.bool_)
    for n in range(len(order)):
        taken[order[n]] = True
    total = np.zeros((last - first, SLOTS), np.float32)
    # (1) upwards: each face's costs, its resting neighbours' and its subtrees'
    for n in range(len(order) - 1, -1, -1):
        i = order[n]
        f = first + i
        for s in range(SLOTS):
            if views[f, s] < 0:
                total[i, s] = np.inf
            else:
                total[i, s] += area[f] * (costs[f, s] / _UNIT)
        for e in range(3):
            g = neighbour[f, e]
            if g < 0 or old[g] < 0 or (first <= g < last and taken[g - first]):
                continue
            theirs = views[g, old[g]]
            for s in range(SLOTS):
                if views[f, s] != theirs:
                    total[i, s] += smoothness * length[f, e]
        if parent[n] < 0:
            continue
        p = first + parent[n]
        least = total[i].min()
        seam = smoothness * _edge_between(neighbour, length, f, p)
        t = 0
        for s in range(SLOTS):  # both rows are sorted by view: one pass finds the common ones
            view = views[p, s]
            if view < 0:
                break
            message = seam
            while t < SLOTS and 0 <= views[f, t] < view:
                t += 1
            if t < SLOTS and views[f, t] == view:
                message = min(message, total[i, t] - least)
            total[parent[n], s] += message
    # (2) downwards: each face's best label given its parent's
    for n in range(len(order)):
        i = order[n]
        f = first + i
        best = old[f]  # stays where another is only as good
        for s in range(SLOTS):
            if views[f, s] >= 0 and total[i, s] < total[i, best]:
                best = s
        if parent[n] >= 0:
            p = first + parent[n]
            seam = smoothness * _edge_between(neighbour, length, f, p)
            theirs = views[p, slot[p]]
            for s in range(SLOTS):
                if views[f, s] == theirs and total[i, s] <= total[i, best] + seam:
                    best = s
                    break
        slot[f] = best
