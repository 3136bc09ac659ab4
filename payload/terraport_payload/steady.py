"""Codes that change as little as their bounds allow, which is what the vertex codec stores.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import numpy.typing as npt

__all__ = ["steady_codes"]

_Integer = TypeVar("_Integer", bound=np.signedinteger)


def steady_codes(
    least: npt.NDArray[_Integer], most: npt.NDArray[_Integer]
) -> npt.NDArray[_Integer]:
    """Choose a code within bounds for every place, the nearest to the code before it.

    Parameters
    ----------
    least, most : ndarray of the same shape, signed integer
        Bounds along the last axis, ``least <= most``. Not modified.

    Returns
    -------
    ndarray, same shape and dtype
        The first is its lower bound.

    Notes
    -----
    Each code is the one before, clamped. Clamps that follow one another make a clamp again, so a
    prefix scan of bounds does it in log2 of the length steps.

    Examples
    --------
    >>> steady_codes(np.array([2, 0, 4, 0]), np.array([3, 5, 6, 5])).tolist()
    [2, 2, 4, 4]
    """
    low, high = least.copy(), most.copy()
    reach = 1
    while reach < low.shape[-1]:
        own = low[..., reach:], high[..., reach:]
        earlier = [
            np.minimum(np.maximum(bound[..., :-reach], own[0]), own[1]) for bound in (low, high)
        ]
        low[..., reach:], high[..., reach:] = earlier
        reach *= 2
    return low
