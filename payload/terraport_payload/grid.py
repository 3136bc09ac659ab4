"""The scene's quantisation: one position grid, one scale per attribute.

One grid for the whole scene, not one per segment: a grid scaled to each segment's box would round a
border vertex differently in two neighbours, which is a crack. The step is a power of two, so that
``origin + step * code`` is exact in float32 wherever ``|coordinate| < 2**24 * step``, on the CPU
and in a shader alike.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.errors import PayloadError
from terraport_payload.types import Float32, Int64, UInt16

__all__ = [
    "MAX_CODE",
    "MAX_STEPS",
    "MIN_STEP_M",
    "NULL_CODE",
    "AttributeScale",
    "choose_attribute_scale",
    "choose_step_m",
    "decode_attribute",
    "encode_attribute",
    "grid_codes",
    "snap",
]

MAX_CODE: Final = 65535
"""Widest segment in steps: positions are unsigned 16-bit about the segment's origin."""

MAX_STEPS: Final = 1 << 24
"""Farthest grid coordinate, exclusive: float32 holds every integer below it exactly."""

MIN_STEP_M: Final = 2.0**-12
"""0.24 mm: finer than any survey, and 65535 of them still span 16 m."""

NULL_CODE: Final = 65535
"""Attribute code that stands for "no value here" (NaN)."""

MAX_ERROR_M: Final = 0.0025
"""A default grid moves no vertex by more than this along an axis, however coarse the survey."""

ERROR_PER_SPACING: Final = 1.0 / 64.0
"""Nor by more than this part of the point spacing: far below the noise of any survey."""

_FLOAT32_MAX: Final = float(np.finfo(np.float32).max)

_ATTRIBUTE_LEVELS: Final = 65534
"""Largest attribute code that is a value."""


@dataclass(frozen=True, slots=True)
class AttributeScale:
    """How 16-bit codes of one attribute become values: ``offset + step * code``.

    Raises
    ------
    PayloadError
        When offset or step is not finite, step is not positive, or a value would not fit float32.

    Examples
    --------
    >>> AttributeScale(offset=1.0, step=0.5)
    AttributeScale(offset=1.0, step=0.5)
    """

    offset: float
    """Value of code 0, in the attribute's own unit."""
    step: float
    """Value per code, in the attribute's own unit."""

    def __post_init__(self) -> None:
        last = self.offset + self.step * _ATTRIBUTE_LEVELS
        inside = abs(self.offset) <= _FLOAT32_MAX and abs(last) <= _FLOAT32_MAX
        if not (inside and self.step > 0):  # NaN fails every comparison
            raise PayloadError(
                f"attribute scale offset={self.offset!r} step={self.step!r}, "
                "expected finite numbers and step > 0, all values within float32"
            )


def choose_step_m(
    widest_segment_m: float, farthest_m: float = 0.0, spacing_m: float = 0.0
) -> float:
    """Choose the grid step of a scene: as fine as its survey deserves, as coarse as it needs.

    Finer steps cost bytes and show nothing: what is below the survey's noise does not compress.

    Parameters
    ----------
    widest_segment_m : float
        Longest side of any segment's axis-aligned box, metres.
    farthest_m : float, optional
        Largest absolute scene coordinate, metres.
    spacing_m : float, optional
        Typical distance between the survey's points, metres; 0 when it is not known.

    Returns
    -------
    float
        A power of two of at least 2^-12 m: the largest whose error (half a step along each axis) is
        at most :data:`ERROR_PER_SPACING` of the spacing and :data:`MAX_ERROR_M`, or the smallest
        for which every segment spans at most 65534 steps (one is left for the rounding of either
        end) and no coordinate reaches 2^24 steps, whichever is larger.

    Raises
    ------
    PayloadError
        When a length is negative or not finite.

    Examples
    --------
    >>> choose_step_m(15.0) == 2.0**-12
    True
    >>> choose_step_m(40.0, 300.0) == 2.0**-10
    True
    >>> choose_step_m(15.0, spacing_m=0.12) == 2.0**-9
    True
    """
    lengths = {
        "widest_segment_m": widest_segment_m,
        "farthest_m": farthest_m,
        "spacing_m": spacing_m,
    }
    for name, value in lengths.items():
        if not (math.isfinite(value) and value >= 0):
            raise PayloadError(f"{name} is {value!r}, expected a finite length >= 0")
    step = MIN_STEP_M
    while step <= min(ERROR_PER_SPACING * spacing_m, MAX_ERROR_M):  # 2 * step has an error of step
        step *= 2.0
    while widest_segment_m > (MAX_CODE - 1) * step or farthest_m >= (MAX_STEPS - 1) * step:
        step *= 2.0
    return step


def grid_codes(positions: Float32, step_m: float) -> Int64:
    """Round positions to whole steps.

    Parameters
    ----------
    positions : ndarray of shape (V, 3), float32
        Metres, scene frame.
    step_m : float
        Grid step, a power of two, metres.

    Returns
    -------
    ndarray of shape (V, 3), int64
        Nearest grid coordinate; halves round to even.

    Raises
    ------
    PayloadError
        When step_m is not a power of two, or a position is not finite or lies 2^24 steps or more
        from the origin.

    Examples
    --------
    >>> grid_codes(np.array([[0.9, 0.5, -1.0]], dtype=np.float32), 0.5).tolist()
    [[2, 1, -2]]
    """
    if not (math.isfinite(step_m) and step_m > 0 and math.frexp(step_m)[0] == 0.5):
        raise PayloadError(f"step_m is {step_m!r}, expected a positive power of two")
    codes = np.rint(positions.astype(np.float64) / step_m)
    if not bool((np.abs(codes) < MAX_STEPS).all()):  # NaN and infinity fail the comparison too
        farthest = float(np.abs(positions).max())
        raise PayloadError(
            f"a position is {farthest} m from the scene's origin, "
            f"expected finite and below 2^24 steps ({MAX_STEPS * step_m} m at step {step_m} m); "
            "use a coarser step"
        )
    return codes.astype(np.int64)


def snap(positions: Float32, step_m: float) -> Float32:
    """Round positions to the grid; exactly what decoding a payload gives back.

    Parameters
    ----------
    positions : ndarray of shape (V, 3), float32
        Metres, scene frame.
    step_m : float
        Grid step, a power of two, metres.

    Returns
    -------
    ndarray of shape (V, 3), float32
        Within step_m / 2 of the input along each axis.

    Raises
    ------
    PayloadError
        As :func:`grid_codes`.

    Examples
    --------
    >>> snap(np.array([[0.9, 0.1, -1.2]], dtype=np.float32), 0.5).tolist()
    [[1.0, 0.0, -1.0]]
    """
    return (grid_codes(positions, step_m) * step_m).astype(np.float32)


def choose_attribute_scale(values: Float32) -> AttributeScale:
    """Choose the scale for all values of one attribute in a scene.

    Whole numbers that span at most 65534 get step 1 and come back exactly; everything else divides
    its range by 65534.

    Parameters
    ----------
    values : ndarray of shape (N,), float32
        NaN stands for "no value".

    Returns
    -------
    AttributeScale
        Offset and step in the values' own unit; (0, 1) when there is no value at all.

    Raises
    ------
    PayloadError
        When a value is infinite.

    Examples
    --------
    >>> choose_attribute_scale(np.array([3, 9, np.nan], dtype=np.float32))
    AttributeScale(offset=3.0, step=1.0)
    """
    known = values[~np.isnan(values)].astype(np.float64)
    if known.size == 0:
        return AttributeScale(0.0, 1.0)
    low, high = float(known.min()), float(known.max())
    if not (math.isfinite(low) and math.isfinite(high)):
        raise PayloadError(
            "an attribute value is infinite, expected finite numbers or NaN for none"
        )
    if high - low <= _ATTRIBUTE_LEVELS and bool((known == np.rint(known)).all()):
        return AttributeScale(low, 1.0)
    step = (high - low) / _ATTRIBUTE_LEVELS
    return AttributeScale(low, step if step > 0 else 1.0)


def encode_attribute(values: Float32, scale: AttributeScale) -> UInt16:
    """Round attribute values to 16-bit codes.

    Parameters
    ----------
    values : ndarray of shape (V,), float32
        In the attribute's own unit; NaN becomes the null code.
    scale : AttributeScale
        The scene's scale for this attribute.

    Returns
    -------
    ndarray of shape (V,), uint16
        0..65534 for values, 65535 for none.

    Raises
    ------
    PayloadError
        When a value lies more than half a step outside the scale, which would need clamping.

    Examples
    --------
    >>> values = np.array([1.2, np.nan], dtype=np.float32)
    >>> encode_attribute(values, AttributeScale(1.0, 0.1)).tolist()
    [2, 65535]
    """
    nothing = np.isnan(values)
    codes = np.rint(
        (np.where(nothing, scale.offset, values).astype(np.float64) - scale.offset) / scale.step
    )
    if codes.size and not (codes.min() >= 0 and codes.max() <= _ATTRIBUTE_LEVELS):
        top = scale.offset + scale.step * _ATTRIBUTE_LEVELS
        raise PayloadError(
            f"attribute values {float(np.nanmin(values))} to {float(np.nanmax(values))}, "
            f"expected within the scale's {scale.offset} to {top}; "
            "choose the scale over the whole scene"
        )
    codes[nothing] = NULL_CODE
    return codes.astype(np.uint16)


def decode_attribute(codes: UInt16, scale: AttributeScale) -> Float32:
    """Turn 16-bit codes back into values.

    Parameters
    ----------
    codes : ndarray of shape (V,), uint16
        0..65534 for values, 65535 for none.
    scale : AttributeScale
        The scene's scale for this attribute.

    Returns
    -------
    ndarray of shape (V,), float32
        Within step / 2 of what was encoded (and float32's own rounding); NaN for the null code.

    Examples
    --------
    >>> decode_attribute(np.array([2, 65535], dtype=np.uint16), AttributeScale(1.0, 0.5)).tolist()
    [2.0, nan]
    """
    values = (scale.offset + scale.step * codes.astype(np.float64)).astype(np.float32)
    values[codes == NULL_CODE] = np.nan
    return values
