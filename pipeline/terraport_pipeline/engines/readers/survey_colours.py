"""Which columns of a survey are its colours, and how their values become 0..255.

PURE.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyArray, Bool, Float64, Int64, UInt8

__all__ = [
    "DEPTH_TEXTS",
    "GREY",
    "ColourCounts",
    "ColourRule",
    "brightness_warnings",
    "choose_rule",
    "find_colours",
]

GREY: Final = 160
"""sRGB value of points without colour: perceived as halfway between black and white when lit."""

_COLOUR_NAMES: Final = (
    ("red", "green", "blue"),
    ("r", "g", "b"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
)
"""Field names that mean colour, compared in lower case."""

_UNIT: Final = 1.0
_EIGHT: Final = 255.0
_SIXTEEN: Final = 65535.0
DEPTH_TEXTS: Final = {"unit": "0 to 1", "eight": "8 bits", "sixteen": "16 bits"}
"""Texts that messages use for the depths."""

_NAMES: Final = {_UNIT: "unit", _EIGHT: "eight", _SIXTEEN: "sixteen"}

_EDGES: Final = np.array([0.0, 0.5, _UNIT, 2.0, 127.0, _EIGHT, 511.0, _SIXTEEN])
"""Upper limits of the histogram bins for a point's brightest channel."""

_FEW: Final = 0.01
"""Largest share of points above a depth's maximum that counts as writer errors."""

_BULK: Final = 0.1
_DROP: Final = 1 / 16
"""Colours end at the maximum of a depth if the upper half of its range has at least the first share
of its points, and the equally wide range above it less than the second share of that half. Dark
colours of a larger depth decrease steadily instead (an exponential never meets both conditions)."""

_SLIPS: Final = {_UNIT: 16.0, _EIGHT: 511.0}
"""Largest value that is still read with each depth, as some writers round up or do not clip. With
the next larger depth, such a point would be black."""

_FAR_BEYOND: Final = 32
"""Ratio of stated limits to the depth of the values above which the limits are ignored."""

_IMPOSSIBLE: Final = 0.05
"""Share of points with impossible values above which the fields are not colours."""

_FEWEST: Final = 50
"""Minimum number of points for a brightness warning; a smaller survey is refused later."""

_BLACK_SHARE: Final = 0.02
_DARK_MEDIAN: Final = 20
_DARK_MOST: Final = 64
"""A scene is nearly black if the median of the points' brightest channels is below the first, or
their 99th percentile below the second, of 255."""


@dataclass(slots=True)
class ColourCounts:
    """Statistics of the colours of a file, or of a scan in it, collected while it is read."""

    limits: tuple[float, float] | None = None
    """Smallest and largest value that a channel can have, as the file states."""
    bins: Int64 = field(default_factory=lambda: np.zeros(len(_EDGES) + 1, np.int64))
    """Histogram of the brightest channel of the points with a colour."""
    steps: int = 0
    """Number of points above 255 whose channels are 8-bit values times 256 or 257."""
    none: int = 0
    """Number of points without colour: a channel is not a finite number."""
    negative: int = 0
    beyond: int = 0
    """Number of points with a channel outside the stated limits."""
    low: float = np.inf
    high: float = -np.inf
    whole: bool = True

    def look(self, colours: AnyArray) -> None:
        """Update with the colours (n, 3) of more points."""
        if colours.dtype.kind == "f":
            finite = np.isfinite(colours).all(axis=1)
            self.none += len(colours) - int(finite.sum())
            colours = colours[finite]
            self.whole = self.whole and bool((colours == np.rint(colours)).all())
        if not len(colours):
            return
        top, least = colours.max(axis=1), colours.min(axis=1)
        self.low, self.high = min(self.low, float(least.min())), max(self.high, float(top.max()))
        self.bins += np.bincount(np.searchsorted(_EDGES, top), minlength=len(self.bins))
        self.negative += int((least < 0).sum())
        wide = colours[top > _EIGHT]
        if len(wide):
            self.steps += int(_are_widened(wide).sum())
        if self.limits is not None:
            self.beyond += int(((least < self.limits[0]) | (top > self.limits[1])).sum())

    @property
    def total(self) -> int:
        """Number of points with a colour, including black ones."""
        return int(self.bins.sum())

    @property
    def impossible(self) -> int:
        """Number of points with a value that no depth allows."""
        return int(self.bins[-1]) + self.negative

    def below(self, top: float) -> int:
        """Count the points that are not black and have no channel above a depth's maximum."""
        return int(self.bins[1 : int(np.searchsorted(_EDGES, top)) + 1].sum())

    def above(self, top: float) -> int:
        """Count the points with a channel above a depth's maximum."""
        return int(self.bins[int(np.searchsorted(_EDGES, top)) + 1 :].sum())

    def stops_at(self, top: float) -> bool:
        """Return whether at least some points have a depth, by the distribution of values."""
        below, above = self.below(top), self.above(top)
        if not below or not above:
            return below > 0
        at = int(np.searchsorted(_EDGES, top))
        upper, beyond = int(self.bins[at]), int(self.bins[at + 1])
        if top == _EIGHT and self.steps >= (1 - _FEW) * above:
            return True  # what is above was widened from 8 bits, and the others were not
        return above <= _FEW * (below + above) or (
            upper >= _BULK * below and beyond < _DROP * upper
        )


@dataclass(frozen=True, slots=True)
class ColourRule:
    """How the colours of a file, or of a scan in it, become 0..255."""

    tops: tuple[float, ...]
    """Maxima of the depths in use, ascending: a point has the first depth that its channels do
    not exceed."""
    low: float = 0.0
    """Value of black."""

    @property
    def names(self) -> tuple[str, ...]:
        """Depths by name: ``unit`` (0..1), ``eight`` and ``sixteen`` bits, or their range."""
        return tuple(
            _NAMES[top] if top in _NAMES and not self.low else f"{self.low:g} to {top:g}"
            for top in self.tops
        )

    def apply(self, colours: AnyArray) -> UInt8:
        """Convert colours (n, 3) to 0..255; points without a valid colour become grey."""
        if colours.dtype.kind == "f" or colours.dtype.kind == "i":
            possible = np.asarray(np.isfinite(colours).all(axis=1))
            possible &= (colours >= min(0.0, self.low)).all(axis=1)
            possible &= (colours <= max(_SIXTEEN, self.tops[-1])).all(axis=1)
            if not possible.all():
                out = np.full(colours.shape, GREY, np.uint8)
                out[possible] = self._scaled(colours[possible])
                return out
        return self._scaled(colours)

    def _scaled(self, colours: AnyArray) -> UInt8:
        [first, *more] = self.tops
        out = self._of_depth(colours, first)
        top = colours.max(axis=1)
        for before, depth in zip(self.tops, more, strict=False):
            # Slightly above the smaller depth: the writer rounded up, unless 8 bits were widened.
            rows = np.flatnonzero(top > before)
            slip = (top[rows] <= _SLIPS[before]) & ~_are_widened(colours[rows])
            rows = rows[~slip]
            out[rows] = self._of_depth(colours[rows], depth)
        return out

    def _of_depth(self, colours: AnyArray, top: float) -> UInt8:
        if not self.low and top == _SIXTEEN:
            # The high byte is right whether 8 bits were multiplied by 256 or by 257.
            return (np.clip(colours, 0, _SIXTEEN).astype(np.uint16) >> 8).astype(np.uint8)
        if not self.low and top == _EIGHT and colours.dtype.kind != "f":
            return np.clip(colours, 0, int(_EIGHT)).astype(np.uint8)
        share: Float64 = (colours.astype(np.float64) - self.low) / (top - self.low)
        scaled: UInt8 = np.rint(np.clip(share, 0.0, 1.0) * _EIGHT).astype(np.uint8)
        return scaled


def choose_rule(
    counts: ColourCounts, dtype: np.dtype[Any], *, where: str
) -> tuple[ColourRule | None, tuple[str, ...]]:
    """Choose how to convert a file's colours to 0..255, by the distribution of their values.

    Floats mostly within 0..1 are scaled by 255; values within 0..255 are kept; larger values up to
    65,535 lose their low byte (which is right both for files that multiply by 256 and for those
    that multiply by 257). If many values end at the maximum of a smaller depth and larger ones also
    occur, the file mixes depths, and each point is read with its own. Limits that the file states
    have precedence, unless its values contradict them.

    Parameters
    ----------
    counts : ColourCounts
        Statistics of all points.
    dtype : numpy.dtype
        Data type of the colours in the file.
    where : str
        Names of the fields for warnings, for example ``"red, green, blue"``.

    Returns
    -------
    rule : ColourRule or None
        None if the fields are not colours, or black in all points.
    warnings : tuple of str
    """
    if not counts.total:
        return None, ()
    if counts.impossible > _IMPOSSIBLE * counts.total and counts.limits is None:
        warning = (
            f"The fields {where} hold values from {counts.low:g} to {counts.high:g}, which are no "
            "colours."
        )
        return None, (warning,)
    if counts.high == 0.0:
        return None, (f"The fields {where} are 0 in every point.",)
    tops = _depths(counts, dtype)
    warnings: list[str] = []
    if counts.limits is not None:
        low, high = counts.limits
        if counts.beyond <= _IMPOSSIBLE * counts.total and not (
            tops[-1] < _SIXTEEN and high > _FAR_BEYOND * tops[-1]
        ):
            return ColourRule((high,), low), ()
        warnings.append(
            f"The stated range of colours is {low:g} to {high:g}, but they reach from "
            f"{counts.low:g} to {counts.high:g}: the stated range is ignored."
        )
    if len(tops) > 1:
        small, others = counts.below(tops[0]), counts.above(tops[0])
        warnings.append(
            f"The colours mix depths: {small:,} points have values up to {tops[0]:g}, and "
            f"{others:,} larger ones up to {counts.high:g}. Each point is scaled by its own depth."
        )
    elif beyond := counts.above(tops[0]):
        warnings.append(
            f"Colour values go up to {counts.high:g}, above {tops[0]:g} in {beyond:,} points: they "
            f"are taken as {tops[0]:g}."
        )
    return ColourRule(tops), tuple(warnings)


def _depths(counts: ColourCounts, dtype: np.dtype[Any]) -> tuple[float, ...]:
    """Find the maxima of the depths that the points of a file have, ascending."""
    fractions = dtype.kind == "f" and (not counts.whole or counts.high <= _UNIT)
    if fractions and counts.high <= _SLIPS[_UNIT]:
        return (_UNIT,)
    tops: list[float] = []
    for top in (_UNIT, _EIGHT) if fractions else (_EIGHT,):
        if counts.stops_at(top) and (not tops or counts.above(tops[-1])):
            tops.append(top)
    if not tops or counts.high > _SLIPS[tops[-1]]:
        tops.append(_SIXTEEN if not tops or tops[-1] == _EIGHT else _EIGHT)
    return tuple(tops)


def brightness_warnings(
    points: Int64, names: Sequence[str], rules: Sequence[ColourRule]
) -> tuple[str, ...]:
    """Warn about a black or nearly black scene, or about such files.

    Parameters
    ----------
    points : ndarray of shape (F, 256), int64
        Histogram of each file's points by their brightest channel.
    names : sequence of str
        Names of the files.
    rules : sequence of ColourRule
        Rules that were applied to their colours.
    """
    every = points.sum(axis=0)
    total = int(every.sum())
    if total < _FEWEST:
        return ()
    warnings: list[str] = []
    black = float(every[0]) / total
    if black >= _BLACK_SHARE:
        warnings.append(f"{black:.1%} of the points are black: without colour?")
    dark = [name for name, one in zip(names, points, strict=True) if _is_dark(one)]
    if dark or _is_dark(every):
        what = "The scene is nearly black"
        if not _is_dark(every):
            more = f" and {len(dark) - 1:,} more files" if len(dark) > 1 else ""
            what = f"The colours of {dark[0]}{more} are nearly black, and others are not"
            every = points[list(names).index(dark[0])]
        median, most = _brightness(every)
        depths = sorted({DEPTH_TEXTS.get(name, name) for rule in rules for name in rule.names})
        warnings.append(
            f"{what}: half of the points are no brighter than {median} of 255, and 99 % no "
            f"brighter than {most}. The colours were read as {', '.join(depths)}. If they have "
            "another depth (10, 12 or 14 bits), multiply them to fill 16 bits (PDAL: "
            "filters.assign), and build again."
        )
    return tuple(warnings)


def _brightness(points: Int64) -> tuple[int, int]:
    """Return the median and the 99th percentile of the points' brightest channel."""
    below = np.cumsum(points) / points.sum()
    return int(np.searchsorted(below, 0.5)), int(np.searchsorted(below, 0.99))


def _is_dark(points: Int64) -> bool:
    if points.sum() < _FEWEST:
        return False
    median, most = _brightness(points)
    return median < _DARK_MEDIAN or most < _DARK_MOST


def find_colours(names: Sequence[str]) -> tuple[str, str, str] | None:
    """Return the three names, as spelt in `names`, that hold red, green and blue."""
    lower = {name.lower(): name for name in reversed(names)}
    for triple in _COLOUR_NAMES:
        if all(name in lower for name in triple):
            return lower[triple[0]], lower[triple[1]], lower[triple[2]]
    return None


def _are_widened(colours: AnyArray) -> Bool:
    """Mark the points (n,) whose channels are 8-bit values times 256 or 257."""
    widened: Bool = (colours % 257 == 0).all(axis=1) | (colours % 256 == 0).all(axis=1)
    return widened
