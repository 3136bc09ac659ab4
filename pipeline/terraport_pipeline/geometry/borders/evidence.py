"""Evidence for borders: what cells look like, how steeply that changes, how much is around.

Every cell's sums are spread to its neighbours in rounds, so that means are taken over some cells'
width: the near ones for colour and slope, the wide ones for texture. Texture is the deviation of
lightness, on a logarithmic scale: people see gravel beside grass by it where colours are the same.

*Contrast* is how far the colours spread within some region sizes, weighed by distance: ground is
looked at by what is around it, and not by what else was flown. It counts for more where the ground
is smooth for so much of it: there are few materials, in large pieces, and people draw only those.
Where the same contrast is spread over rough ground, there are many small ones.

PURE: no I/O, no clock. A round is one product with a sparse matrix of the cells' neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.sparse import coo_array, diags_array

from terraport_payload.types import Float64, Int64
from terraport_pipeline.geometry.borders.cells import LAB_STEPS, CellGraph, length_steps

__all__ = ["FEATURES", "Weights", "cell_features", "contrast", "gradients", "roughness"]

NEAR_ROUNDS: Final = 3
"""Rounds for colour and slope: means over some 3 cells."""
WIDE_ROUNDS: Final = 12
"""More rounds for texture: means over some 8 cells."""
_REACH_SQUARES: Final = 4
"""Squares, half a reach wide, over which ground counts as around."""
_USUAL_CONTRAST: Final = 7.0
"""CIELAB units, of surveys."""
_MOST_CONTRAST: Final = 1.5
"""Times the usual above which contrast counts in proportion, and the part below which it does."""
_CONTRAST_POWER: Final = 0.5
_USUAL_SMOOTHNESS: Final = 6.0
"""Contrast over steepness, of surveys."""
_MOST_SMOOTHNESS: Final = 1.7
"""Times the usual above which ground counts as no smoother, and the part below which as no less."""
_SMOOTHNESS_POWER: Final = 0.75
_SIDE: Final = 2**31
"""Squares from north to south that a place can tell apart."""
FEATURES: Final = 7
"""L*, a*, b*, texture, and the three components of the mean normal."""


@dataclass(frozen=True, slots=True)
class Weights:
    """How much each kind of evidence counts, all in CIELAB units."""

    lightness: float = 0.33
    """Of L* against a* and b*. Lower ignores shadows."""
    texture: float = 3.6
    """Units for a deviation of lightness that is e times as large."""
    slope: float = 0.0
    """Units for a normal turned by a radian. Where colours are, slope gave nothing on drawn pieces
    and parted every bench from its rock face."""


def cell_features(graph: CellGraph, weights: Weights, cell_m: float) -> tuple[Float64, Float64]:
    """Mean features of every cell's near and wide surroundings, two (U, 7), weighed.

    Parameters
    ----------
    graph : CellGraph
    weights : Weights
    cell_m : float
        Side of a cell, metres.
    """
    count = graph.count
    cell = float(length_steps(np.array(cell_m)))
    # Ground is exchanged over borders: per round a cell keeps two cells' widths of itself against
    # the lengths that it shares. A border longer than a cell and a half counts as that.
    shared = np.minimum(graph.border, 1.5 * cell)
    low, high = graph.pairs.T
    exchange = coo_array((shared, (low, high)), shape=(count, count))
    exchange = (exchange + exchange.T).tocsr()
    out = 1.0 / (exchange.sum(axis=1) + 2.0 * cell)
    spread = (exchange + diags_array(np.full(count, 2.0 * cell))).tocsr() @ diags_array(out)
    spread = spread.tocsr()
    spread.sort_indices()
    sums = graph.sums.astype(np.float64)
    for _ in range(NEAR_ROUNDS):
        sums = spread @ sums
    near = _features(sums, weights)
    for _ in range(WIDE_ROUNDS):
        sums = spread @ sums
    return near, _features(sums, weights)


def gradients(graph: CellGraph, near: Float64, wide: Float64) -> Float64:
    """Steepness at every pair of cells, (E,): colour and slope near by, and all over the width."""
    low, high = graph.pairs.T
    step = near[low] - near[high]
    step[:, 3] = 0.0  # the texture of few cells is noise
    far = wide[low] - wide[high]
    steepness: Float64 = np.sqrt((step * step).sum(axis=1)) + np.sqrt((far * far).sum(axis=1))
    return steepness


def contrast(
    features: Float64,
    roughness: Float64,
    area: Float64,
    middles: Float64,
    keys: Int64,
    reach_m: float,
) -> Float64:
    """Contrast around every cell, CIELAB units, (U,): root of the summed variances of the features.

    Times how many roughnesses that is, over :data:`_USUAL_SMOOTHNESS`, to a power.

    Parameters
    ----------
    features : ndarray of shape (U, K)
    roughness : ndarray of shape (U,)
        Root of the steepness at every cell, as :func:`roughness` gives it.
    area : ndarray of shape (U,)
        Of the cells: how much each counts.
    middles : ndarray of shape (U, 3)
        Metres, Y up; distance is taken in plan.
    keys : ndarray of shape (U,)
        Order in which cells are added up, whatever order they come in.
    reach_m : float
        Standard deviation of the Gaussian that the ground around is weighed by; it is summed up in
        squares of half of this, and ends at twice this.
    """
    # (1) Squares of the ground that hold any, with their sums.
    order = np.argsort(keys, kind="stable")
    square = np.floor(middles[:, [0, 2]] * (2.0 / reach_m)).astype(np.int64)
    square -= square.min(axis=0, initial=0) - _REACH_SQUARES
    row = square[:, 0] * _SIDE + square[:, 1]
    places, of_cell = np.unique(row, return_inverse=True)
    columns = np.column_stack([np.ones(len(area)), features, features * features, roughness])
    columns *= area[:, None]
    sums = np.stack(
        [np.bincount(of_cell[order], column[order], len(places)) for column in columns.T], axis=1
    )
    # (2) Every square's surroundings.
    spread = np.zeros_like(sums)
    for east in range(-_REACH_SQUARES, _REACH_SQUARES + 1):
        for south in range(-_REACH_SQUARES, _REACH_SQUARES + 1):
            there = places + east * _SIDE + south
            at = np.minimum(np.searchsorted(places, there), len(places) - 1)
            weight = np.exp(-(east * east + south * south) / 8.0) * (places[at] == there)
            spread += weight[:, None] * sums[at]
    # (3) Variances.
    count = features.shape[1]
    mean = spread[:, 1:] / spread[:, :1]
    variance = np.maximum(mean[:, count : 2 * count] - mean[:, :count] ** 2, 0.0)
    spread_of_colours = np.sqrt(variance.sum(axis=1))
    steepness = mean[:, -1] ** 2
    smoothness = spread_of_colours / np.maximum(steepness, 1e-9)
    noticed = (
        spread_of_colours
        * _within(spread_of_colours / _USUAL_CONTRAST, _MOST_CONTRAST) ** _CONTRAST_POWER
    )
    noticed *= _within(smoothness / _USUAL_SMOOTHNESS, _MOST_SMOOTHNESS) ** _SMOOTHNESS_POWER
    around: Float64 = noticed[of_cell]
    return around


def roughness(graph: CellGraph, steepness: Float64) -> Float64:
    """Mean root of the steepness at the borders of every cell, (U,): few borders are steep.

    0 where a cell touches nothing.
    """
    low, high = graph.pairs.T
    length = graph.border.astype(np.float64)
    total, summed = (
        np.bincount(low, weight, graph.count) + np.bincount(high, weight, graph.count)
        for weight in (length, length * np.sqrt(steepness))
    )
    mean: Float64 = summed / np.maximum(total, 1.0)
    return mean


def _within(times: Float64, most: float) -> Float64:
    """Keep what is told in times the usual within ``most`` times and a ``most``-th of it."""
    return np.clip(times, 1.0 / most, most)


def _features(sums: Float64, weights: Weights) -> Float64:
    """Features (U, 7) of sums as ``CellGraph.sums``."""
    mean = sums[:, 1:] / sums[:, :1]
    lab = mean[:, :3] / LAB_STEPS
    variance = mean[:, 3] / LAB_STEPS**2 - lab[:, 0] ** 2
    texture = np.log(2.0 + np.sqrt(np.maximum(variance, 0.0)))
    features: Float64 = np.column_stack(
        [
            lab * [weights.lightness, 1.0, 1.0],
            weights.texture * texture,
            weights.slope * mean[:, 4:7],
        ]
    )
    return features
