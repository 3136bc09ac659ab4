"""Uncertainty of volumes: one model for volumes at a toe and for cut and fill.

A volume between two surfaces is a sum of height differences over cells. Two kinds of error are kept
apart, as they add up differently:

- *shared* errors, the same in every cell (two surveys that are apart throughout, a toe that is
  placed too far out): the area times the error;
- *independent* errors (noise of the points): root of the sum of squares over cells. Of ``n`` cells
  of one size and one error, ``sqrt(n)`` times the cell's area times the error.

Both are standard deviations in cubic metres. What is stated is half the width of a 95 % interval.

References
----------
S. W. Anderson, "Uncertainty in quantitative analyses of topographic change: error propagation and
the role of thresholding", Earth Surface Processes and Landforms 44, 2019, doi:10.1002/esp.4551.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.special import ndtr

from terraport_payload.types import AnyFloat, Float64

__all__ = ["CONFIDENCE", "clipping_bias", "interval_m3", "noise_m3"]

CONFIDENCE: Final = 1.96
"""Standard deviations of half a 95 % interval."""


def noise_m3(area_m2: float, cell_m: float, noise_m: float) -> float:
    """Return the standard deviation of a volume by independent noise of its cells, cubic metres.

    Examples
    --------
    >>> noise_m3(400.0, 2.0, 0.1) == 100**0.5 * 2.0**2 * 0.1
    True
    """
    return float(np.sqrt(area_m2) * cell_m * noise_m)


def interval_m3(*deviations_m3: float) -> float:
    """Return half the 95 % interval of a volume with these standard deviations, shared or not."""
    return CONFIDENCE * float(np.sqrt(sum(deviation**2 for deviation in deviations_m3)))


def clipping_bias(height_m: AnyFloat, noise_m: float | Float64) -> Float64:
    """Return what noise adds to a height difference of which one sign alone is summed, metres.

    On ground that is level with the reference, noise alone has a volume above and one below it.
    """
    # Of 40 deviations and more nothing is left.
    t = np.minimum(np.abs(height_m) / np.maximum(noise_m, 1e-9), 40.0)
    density = np.exp(-0.5 * t**2) / np.sqrt(2.0 * np.pi)
    bias: Float64 = noise_m * (density - t * ndtr(-t))
    return bias
