"""The graph that the graph engine merges: faces (or pieces of them), their borders and facts.

Everything summed later is held in whole steps of a fixed fraction of the largest value, so that
sums are exact: no result depends on their order, hence none on the numbering of the vertices. What
is averaged over a piece (normal, centre, CIELAB colour) is averaged over its faces, each counting
once.

PURE: no I/O, no clock. Time linear in the faces.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
import numpy.typing as npt

from terraport_pipeline.geometry.adjacency import face_pairs
from terraport_pipeline.geometry.colour import face_lab
from terraport_pipeline.geometry.kernel_input import as_kernel_input

__all__ = [
    "EdgeWeights",
    "FaceGraph",
    "UnitFacts",
    "border_weights",
    "face_graph",
    "sum_areas",
    "sum_facts",
]

_Float32 = npt.NDArray[np.float32]
_Float64 = npt.NDArray[np.float64]
_Int32 = npt.NDArray[np.int32]
_Int64 = npt.NDArray[np.int64]

_STEPS: Final = 2.0**30
"""Steps in the longest edge and in the largest face: 2^33 of either fit an int64 sum."""
_NORMAL_STEPS: Final = 2.0**14
"""Steps in a unit normal: 16 bits hold it, and it is good to 0.004 degrees."""
_PLACE_STEPS: Final = 2.0**24
"""Steps in the longest side of the mesh's box: the resolution of float32."""
LAB_STEPS: Final = 64.0
"""Steps in one unit of CIELAB: far below the width of an 8-bit grey level (0.4)."""
_LEAST_WEIGHT: Final = 1e-3
"""No border weighs less than this share of its length: a perimeter of zero would make a piece that
no size bound could move."""


@dataclass(frozen=True, slots=True)
class EdgeWeights:
    """How much a border weighs per length.

    1 where nothing tells two pieces apart, towards 0 where they should stay apart.
    """

    colour_scale: float = 4.0
    """CIELAB difference at which a border weighs 1/e; 0 leaves colour out. Lower keeps fainter
    borders, and noise. 0..1000."""
    colour_noise: float = 2.0
    """The scale is at least this many times the median difference between neighbouring pieces, so
    that even noise leaves no borders. 0 trusts ``colour_scale`` alone. 0..100."""
    lightness: float = 0.5
    """Weight of the lightness difference against the colour difference; below 1 makes shadows
    fainter than changes of hue, 0 ignores light and dark altogether. 0..10."""
    concavity: float = 10.0
    """Exponent of ``1 - angle / pi`` where the surface folds inwards; 0 leaves shape out.
    0..100."""

    def __post_init__(self) -> None:
        """Refuse values outside their range before any work."""
        for name, high in (
            ("colour_scale", 1000.0),
            ("colour_noise", 100.0),
            ("lightness", 10.0),
            ("concavity", 100.0),
        ):
            value = getattr(self, name)
            if not 0.0 <= value <= high:
                msg = f"{name} is {value}, expected a number in 0..{high:g}"
                raise ValueError(msg)


@dataclass(frozen=True, slots=True, eq=False)
class UnitFacts:
    """What borders are weighed by; row u belongs to unit u, sums over its faces."""

    faces: _Int32
    """(U,) number of faces."""
    normal: npt.NDArray[np.integer]
    """(U, 3) unit normals in steps."""
    centre: npt.NDArray[np.integer]
    """(U, 3) centres in steps from the box's least corner."""
    lab: npt.NDArray[np.integer] | None
    """(U, 3) CIELAB colours in steps; None without colour."""


@dataclass(frozen=True, slots=True, eq=False)
class FaceGraph:
    """Faces as units, and which of them share edges."""

    pairs: _Int32
    """(P, 2) neighbouring faces, each pair once, lower first."""
    length: _Int64
    """(P,) summed length of the edges that a pair shares, in steps, >= 1."""
    area: _Int64
    """(F,) area in steps, >= 1."""
    facts: UnitFacts
    """(F,) rows."""
    scale: float
    """A cost in steps times this is scale-free: multiplied by the root of the whole area."""


def face_graph(
    vertices: npt.NDArray[np.floating],
    faces: npt.NDArray[np.integer],
    *,
    colours: npt.NDArray[np.uint8] | None = None,
    scalar: npt.NDArray[np.floating] | None = None,
    pairs: _Int32 | None = None,
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
    corners = as_kernel_input(vertices, np.float32)
    triangles = as_kernel_input(faces, np.int32)
    low = corners.min(axis=0).astype(np.float64)
    side = float((corners.max(axis=0) - low).max()) or 1.0
    area, normal, centre = _measure_faces(corners, triangles, low, side)
    length = _measure_borders(corners, triangles, as_kernel_input(pairs, np.int32))
    largest = float(area.max())
    longest = float(length.max()) if len(length) else 0.0
    area_steps = _in_steps(area, largest)
    lab: npt.NDArray[np.int16] | None = None
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


def sum_facts(facts: UnitFacts, nodes: _Int32, count: int) -> UnitFacts:
    """Facts of unions: ``nodes[u]`` is the union of unit u."""
    lab = facts.lab
    return UnitFacts(
        _sum_counts(facts.faces, nodes, count),
        _sum_rows(facts.normal, nodes, count),
        _sum_rows(facts.centre, nodes, count),
        None if lab is None else _sum_rows(lab, nodes, count),
    )


def border_weights(
    pairs: _Int32, length: _Int64, facts: UnitFacts, weights: EdgeWeights
) -> tuple[_Int64, float]:
    """Weigh borders: ``length * f(concavity) * g(CIELAB difference)``.

    Parameters
    ----------
    pairs : ndarray of shape (E, 2), int32
        Units that touch, each pair once.
    length : ndarray of shape (E,), int64
        Length of their border in steps.
    facts : UnitFacts
        Of the units.
    weights : EdgeWeights

    Returns
    -------
    border : ndarray of shape (E,), int64
        Steps, 1..length.
    colour_scale : float
        The scale of colour differences that was used; 0 where colour plays no part.

    Notes
    -----
    ``f = (1 - angle / pi) ** concavity`` where the mean normals of the two units turn towards each
    other seen along the line between their centres, else 1 (Golovinskiy and Funkhouser 2008).
    ``g = exp(-(difference / scale)^2)``.
    """
    scale = 0.0
    if facts.lab is not None and weights.colour_scale > 0.0 and len(pairs):
        difference = _lab_differences(pairs, facts.lab, facts.faces, weights.lightness)
        scale = weights.colour_scale
        if weights.colour_noise > 0.0:
            scale = max(scale, weights.colour_noise * float(np.median(difference)))
    else:
        difference = np.zeros(0, np.float32)
    border = _weigh(
        pairs, length, facts.normal, facts.centre, facts.faces, difference, scale,
        weights.concavity,
    )  # fmt: skip
    return border, scale


def _scalar_as_hue(scalar: npt.NDArray[np.floating]) -> npt.NDArray[np.int16]:
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


def _in_steps(values: _Float64, largest: float) -> _Int64:
    """Whole steps, at least 1."""
    if largest <= 0.0:
        return np.ones(len(values), np.int64)
    return np.maximum(np.rint(values * (_STEPS / largest)), 1.0).astype(np.int64)


@numba.njit(cache=True)
def _measure_faces(
    vertices: _Float32, faces: _Int32, low: _Float64, side: float
) -> tuple[_Float64, npt.NDArray[np.int16], _Int32]:
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
def _measure_borders(vertices: _Float32, faces: _Int32, pairs: _Int32) -> _Float64:
    """Sum the lengths of all edges that the faces of a pair share."""
    length = np.empty(len(pairs), np.float64)
    for i in range(len(pairs)):
        f, g = pairs[i, 0], pairs[i, 1]
        total = 0.0
        for c in range(3):
            a, b = faces[f, c], faces[f, (c + 1) % 3]
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
def sum_areas(area: _Int64, nodes: _Int32, count: int) -> _Int64:
    """Areas of unions: ``nodes[u]`` is the union of unit u."""
    total = np.zeros(count, np.int64)
    for u in range(len(nodes)):
        total[nodes[u]] += area[u]
    return total


@numba.njit(cache=True)
def _sum_counts(values: _Int32, nodes: _Int32, count: int) -> _Int32:
    total = np.zeros(count, np.int32)
    for u in range(len(nodes)):
        total[nodes[u]] += values[u]
    return total


@numba.njit(cache=True)
def _sum_rows(values: npt.NDArray[np.integer], nodes: _Int32, count: int) -> _Int64:
    total = np.zeros((count, 3), np.int64)
    for u in range(len(nodes)):
        for axis in range(3):
            total[nodes[u], axis] += values[u, axis]
    return total


@numba.njit(cache=True)
def _lab_differences(
    pairs: _Int32, lab: npt.NDArray[np.integer], faces: _Int32, lightness: float
) -> _Float32:
    difference = np.empty(len(pairs), np.float32)
    for i in range(len(pairs)):
        u, v = pairs[i, 0], pairs[i, 1]
        square = 0.0
        for axis in range(3):
            part = (lab[u, axis] / faces[u] - lab[v, axis] / faces[v]) / LAB_STEPS
            if axis == 0:
                part *= lightness
            square += part * part
        difference[i] = np.sqrt(square)
    return difference


@numba.njit(cache=True)
def _weigh(
    pairs: _Int32,
    length: _Int64,
    normal: npt.NDArray[np.integer],
    centre: npt.NDArray[np.integer],
    faces: _Int32,
    difference: _Float32,
    scale: float,
    exponent: float,
) -> _Int64:
    border = np.empty(len(pairs), np.int64)
    for i in range(len(pairs)):
        u, v = pairs[i, 0], pairs[i, 1]
        weight = 1.0
        if scale > 0.0:
            ratio = difference[i] / scale
            weight *= np.exp(-ratio * ratio)
        if exponent > 0.0:
            dot, size_u, size_v = 0.0, 0.0, 0.0
            for axis in range(3):
                dot += np.float64(normal[u, axis]) * normal[v, axis]
                size_u += np.float64(normal[u, axis]) * normal[u, axis]
                size_v += np.float64(normal[v, axis]) * normal[v, axis]
            if size_u > 0.0 and size_v > 0.0:
                root_u, root_v = np.sqrt(size_u), np.sqrt(size_v)
                towards = 0.0
                for axis in range(3):
                    towards += (normal[v, axis] / root_v - normal[u, axis] / root_u) * (
                        centre[v, axis] / faces[v] - centre[u, axis] / faces[u]
                    )
                if towards < 0.0:
                    angle = np.arccos(min(1.0, max(-1.0, dot / (root_u * root_v))))
                    weight *= (1.0 - angle / np.pi) ** exponent
        steps = np.rint(length[i] * max(weight, _LEAST_WEIGHT))
        border[i] = np.int64(max(steps, 1.0))
    return border
