"""Probabilities of units, evened out along the ground up to the next border. PURE.

Each unit keeps to what its own looks say and is drawn to its neighbours, the more the stronger they
hang together: the least of the sum of both is a random walk that starts at a unit, goes on to a
neighbour or ends, and asks where it ends (L. Grady, "Multilabel Random Walker Image Segmentation
Using Prior Models", CVPR 2005).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.sparse import csr_array

from terraport_payload.types import Float32, Float64

__all__ = ["evened_out"]

_ENDS: Final = 0.05
"""How readily a walk ends, where 1 is how readily it goes on to a neighbour of the same looks."""

_ROUNDS: Final = 30
"""Of conjugate gradients at most; each takes a product with the neighbours for every name."""

_EXACT: Final = 0.01
"""Largest error of a probability at which they end earlier."""


def evened_out(votes: Float32, hold: csr_array) -> Float64:
    """Even out votes along the ground.

    Parameters
    ----------
    votes : ndarray of shape (U, C), float32
        Probabilities of every class; rows add up to 1.
    hold : sparse array of shape (U, U)
        Symmetric; how strongly neighbours hang together, from ``unit_patches``.

    Returns
    -------
    ndarray of shape (U, C), float64
        Not below 0; rows add up to 1. What one unit alone says against all around it is outvoted;
        across a border hardly anything passes.
    """
    own = votes.astype(np.float64)
    diagonal = _ENDS + np.asarray(hold.sum(axis=1)).reshape(-1, 1)
    # Conjugate gradients with the diagonal taken out, all classes side by side.
    result = own.copy()
    rest = _ENDS * own - (diagonal * result - hold @ result)
    scaled = rest / diagonal
    way = scaled.copy()
    size = (rest * scaled).sum(axis=0)
    for _ in range(_ROUNDS):
        if np.abs(rest).max(initial=0.0) <= _EXACT * _ENDS:
            break
        image = diagonal * way - hold @ way
        step = size / np.maximum((way * image).sum(axis=0), 1e-300)
        result += step * way
        rest -= step * image
        scaled = rest / diagonal
        before, size = size, (rest * scaled).sum(axis=0)
        way = scaled + (size / np.maximum(before, 1e-300)) * way
    np.maximum(result, 0.0, out=result)
    evened: Float64 = result / np.maximum(result.sum(axis=1, keepdims=True), 1e-300)
    return evened
