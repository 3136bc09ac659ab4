"""Probabilities of units, averaged along the ground with those that look alike. PURE."""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.learning.ground_units import GroundUnits

__all__ = ["averaged", "unit_pairs"]

_ROUNDS: Final = 16
"""A vote reaches so many units; where a border is, one."""

_COLOUR: Final = 6.0
"""CIELAB units by which neighbours differ where their votes count .6 for each other."""

_SLOPE_DEG: Final = 12.0


def unit_pairs(units: GroundUnits, face_pairs: Int32) -> Int64:
    """Find units that touch, (P, 2), each pair once, lower first."""
    one, other = units.of_face[face_pairs[:, 0]], units.of_face[face_pairs[:, 1]]
    apart = one != other
    low = np.minimum(one[apart], other[apart]).astype(np.int64)
    high = np.maximum(one[apart], other[apart]).astype(np.int64)
    keys = np.unique(low * units.count + high)
    return np.stack(np.divmod(keys, units.count), axis=1)


def averaged(votes: Float32, features: Float32, pairs: Int64) -> Float64:
    """Average votes with those of neighbours of like colour and slope, round by round.

    Parameters
    ----------
    votes : ndarray of shape (U, C), float32
        Probabilities of every class.
    features : ndarray of shape (U, K), float32
        From ``ground_features``: lightness, a, b first, then deviation and slope.
    pairs : ndarray of shape (P, 2), int64
        From :func:`unit_pairs`.

    Returns
    -------
    ndarray of shape (U, C), float64
        Rows add up to 1. What one unit alone says against all around it is outvoted; across a
        border, where colour or slope change, hardly anything passes.
    """
    one, other = pairs.T
    lab = features[:, :3].astype(np.float64)
    colour = ((lab[one] - lab[other]) ** 2).sum(axis=1) / (2 * _COLOUR**2)
    slope = (features[one, 4] - features[other, 4]).astype(np.float64) ** 2 / (2 * _SLOPE_DEG**2)
    weight = np.exp(-colour - slope)
    count = len(votes)
    total = 1.0 + np.bincount(one, weight, count) + np.bincount(other, weight, count)
    result: Float64 = votes.astype(np.float64)
    for _ in range(_ROUNDS):
        summed = result.copy()
        for kind in range(votes.shape[1]):
            column = result[:, kind]
            summed[:, kind] += np.bincount(one, weight * column[other], count)
            summed[:, kind] += np.bincount(other, weight * column[one], count)
        result = summed / total[:, None]
    return result
