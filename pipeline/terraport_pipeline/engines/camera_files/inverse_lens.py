"""Lenses whose distortion is stated the other way round: from the photo to the ray.

VisualSFM states ``(1 + r m^2) m`` of a *measured* point m as where an ideal lens would put it. Our
lens goes from the ray to the pixel, so its polynomial is fitted to the inverse over the radius of
the picture, as exactly as the photo's pixels need.
"""

from __future__ import annotations

from typing import Final

import numpy as np

__all__ = ["invert_radial"]

_TERMS: Final = 6
"""Coefficients of the fitted polynomial; as many as a lens takes."""

_SAMPLES: Final = 512

_LARGEST_ERROR_PX: Final = 0.005
"""A tenth of what photogrammetry itself reaches."""


def invert_radial(undistortion: float, focal_px: float, radius_px: float) -> tuple[float, ...]:
    """Fit radial coefficients to the inverse of ``(1 + r m^2) m``.

    Parameters
    ----------
    undistortion : float
        r, of measured points divided by the focal length.
    focal_px : float
    radius_px : float
        From the principal point to the farthest corner.

    Returns
    -------
    tuple of float
        k1 .. k6 of our lens; empty where there is no distortion.

    Raises
    ------
    ValueError
        The distortion folds back within the picture, or no polynomial comes near it.

    Examples
    --------
    >>> invert_radial(0.0, 1000.0, 700.0)
    ()
    >>> round(invert_radial(-0.02, 1000.0, 700.0)[0], 4)
    0.02
    """
    if undistortion == 0.0:
        return ()
    farthest = radius_px / focal_px
    if 1.0 + 3.0 * undistortion * farthest**2 <= 0.05:
        raise ValueError(f"a radial distortion of {undistortion:g} folds the picture's corners")
    measured = np.linspace(0.0, farthest, _SAMPLES)
    ideal = measured * (1.0 + undistortion * measured**2)
    # In units of the largest radius, so that the columns are of like size.
    largest = ideal[-1]
    powers = np.arange(1, _TERMS + 1)
    columns = (ideal[:, None] / largest) ** (2 * powers + 1)
    scaled, *_ = np.linalg.lstsq(columns, measured - ideal, rcond=None)
    error_px = float(np.abs(columns @ scaled - (measured - ideal)).max()) * focal_px
    if error_px > _LARGEST_ERROR_PX:
        raise ValueError(
            f"a radial distortion of {undistortion:g} cannot be turned round within "
            f"{_LARGEST_ERROR_PX} pixels ({error_px:.3f})"
        )
    return tuple((scaled / largest ** (2 * powers + 1)).tolist())
