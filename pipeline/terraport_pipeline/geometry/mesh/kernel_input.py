"""What compiled kernels are given: one type of array, whoever calls.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from terraport_payload.types import AnyArray

__all__ = ["as_kernel_input"]


def as_kernel_input(array: npt.NDArray[np.generic], dtype: type[np.generic]) -> AnyArray:
    """Contiguous read-only view (or copy) of an array, for the compiled kernels.

    Whether an array may be written to is part of its type for numba: without this a kernel would be
    compiled once more for the first caller with a read-only (memory-mapped) array, which takes
    seconds.
    """
    view = np.ascontiguousarray(array, dtype).view()
    view.flags.writeable = False
    return view
