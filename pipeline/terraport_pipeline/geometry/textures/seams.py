"""Where faces of different photos meet, and how much the photos differ there.

A *node* is a vertex as one photo sees it: a vertex has one node for each view that colours a face
around it, usually one, at a seam two or more. Corrections belong to nodes, so they are continuous
inside every chart and free to differ across a seam.

The difference of two photos at a seam is measured on the same faces in both: on the faces of both
sides that have both views among their candidates. (Waechter, Moehrle, Goesele, ECCV 2014, section
4.3.1, average each photo along the seam's edges; comparing whole faces needs no second reading of
the photos, and a pixel of error in the cameras matters less.) Where no face is seen by both, the
two sides' own colours are compared, with little weight. A face that took a neighbour's photo
(:mod:`terraport_pipeline.geometry.textures.small_charts`) has no colour in it: it says nothing.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Float32, Int16, Int32, UInt8
from terraport_pipeline.geometry.photos.photo_samples import SRGB_OFFSET
from terraport_pipeline.geometry.photos.view_candidates import SLOTS, Candidates

__all__ = ["Nodes", "Seams", "find_seams", "label_nodes"]

_UNSHARED: Final = 0.2
"""Weight of an edge whose two faces have no view in common."""

_TRUSTED_STEP: Final = 12.0
"""Steps of this many levels count half: small ones are exposure, large ones are two photos that
show different things, which no correction should hide in their surroundings."""

_MAX_STEP: Final = 48.0
"""Larger differences, in levels, count as this: two photos that differ by more show different
things."""


@dataclass(frozen=True, slots=True, eq=False)
class Nodes:
    """N nodes: vertices, once for every view that colours a face around them."""

    corner: Int32
    """(F, 3) node of every corner."""
    vertex: Int32
    """(N,) vertex of every node; node v < V belongs to vertex v."""
    view: Int32
    """(N,) view of every node, -1 for vertex colours; -2 for vertices without faces."""


@dataclass(frozen=True, slots=True, eq=False)
class Seams:
    """Edges between faces of different views; S of them."""

    face: Int32
    """(S, 2) the two faces."""
    node: Int32
    """(S, 2, 2) nodes of the edge's two ends (second axis), on the first and the second face's side
    (last axis)."""
    step: Float32
    """(S, 3) first view's level minus the second's, after gains, clipped to 48 levels."""
    raw_step: Float32
    """(S, 3) the same without gains and not clipped."""
    weight: Float32
    """(S,) length over the mean edge of the seams, or over another unit; 0 where a side's colour is
    not known."""
    trust: Float32
    """(S,) how far the step is one of exposure, 0..1: less where it is large, and where no face is
    seen by both."""


def label_nodes(faces: Int32, view: Int32, n_vertices: int) -> Nodes:
    """Give every vertex a number for each view around it.

    Parameters
    ----------
    faces : ndarray of shape (F, 3), int32
    view : ndarray of shape (F,), int32
        Chosen view of every face.
    n_vertices : int

    Examples
    --------
    Two faces of different views share the edge (1, 2), so vertices 1 and 2 have two nodes each.

    >>> faces = np.array([[0, 1, 2], [2, 1, 3]], np.int32)
    >>> nodes = label_nodes(faces, np.array([7, 8], np.int32), 4)
    >>> nodes.corner.tolist(), nodes.view.tolist()
    ([[0, 1, 2], [4, 5, 3]], [7, 7, 7, 8, 8, 8])
    """
    return Nodes(*_label_nodes(faces, view, n_vertices))


def find_seams(
    nodes: Nodes,
    faces: Int32,
    view: Int32,
    candidates: Candidates,
    own_colour: UInt8,
    gain_of_slot: Float32,
    pairs: Int32,
    edges: Int32,
    vertices: Float32,
    *,
    unit_m: float | None = None,
) -> Seams:
    """Find the seams and measure them.

    Parameters
    ----------
    nodes : Nodes
    faces : ndarray of shape (F, 3), int32
    view : ndarray of shape (F,), int32
    candidates : Candidates
        Sorted by view.
    own_colour : ndarray of shape (F, 3), uint8
        Faces' vertex colours after their gain: what view -1 shows.
    gain_of_slot : ndarray of shape (n_views + 1, 3), float32
        Gains h, to undo them for ``raw_step``.
    pairs, edges : ndarray of shape (P, 2), int32
        From :func:`terraport_pipeline.geometry.mesh.adjacency.face_pairs`.
    vertices : ndarray of shape (V, 3), float32
    unit_m : float, optional
        Length of an edge of weight 1, the mean of all seams by default: one number for all pieces
        of a surface.

    Returns
    -------
    Seams
        In the order of the pairs.
    """
    rows = np.flatnonzero(view[pairs[:, 0]] != view[pairs[:, 1]])
    return Seams(
        *_measure_seams(
            nodes.corner, faces, view, candidates.view, candidates.colour, own_colour,
            gain_of_slot, pairs[rows], edges[rows], vertices, 0.0 if unit_m is None else unit_m,
        )
    )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def _label_nodes(faces: Int32, view: Int32, n_vertices: int) -> tuple[Int32, Int32, Int32]:
    # Invariant: node v < n_vertices is vertex v in the view that came first; further views of a
    # vertex are a linked list from following[v]. Usually there is none, so memory is that of the
    # vertices.
    first = np.full(n_vertices, -2, np.int32)
    following = np.full(n_vertices, -1, np.int32)  # next node of the same vertex
    corner = np.empty((len(faces), 3), np.int32)
    room = n_vertices + 1024
    vertex = np.empty(room, np.int32)
    label = np.empty(room, np.int32)
    link = np.empty(room, np.int32)
    for v in range(n_vertices):
        vertex[v] = v
    count = n_vertices
    for f in range(len(faces)):
        for c in range(3):
            v = faces[f, c]
            if first[v] == -2 or first[v] == view[f]:
                first[v] = view[f]
                corner[f, c] = v
                continue
            node = following[v]
            while node >= 0 and label[node] != view[f]:
                node = link[node]
            if node < 0:
                if count == room:
                    room += room // 2
                    vertex = _grown(vertex, room)
                    label = _grown(label, room)
                    link = _grown(link, room)
                node = count
                count += 1
                vertex[node], label[node], link[node] = v, view[f], following[v]
                following[v] = node
            corner[f, c] = node
    label[:n_vertices] = first
    return corner, vertex[:count].copy(), label[:count].copy()


@numba.njit(cache=True, nogil=True)
def _grown(array: Int32, room: int) -> Int32:
    larger = np.empty(room, np.int32)
    larger[: len(array)] = array
    return larger


@numba.njit(cache=True, nogil=True)
def _slot_of(views: Int16, f: int, view: int) -> int:
    """Place of a view among a face's candidates; SLOTS for the vertex colours, -1: not there."""
    if view < 0:
        return SLOTS
    for s in range(SLOTS):
        if views[f, s] == view:
            return s
    return -1


@numba.njit(cache=True, nogil=True)
def _level(colour: UInt8, own: UInt8, f: int, slot: int, k: int) -> float:
    return np.float64(own[f, k]) if slot == SLOTS else np.float64(colour[f, slot, k])


@numba.njit(cache=True, nogil=True)
def _measure_seams(
    corner: Int32,
    faces: Int32,
    view: Int32,
    views: Int16,
    colour: UInt8,
    own: UInt8,
    gains: Float32,
    pairs: Int32,
    edges: Int32,
    vertices: Float32,
    unit_m: float,
) -> tuple[Int32, Int32, Float32, Float32, Float32, Float32]:
    """Measure the edges of `pairs`; the fields of :class:`Seams`.

    Parameters
    ----------
    corner : ndarray of shape (F, 3), int32
        Node of every corner.
    faces, vertices : ndarray
        The mesh, metres.
    view : ndarray of shape (F,), int32
        Chosen view, -1 for vertex colours.
    views, colour : ndarray of shape (F, SLOTS), (F, SLOTS, 3)
        Candidates sorted by view, and the face's colour in each.
    own : ndarray of shape (F, 3), uint8
        Vertex colours of the faces.
    gains : ndarray of shape (n_views + 1, 3), float32
        To undo for the raw step.
    pairs, edges : ndarray of shape (S, 2), int32
        Faces of different views, and the edge between them.
    unit_m : float
        Length that weighs 1; 0 for the mean of these edges.
    """
    n = len(pairs)
    node = np.empty((n, 2, 2), np.int32)
    step = np.zeros((n, 3), np.float32)
    raw = np.zeros((n, 3), np.float32)
    weight = np.empty(n, np.float32)
    trust = np.empty(n, np.float32)
    measured = np.ones(n, np.bool_)
    total = 0.0
    for p in range(n):
        # (1) Length of the edge, and the node at each of its ends on each side.
        square = 0.0
        for k in range(3):
            square += (np.float64(vertices[edges[p, 0], k]) - vertices[edges[p, 1], k]) ** 2
        weight[p] = np.sqrt(square)
        total += weight[p]
        for side in range(2):
            f = pairs[p, side]
            for c in range(3):
                for end in range(2):
                    if faces[f, c] == edges[p, end]:
                        node[p, end, side] = corner[f, c]
        # (2) Step between the photos on the faces that both see; `raw` is the same without the
        # gains.
        one, two = view[pairs[p, 0]], view[pairs[p, 1]]
        shared, few = 0, 1.0
        for side in range(2):
            f = pairs[p, side]
            s, t = _slot_of(views, f, one), _slot_of(views, f, two)
            if s < 0 or t < 0:
                continue
            shared += 1
            for k in range(3):
                a, b = _level(colour, own, f, s, k), _level(colour, own, f, t, k)
                step[p, k] += a - b
                raw[p, k] += (a + SRGB_OFFSET) / gains[one, k] - (b + SRGB_OFFSET) / gains[two, k]
        # (3) No such face: each side's own colour in its own photo, with little trust.
        if shared == 0:
            shared = 1
            few = _UNSHARED
            s = _slot_of(views, pairs[p, 0], one)
            t = _slot_of(views, pairs[p, 1], two)
            if s < 0 or t < 0:
                measured[p], trust[p] = False, 0.0
                continue
            for k in range(3):
                a = _level(colour, own, pairs[p, 0], s, k)
                b = _level(colour, own, pairs[p, 1], t, k)
                step[p, k] = a - b
                raw[p, k] = (a + SRGB_OFFSET) / gains[one, k] - (b + SRGB_OFFSET) / gains[two, k]
        # (4) Means, clipped; large steps are mostly things that only one photo shows, so trust
        # falls.
        square = 0.0
        for k in range(3):
            step[p, k] = min(max(step[p, k] / shared, -_MAX_STEP), _MAX_STEP)
            raw[p, k] /= shared
            square += np.float64(step[p, k]) ** 2 / 3.0
        trust[p] = few / (1.0 + square / (_TRUSTED_STEP * _TRUSTED_STEP))
    # (5) Lengths relative to their mean, or to the unit given, where tiles must agree on one.
    # Edges that say nothing weigh nothing.
    scale = n / total if total > 0.0 else 1.0
    if unit_m > 0.0:
        scale = 1.0 / unit_m
    for p in range(n):
        weight[p] = weight[p] * scale if measured[p] else 0.0
    return pairs.astype(np.int32), node, step, raw, weight, trust
