"""Uncertainty of volumes: one model for volumes at a toe and for cut and fill.

A volume between two surfaces is a sum of height differences over cells. Two kinds of error are
treated separately, as they add up differently:

- *shared* errors, the same in every cell (an offset between two surveys, a toe that is placed too
  far out): the area times the error;
- *independent* errors (noise of the points): root of the sum of squares over cells. For ``n`` cells
  of one size and one error, ``sqrt(n)`` times the cell's area times the error.

Both are standard deviations in cubic metres. The stated uncertainty is half a 95 % interval.

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
"""Half the width of a 95 % interval, in standard deviations."""


def noise_m3(area_m2: float, cell_m: float, noise_m: float) -> float:
    """Return the standard deviation of a volume from independent noise of its cells, cubic metres.

    Examples
    --------
    >>> noise_m3(400.0, 2.0, 0.1) == 100**0.5 * 2.0**2 * 0.1
    True
    """
    return float(np.sqrt(area_m2) * cell_m * noise_m)


def interval_m3(*deviations_m3: float) -> float:
    """Return half the 95 % interval of a volume, from its standard deviations of either kind."""
    return CONFIDENCE * float(np.sqrt(sum(deviation**2 for deviation in deviations_m3)))


def clipping_bias(height_m: AnyFloat, noise_m: float | Float64) -> Float64:
    """Return the bias that noise adds to height differences if only one sign is summed, metres.

    On ground that is level with the reference, noise alone gives a volume above and one below it.
    """
    # Beyond 40 standard deviations the bias is zero.
    t = np.minimum(np.abs(height_m) / np.maximum(noise_m, 1e-9), 40.0)
    density = np.exp(-0.5 * t**2) / np.sqrt(2.0 * np.pi)
    bias: Float64 = noise_m * (density - t * ndtr(-t))
    return bias
