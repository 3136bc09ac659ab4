"""The quarry's ground: one surface over a rectangle of parameters, with real overhangs.

The surface is ``S(u, v) = W(u, v, h(u, v))``: a height field `h` (plateau, stepped pit, haul road,
lake, stockpiles) followed by a horizontal warp `W` that acts near the highwall only. The warp moves
a point along the highwall's direction by an amount that depends on how high it is, so notches get
roofs that no height field could have. Along that direction `W` grows strictly, so it is one-to-one
in space and the surface never cuts itself.

Frame: *design metres* about the site's centre, x east, y north, z up from the plateau (see
:mod:`.options`). PURE.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.synth.noise import Noise
from terraport_pipeline.synth.options import QuarryOptions

__all__ = ["LAKE_DEPTH", "Terrain", "TerrainSample"]

LAKE_DEPTH: Final = 3.4
"""Water above the lowest point of the floor."""

_PIT: Final = (-8.0, 4.0)
_RIM_RADIUS: Final = 122.0
_ROAD_WIDTH: Final = 13.0
_ROAD_SWEEP: Final = np.radians(282.0)
_ROAD_START: Final = np.radians(130.0)
"""The ramp leaves the rim here and winds anticlockwise; the highwall fills what it leaves."""

_WAY_IN: Final = 0.3
_WAY_IN_LENGTH: Final = 140.0
"""Of the road's line, the share and the length of the way in; it goes on beyond the site's edge."""

_WALL_AZIMUTH: Final = _ROAD_START - 0.5 * (2.0 * np.pi - _ROAD_SWEEP)
_WALL_CREST: Final = 9.0
"""How far inside the rim the highwall's crest lies."""

_WALL_ANGLE: Final = np.radians(80.0)
_REPOSE: Final = np.tan(np.radians(36.0))
"""Slope at which loose material rests."""


@dataclass(frozen=True, slots=True)
class TerrainSample:
    """Positions and surroundings of the ground at some parameters."""

    positions: Float64
    """(N, 3) design metres."""
    road: Float64
    """(N,) 1 on the haul road, falling to 0 beside it."""
    lane: Float64
    """(N,) -1..1 across the road."""
    water: Float64
    """(N,) depth of water, 0 where dry."""
    pile: Float64
    """(N,) index of the stockpile the point lies on, -1 elsewhere."""
    inside: Float64
    """(N,) distance inside the rim, negative on the plateau."""


class Terrain:
    """The ground of one quarry.

    Parameters
    ----------
    options : QuarryOptions
        Shape and seed.
    noise : Noise
        Shared by everything of this quarry.
    rng : numpy.random.Generator
        Places piles and notches.
    """

    def __init__(self, options: QuarryOptions, noise: Noise, rng: np.random.Generator) -> None:
        self._noise = noise
        self._depth = options.depth_design_m
        self._bench_knots(options)
        self._lake = np.array([_PIT[0] + 17.0, _PIT[1] - 12.0])
        self._lake_level = -self._depth - 4.0 + LAKE_DEPTH
        self.piles = self._place_piles(options.stockpiles, rng)
        wall = min(36.0, self._depth)
        self._notches = _place_notches(options.overhangs, wall, rng)
        self._wall_height = wall

    # Evaluation

    def sample(self, u: Float64, v: Float64) -> TerrainSample:
        """Evaluate the surface.

        Parameters
        ----------
        u, v : ndarray of shape (N,), float64
            Parameters: the unwarped x and y, design metres.
        """
        dx, dy = u - _PIT[0], v - _PIT[1]
        radius = np.hypot(dx, dy)
        angle = np.arctan2(dy, dx)
        inside = _rim(angle) - radius
        inside += self._rim_noise(u, v)
        z = self._plateau(u, v, inside)
        wall = _bump(_wrap(angle - _WALL_AZIMUTH) / np.radians(36.0), 0.55)
        stepped = np.interp(inside, self._knots_s, self._knots_z)
        sheer = np.interp(inside, self._wall_s, self._wall_z)
        z += stepped + wall * (sheer - stepped)
        z += np.where(inside > 0, 0.22, 0.1) * self._noise(u, v, wavelength=5.0, octaves=3, field=2)
        z, road, lane = self._carve_road(z, angle, radius, inside)
        z, pile = self._heap(z, u, v, road)
        z, water = self._fill_lake(z, u, v, inside)
        x, y = self._warp(u, v, z)
        return TerrainSample(np.stack([x, y, z], axis=1), road, lane, water, pile, inside)

    def positions(self, u: Float64, v: Float64) -> Float64:
        """Return ``S(u, v)``, (N, 3) design metres."""
        return self.sample(u, v).positions

    def road_line(self, share: Float64) -> tuple[Float64, Float64]:
        """Return parameters (u, v) of the road's middle, from beyond the site's edge to the floor.

        Parameters
        ----------
        share : ndarray of shape (N,), float64
            0 to 1; the way in ends and the ramp begins at 0.3.
        """
        along = np.clip((share - _WAY_IN) / (1.0 - _WAY_IN), 0.0, 1.0)
        centre = self._road_centre(along)
        angle = _ROAD_START + along * _ROAD_SWEEP
        radius = _rim(angle) - centre
        for _ in range(4):  # the rim's own noise is of the place: it moves by less each round
            u, v = _PIT[0] + radius * np.cos(angle), _PIT[1] + radius * np.sin(angle)
            radius = _rim(angle) - centre + self._rim_noise(u, v)
        away = np.maximum(_WAY_IN - share, 0.0) / _WAY_IN * _WAY_IN_LENGTH
        radius = radius + away
        angle = angle + np.where(away > 0.0, 0.0009 * (radius - _RIM_RADIUS), 0.0)
        return _PIT[0] + radius * np.cos(angle), _PIT[1] + radius * np.sin(angle)

    # Height field

    def _rim_noise(self, u: Float64, v: Float64) -> Float64:
        return 2.2 * self._noise(u, v, wavelength=34.0, octaves=4, field=1)

    def _road_centre(self, along: Float64) -> Float64:
        """Distance of the ramp's middle inside the rim, by the share of its length."""
        first = -0.5 * _ROAD_WIDTH - 2.0
        return first + along * (self._foot + _ROAD_WIDTH + 3.0)

    def _bench_knots(self, options: QuarryOptions) -> None:
        """Lay out both wall profiles: height over the distance inside the rim."""
        face = options.bench_height_m / np.tan(np.radians(options.face_angle_deg))
        s, z = [0.0], [0.0]
        for _ in range(options.benches):
            s.append(s[-1] + face)
            z.append(z[-1] - options.bench_height_m)
            s.append(s[-1] + options.berm_width_m)
            z.append(z[-1] - 0.15)  # a berm falls slightly outwards: water runs off
        self._knots_s, self._knots_z = np.array(s), np.array(z)
        self._knots_z *= -options.depth_design_m / self._knots_z[-1]
        self._foot = s[-1]
        wall = min(36.0, options.depth_design_m)
        toe = _WALL_CREST + wall / np.tan(_WALL_ANGLE)
        # Below the sheer face lies talus down to the floor.
        end = max(self._foot, toe + 4.0 + (options.depth_design_m - wall) / _REPOSE)
        self._wall_s = np.array([0.0, _WALL_CREST, toe, toe + 4.0, end])
        self._wall_z = np.array([0.0, -0.4, -wall, -wall - 0.8, -options.depth_design_m])
        self._wall_z = np.maximum(self._wall_z, -options.depth_design_m)

    def _plateau(self, u: Float64, v: Float64, inside: Float64) -> Float64:
        rolling = 3.0 * self._noise(u, v, wavelength=110.0, octaves=2, field=3)
        return rolling * _smooth((-4.0 - inside) / 45.0)

    def _carve_road(
        self, z: Float64, angle: Float64, radius: Float64, inside: Float64
    ) -> tuple[Float64, Float64, Float64]:
        """Cut the ramp into the wall above it and fill the wall below it."""
        half = 0.5 * _ROAD_WIDTH
        turned = np.mod(angle - _ROAD_START, 2.0 * np.pi)
        # Past the far end, the nearer end is whichever is nearer in angle.
        gap = 2.0 * np.pi - _ROAD_SWEEP
        before = turned > _ROAD_SWEEP + 0.5 * gap
        turned = np.where(before, turned - 2.0 * np.pi, turned)
        along = np.clip(turned / _ROAD_SWEEP, 0.0, 1.0)
        # Exactly 0 beside the road. By `turned - along * sweep` it was 0 or a rounding error, which
        # the processor decided, and the windrow came and went with it.
        beyond = np.maximum(np.maximum(-turned, turned - _ROAD_SWEEP), 0.0) * radius
        across = inside - self._road_centre(along)
        off = np.hypot(np.maximum(np.abs(across) - half, 0.0), beyond)
        level = -self._depth * along
        carved = np.clip(z, level - 2.3 * off, level + 3.0 * off)
        road = _smooth(1.0 - off / 1.5)
        # The way in: from the ramp's upper end straight to the site's edge.
        windrow = 1.3 * np.exp(-(((across - half + 1.2) / 0.9) ** 2)) * (beyond == 0.0)
        carved += windrow * _smooth(along * 30.0) * _smooth((1.0 - along) * 30.0)
        out = (beyond > 0.0) | (across < -half)
        way = np.where(out & (inside < -2.0), self._access(angle, radius), 0.0)
        carved = np.where(way > 0.0, carved * (1.0 - way), carved)
        return carved, np.maximum(road, way), np.clip(across / half, -1.0, 1.0)

    def _access(self, angle: Float64, radius: Float64) -> Float64:
        """1 on the road that leads from the ramp's upper end to the site's edge."""
        turned = _wrap(angle - _ROAD_START - 0.0009 * (radius - _RIM_RADIUS))
        return _smooth(1.0 - (np.abs(turned) * radius - 5.0) / 2.0)

    def _place_piles(self, count: int, rng: np.random.Generator) -> Float64:
        """Choose (x, y, base z, ridge angle, ridge length, height) of each pile."""
        spots = [(132, -112), (_PIT[0] - 38, _PIT[1] + 2), (150, 118), (96, -138), (-140, -118)]
        spots += [(_PIT[0] - 16, _PIT[1] + 34), (150, -70), (-104, -142), (-158, -82), (166, 80)]
        spots += [(-160, 60), (128, 142)]
        piles = []
        for x, y in spots[:count]:
            on_floor = np.hypot(x - _PIT[0], y - _PIT[1]) < 60.0
            height = rng.uniform(4.5, 6.5) if on_floor else rng.uniform(7.0, 11.0)
            base = -self._depth if on_floor else 0.0
            turn = rng.uniform(0.0, np.pi)
            jitter = rng.uniform(-3.0, 3.0, 2)
            piles.append([x + jitter[0], y + jitter[1], base, turn, rng.uniform(3.0, 13.0), height])
        return np.array(piles).reshape(-1, 6)

    def _heap(self, z: Float64, u: Float64, v: Float64, road: Float64) -> tuple[Float64, Float64]:
        pile = np.full(len(u), -1.0)
        for index, (x, y, base, turn, length, height) in enumerate(self.piles):
            reach = height / _REPOSE + 0.5 * length + 4.0
            near = np.flatnonzero((np.abs(u - x) < reach) & (np.abs(v - y) < reach) & (road < 0.01))
            if len(near) == 0:
                continue
            du, dv = u[near] - x, v[near] - y
            a = du * np.cos(turn) + dv * np.sin(turn)
            b = dv * np.cos(turn) - du * np.sin(turn)
            # A ridge, slightly bent, as a loader leaves it.
            b += 0.02 * a * a
            far = np.hypot(np.maximum(np.abs(a) - 0.5 * length, 0.0), b)
            far += 1.1 * self._noise(u[near], v[near], wavelength=9.0, octaves=2, field=4)
            top = base + height - _REPOSE * (np.sqrt(far**2 + 2.2) - 1.0)
            top += 0.25 * self._noise(u[near], v[near], wavelength=2.4, octaves=2, field=5)
            over = top > z[near]
            z[near[over]] = top[over]
            pile[near[over]] = index
        return z, pile

    def _fill_lake(
        self, z: Float64, u: Float64, v: Float64, inside: Float64
    ) -> tuple[Float64, Float64]:
        away = np.hypot(u - self._lake[0], v - self._lake[1])
        away += 6.0 * self._noise(u, v, wavelength=40.0, octaves=2, field=6)
        floor = _smooth((inside - self._foot + 2.0) / 12.0)
        z = z - 4.0 * floor * _smooth(1.5 - away / 32.0)
        water = np.where(floor > 0.0, np.maximum(self._lake_level - z, 0.0), 0.0)
        return z + water, water

    # Warp

    def _warp(self, u: Float64, v: Float64, z: Float64) -> tuple[Float64, Float64]:
        """Move the highwall in and out according to height."""
        x, y = u.copy(), v.copy()
        nx, ny = np.cos(_WALL_AZIMUTH), np.sin(_WALL_AZIMUTH)
        out = (u - _PIT[0]) * nx + (v - _PIT[1]) * ny
        side = (v - _PIT[1]) * nx - (u - _PIT[0]) * ny
        face = _rim(np.full(1, _WALL_AZIMUTH))[0] - _WALL_CREST - 3.0
        # The mask fades over 24 m, a slope of at most 0.079; shifts stay below 10 even where two
        # notches meet, so the derivative of the warped coordinate stays above 1 - 0.79.
        mask = _bump((out - face) / 34.0, 0.3) * _bump(side / 62.0, 0.6)
        near = np.flatnonzero(mask > 0.0)
        if len(near) == 0:
            return x, y
        t, h = side[near], z[near]
        shift = 0.9 * self._noise(t, 1.6 * h, wavelength=9.0, octaves=4, field=7)
        # Hard beds stand out, soft ones weather back: ledges that dip gently along the wall.
        bed = h + 0.05 * t + 0.8 * self._noise(t, h, wavelength=25.0, field=8)
        shift += 0.55 * np.clip(2.5 * np.sin(2.0 * np.pi * bed / 4.6), -1.0, 1.0)
        for centre, depth, amount, width, height in self._notches:
            shape = np.exp(-(((t - centre) / width) ** 4))
            rise = (h + depth) / height
            # The roof (upper side) is three times as abrupt as the floor of the notch.
            shift += amount * shape * np.exp(-(np.where(rise > 0, 2.2 * rise, 0.8 * rise) ** 4))
        wall = _smooth(-h / 0.8) * _smooth((h + self._wall_height - 0.5) / 2.0)
        shift *= mask[near] * wall
        x[near] += nx * shift
        y[near] += ny * shift
        return x, y


def _place_notches(count: int, wall: float, rng: np.random.Generator) -> Float64:
    """Choose (place along the wall, depth below the crest, inset, half width, half height)."""
    notches = []
    for index in range(count):
        side = -34.0 + 68.0 * (index + rng.uniform(0.2, 0.8)) / max(count, 1)
        depth = rng.uniform(0.3, 0.8) * wall
        notches.append(
            [side, depth, rng.uniform(2.6, 4.2), rng.uniform(4.0, 7.5), rng.uniform(2.6, 4.0)]
        )
    return np.array(notches).reshape(-1, 5)


def _rim(angle: Float64) -> Float64:
    """Distance from the pit's centre to its rim."""
    wobble = 0.10 * np.cos(2.0 * angle) + 0.05 * np.sin(3.0 * angle + 0.6)
    result: Float64 = _RIM_RADIUS * (1.0 + wobble + 0.025 * np.cos(5.0 * angle))
    return result


def _wrap(angle: Float64) -> Float64:
    """Bring angles to [-pi, pi)."""
    result: Float64 = np.mod(angle + np.pi, 2.0 * np.pi) - np.pi
    return result


def _smooth(t: Float64) -> Float64:
    """Quintic step: 0 at t <= 0, 1 at t >= 1."""
    t = np.clip(t, 0.0, 1.0)
    result: Float64 = t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
    return result


def _bump(t: Float64, flat: float) -> Float64:
    """1 for |t| <= flat, 0 for |t| >= 1."""
    return _smooth((1.0 - np.abs(t)) / (1.0 - flat))
