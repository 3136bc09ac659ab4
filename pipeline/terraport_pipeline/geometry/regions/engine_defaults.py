"""Default sizes and thresholds of the region engines, without their kernels, so that help is quick.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from typing import Final

__all__ = [
    "BORDERS_SIZE_M",
    "FELZENSZWALB_SCALE",
    "FELZENSZWALB_SHARE",
    "MEANS_LEAK",
    "MEANS_LIGHTNESS",
    "MEANS_SMALL_SHARE",
    "MEANS_SPREAD",
]

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
