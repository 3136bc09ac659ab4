"""Segmentation by shape diameter: a mixture of Gaussians, and a graph cut.

How thick the body is under every face, on a log scale and smoothed (``shape_index``), is taken for
a mixture of five Gaussians. Every face gets one of these, so that the likelihoods and the borders
together cost least; a border costs more the flatter it is, and much more where it is convex.

References
----------
L. Shapira, A. Shamir, D. Cohen-Or, "Consistent mesh partitioning and skeletonisation using the
shape diameter function", The Visual Computer 24(4), 2008, section 4.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Float64, Int32
from terraport_pipeline.geometry.regions.shape_index import shape_index
from terraport_research.cutters.contract import Body, Cut, Cutter
from terraport_research.kernels.graph_cut import expand_labels

__all__ = ["SHAPE_DIAMETER", "fit_gaussians"]

_LEVELS: Final = 5
_ROUNDS: Final = 40
_LEAST_DEVIATION: Final = 0.01
_SMOOTHNESS: Final = 8.0
"""Of borders against likelihoods; the paper leaves it open. Chosen on every eighth model."""
_CONVEX: Final = 0.08
"""Share of a convex fold that counts (the paper says only that concave folds count more)."""
_FLATTEST: Final = 1e-3
_LEAST_LIKELIHOOD: Final = 1e-4


def _prepare(body: Body) -> Cut:
    pairs = body.neighbours[0]
    index = shape_index(body.thickness, pairs)
    mean, deviation, share = fit_gaussians(index, body.area)
    costs = -np.log(np.maximum(_likelihood(index, mean, deviation, share), _LEAST_LIKELIHOOD))
    fold = np.where(body.folds < 0.0, -body.folds, _CONVEX * body.folds) / np.pi
    flat = -np.log(np.clip(fold, _FLATTEST, 1.0))
    length = body.edge_lengths / max(float(body.edge_lengths.mean()), 1e-300)
    # Costs of faces count by area, so that fine and coarse places are alike.
    area = body.area / max(float(body.area.mean()), 1e-300)
    start = costs.argmin(axis=1).astype(np.int32)
    weights = _SMOOTHNESS * length * flat
    labels = expand_labels(start, costs * area[:, None], pairs, weights)

    def cut(k: int) -> Int32:  # noqa: ARG001  finds the number itself
        return labels

    return cut


def fit_gaussians(values: Float64, weights: Float64) -> tuple[Float64, Float64, Float64]:
    """Fit a mixture to weighted values, by expectation and maximisation from their quantiles.

    Returns
    -------
    mean, deviation, share : ndarray of shape (5,), float64
    """
    order = np.argsort(values, kind="stable")
    reach = np.cumsum(weights[order])
    at = np.searchsorted(reach, (np.arange(_LEVELS) + 0.5) / _LEVELS * reach[-1])
    mean = values[order][np.minimum(at, len(values) - 1)].astype(np.float64)
    deviation = np.full(_LEVELS, max(float(values.std()) / _LEVELS, _LEAST_DEVIATION))
    share = np.full(_LEVELS, 1.0 / _LEVELS)
    for _ in range(_ROUNDS):
        held = _likelihood(values, mean, deviation, share) + 1e-300
        held *= (weights / held.sum(axis=1))[:, None]
        total = np.maximum(held.sum(axis=0), 1e-300)
        mean = (held * values[:, None]).sum(axis=0) / total
        spread = (held * (values[:, None] - mean) ** 2).sum(axis=0) / total
        deviation = np.maximum(np.sqrt(spread), _LEAST_DEVIATION)
        share = total / total.sum()
    return mean, deviation, share


def _likelihood(values: Float64, mean: Float64, deviation: Float64, share: Float64) -> Float64:
    away = (values[:, None] - mean) / deviation
    return np.asarray(share * np.exp(-away * away / 2) / (deviation * np.sqrt(2 * np.pi)))


SHAPE_DIAMETER: Final = Cutter(
    "shape-diameter",
    "Shape Diameter",
    "Shapira, Shamir, Cohen-Or 2008",
    takes_k=False,
    prepare=_prepare,
    thesis="SD",
    departs="Five Gaussians for every model; the weight of borders, which the paper leaves open, "
    "was chosen on every eighth model.",
)
