"""How well a photo agrees with what is known of the places in it.

Brightness at the places' pixels is correlated with what the cloud, or the other photos, show there:
exposure and contrast drop out. Also with the picture moved by so many pixels: where that agrees
much better, the camera stands or looks beside where it says.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numba
import numpy as np

from terraport_payload.types import AnyFloat, Float32, Float64, Int32

__all__ = ["correlation", "moved_correlations"]


def correlation(one: AnyFloat, other: AnyFloat) -> float:
    """Correlate two rows of numbers; 0 where one of them does not change.

    Examples
    --------
    >>> round(correlation(np.array([1.0, 2.0, 3.0]), np.array([5.0, 7.0, 9.0])), 6)
    1.0
    """
    a, b = one - one.mean(dtype=np.float64), other - other.mean(dtype=np.float64)
    size = float(np.sqrt((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / size if size > 0.0 else 0.0


def moved_correlations(
    picture: Float32, column: Int32, row: Int32, value: Float32, reach: int
) -> Float64:
    """Correlate values with a picture that is moved to and fro.

    Parameters
    ----------
    picture : ndarray of shape (H, W), float32
    column, row : ndarray of shape (N,), int32
        Pixel of every value, at least `reach` from the picture's rim.
    value : ndarray of shape (N,), float32
    reach : int
        Pixels that the picture is moved at most.

    Returns
    -------
    ndarray of shape (2 * reach + 1, 2 * reach + 1), float64
        ``[reach + dy, reach + dx]``: with what the picture shows dx pixels right of and dy below
        each place; not moved in the middle.
    """
    centred = (value - value.mean(dtype=np.float64)).astype(np.float64)
    return _moved(picture, column, row, centred, reach)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _moved(picture: Float32, column: Int32, row: Int32, centred: Float64, reach: int) -> Float64:
    correlations = np.zeros((2 * reach + 1, 2 * reach + 1))
    square = 0.0
    for n in range(len(centred)):
        square += centred[n] * centred[n]
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            total, squares, products = 0.0, 0.0, 0.0
            for n in range(len(centred)):
                level = np.float64(picture[row[n] + dy, column[n] + dx])
                total += level
                squares += level * level
                products += level * centred[n]
            size = np.sqrt(max(squares - total * total / len(centred), 0.0) * square)
            if size > 1e-9:
                correlations[reach + dy, reach + dx] = products / size
    return correlations
