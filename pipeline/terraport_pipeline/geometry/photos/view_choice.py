"""Which photo colours which face, and how the photos are made to agree: the values.

**How to colour a place** of face f with barycentric weights (b0, b1, b2), for one channel k::

    view    = choice.view[f]                          (-1: the vertex colours are the picture)
    level   = gained level of that view there         (photo_samples.sample, .gain_at, .apply_gain)
    weight  = sum over corners c: b_c blend_weight[f, c]
    if weight > 0: level = (1 - weight) level + weight * (gained level of blend_view[f] there)
    level  += sum over corners c: b_c correction[f, c, k]

All in sRGB levels, 0..255; clip at the end. The gain of view v is ``choice.gains[v]``; row -1, the
last, is that of the vertex colours (the same affine map, without vignetting). The correction
already allows for the blending.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from terraport_payload.types import Float16, Float32, Int32

__all__ = ["ViewChoice"]


@dataclass(frozen=True, slots=True, eq=False)
class ViewChoice:
    """What colours each face of a mesh of F faces."""

    view: Int32
    """(F,) index into the views; -1: no photo sees the face."""
    blend_view: Int32
    """(F,) second view near a seam; -1 none."""
    blend_weight: Float32
    """(F, 3) weight of the second view at the corners, 0..0.5."""
    correction: Float16
    """(F, 3, 3) sRGB levels to add at corner c, channel k; linear inside the face."""
    gains: Float32
    """(views + 1, GAIN_COLUMNS) of :mod:`terraport_pipeline.geometry.photos.photo_samples`."""
    facts: dict[str, Any] = field(default_factory=dict)
    """Numbers by name, units in the names."""
