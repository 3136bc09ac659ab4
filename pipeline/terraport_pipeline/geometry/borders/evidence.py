"""Evidence for borders: what cells look like, how steeply that changes, how much is around.

Every cell's sums are spread to its neighbours in rounds, so that means are taken over some cells'
width: the near ones for colour and slope, the wide ones for texture. Texture is the deviation of
lightness, on a logarithmic scale: people see gravel beside grass by it where colours are the same.

*Contrast* is how far the colours spread within some region sizes, weighed by distance: ground is
looked at by what is around it, and not by what else was flown.

PURE: no I/O, no clock. A round is one product with a sparse matrix of the cells' neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.sparse import coo_array, diags_array

from terraport_payload.types import Float64, Int64
from terraport_pipeline.geometry.borders.cells import LAB_STEPS, CellGraph, length_steps

__all__ = ["FEATURES", "Weights", "cell_features", "contrast", "gradients"]

NEAR_ROUNDS: Final = 3
"""Rounds for colour and slope: means over some 3 cells."""
WIDE_ROUNDS: Final = 12
"""More rounds for texture: means over some 8 cells."""
_REACH_SQUARES: Final = 4
"""Squares, half a reach wide, over which ground counts as around."""
_SIDE: Final = 2**31
"""Squares from north to south that a place can tell apart."""
FEATURES: Final = 7
"""L*, a*, b*, texture, and the three components of the mean normal."""


@dataclass(frozen=True, slots=True)
class Weights:
    """How much each kind of evidence counts, all in CIELAB units."""

    lightness: float = 0.45
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

    def distance(features: Float64) -> Float64:
        # Column by column: rows of all pairs take gigabytes where a survey is large.
        squares = np.zeros(len(low))
        for values in features.T:
            squares += (values[low] - values[high]) ** 2
        return np.sqrt(squares)

    seen = np.delete(near, 3, axis=1)  # the texture of few cells is noise
    steepness: Float64 = distance(seen) + distance(wide)
    return steepness


def contrast(
    features: Float64, area: Float64, middles: Float64, keys: Int64, reach_m: float
) -> Float64:
    """Spread of the features around every cell, (U,): root of their summed variances.

    Parameters
    ----------
    features : ndarray of shape (U, K)
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
    columns = np.column_stack([np.ones(len(area)), features, features * features]) * area[:, None]
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
    variance = np.maximum(mean[:, count:] - mean[:, :count] ** 2, 0.0)
    around: Float64 = np.sqrt(variance.sum(axis=1))[of_cell]
    return around


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
