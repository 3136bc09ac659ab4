"""Parts of a closed body: what is known of each, of each border, and of each two together.

All of it is sums, so that two parts become one by adding rows. From the sums come the *facts* by
which :mod:`.part_merge` says how likely people take two neighbours for one part: their sizes, their
border's length and folds at three scales, how thick the body is on both sides (shape diameter), how
much of each other they see inside the body, and their extents along their own axes.

Lengths are over the root of the whole area, so that facts know no unit.

PURE: no I/O, no clock.

References
----------
A. Golovinskiy, T. Funkhouser, "Randomized cuts for 3D mesh analysis", ACM Transactions on Graphics
27(5), 2008 (folds). L. Shapira, A. Shamir, D. Cohen-Or, "Consistent mesh partitioning and
skeletonisation using the shape diameter function", The Visual Computer 24(4), 2008. S. Asafi, A.
Goren, D. Cohen-Or, "Weak convex decomposition by lines-of-sight", Computer Graphics Forum 32(5),
2013 (what parts see of each other).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Bool, Float64, Int32, Int64

__all__ = ["FACTS", "BodyFacts", "PartTable"]

_SMOOTH_ROUNDS: Final = (0, 2, 6)
"""Times that normals are averaged with their neighbours' before folds are measured: the scales."""
_THICKNESS_ROUNDS: Final = 5
_SHARPNESS: Final = 20.0
"""Exponent of a concave fold's weight, as ``SHAPE_GRAPH`` has it."""
_TINY: Final = 1e-12

FACTS: Final = (
    "log area of the smaller", "log area of the larger",
    "log border", "border over perimeter of the smaller", "of the larger",
    "log border over root of area of the smaller", "of the larger",
    "concave fold", "convex fold", "border's weight",
    "concave fold, smoothed", "convex fold, smoothed", "border's weight, smoothed",
    "concave fold, smoother", "convex fold, smoother", "border's weight, smoother",
    "log thickness of the smaller", "of the larger", "their difference", "its size",
    "spread of log thickness in the smaller", "in the larger",
    "log thickness at the border over the smaller's", "over the larger's",
    "sight between the two", "within the smaller", "within the larger",
    "sight between over the lesser within",
    "log border over thickness there",
    "log least extent over largest, of the smaller", "middle one",
    "log least extent over largest, of the larger", "middle one",
    "log least extent over largest, of both together", "middle one",
    "log box of both over the sum of two boxes",
    "log distance of the middles", "over root of both areas",
    "sight within the whole body",
    "mean normal of the smaller", "of the larger", "of both", "angle between them",
)  # fmt: skip
"""What the columns of :meth:`PartTable.facts` are."""


@dataclass(frozen=True, slots=True, eq=False)
class BodyFacts:
    """A closed body's faces and borders, and what rays said of it."""

    area: Float64
    """(F,) > 0 in sum."""
    centres: Float64
    """(F, 3)"""
    normals: Float64
    """(F, 3) unit, outwards; zero of a face without area."""
    pairs: Int32
    """(P, 2) faces that share an edge."""
    edge_lengths: Float64
    """(P,) of those edges."""
    thickness: Float64
    """(F,) shape diameter; NaN where there is none."""
    samples: Int32
    """(S,) faces from which sight was measured, evenly by area."""
    sees: Bool
    """(S, S) whether two samples see each other inside the body."""


class PartTable:
    """Sums over parts and borders; parts are rows, and a merged part's row is empty.

    Parameters
    ----------
    body : BodyFacts
    labels : ndarray of shape (F,), int32
        Part of every face, 0..count-1.
    count : int
    """

    def __init__(self, body: BodyFacts, labels: Int32, count: int) -> None:
        whole = max(float(body.area.sum()), np.finfo(np.float64).tiny)
        unit = float(np.sqrt(whole))
        share = body.area / whole
        middle = (body.centres * share[:, None]).sum(axis=0)
        place = (body.centres - middle) / unit
        thick = _log_thickness(body, unit)
        # (1) Of parts: area, log thickness and its square, place, spread, normals.
        second = (place[:, :, None] * place[:, None, :]).reshape(-1, 9)
        rows = [np.ones(len(labels)), thick, thick**2, *place.T, *second.T, *body.normals.T]
        columns = [np.bincount(labels, share * row, count) for row in rows]
        self._parts = np.stack(columns, axis=1).astype(np.float64)
        # (2) Of borders: length, folds at three scales, thickness.
        a, b = labels[body.pairs[:, 0]], labels[body.pairs[:, 1]]
        across = a != b
        a, b, pairs = a[across], b[across], body.pairs[across]
        length = body.edge_lengths[across] / unit
        borders = [np.ones(len(a))]
        for rounds in _SMOOTH_ROUNDS:
            fold = _folds(_smooth(body, rounds), body.centres, pairs)
            inwards, outwards = np.maximum(-fold, 0.0), np.maximum(fold, 0.0)
            borders += [inwards, outwards, (1.0 - inwards / np.pi) ** _SHARPNESS]
        borders.append((thick[pairs[:, 0]] + thick[pairs[:, 1]]) / 2)
        cell = a.astype(np.int64) * count + b
        half = np.stack(
            [np.bincount(cell, length * one, count * count) for one in borders]
        ).reshape(-1, count, count)
        self._borders = half + half.transpose(0, 2, 1)
        # (3) Of any two parts: pairs of samples that see each other.
        part = labels[body.samples]
        member = np.zeros((len(part), count))
        member[np.arange(len(part)), part] = 1.0
        self._seen = member.T @ body.sees.astype(np.float64) @ member
        self._samples = member.sum(axis=0)
        self._openness = float(body.sees.mean()) if body.sees.size else 1.0

    def neighbours(self) -> tuple[Int64, Int64]:
        """Parts that touch, the one of less area first; each two once."""
        a, b = np.nonzero(np.triu(self._borders[0], 1))
        area = self._parts[:, 0]
        swap = area[a] > area[b]
        return np.where(swap, b, a), np.where(swap, a, b)

    def neighbours_of(self, part: int) -> tuple[Int64, Int64]:
        """Parts that touch one, as :meth:`neighbours` gives them."""
        other = np.flatnonzero(self._borders[0, part])
        area = self._parts[:, 0]
        swap = area[other] < area[part]
        mine = np.full(len(other), part)
        return np.where(swap, other, mine), np.where(swap, mine, other)

    def merge(self, kept: int, gone: int) -> None:
        """Make one part of two that touch."""
        for rows in (self._parts, self._samples):
            rows[kept] += rows[gone]
            rows[gone] = 0.0
        for table in (*self._borders, self._seen):
            table[kept] += table[gone]
            table[:, kept] += table[:, gone]
            table[gone] = 0.0
            table[:, gone] = 0.0
        self._borders[:, kept, kept] = 0.0

    def facts(self, small: Int64, large: Int64) -> Float64:
        """Facts of parts that touch, (N, len(FACTS)): rows of ``small`` and ``large``."""
        of_a, of_b = self._parts[small], self._parts[large]
        borders = self._borders[:, small, large]
        border = borders[0]
        folds = borders[1:-1] / border
        thick_there = borders[-1] / border
        perimeter = self._borders[0].sum(axis=1)
        area_a, area_b = of_a[:, 0], of_b[:, 0]
        both = area_a + area_b
        thick_a, spread_a = _mean_and_spread(of_a)
        thick_b, spread_b = _mean_and_spread(of_b)
        extent_a, extent_b, extent = _extents(of_a), _extents(of_b), _extents(of_a + of_b)
        n_a, n_b = self._samples[small], self._samples[large]
        # One sample pair is taken for half seen: parts without samples know nothing.
        sight = (self._seen[small, large] + 1.0) / (n_a * n_b + 2.0)
        sight_a = (self._seen[small, small] + 1.0) / (n_a * n_a + 2.0)
        sight_b = (self._seen[large, large] + 1.0) / (n_b * n_b + 2.0)
        away = np.maximum(
            _norm(of_a[:, 3:6] / area_a[:, None] - of_b[:, 3:6] / area_b[:, None]), _TINY
        )
        look_a, look_b = of_a[:, 15:18], of_b[:, 15:18]
        columns = [
            np.log(area_a), np.log(area_b),
            np.log(border), border / perimeter[small], border / perimeter[large],
            np.log(border / np.sqrt(area_a)), np.log(border / np.sqrt(area_b)),
            *folds,
            thick_a, thick_b, thick_a - thick_b, np.abs(thick_a - thick_b), spread_a, spread_b,
            thick_there - thick_a, thick_there - thick_b,
            sight, sight_a, sight_b, sight / np.minimum(sight_a, sight_b),
            np.log(border) - thick_there,
            *_ratios(extent_a), *_ratios(extent_b), *_ratios(extent),
            np.log(extent.prod(axis=1) / (extent_a.prod(axis=1) + extent_b.prod(axis=1))),
            np.log(away), np.log(away / np.sqrt(both)),
            np.full(len(border), self._openness),
            _norm(look_a) / area_a, _norm(look_b) / area_b, _norm(look_a + look_b) / both,
            (look_a * look_b).sum(axis=1) / (_norm(look_a) * _norm(look_b) + _TINY),
        ]  # fmt: skip
        return np.stack(columns, axis=1)


def _norm(rows: Float64) -> Float64:
    return np.asarray(np.sqrt((rows * rows).sum(axis=1)))


def _mean_and_spread(parts: Float64) -> tuple[Float64, Float64]:
    mean = parts[:, 1] / parts[:, 0]
    return mean, np.sqrt(np.maximum(parts[:, 2] / parts[:, 0] - mean * mean, 0.0))


def _extents(parts: Float64) -> Float64:
    """Measure standard deviations along a part's own axes, (N, 3) ascending, never 0."""
    middle = parts[:, 3:6] / parts[:, :1]
    spread = (parts[:, 6:15] / parts[:, :1]).reshape(-1, 3, 3)
    spread -= middle[:, :, None] * middle[:, None, :]
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(spread), 1e-10)))


def _ratios(extents: Float64) -> tuple[Float64, Float64]:
    return np.log(extents[:, 0] / extents[:, 2]), np.log(extents[:, 1] / extents[:, 2])


def _mean_of_neighbours(values: Float64, pairs: Int32, own: Float64) -> Float64:
    """Sum a face's weighted value and its neighbours' alike weighted ones, (F,)."""
    a, b = pairs[:, 0], pairs[:, 1]
    weighted = values * own
    total = weighted + np.bincount(a, weighted[b], len(values))
    return np.asarray(total + np.bincount(b, weighted[a], len(values)))


def _log_thickness(body: BodyFacts, unit: float) -> Float64:
    """Log of the shape diameter over the unit, filled and smoothed, (F,)."""
    known = np.isfinite(body.thickness) & (body.thickness > 0.0)
    usual = float(np.median(body.thickness[known])) if known.any() else unit
    values = np.log(np.where(known, body.thickness, usual) / unit)
    ones = np.ones(len(values))
    around = _mean_of_neighbours(ones, body.pairs, ones)
    for _ in range(_THICKNESS_ROUNDS):
        values = _mean_of_neighbours(values, body.pairs, ones) / around
    return values


def _smooth(body: BodyFacts, rounds: int) -> Float64:
    """Average normals, weighed by area, with the neighbours'; unit again, (F, 3)."""
    if rounds == 0:
        return body.normals
    ones = np.ones(len(body.area))
    columns = [body.normals[:, axis] * body.area for axis in range(3)]
    for _ in range(rounds):
        columns = [_mean_of_neighbours(one, body.pairs, ones) for one in columns]
    normals = np.stack(columns, axis=1)
    return np.asarray(normals / np.maximum(_norm(normals), 1e-300)[:, None])


def _folds(normals: Float64, centres: Float64, pairs: Int32) -> Float64:
    """Angles between neighbours' normals, radians, (N,); negative where folded inwards."""
    a, b = normals[pairs[:, 0]], normals[pairs[:, 1]]
    angle = np.arccos(np.clip((a * b).sum(axis=1), -1.0, 1.0))
    apart = centres[pairs[:, 1]] - centres[pairs[:, 0]]
    return np.asarray(np.where(((a - b) * apart).sum(axis=1) > 0.0, -angle, angle))
