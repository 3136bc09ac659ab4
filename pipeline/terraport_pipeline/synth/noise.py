"""Smooth random fields: value noise on a lattice, and its fractal sum.

Ken Perlin's scheme ("Improving noise", SIGGRAPH 2002) with lattice *values* in place of gradients:
quintic interpolation between random numbers at integer coordinates. Values suffice here (the field
is summed over octaves) and cost a third. PURE.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.synth._noise_kernel import fractal_kernel

__all__ = ["Noise"]

_SIDE: Final = 256
"""Lattice period in cells; a power of two, so that wrapping is a mask."""

_OCTAVE_SHIFT: Final = 37.31
"""Cells between the origins of two octaves, so that their lattice lines do not coincide."""


class Noise:
    """A family of independent smooth fields over the plane.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws the lattice; the same state gives the same fields.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._lattice = rng.uniform(-1.0, 1.0, (_SIDE, _SIDE)).astype(np.float32)

    def __call__(
        self, x: Float64, y: Float64, *, wavelength: float, octaves: int = 1, field: int = 0
    ) -> Float64:
        """Evaluate a field.

        Parameters
        ----------
        x, y : ndarray of shape (N,), float64
            Coordinates, in the unit of `wavelength`.
        wavelength : float
            Distance between lattice values of the first octave, > 0.
        octaves : int
            Each further octave has half the wavelength and half the amplitude.
        field : int
            Chooses one of many unrelated fields.

        Returns
        -------
        ndarray of shape (N,), float64
            Mean about 0, within [-1, 1].
        """
        shift = 61.7 * field + 0.5
        return fractal_kernel(
            self._lattice,
            np.ascontiguousarray(x, dtype=np.float64),
            np.ascontiguousarray(y, dtype=np.float64),
            1.0 / wavelength,
            octaves,
            shift,
            _OCTAVE_SHIFT,
        )
