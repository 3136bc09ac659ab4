"""Probabilities of units, evened out along the ground up to the next border. PURE.

Each unit keeps to what its own looks say and is drawn to its neighbours, the more the stronger they
hang together: the least of the sum of both is a random walk that starts at a unit, goes on to a
neighbour or ends, and asks where it ends (L. Grady, "Multilabel Random Walker Image Segmentation
Using Prior Models", CVPR 2005).
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from scipy.sparse import csr_array

from terraport_payload.types import Float32, Float64, Int32

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
    own = np.ascontiguousarray(votes, np.float64)
    diagonal = _ENDS + np.asarray(hold.sum(axis=1)).reshape(-1)
    matrix = hold.tocsr()
    # Conjugate gradients with the diagonal taken out, all classes side by side. Each round goes
    # over the units three times, and not once for every operation.
    result = own.copy()
    image, way = np.empty_like(own), np.empty_like(own)
    _product(matrix.indptr, matrix.indices, matrix.data, diagonal, result, image)
    rest = _ENDS * own - image
    size = _prepared(rest, diagonal, way)
    for _ in range(_ROUNDS):
        if np.abs(rest).max(initial=0.0) <= _EXACT * _ENDS:
            break
        along = _product(matrix.indptr, matrix.indices, matrix.data, diagonal, way, image)
        step = size / np.maximum(along, 1e-300)
        before, size = size, _stepped(step, way, image, diagonal, result, rest)
        _turned(size / np.maximum(before, 1e-300), rest, diagonal, way)
    np.maximum(result, 0.0, out=result)
    evened: Float64 = result / np.maximum(result.sum(axis=1, keepdims=True), 1e-300)
    return evened


@numba.njit(cache=True, nogil=True)
def _product(
    start: Int32,
    neighbours: Int32,
    hold: Float64,
    diagonal: Float64,
    way: Float64,
    image: Float64,
) -> Float64:
    """Set `image` to the system times `way`; return the products of both, by class."""
    units, classes = way.shape
    along = np.zeros(classes, np.float64)
    for unit in range(units):
        for kind in range(classes):
            image[unit, kind] = diagonal[unit] * way[unit, kind]
        for at in range(start[unit], start[unit + 1]):
            other, weight = neighbours[at], hold[at]
            for kind in range(classes):
                image[unit, kind] -= weight * way[other, kind]
        for kind in range(classes):
            along[kind] += image[unit, kind] * way[unit, kind]
    return along


@numba.njit(cache=True, nogil=True)
def _prepared(rest: Float64, diagonal: Float64, way: Float64) -> Float64:
    """Set `way` to what is left, by the diagonal; return the products of both, by class."""
    units, classes = rest.shape
    size = np.zeros(classes, np.float64)
    for unit in range(units):
        for kind in range(classes):
            way[unit, kind] = rest[unit, kind] / diagonal[unit]
            size[kind] += rest[unit, kind] * way[unit, kind]
    return size


@numba.njit(cache=True, nogil=True)
def _stepped(
    step: Float64,
    way: Float64,
    image: Float64,
    diagonal: Float64,
    result: Float64,
    rest: Float64,
) -> Float64:
    """Go a step; return the size of what is left, by class."""
    units, classes = rest.shape
    size = np.zeros(classes, np.float64)
    for unit in range(units):
        for kind in range(classes):
            result[unit, kind] += step[kind] * way[unit, kind]
            left = rest[unit, kind] - step[kind] * image[unit, kind]
            rest[unit, kind] = left
            size[kind] += left * left / diagonal[unit]
    return size


@numba.njit(cache=True, nogil=True)
def _turned(turn: Float64, rest: Float64, diagonal: Float64, way: Float64) -> None:
    """Set the next way."""
    units, classes = rest.shape
    for unit in range(units):
        for kind in range(classes):
            way[unit, kind] = rest[unit, kind] / diagonal[unit] + turn[kind] * way[unit, kind]
