"""A drone's flight over the quarry: a grid of nadir photos, and two orbits of oblique ones.

The grid takes the given overlap in both directions and flies as low as its share of the photos
allows. The outer orbit stands over the site's edge and looks across the pit; the inner one stands
over the pit and looks at the wall in front of it, below roofs that no nadir photo sees. Over a
window both orbits look at its middle, the inner one from low above the ground. A share of the
photos may follow the haul road instead, low over it: where somebody walks, ground is looked at from
1.7 m.

Frame: scene metres about the quarry's origin (x east, y up, z south), as
:class:`~terraport_pipeline.geometry.photos.lens.View` wants it. PURE.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.photos.lens import Lens, View
from terraport_pipeline.synth.noise import Noise
from terraport_pipeline.synth.options import HALF_X, HALF_Y, FlightOptions, QuarryOptions
from terraport_pipeline.synth.terrain import Terrain
from terraport_pipeline.synth.way import way_places

__all__ = ["Flight", "plan_flight", "seen_by"]

_NADIR_SHARE: Final = 0.6
"""Of all photos; the rest goes to the orbits, half each."""

_FOCAL: Final = 0.72
"""Focal length in photo widths: 70 degrees across, a common drone's wide lens."""

_RADIAL: Final = (-0.062, 0.024)
_TANGENTIAL: Final = (0.0009, -0.0006)
_AXIS_SHIFT: Final = (0.004, -0.003)
"""Brown's k1, k2 and p1, p2, and the principal point's offset in photo widths: each moves a
corner's pixel by 2 to 30 in a photo 2,000 wide, so that leaving one out shows."""

_SIDE: Final = 0.92
"""The grid covers this share of the site: at the very edge a photo sees mostly nothing."""

_CLEARANCE_M: Final = 4.0
"""Of a drone that flies low over a window above the ground below it."""

_WAY_OVERLAP: Final = 0.3
"""Of neighbouring photos along the way: what one sees cut, the next sees whole."""

_SWAY_DEG: Final = 1.2
_DRIFT: Final = 0.01
"""Wind: deviation of the attitude, and of the position as a share of the height."""

_STREAM: Final = 5


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """Views of a photo flight, its height and ground sampling distances."""

    views: tuple[View, ...]
    """Named ``DJI_0001.JPG`` and so on."""
    nadir: int
    """The first so many look straight down."""
    height_m: float
    """Height of the nadir photos above the plateau."""
    gsd_m: float
    """Ground sampling distance of the nadir photos on the plateau."""
    way: int
    """The last so many look down on the haul road."""
    way_gsd_m: float
    """Ground sampling distance of these; that of the others where there are none."""


def plan_flight(options: FlightOptions, quarry: QuarryOptions) -> Flight:
    """Lay out the flight.

    Parameters
    ----------
    options : FlightOptions
    quarry : QuarryOptions
        Size, depth and seed of the site.

    Returns
    -------
    Flight
    """
    # (1) The grid straight down, at the height that makes it fit the count.
    lens = _lens(options)
    way = round(options.count * options.way_share)
    if way and quarry.window_m:
        raise OptionError(
            f"{way} photos along the haul road, and a window of {quarry.window_m:g} m: a window is "
            "flown over as a whole; leave out --photo-way or --window-m"
        )
    elsewhere = options.count - way
    side = 1.0 if quarry.window_m else _SIDE
    half = np.array(quarry.surveyed[2:]) * quarry.scale * side
    columns, rows, height = _grid(options, elsewhere, half, lens)
    rng = np.random.default_rng([quarry.seed, _STREAM])
    shown = np.array([lens.height, lens.width]) * height / lens.fx
    positions, looks, ups = _nadir(half, shown, columns, rows, height)
    nadir = len(positions)
    over = _Window(quarry) if quarry.window_m else None
    if over is not None:
        positions = over.above(positions)
    # (2) Two orbits of oblique photos, and what is left follows the way.
    outer = (elsewhere - nadir + 1) // 2
    inner = elsewhere - nadir - outer
    if over is None:
        parts = [_outer(outer, quarry), _inner(inner, quarry)]
    else:
        parts = [over.outer(outer), over.inner(inner)]
    heights = np.full(options.count, height)
    if way:
        low, heights[elsewhere:] = _over_way(way, quarry, lens)
        parts.append(low)
    for more in parts:
        positions, looks, ups = (
            np.concatenate([a, b]) for a, b in zip((positions, looks, ups), more, strict=True)
        )
    # (3) Drift and sway, as of a real drone; from the seed alone.
    positions = positions + rng.normal(0.0, 1.0, positions.shape) * (_DRIFT * heights)[:, None]
    sway = np.radians(rng.normal(0.0, _SWAY_DEG, (len(positions), 3)))
    views = tuple(
        View(
            f"DJI_{number + 1:04d}.JPG",
            lens,
            _tilt(sway[number]) @ _look(looks[number], ups[number]),
            positions[number],
        )
        for number in range(len(positions))
    )
    gsd_m = height / lens.fx
    return Flight(views, nadir, height, gsd_m, way, heights[-1] / lens.fx)


def seen_by(options: FlightOptions, quarry: QuarryOptions) -> QuarryOptions:
    """Return the options of a cloud made from these photos: both show one and the same ground.

    Its colours have the fine pattern, as a photo's pixels see it; values that are set already stay.
    """
    return replace(
        quarry,
        detail=quarry.detail or 1.0,
        pixel_m=quarry.pixel_m or plan_flight(options, quarry).gsd_m,
    )


def _lens(options: FlightOptions) -> Lens:
    # A photo taken upright has the same lens: the longer side counts.
    long = max(options.width, options.height)
    focal = _FOCAL * long
    return Lens(
        width=options.width,
        height=options.height,
        fx=focal,
        fy=focal * 0.999,
        cx=options.width / 2 + _AXIS_SHIFT[0] * long,
        cy=options.height / 2 + _AXIS_SHIFT[1] * long,
        radial=_RADIAL,
        tangential=_TANGENTIAL,
    )


def _grid(options: FlightOptions, count: int, half: Float64, lens: Lens) -> tuple[int, int, float]:
    """Columns (along a line), rows (lines) and height: the lowest that the photos suffice for."""
    most = max(1, round(count * _NADIR_SHARE))
    best: tuple[int, int, float] | None = None
    for rows in range(1, most + 1):
        columns = most // rows
        # Lines run east and west, a photo's width across them.
        across = 2 * half[1] / (rows * (1 - options.overlap) + options.overlap) / options.width
        along = 2 * half[0] / (columns * (1 - options.overlap) + options.overlap) / options.height
        height = max(across, along) * lens.fx
        if best is None or height < best[2]:
            best = (columns, rows, float(height))
    assert best is not None
    return best


def _nadir(
    half: Float64, shown: Float64, columns: int, rows: int, height: float
) -> tuple[Float64, Float64, Float64]:
    """Lay out the grid; `shown` is what one photo shows of the plateau, east and north."""
    # The outermost photos end where the covered part of the site ends.
    reach = np.maximum(half - 0.5 * shown, 0.0)
    east = np.linspace(-reach[0], reach[0], columns) if columns > 1 else np.zeros(1)
    north = np.linspace(-reach[1], reach[1], rows) if rows > 1 else np.zeros(1)
    positions, ups = [], []
    for row, y in enumerate(north):
        way = 1.0 if row % 2 == 0 else -1.0
        line = east[:: int(way)]
        positions.append(np.stack([line, np.full(columns, height), np.full(columns, -y)], axis=1))
        ups.append(np.tile([way, 0.0, 0.0], (columns, 1)))
    looks = np.tile([0.0, -1.0, 0.0], (rows * columns, 1))
    return np.concatenate(positions), looks, np.concatenate(ups)


def _outer(count: int, quarry: QuarryOptions) -> tuple[Float64, Float64, Float64]:
    """From over the site's edge across the pit, 40 degrees down."""
    turn = 2 * np.pi * (np.arange(count) + 0.25) / max(count, 1)
    ring = np.stack([np.cos(turn) * HALF_X, np.zeros(count), np.sin(turn) * HALF_Y], axis=1)
    positions = ring * 0.92 + np.array([0.0, 105.0, 0.0])
    aim = np.array([0.0, -0.6 * quarry.depth_design_m, 0.0]) - 0.15 * ring
    return _as_rows(positions, aim - positions, quarry.scale)


def _inner(count: int, quarry: QuarryOptions) -> tuple[Float64, Float64, Float64]:
    """From over the pit at the wall on its other side, 35 degrees down."""
    turn = 2 * np.pi * (np.arange(count) + 0.5) / max(count, 1)
    ring = np.stack([np.cos(turn), np.zeros(count), np.sin(turn)], axis=1)
    positions = ring * 40.0 + np.array([0.0, 42.0, 0.0])
    aim = -ring * 95.0 + np.array([0.0, -0.6 * quarry.depth_design_m, 0.0])
    return _as_rows(positions, aim - positions, quarry.scale)


def _over_way(
    count: int, quarry: QuarryOptions, lens: Lens
) -> tuple[tuple[Float64, Float64, Float64], float]:
    """From low over the haul road, straight down; and the height above it, which covers it."""
    rng = np.random.default_rng([quarry.seed, 0])
    places, headings, length = way_places(Terrain(quarry, Noise(rng), rng), count)
    # The longer side lies along the way; where it turns, the shorter one is wide enough.
    long = max(lens.width, lens.height)
    height = length * quarry.scale / (1.0 - _WAY_OVERLAP) / long * lens.fx
    height = max(height, _CLEARANCE_M)
    east, north = headings.T
    level = np.zeros(count)
    ways = np.stack([east, level, -north], axis=1)
    across = np.stack([-north, level, -east], axis=1)
    positions = places[:, [0, 2, 1]] * [1.0, 1.0, -1.0] * quarry.scale
    positions[:, 1] += height
    looks = np.tile([0.0, -1.0, 0.0], (count, 1))
    return (positions, looks, across if lens.width >= lens.height else ways), height


class _Window:
    """Orbits over a part of the site, and how high its ground is; scene metres."""

    def __init__(self, quarry: QuarryOptions) -> None:
        rng = np.random.default_rng([quarry.seed, 0])
        self._terrain = Terrain(quarry, Noise(rng), rng)
        self._scale = quarry.scale
        x, y, self._half, _ = (value * quarry.scale for value in quarry.surveyed)
        steps = np.linspace(-1.0, 1.0, 9) * self._half
        east, south = (grid.ravel() for grid in np.meshgrid(x + steps, steps - y))
        self._middle = np.array([x, float(np.median(self._ground(east, south))), -y])

    def above(self, positions: Float64) -> Float64:
        """Move positions over a flat site's middle to over the window, clear of its ground."""
        result: Float64 = positions + self._middle
        result[:, 1] = np.maximum(
            result[:, 1], self._ground(result[:, 0], result[:, 2]) + _CLEARANCE_M
        )
        return result

    def outer(self, count: int) -> tuple[Float64, Float64, Float64]:
        """From over its edge, 45 degrees down."""
        return self._ring(count, 0.25, 1.0, 0.9)

    def inner(self, count: int) -> tuple[Float64, Float64, Float64]:
        """From within, 17 degrees down: what stands up is seen from the side."""
        return self._ring(count, 0.5, 0.8, 0.22)

    def _ring(
        self, count: int, first: float, radius: float, height: float
    ) -> tuple[Float64, Float64, Float64]:
        turn = 2 * np.pi * (np.arange(count) + first) / max(count, 1)
        ring = np.stack([np.cos(turn) * radius, np.full(count, height), np.sin(turn) * radius], 1)
        positions = self.above(ring * self._half)
        return _as_rows(positions, self._middle - 0.2 * ring * self._half - positions, 1.0)

    def _ground(self, east: Float64, south: Float64) -> Float64:
        x, y = east / self._scale, -south / self._scale
        heights: Float64 = self._terrain.positions(x, y)[:, 2] * self._scale
        return heights


def _as_rows(positions: Float64, looks: Float64, scale: float) -> tuple[Float64, Float64, Float64]:
    length = np.linalg.norm(looks, axis=1, keepdims=True)
    return positions * scale, looks / length, np.tile([0.0, 1.0, 0.0], (len(positions), 1))


def _look(forward: Float64, up: Float64) -> Float64:
    """Rotation scene -> camera whose rows are right, down and forward."""
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    result: Float64 = np.stack([right, down, forward])
    return result


def _tilt(angles: Float64) -> Float64:
    """Small rotation about the camera's axes by angles in radians."""
    (ca, cb, cc), (sa, sb, sc) = np.cos(angles), np.sin(angles)
    about_x = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
    about_y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    about_z = np.array([[cc, -sc, 0], [sc, cc, 0], [0, 0, 1]])
    result: Float64 = about_z @ about_y @ about_x
    return result
