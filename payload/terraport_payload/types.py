"""The array types that signatures name, by dtype; every package but the wire takes them from here.

Shapes, units and frames stand in the docstring of the function or the field.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = [
    "AnyArray",
    "AnyFloat",
    "AnyInt",
    "Bool",
    "Float16",
    "Float32",
    "Float64",
    "Int8",
    "Int16",
    "Int32",
    "Int64",
    "UInt8",
    "UInt16",
    "UInt32",
    "UInt64",
]

Bool = npt.NDArray[np.bool_]
Int8 = npt.NDArray[np.int8]
Int16 = npt.NDArray[np.int16]
Int32 = npt.NDArray[np.int32]
Int64 = npt.NDArray[np.int64]
UInt8 = npt.NDArray[np.uint8]
UInt16 = npt.NDArray[np.uint16]
UInt32 = npt.NDArray[np.uint32]
UInt64 = npt.NDArray[np.uint64]
Float16 = npt.NDArray[np.float16]
Float32 = npt.NDArray[np.float32]
Float64 = npt.NDArray[np.float64]

AnyInt = npt.NDArray[np.integer]
"""Integers of any width, signed or not."""
AnyFloat = npt.NDArray[np.floating]
"""Floats of any width."""
AnyArray = npt.NDArray[Any]
"""Of any dtype: kept as it came."""
