"""Colours for pictures: distinct ones for numbered things, a ramp for measured values.

All colours are sRGB, uint8.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import AnyFloat, Float64, UInt8

__all__ = [
    "DIVERGING_STOPS",
    "NO_VALUE",
    "RAMP_STOPS",
    "distinct_colours",
    "diverging_colours",
    "ramp_colours",
    "value_range",
]

RAMP_STOPS: Final[tuple[str, ...]] = (
    "#440154",
    "#472d7b",
    "#3b528b",
    "#2c728e",
    "#21918c",
    "#28ae80",
    "#5ec962",
    "#addc30",
    "#fde725",
)
"""Viridis (Smith and van der Walt 2015, CC0) at nine even stops: even steps of lightness, safe for
colour-blind eyes."""

DIVERGING_STOPS: Final[tuple[str, ...]] = (
    "#67001f",
    "#b2182b",
    "#d6604d",
    "#f4a582",
    "#fddbc7",
    "#f7f7f7",
    "#d1e5f0",
    "#92c5de",
    "#4393c3",
    "#2166ac",
    "#053061",
)
"""RdBu (ColorBrewer, C. Brewer and M. Harrower, Apache 2.0) at eleven even stops: below, and above,
a middle that counts as nothing. Red and blue are told apart by all common kinds of colour-blind
eyes."""

NO_VALUE: Final = (150, 150, 150)
"""Drawn where a value is missing (NaN)."""

GOLDEN_RATIO_CONJUGATE: Final = 0.6180339887498949
"""Steps of this share of the hue circle keep any run of consecutive numbers far apart."""

LEVELS: Final = ((0.72, 0.12), (0.58, 0.13), (0.82, 0.09))
"""OKLab lightness and chroma, used in turn: levels tell apart what the hue alone would not."""


def distinct_colours(count: int) -> UInt8:
    """Give each number a colour of its own, far from those of its neighbours in number.

    The colour of a number does not depend on ``count``, so a picture of part of a scene has the
    colours of the whole.

    Parameters
    ----------
    count : int
        How many, >= 0.

    Returns
    -------
    ndarray of shape (count, 3), uint8
        sRGB.

    References
    ----------
    B. Ottosson, "A perceptual color space for image processing" (OKLab), 2020.
    """
    number = np.arange(count)
    hue = 2 * np.pi * ((0.08 + number * GOLDEN_RATIO_CONJUGATE) % 1.0)
    level = np.array(LEVELS)[number % len(LEVELS)].reshape(-1, 2)
    return _oklab_to_srgb(level[:, 0], level[:, 1] * np.cos(hue), level[:, 1] * np.sin(hue))


def ramp_colours(values: AnyFloat, low: float, high: float) -> UInt8:
    """Colour measured values by the ramp.

    Parameters
    ----------
    values : ndarray of shape (N,)
        NaN gives :data:`NO_VALUE`.
    low, high : float
        Values at and beyond which the first and last colour are drawn; equal ones give the first.

    Returns
    -------
    ndarray of shape (N, 3), uint8
        sRGB.
    """
    return _between_stops(values, low, high, RAMP_STOPS)


def diverging_colours(values: AnyFloat, span: float) -> UInt8:
    """Colour values that may lie on either side of 0: red below, blue above.

    Parameters
    ----------
    values : ndarray of shape (N,)
        NaN gives :data:`NO_VALUE`.
    span : float
        Values at and beyond which, on either side, the last colour is drawn.

    Returns
    -------
    ndarray of shape (N, 3), uint8
        sRGB.
    """
    return _between_stops(values, -span, span, DIVERGING_STOPS)


def _between_stops(values: AnyFloat, low: float, high: float, ramp: tuple[str, ...]) -> UInt8:
    stops = np.array([[int(stop[i : i + 2], 16) for i in (1, 3, 5)] for stop in ramp])
    span = high - low
    share = (np.asarray(values, np.float64) - low) / span if span > 0 else np.zeros(len(values))
    share = np.where(np.isnan(values), np.nan, share)
    position = np.clip(np.nan_to_num(share), 0, 1) * (len(stops) - 1)
    channels = [np.interp(position, np.arange(len(stops)), stops[:, c]) for c in range(3)]
    colours = np.round(np.stack(channels, axis=1)).astype(np.uint8)
    colours[np.isnan(share)] = NO_VALUE
    return colours


def value_range(values: AnyFloat) -> tuple[float, float]:
    """Choose the ramp's ends: the 1st and 99th percentile, so that no single spike sets them.

    Parameters
    ----------
    values : ndarray of shape (N,)
        NaN are left out.

    Returns
    -------
    low, high : float
        (0, 0) when no value is finite.
    """
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return 0.0, 0.0
    low, high = np.percentile(finite, [1, 99])
    return float(low), float(high)


def _oklab_to_srgb(lightness: Float64, a: Float64, b: Float64) -> UInt8:
    long = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3
    medium = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3
    short = (lightness - 0.0894841775 * a - 1.2914855480 * b) ** 3
    linear = np.stack(
        [
            4.0767416621 * long - 3.3077115913 * medium + 0.2309699292 * short,
            -1.2684380046 * long + 2.6097574011 * medium - 0.3413193965 * short,
            -0.0041960863 * long - 0.7034186147 * medium + 1.7076147010 * short,
        ],
        axis=1,
    )
    linear = np.clip(linear, 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(encoded * 255).astype(np.uint8)
