"""How the quarry looks: albedo by material, sunlight, and the ore grade.

Frame: design metres (see :mod:`.terrain`). PURE.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.ndimage import map_coordinates

from terraport_payload.types import Float32, Float64, UInt8
from terraport_pipeline.synth.fine_pattern import paint_fine_pattern
from terraport_pipeline.synth.materials import Material
from terraport_pipeline.synth.noise import Noise
from terraport_pipeline.synth.options import HALF_X, HALF_Y, QuarryOptions
from terraport_pipeline.synth.surface import Surface, SurfacePoints

__all__ = ["SUN", "Sunlight", "albedo", "grade", "lit_colours", "material_colours", "photographed"]

SUN: Final = np.array([0.56, -0.34, 0.755]) / np.linalg.norm([0.56, -0.34, 0.755])
"""Towards the sun: a December morning south of the equator, 49 degrees high, south of east."""

_MAP_STEP: Final = 1.0
"""Cell of the shadow map."""

_MAP_REACH: Final = 84
"""Cells that a shadow can reach: the deepest pit (110) would need 93, all else far less."""

_PENUMBRA: Final = 1.0
"""Height over which a shadow's edge fades; hides the map's cells."""

_BASE: Final[dict[Material, tuple[int, int, int]]] = {
    Material.ROCK_FACE: (178, 158, 130),
    Material.BENCH: (172, 159, 140),
    Material.ROAD: (158, 149, 136),
    Material.WATER: (52, 104, 108),
    Material.LIMESTONE_PILE: (206, 200, 188),
    Material.ORE_PILE: (148, 84, 54),
    Material.SAND_PILE: (216, 188, 136),
    Material.OVERBURDEN_PILE: (108, 92, 78),
    Material.GRASSLAND: (112, 120, 70),
    Material.TREE: (58, 82, 40),
    Material.BUSH: (86, 104, 54),
    Material.BOULDER: (166, 154, 136),
    Material.OUTLIER: (200, 200, 205),
}
"""Mean sRGB of each material in full sun."""


def material_colours() -> dict[Material, tuple[int, int, int]]:
    """Return the mean sRGB of every material in full sun."""
    return {m: colour for m, colour in _BASE.items() if m != Material.OUTLIER}


def albedo(
    points: SurfacePoints, noise: Noise, *, contrast: float = 1.0, texture: float = 1.0
) -> Float64:
    """Return colours without light, (N, 3) sRGB in 0..255.

    Parameters
    ----------
    points : SurfacePoints
        N places.
    noise : Noise
        The patterns.
    contrast : float
        Differences between the materials' mean colours are multiplied by this.
    texture : float
        Differences within a material (grain, strata, dry grass, rust) are multiplied by this.
    """
    table = np.zeros((256, 3))
    for material, colour in _BASE.items():
        table[material] = colour
    if contrast != 1.0:  # at 1 the bytes of earlier clouds stay
        middle = np.mean([_BASE[m] for m in Material if m != Material.OUTLIER], axis=0)
        table = middle + contrast * (table - middle)
    colours = table[points.material]
    x, y, z = points.positions.T
    grain = noise(x, y, wavelength=6.0, octaves=5, field=20)
    colours *= (1.0 + 0.10 * grain)[:, None]
    _paint_strata(colours, points, noise)
    _paint_meadow(colours, points, noise)
    _paint_road(colours, points, noise)
    rusty = np.isin(points.material, (Material.BENCH, Material.ROCK_FACE))
    vein = np.clip(_vein(x, y, z) * 1.1 - 0.35, 0.0, 0.75) * rusty
    colours += (vein * (0.6 + 0.5 * grain))[:, None] * (np.array([166, 98, 62]) - colours)
    if texture != 1.0:
        flat = table[points.material]
        colours = flat + texture * (colours - flat)
    result: Float64 = np.clip(colours, 0.0, 255.0)
    return result


def grade(positions: Float64) -> Float32:
    """Ore grade in percent: a dipping vein and a broad halo, smooth everywhere.

    Parameters
    ----------
    positions : ndarray of shape (N, 3), float64
        Design metres.

    Returns
    -------
    ndarray of shape (N,), float32
        0.2 to about 4.2; changes by less than 0.25 per design metre.
    """
    x, y, z = positions.T
    halo = np.exp(-(((x - 40.0) / 110.0) ** 2 + ((y + 30.0) / 90.0) ** 2))
    lens = 0.75 + 0.25 * np.sin(x / 31.0) * np.cos(y / 27.0 + z / 19.0)
    result: Float32 = (0.2 + 0.9 * halo + 3.1 * _vein(x, y, z) * lens).astype(np.float32)
    return result


class Sunlight:
    """Light on the surface: slope shading and cast shadows.

    Parameters
    ----------
    surface : Surface
        Casts the shadows; its height map at 1 design metre is marched once, here.
    """

    def __init__(self, surface: Surface) -> None:
        height = surface.height_map(_MAP_STEP)
        rows, columns = np.indices(height.shape, dtype=np.float64)
        plan = SUN[:2] / np.linalg.norm(SUN[:2])
        rise = SUN[2] / np.linalg.norm(SUN[:2]) * _MAP_STEP
        roof = np.full(height.shape, -np.inf)
        for step in range(1, _MAP_REACH):
            at = [rows + step * plan[1], columns + step * plan[0]]
            seen = map_coordinates(height, at, order=1, mode="nearest")
            np.maximum(roof, seen - step * rise, out=roof)
        self._roof = roof

    def __call__(self, points: SurfacePoints, unblocked: float | Float64 = 1.0) -> Float64:
        """Return the light on each point, (N,): 1 in full sun on a slope that faces it.

        `unblocked` is 0 where something that is no part of the surface stands in the sun.
        """
        at = [
            (points.positions[:, 1] + HALF_Y) / _MAP_STEP,
            (points.positions[:, 0] + HALF_X) / _MAP_STEP,
        ]
        roof = map_coordinates(self._roof, at, order=1, mode="nearest")
        lit = np.clip((points.positions[:, 2] - roof) / _PENUMBRA + 0.5, 0.0, 1.0)
        slope = np.clip(points.normals @ SUN, 0.0, 1.0)
        sky = 0.5 + 0.5 * points.normals[:, 2]
        result: Float64 = 0.22 * sky + 0.78 * slope * lit * unblocked
        return result


def lit_colours(
    points: SurfacePoints,
    surface: Surface,
    sunlight: Sunlight,
    options: QuarryOptions,
    *,
    footprint: float | Float64 = 0.0,
    unblocked: float | Float64 = 1.0,
) -> Float64:
    """Return what reaches the sensor: albedo with its fine pattern, in the day's light.

    Parameters
    ----------
    points : SurfacePoints
        N places.
    surface : Surface
        Holds the patterns.
    sunlight : Sunlight
        Of the same surface.
    options : QuarryOptions
        Of the same surface.
    footprint : float or ndarray of shape (N,)
        Width of what one colour averages, design metres.
    unblocked : float or ndarray of shape (N,)
        See :class:`Sunlight`.

    Returns
    -------
    ndarray of shape (N, 3), float64
        sRGB in 0..255.
    """
    colours = albedo(points, surface.noise, contrast=options.contrast, texture=options.texture)
    if options.detail > 0.0:
        paint_fine_pattern(
            colours,
            points,
            surface.noise,
            surface.targets,
            strength=options.detail,
            footprint=footprint,
        )
        np.clip(colours, 0.0, 255.0, out=colours)
    dark = options.shadows * (1.0 - sunlight(points, unblocked))
    colours *= (1.0 - dark)[:, None]
    return colours


def photographed(
    points: SurfacePoints,
    surface: Surface,
    sunlight: Sunlight,
    options: QuarryOptions,
    rng: np.random.Generator,
) -> UInt8:
    """Return colours as a camera sees them: albedo, light, sensor noise; (N, 3) sRGB."""
    colours = lit_colours(
        points, surface, sunlight, options, footprint=options.pixel_m / options.scale
    )
    sigma = options.colour_noise / np.sqrt(2.0)
    colours += rng.normal(0.0, 1.0, (len(colours), 1)) * sigma
    colours += rng.normal(0.0, 1.0, colours.shape) * sigma
    return np.clip(np.rint(colours), 0, 255).astype(np.uint8)


def _vein(x: Float64, y: Float64, z: Float64) -> Float64:
    """1 on a plane that dips east, falling smoothly to 0 beside it."""
    across = 0.81 * x + 0.36 * y + 0.46 * z - 14.0 + 9.0 * np.sin(y / 38.0)
    result: Float64 = np.exp(-((across / 17.0) ** 2))
    return result


def _paint_strata(colours: Float64, points: SurfacePoints, noise: Noise) -> None:
    rows = np.flatnonzero(points.material == Material.ROCK_FACE)
    x, y, z = points.positions[rows].T
    bed = z + 0.05 * x + 1.6 * noise(x, y, wavelength=40.0, octaves=2, field=21)
    band = noise(bed, 0.02 * x, wavelength=2.4, octaves=3, field=22)
    colours[rows] += band[:, None] * np.array([46.0, 44.0, 40.0])
    stain = np.clip(noise(x + y, 0.15 * z, wavelength=5.0, octaves=3, field=23) - 0.1, 0.0, 1.0)
    colours[rows] *= (1.0 - 0.5 * stain)[:, None]


def _paint_meadow(colours: Float64, points: SurfacePoints, noise: Noise) -> None:
    rows = np.flatnonzero(points.material == Material.GRASSLAND)
    x, y, _ = points.positions[rows].T
    dry = 0.5 + 0.9 * noise(x, y, wavelength=46.0, octaves=5, field=24)
    # Traffic has worn the ground near the rim.
    dry += 0.6 * np.clip(1.0 + points.inside[rows] / 9.0, 0.0, 1.0)
    dry = np.clip(dry, 0.0, 1.0)
    straw = np.array([164.0, 146.0, 104.0])
    colours[rows] += dry[:, None] * (straw - colours[rows])
    colours[rows] *= (1.0 + 0.12 * noise(x, y, wavelength=3.0, octaves=2, field=25))[:, None]


def _paint_road(colours: Float64, points: SurfacePoints, noise: Noise) -> None:
    rows = np.flatnonzero(points.material == Material.ROAD)
    lane = np.abs(points.lane[rows])
    x, y, _ = points.positions[rows].T
    wheel = np.exp(-(((lane - 0.45) / 0.16) ** 2))
    damp = np.clip(noise(x, y, wavelength=22.0, octaves=3, field=26), 0.0, 1.0)
    colours[rows] *= (1.0 - 0.13 * wheel - 0.12 * damp)[:, None]
