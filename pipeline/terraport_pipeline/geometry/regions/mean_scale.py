"""What a whole scene says about its colours: sums that tiles add up, and what follows from them.

All sums are of whole numbers, so they come out the same however a surface is cut into tiles.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from terraport_payload.types import Float32, Float64, Int32, Int64

__all__ = ["ColourTotals", "axis_index"]


@dataclass(frozen=True, slots=True, eq=False)
class ColourTotals:
    """Sums over the colours of faces, in steps."""

    faces: int
    whole: Int64
    """(C,) sum of every channel."""
    products: Int64
    """(C, C) sums of the products of two channels; 10^8 faces of 6400 steps are 4e15."""

    @classmethod
    def of(cls, colour: Int32) -> ColourTotals:
        """Sum up the colours (F, C) of one mesh's faces, and their products."""
        whole = colour.astype(np.int64)
        return cls(len(colour), whole.sum(axis=0), whole.T @ whole)

    def plus(self, other: ColourTotals) -> ColourTotals:
        """Add the sums of another piece of the surface; exact, so the order does not matter."""
        return ColourTotals(
            self.faces + other.faces, self.whole + other.whole, self.products + other.products
        )

    def spread(self, weight: Float64) -> float:
        """Root of the summed variances of the weighed channels (C,); 0 without faces."""
        n = self.faces
        if n == 0:
            return 0.0
        total = 0.0
        for channel, scale in enumerate(weight):
            squares, whole = int(self.products[channel, channel]), int(self.whole[channel])
            total += float(scale) ** 2 * ((n * squares - whole * whole) / (n * n))
        return float(np.sqrt(total))


def axis_index(colour: Int32, totals: ColourTotals, weight: Float64) -> Float32:
    """Place of every colour on the scene's main axis of colour, in hundreds of units.

    Parameters
    ----------
    colour : ndarray of shape (F, C), int32
        Steps.
    totals : ColourTotals
        Of the whole scene, at least one face.
    weight : ndarray of shape (C,), float64
        Weight of each channel per step.

    Returns
    -------
    ndarray of shape (F,), float32
        0 for the scene's mean colour.
    """
    # Products of whole numbers are exact, so the axis does not depend on how a library adds in
    # parallel.
    mean = totals.whole / totals.faces
    spread = totals.products / totals.faces - np.outer(mean, mean)
    _, axes = np.linalg.eigh(spread * np.outer(weight, weight))
    axis = axes[:, -1] * np.sign(axes[np.argmax(np.abs(axes[:, -1])), -1]) * weight
    centred = colour - mean
    index = centred[:, 0] * axis[0]
    for channel in range(1, len(axis)):
        index = index + centred[:, channel] * axis[channel]
    hundreds: Float32 = (index / 100.0).astype(np.float32)
    return hundreds
