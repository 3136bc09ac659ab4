"""Evidence for borders: what cells look like over a few metres, and how steeply that changes.

Every cell's sums are spread to its neighbours in rounds, so that means are taken over some cells'
width: the near ones for colour and slope, the wide ones for texture. Texture is the deviation of
lightness, on a logarithmic scale: people see gravel beside grass by it where colours are the same.

PURE: no I/O, no clock. A round is one product with a sparse matrix of the cells' neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.sparse import coo_array, diags_array

from terraport_payload.types import Float64
from terraport_pipeline.geometry.borders.cells import LAB_STEPS, CellGraph, length_steps

__all__ = ["FEATURES", "Weights", "cell_features", "gradients"]

NEAR_ROUNDS: Final = 3
"""Rounds for colour and slope: means over some 3 cells."""
WIDE_ROUNDS: Final = 12
"""More rounds for texture: means over some 8 cells."""
FEATURES: Final = 7
"""L*, a*, b*, texture, and the three components of the mean normal."""


@dataclass(frozen=True, slots=True)
class Weights:
    """How much each kind of evidence counts, all in CIELAB units."""

    lightness: float = 0.6
    """Of L* against a* and b*. Lower ignores shadows."""
    texture: float = 4.8
    """Units for a deviation of lightness that is e times as large."""
    slope: float = 40.0
    """Units for a normal turned by a radian."""


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
