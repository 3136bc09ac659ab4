"""What photos show and a cloud cannot: gravel, cracks, and the surveyor's targets.

A survey's points lie decimetres apart; a photo's pixels lie centimetres apart. Colours that vary
between two points are what a texture keeps and a vertex colour loses, so a test of textures needs
them. Each octave of the pattern fades out where a pixel is wider than half of its wavelength, as a
camera's own pixels average it away: a rendered photo shows no moire. Frame: design metres (see
:mod:`.terrain`). PURE.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.synth.materials import Material
from terraport_pipeline.synth.noise import Noise
from terraport_pipeline.synth.surface import SurfacePoints
from terraport_pipeline.synth.targets import TARGET_HALF

__all__ = ["paint_fine_pattern"]

_WAVES: Final = (1.1, 0.52, 0.25, 0.13, 0.065, 0.033)
"""Wavelengths of the gravel; the longest joins the shortest of the grain (0.375), the shortest is
what somebody sees who stands on it."""

_GRAVEL: Final = 0.26
"""Amplitude of each octave as a share of the colour; the sum has a deviation of about 0.15."""

_CRACK_WAVE: Final = 2.6
_CRACK_WIDTH: Final = 0.045
"""Half width of a crack in units of the noise whose zero it follows: about 8 cm."""


def paint_fine_pattern(
    colours: Float64,
    points: SurfacePoints,
    noise: Noise,
    targets: Float64,
    *,
    strength: float,
    footprint: float | Float64 = 0.0,
) -> None:
    """Paint the fine pattern over colours, in place.

    Parameters
    ----------
    colours : ndarray of shape (N, 3), float64
        sRGB in 0..255, without light; changed.
    points : SurfacePoints
        N places.
    noise : Noise
        The patterns.
    targets : ndarray of shape (T, 2), float64
        See :func:`~terraport_pipeline.synth.targets.place_targets`.
    strength : float
        0 paints nothing, 1 the full pattern.
    footprint : float or ndarray of shape (N,)
        Width of what one colour averages: a pixel's size on the ground, design metres.
    """
    rows = np.flatnonzero(points.material != Material.WATER)
    x, y, z = points.positions[rows].T
    wide = np.broadcast_to(np.asarray(footprint, dtype=np.float64), len(colours))[rows]
    gravel = np.zeros(len(rows))
    # Three planes, weighted by how far the surface faces each: no streaks on walls.
    facing = points.normals[rows] ** 4
    facing /= np.maximum(facing.sum(axis=1, keepdims=True), 1e-9)
    for octave, wave in enumerate(_WAVES):
        weight = np.clip(wave / np.maximum(wide, 1e-9) - 1.0, 0.0, 1.0)
        # Each octave is turned, or the lattice would show.
        c, d = np.cos(0.5 + 0.7 * octave), np.sin(0.5 + 0.7 * octave)
        plane = np.zeros(len(rows))
        for side, (p, q) in enumerate(((y, z), (z, x), (x, y))):
            field = 40 + 4 * side + octave
            turned = noise(c * p - d * q, d * p + c * q, wavelength=wave, field=field)
            plane += facing[:, side] * turned
        gravel += weight * plane
    factor = 1.0 + strength * _GRAVEL * gravel
    rocky = np.isin(points.material[rows], (Material.ROCK_FACE, Material.BENCH, Material.BOULDER))
    at = np.flatnonzero(rocky)
    vein = noise(x[at] + 0.9 * z[at], y[at] + 0.7 * z[at], wavelength=_CRACK_WAVE, field=60)
    # A crack narrower than a pixel darkens it by its share only.
    width = np.maximum(_CRACK_WIDTH, wide[at] / _CRACK_WAVE)
    dark = np.clip(1.0 - np.abs(vein) / width, 0.0, 1.0) * (_CRACK_WIDTH / width)
    factor[at] *= 1.0 - 0.6 * strength * dark
    colours[rows] *= factor[:, None]
    _paint_targets(colours, points, targets, min(strength, 1.0))


def _paint_targets(
    colours: Float64, points: SurfacePoints, targets: Float64, strength: float
) -> None:
    """Paint black and white quarters, as survey targets have."""
    x, y, _ = points.positions.T
    level = np.flatnonzero(points.normals[:, 2] > 0.9)
    for tx, ty in targets:
        dx, dy = x[level] - tx, y[level] - ty
        on = np.flatnonzero((np.abs(dx) < TARGET_HALF) & (np.abs(dy) < TARGET_HALF))
        if len(on):
            paint = np.where(dx[on] * dy[on] > 0.0, 235.0, 28.0)[:, None]
            at = level[on]
            colours[at] += strength * (paint - colours[at])
