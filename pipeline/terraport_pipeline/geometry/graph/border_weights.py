"""How much a border between two pieces weighs: length, fold and colour difference.

PURE: no I/O, no clock.

References
----------
A. Golovinskiy, T. Funkhouser, "Randomized cuts for 3D mesh analysis", ACM Transactions on Graphics
27(5), 2008, section 4, for the concavity; the colour factor is ours.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from terraport_payload.types import AnyInt, Float32, Int32, Int64
from terraport_pipeline.geometry.graph.face_graph import LAB_STEPS, UnitFacts
from terraport_pipeline.geometry.graph.graph_options import EdgeWeights

__all__ = ["border_weights"]


_LEAST_WEIGHT: Final = 1e-3
"""No border weighs less than this share of its length: a perimeter of zero would make a piece that
no size bound could move."""


def border_weights(
    pairs: Int32, length: Int64, facts: UnitFacts, weights: EdgeWeights
) -> tuple[Int64, float]:
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


@numba.njit(cache=True)
def _lab_differences(pairs: Int32, lab: AnyInt, faces: Int32, lightness: float) -> Float32:
    difference = np.empty(len(pairs), np.float32)
    for i in range(len(pairs)):
        u, v = pairs[i, 0], pairs[i, 1]
        square = 0.0
        for axis in range(3):
            step = (lab[u, axis] / faces[u] - lab[v, axis] / faces[v]) / LAB_STEPS
            if axis == 0:
                step *= lightness
            square += step * step
        difference[i] = np.sqrt(square)
    return difference


@numba.njit(cache=True)
def _weigh(
    pairs: Int32,
    length: Int64,
    normal: AnyInt,
    centre: AnyInt,
    faces: Int32,
    difference: Float32,
    scale: float,
    exponent: float,
) -> Int64:
    border = np.empty(len(pairs), np.int64)
    for i in range(len(pairs)):
        u, v = pairs[i, 0], pairs[i, 1]
        # (1) Unlike colours weigh less: a Gaussian of their difference.
        weight = 1.0
        if scale > 0.0:
            ratio = difference[i] / scale
            weight *= np.exp(-ratio * ratio)
        # (2) Folds weigh less by their angle; only concave ones, where the normals lean together.
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
        # (3) Whole steps, never 0: a border stays a border.
        steps = np.rint(length[i] * max(weight, _LEAST_WEIGHT))
        border[i] = np.int64(max(steps, 1.0))
    return border
