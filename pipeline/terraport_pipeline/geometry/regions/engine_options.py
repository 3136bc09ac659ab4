"""Parameters of the Triangle Pool Algorithm, and default sizes and thresholds of other engines.

Apart from the kernels, so that ``--help`` imports only this.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

__all__ = [
    "BORDERS_SIZE_M",
    "FELZENSZWALB_SCALE",
    "FELZENSZWALB_SHARE",
    "FINE_POOLS",
    "MEANS_LEAK",
    "MEANS_LIGHTNESS",
    "MEANS_SMALL_SHARE",
    "MEANS_SPREAD",
    "REGION_POOLS",
    "TrianglePoolOptions",
]


@dataclass(frozen=True, slots=True)
class TrianglePoolOptions:
    """Parameters of the Triangle Pool Algorithm; the defaults are the thesis's for regions."""

    threshold: float = 0.7
    """[Th] width of a chained bin in s; larger gives fewer, larger pools. > 0."""
    small_threshold: float = 0.015
    """[sTh] share of all faces below which a pool is small and joins a large one; 0 keeps every
    pool. 0..1."""
    mu: float = 1.0
    """Weight of the colour (or scalar) index. >= 0."""
    tau: float = 0.1
    """Weight of the separation index. >= 0."""
    normalise: Literal["minmax", "max", "raw"] = "minmax"
    """How l is scaled: to 0..``attribute_range`` by its least and largest value, by its largest
    magnitude only, or not at all."""
    attribute_range: float = 1.0
    """Upper end of the normalised l; 2 reproduces the thesis's results with shape diameters. >
    0."""
    origin: Literal["min_corner", "first", "centroid"] = "min_corner"
    """The point d is measured from: the least corner of the centres' box (independent of face
    order), the first face's centre (the thesis), or the mean of the centres (independent of order
    and of rotation)."""
    contiguity: Literal["edge", "vertex"] = "edge"
    """Whether faces must share an edge, or only a vertex, to be neighbours."""
    islands: Literal["nearest", "stay"] = "nearest"
    """Small pools from which no large pool can be reached join the pool of the nearest face, or
    stay as they are."""

    def __post_init__(self) -> None:
        """Refuse values outside their range before any work."""
        for name, low, high in (
            ("threshold", math.nextafter(0, 1), math.inf),
            ("small_threshold", 0.0, 1.0),
            ("mu", 0.0, math.inf),
            ("tau", 0.0, math.inf),
            ("attribute_range", math.nextafter(0, 1), math.inf),
        ):
            value = getattr(self, name)
            if not (low <= value <= high and math.isfinite(value)):
                msg = f"{name} is {value}, expected a finite number in {low:g}..{high:g}"
                raise ValueError(msg)
        for name, allowed in (
            ("normalise", ("minmax", "max", "raw")),
            ("origin", ("min_corner", "first", "centroid")),
            ("contiguity", ("edge", "vertex")),
            ("islands", ("nearest", "stay")),
        ):
            if getattr(self, name) not in allowed:
                msg = f"{name} is {getattr(self, name)!r}, expected one of {', '.join(allowed)}"
                raise ValueError(msg)

    @property
    def similarity_key(self) -> tuple[float | str, ...]:
        """What s depends on: options with equal keys give every face the same s."""
        return self.mu, self.tau, self.normalise, self.attribute_range, self.origin


REGION_POOLS: Final = TrianglePoolOptions()
"""Published setting for regions: Th = 0.7, sTh = 0.015."""
FINE_POOLS: Final = TrianglePoolOptions(threshold=0.2, small_threshold=0.0)
"""Published setting for streaming segments: Th = 0.2, sTh = 0."""

BORDERS_SIZE_M: Final = 15.0
"""Region size of the border engine, metres."""

MEANS_SPREAD: Final = 0.95
"""Maximum colour difference of the mean-colour engine, in multiples of the scene's colour
spread."""

MEANS_SMALL_SHARE: Final = 0.002
"""Share of all faces below which a region of the mean-colour engine joins a neighbour."""

FELZENSZWALB_SCALE: Final = 100.0
"""k of the felzenszwalb engine, CIELAB units x faces."""

FELZENSZWALB_SHARE: Final = 0.002
"""Share of all faces below which a region of the felzenszwalb engine joins a neighbour."""

MEANS_LIGHTNESS: Final = 0.25
"""Weight of lightness against a* and b* in the mean-colour engine."""

MEANS_LEAK: Final = 0.3
"""Power of perimeter over common border in the mean-colour engine."""
