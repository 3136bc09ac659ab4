"""The density map of a survey as a small picture."""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import UInt8
from terraport_pipeline.geometry.clouds.density_map import DensityMap

__all__ = ["draw_density"]

_SCALE: Final = np.array(
    [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]], np.float64
)
"""Dark to light, even to the eye and to those who do not tell red from green (viridis)."""

_EMPTY: Final = 255

_LEAST_SIDE: Final = 400
"""Pixels of the longer side at least: cells of a small map become squares."""

_PERCENTILES: Final = (2, 98)
"""Densities of the scale's ends."""


def draw_density(density: DensityMap) -> UInt8:
    """Draw a map, north up: white where there is no sample, else dark (thin) to yellow (dense).

    Returns
    -------
    ndarray of shape (height, width, 3), uint8
        sRGB. The scale is that of logarithms, from the 2nd to the 98th percentile.
    """
    counts = density.counts
    picture: UInt8 = np.full((*counts.shape, 3), _EMPTY, np.uint8)
    occupied = density.occupied
    if occupied.any():
        logs = np.log(counts[occupied].astype(np.float64))
        least, most = np.percentile(logs, _PERCENTILES)
        at = np.clip((logs - least) / max(most - least, 1e-9), 0.0, 1.0) * (len(_SCALE) - 1)
        for channel in range(3):
            values = np.interp(at, np.arange(len(_SCALE)), _SCALE[:, channel])
            picture[occupied, channel] = np.rint(values).astype(np.uint8)
    factor = max(1, -(-_LEAST_SIDE // max(counts.shape)))
    return np.repeat(np.repeat(picture, factor, axis=0), factor, axis=1)
