"""The graph that the graph engine merges: faces (or pieces of them), their borders and facts.

Everything summed later is held in whole steps of a fixed fraction of the largest value, so that
sums are exact: no result depends on their order, hence none on the numbering of the vertices. What
is averaged over a piece (normal, centre, CIELAB colour) is averaged over its faces, each counting
once.

PURE: no I/O, no clock. Time linear in the faces.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numba
import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float32, Float64, Int16, Int32, Int64, UInt8
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input
from terraport_pipeline.geometry.regions.colour import face_lab

__all__ = [
    "LAB_STEPS",
    "FaceGraph",
    "UnitFacts",
    "face_graph",
    "smooth_colours",
    "sum_areas",
    "sum_facts",
]


_STEPS: Final = 2.0**30
"""Steps in the longest edge and in the largest face: 2^33 of either fit an int64 sum."""
_NORMAL_STEPS: Final = 2.0**14
"""Steps in a unit normal: 16 bits hold it, and it is good to 0.004 degrees."""
_PLACE_STEPS: Final = 2.0**24
"""Steps in the longest side of the mesh's box: the resolution of float32."""
LAB_STEPS: Final = 64.0
"""Steps in one unit of CIELAB: far below the width of an 8-bit grey level (0.4)."""


@dataclass(frozen=True, slots=True, eq=False)
class UnitFacts:
    """What borders are weighed by; row u belongs to unit u, sums over its faces."""

    faces: Int32
    """(U,) number of faces."""
    normal: AnyInt
    """(U, 3) unit normals in steps."""
    centre: AnyInt
    """(U, 3) centres in steps from the box's least corner."""
    lab: AnyInt | None
    """(U, 3) CIELAB colours in steps; None without colour."""


@dataclass(frozen=True, slots=True, eq=False)
class FaceGraph:
    """Faces as units, and which of them share edges."""

    pairs: Int32
    """(P, 2) neighbouring faces, each pair once, lower first."""
    length: Int64
    """(P,) summed length of the edges that a pair shares, in steps, >= 1."""
    area: Int64
    """(F,) area in steps, >= 1."""
    facts: UnitFacts
    """(F,) rows."""
    scale: float
    """A cost in steps times this is scale-free: multiplied by the root of the whole area."""


def face_graph(
    vertices: AnyFloat,
    faces: AnyInt,
    *,
    colours: UInt8 | None = None,
    scalar: AnyFloat | None = None,
    pairs: Int32 | None = None,
) -> FaceGraph:
    """Measure faces and their borders.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Any one unit; finite.
    faces : ndarray of shape (F, 3), integer
        Vertex indices. F may be 0. Repeated and zero-area faces are allowed.
    colours : ndarray of shape (V, 3), uint8, optional
        sRGB.
    scalar : ndarray of shape (F,), float, optional
        A finite value per face that stands for the colour; its range is stretched to 0..100, like a
        hue, so that the lightness weight leaves it alone.
    pairs : ndarray of shape (P, 2), int32, optional
        Pairs of :func:`face_pairs` where the caller has them.

    Returns
    -------
    FaceGraph

    Raises
    ------
    ValueError
        Vertices that are not finite, indices outside them.
    """
    # (1) Refuse what has no geometry; an empty mesh is a graph without nodes.
    if not np.isfinite(vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
        msg = f"vertex {bad} is {vertices[bad].tolist()}, expected finite coordinates"
        raise ValueError(msg)
    if pairs is None:
        pairs = face_pairs(faces, len(vertices))[0]
    if len(faces) == 0:
        none = np.zeros(0, np.int64)
        empty = np.zeros((0, 3), np.int32)
        facts = UnitFacts(np.zeros(0, np.int32), empty, empty, None if colours is None else empty)
        return FaceGraph(pairs, none, none, facts, 1.0)
    # (2) Areas, normals and centres of faces, lengths of borders; float64 sums of float32 input.
    corners = as_kernel_input(vertices, np.float32)
    triangles = as_kernel_input(faces, np.int32)
    low = corners.min(axis=0).astype(np.float64)
    side = float((corners.max(axis=0) - low).max()) or 1.0
    area, normal, centre = _measure_faces(corners, triangles, low, side)
    length = _measure_borders(corners, triangles, as_kernel_input(pairs, np.int32))
    largest = float(area.max())
    longest = float(length.max()) if len(length) else 0.0
    # (3) Whole steps of the largest, at least 1: integers add up alike in any order of merging,
    # which the same tree on every machine needs.
    area_steps = _in_steps(area, largest)
    lab: Int16 | None = None
    if scalar is not None:
        lab = _scalar_as_hue(scalar)
    elif colours is not None:
        lab = face_lab(colours, faces, LAB_STEPS)
    ones = np.ones(len(faces), np.int32)
    # steps of length per step of area, times the root of the whole area; sum of exact integers
    scale = 1.0
    if largest > 0.0 and longest > 0.0:
        whole = float(area_steps.sum()) * (largest / _STEPS)
        scale = (longest / largest) * float(np.sqrt(whole))
    return FaceGraph(
        pairs, _in_steps(length, longest), area_steps, UnitFacts(ones, normal, centre, lab), scale
    )


def smooth_colours(graph: FaceGraph, rounds: int) -> FaceGraph:
    """Average every face's colour with its neighbours', ``rounds`` times; noise goes first.

    In whole steps, rounded half up after each round, so that the order of neighbours has no effect.
    Every round reaches one face farther; borders blur as far.
    """
    lab = graph.facts.lab
    if lab is None or rounds == 0 or len(lab) == 0:
        return graph
    pairs = as_kernel_input(graph.pairs, np.int32)
    for _ in range(rounds):
        lab = _smooth(as_kernel_input(lab, np.int16), pairs)
    return replace(graph, facts=replace(graph.facts, lab=lab))


def sum_facts(facts: UnitFacts, nodes: Int32, count: int) -> UnitFacts:
    """Facts of unions: ``nodes[u]`` is the union of unit u."""
    lab = facts.lab
    return UnitFacts(
        _sum_counts(facts.faces, nodes, count),
        _sum_rows(facts.normal, nodes, count),
        _sum_rows(facts.centre, nodes, count),
        None if lab is None else _sum_rows(lab, nodes, count),
    )


def _scalar_as_hue(scalar: AnyFloat) -> Int16:
    """CIELAB rows that differ in a* alone, by 100 between the least and the greatest value."""
    if not np.isfinite(scalar).all():
        bad = int(np.flatnonzero(~np.isfinite(scalar))[0])
        msg = f"scalar of face {bad} is {scalar[bad]}, expected a finite number"
        raise ValueError(msg)
    low, high = float(scalar.min()), float(scalar.max())
    lab = np.zeros((len(scalar), 3), np.int16)
    if high > low:
        stretched = (scalar.astype(np.float64) - low) * (100.0 * LAB_STEPS / (high - low))
        lab[:, 1] = np.rint(stretched).astype(np.int16)
    return lab


def _in_steps(values: Float64, largest: float) -> Int64:
    """Quantise lengths or areas to whole steps of the largest, at least 1."""
    if largest <= 0.0:
        return np.ones(len(values), np.int64)
    return np.maximum(np.rint(values * (_STEPS / largest)), 1.0).astype(np.int64)


@numba.njit(cache=True)
def _measure_faces(
    vertices: Float32, faces: Int32, low: Float64, side: float
) -> tuple[Float64, Int16, Int32]:
    """Area, unit normal and centre of every face; a face without area has the normal 0."""
    area = np.empty(len(faces), np.float64)
    normal = np.empty((len(faces), 3), np.int16)
    centre = np.empty((len(faces), 3), np.int32)
    p = np.empty((3, 3), np.float64)
    n = np.empty(3, np.float64)
    for f in range(len(faces)):
        for c in range(3):
            for axis in range(3):
                p[c, axis] = vertices[faces[f, c], axis]
        # Products of differences in float64; rounded to whole steps at last, so that merging adds
        # up integers.
        for axis in range(3):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            n[axis] = (p[1, u] - p[0, u]) * (p[2, v] - p[0, v]) - (p[1, v] - p[0, v]) * (
                p[2, u] - p[0, u]
            )
            middle = (p[0, axis] + p[1, axis] + p[2, axis]) / 3.0 - low[axis]
            centre[f, axis] = np.int32(np.rint(_PLACE_STEPS * middle / side))
        twice = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
        area[f] = 0.5 * twice
        for axis in range(3):
            unit = n[axis] / twice if twice > 0.0 else 0.0
            normal[f, axis] = np.int16(np.rint(_NORMAL_STEPS * unit))
    return area, normal, centre


@numba.njit(cache=True)
def _measure_borders(vertices: Float32, faces: Int32, pairs: Int32) -> Float64:
    """Sum the lengths of all edges that the faces of a pair share."""
    length = np.empty(len(pairs), np.float64)
    for i in range(len(pairs)):
        f, g = pairs[i, 0], pairs[i, 1]
        total = 0.0
        for c in range(3):
            a, b = faces[f, c], faces[f, (c + 1) % 3]
            # Faces with repeated corners walk an edge twice; it counts once.
            repeated = (c == 1 and faces[f, 2] == faces[f, 0]) or (
                c == 2 and (faces[f, 2] == faces[f, 1] or faces[f, 0] == faces[f, 1])
            )
            if a == b or repeated:
                continue
            for d in range(3):
                p, q = faces[g, d], faces[g, (d + 1) % 3]
                if (p == a and q == b) or (p == b and q == a):
                    square = 0.0
                    for axis in range(3):
                        along = np.float64(vertices[a, axis]) - np.float64(vertices[b, axis])
                        square += along * along
                    total += np.sqrt(square)
                    break
        length[i] = total
    return length


@numba.njit(cache=True)
def _smooth(lab: Int16, pairs: Int32) -> Int16:
    total = lab.astype(np.int32)
    count = np.ones(len(lab), np.int32)
    for i in range(len(pairs)):
        u, v = pairs[i, 0], pairs[i, 1]
        count[u] += 1
        count[v] += 1
        for axis in range(3):
            total[u, axis] += lab[v, axis]
            total[v, axis] += lab[u, axis]
    smooth = np.empty_like(lab)
    for u in range(len(lab)):
        for axis in range(3):
            smooth[u, axis] = np.int16((2 * total[u, axis] + count[u]) // (2 * count[u]))
    return smooth


@numba.njit(cache=True)
def sum_areas(area: Int64, nodes: Int32, count: int) -> Int64:
    """Areas of unions: ``nodes[u]`` is the union of unit u."""
    total = np.zeros(count, np.int64)
    for u in range(len(nodes)):
        total[nodes[u]] += area[u]
    return total


@numba.njit(cache=True)
def _sum_counts(values: Int32, nodes: Int32, count: int) -> Int32:
    total = np.zeros(count, np.int32)
    for u in range(len(nodes)):
        total[nodes[u]] += values[u]
    return total


@numba.njit(cache=True)
def _sum_rows(values: AnyInt, nodes: Int32, count: int) -> Int64:
    total = np.zeros((count, 3), np.int64)
    for u in range(len(nodes)):
        for axis in range(3):
            total[nodes[u], axis] += values[u, axis]
    return total
