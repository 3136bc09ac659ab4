"""Patches of ground between borders: what units are part of, and how strongly they hang together.

The engine of ``borders`` finds borders between cells; here its cells are the units that features
are measured of. What a unit looks like is then said of its surroundings *up to the next border*
too, in two widths: a square's own Gaussian mixes both sides of every line.

PURE: no I/O, no clock. Memory: 550 bytes per unit while patches are made.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.sparse import coo_array, csr_array

from terraport_payload.types import Float32, Float64, Int32, UInt8
from terraport_pipeline.geometry.borders.border_segmenter import (
    BorderSegmenter,
)
from terraport_pipeline.geometry.borders.cells import (
    LAB_STEPS,
    CellGraph,
    length_steps,
    summed_pairs,
)
from terraport_pipeline.geometry.borders.consensus import COST_OF_A_BORDER
from terraport_pipeline.geometry.borders.unions import unite_level, unite_seeds
from terraport_pipeline.geometry.learning.ground_units import GroundUnits
from terraport_pipeline.geometry.regions.colour import face_lab

__all__ = ["PATCH_NAMES", "Patches", "unit_patches"]

_REGION_UNITS: Final = 20.0
"""Region size, in units: what the engine takes for a cell."""

_SMALL_UNITS: Final = 3.0
"""Width of a small patch at most."""

_LEVELS: Final = 8
"""Steps of the engine's sixteen up to regions: large patches cost half of what a border does."""

_BORDER: Final = 0.25
"""Share of the contrast around at which two units hang together by .6."""

_LEAST_CONTRAST: Final = 3.0
"""CIELAB units; plainer ground counts as having that."""

_LEAST_HOLD: Final = 1e-3
"""Over any border: no unit is alone."""

_SQUARE_MM: Final = 1e6

_MEAN_OF: Final = 6
"""Features of a unit, the first of ``feature_names``, whose means patches have."""

_SPREAD_OF: Final = (0, 1, 2, 4)
"""And deviations: colours and slope."""

_WORDS: Final = ("lightness", "a", "b", "lightness_deviation", "slope_deg", "slope_deviation_deg")

PATCH_NAMES: Final = (
    "lightness@near", "a@near", "b@near",
    "lightness@wide", "a@wide", "b@wide", "texture@wide",
    *(f"{word}@{patch}" for patch in ("small_patch", "large_patch")
      for word in (*_WORDS, *(f"{_WORDS[at]}_spread" for at in _SPREAD_OF))),
)  # fmt: skip
"""Names of :attr:`Patches.features`."""


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """See :func:`unit_patches`."""

    features: Float32
    """(U, len(PATCH_NAMES)) finite."""
    pairs: Int32
    """(P, 2) units that touch, lower first."""
    hold: csr_array
    """(U, U) symmetric: how strongly neighbours hang together, 0 to 1."""


def unit_patches(
    units: GroundUnits,
    vertices: Float32,
    faces: Int32,
    colours: UInt8,
    face_pairs: tuple[Int32, Int32],
    own: Float32,
    heights: Float64,
) -> Patches:
    """Find patches and measure them.

    Parameters
    ----------
    units : GroundUnits
    vertices : ndarray of shape (V, 3), float32
    faces : ndarray of shape (F, 3), int32
    colours : ndarray of shape (V, 3), uint8
        sRGB.
    face_pairs : pair of ndarray
        Neighbouring faces, and the vertices of their edges.
    own : ndarray of shape (U, K), float32
        From ``ground_features``; the first columns are the units' own.
    heights : ndarray of shape (U,), float64
        Metres.

    Returns
    -------
    Patches
        Of the same ground always the same.
    """
    # (1) The engine's evidence, of units in place of its cells.
    cells = _cells(units, vertices, faces, colours, face_pairs)
    plan = units.middles()
    middles = np.stack([plan[:, 0], heights, plan[:, 1]], axis=1)
    engine = BorderSegmenter(region_size_m=_REGION_UNITS * units.cell_m)
    evidence = engine.evidence(cells, middles)
    # (2) Patches of two widths.
    left = evidence.units(cells, np.zeros(len(cells.pairs)))
    left, small = unite_seeds(left, (_SMALL_UNITS * units.cell_m) ** 2, engine.rule)
    large = small
    for level in range(1, _LEVELS + 1):
        left, rounds = unite_level(left, engine.rule, COST_OF_A_BORDER * level / (2 * _LEVELS))
        for node in rounds:
            large = node[large]
    # (3) What they look like.
    area = cells.sums[:, 0] / _SQUARE_MM
    columns = [evidence.near[:, :3], evidence.wide[:, :4]]
    for patch in (small, large):
        mean, spread = _measured(patch, area, own[:, :_MEAN_OF].astype(np.float64))
        columns += [mean[patch], spread[patch][:, _SPREAD_OF]]
    features = np.column_stack(columns).astype(np.float32)
    # (4) Who hangs together.
    low, high = cells.pairs.T
    around = np.maximum(np.minimum(evidence.around[low], evidence.around[high]), _LEAST_CONTRAST)
    hold = np.exp(-((evidence.steepness / (_BORDER * around)) ** 2) / 2.0) + _LEAST_HOLD
    one_way = coo_array((hold, (low, high)), shape=(units.count, units.count))
    return Patches(features, cells.pairs, (one_way + one_way.T).tocsr())


def _cells(
    units: GroundUnits,
    vertices: Float32,
    faces: Int32,
    colours: UInt8,
    face_pairs: tuple[Int32, Int32],
) -> CellGraph:
    """Sum up units as the engine's cells are."""
    places = vertices.astype(np.float64)
    corners = places[faces]
    normal = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.maximum(np.linalg.norm(normal, axis=1), 1.0 / _SQUARE_MM)
    lab = face_lab(colours, faces, LAB_STEPS).astype(np.float64)
    columns = [area, *(area * lab.T), area * lab[:, 0] ** 2, *normal.T]
    sums = np.stack(
        [np.bincount(units.of_face, _SQUARE_MM * c, units.count) for c in columns], axis=1
    )
    neighbours, edges = face_pairs
    ends = places[edges]
    steps = length_steps(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1))
    pairs, border = summed_pairs(units.of_face[neighbours], steps, units.count)
    keys = 2 * units.square + units.steep
    return CellGraph(units.of_face, keys, np.rint(sums).astype(np.int64), pairs, border)


def _measured(patch: Int32, area: Float64, values: Float64) -> tuple[Float64, Float64]:
    """Mean and deviation of every column over every patch."""
    count = int(patch.max()) + 1

    def mean_of(columns: Float64) -> Float64:
        sums = np.stack([np.bincount(patch, area * column, count) for column in columns.T], axis=1)
        means: Float64 = sums / np.bincount(patch, area, count)[:, None]
        return means

    mean = mean_of(values)
    deviation: Float64 = np.sqrt(np.maximum(mean_of(values * values) - mean * mean, 0.0))
    return mean, deviation
