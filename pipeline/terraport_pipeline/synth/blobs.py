"""Closed bodies that stand on the ground: boulders, trees, bushes.

A body is star-shaped about its centre: ``centre + radii * r(d) * d`` over unit directions `d`. For
a boulder, `r` is the distance to the nearest of twelve random planes (a convex polyhedron); for a
plant it is 1 plus noise. Frame: design metres (see :mod:`.terrain`). PURE.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Bool, Float64, Int64
from terraport_pipeline.synth.noise import Noise
from terraport_pipeline.synth.options import HALF_X, HALF_Y, QuarryOptions
from terraport_pipeline.synth.terrain import Terrain

__all__ = ["BUSH", "ROCK", "TREE", "Blobs"]

ROCK: Final = 0
TREE: Final = 1
BUSH: Final = 2

_PLANES: Final = 12

_FARTHEST: Final = 6.0
"""Of a boulder's surface along a direction that none of its planes faces, in its radii."""


class Blobs:
    """Every body of one quarry.

    Attributes
    ----------
    kind : ndarray of shape (B,), uint8
        :data:`ROCK`, :data:`TREE` or :data:`BUSH`.
    centres, radii : ndarray of shape (B, 3), float64
        Design metres.
    """

    def __init__(
        self, options: QuarryOptions, terrain: Terrain, noise: Noise, rng: np.random.Generator
    ) -> None:
        self._noise = noise
        rocks = _place_rocks(options.rocks, terrain, rng)
        trees = _place_plants(options.trees, terrain, noise, rng, (2.0, 3.9), 1.25, 1.35)
        bushes = _place_plants(options.bushes, terrain, noise, rng, (0.7, 1.5), 0.8, 0.45)
        self.centres = np.concatenate([rocks[0], trees[0], bushes[0]])
        self.radii = np.concatenate([rocks[1], trees[1], bushes[1]])
        sizes = [len(rocks[0]), len(trees[0]), len(bushes[0])]
        self.kind = np.repeat(np.array([ROCK, TREE, BUSH], dtype=np.uint8), sizes)
        normals = rng.normal(size=(len(self.kind), _PLANES, 3))
        # The first six planes form a box, so that nearly every direction meets one.
        normals[:, :6] = np.concatenate([np.eye(3), -np.eye(3)]) + 0.25 * normals[:, :6]
        self._normals = normals / np.linalg.norm(normals, axis=2, keepdims=True)
        self._planes = rng.uniform(0.62, 0.95, (len(self.kind), _PLANES))

    def reach(self, body: Int64, directions: Float64) -> Float64:
        """Return r(d), (N,), for bodies (N,) and unit directions (N, 3)."""
        reach = np.empty(len(body))
        stone = self.kind[body] == ROCK
        reach[stone] = self._plane_distances(body[stone], directions[stone]).min(axis=1)
        b, d = body[~stone], directions[~stone]
        shift = 13.0 * b
        leaves = self._noise(2.2 * d[:, 0] + shift, 2.2 * d[:, 1], wavelength=1.0, octaves=2)
        leaves += self._noise(2.2 * d[:, 2] + shift, 2.2 * d[:, 0], wavelength=1.0, octaves=2)
        reach[~stone] = 0.85 + 0.28 * leaves
        return reach

    def positions(self, body: Int64, directions: Float64) -> Float64:
        """Return surface points, (N, 3), for bodies (N,) and directions (N, 3) of any length."""
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        out = self.reach(body, unit)[:, None] * unit
        result: Float64 = self.centres[body] + self.radii[body] * out
        return result

    def normals(self, body: Int64, directions: Float64) -> Float64:
        """Return outward unit normals, (N, 3): a boulder's facets, a plant's ellipsoid."""
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        local = unit.copy()
        stone = np.flatnonzero(self.kind[body] == ROCK)
        facet = self._plane_distances(body[stone], unit[stone]).argmin(axis=1)
        local[stone] = self._normals[body[stone], facet]
        local /= self.radii[body]
        result: Float64 = local / np.linalg.norm(local, axis=1, keepdims=True)
        return result

    def contain(self, points: Float64, body: Int64) -> Bool:
        """Say for each point (N, 3) whether it lies inside the body (N,) named for it."""
        local = (points - self.centres[body]) / self.radii[body]
        distance = np.linalg.norm(local, axis=1)
        unit = local / np.maximum(distance, 1e-9)[:, None]
        result: Bool = distance < self.reach(body, unit)
        return result

    def _plane_distances(self, body: Int64, directions: Float64) -> Float64:
        """Distance along each direction to each plane of its boulder, (N, 12)."""
        facing = np.einsum("nkc,nc->nk", self._normals[body], directions)
        result: Float64 = np.full(facing.shape, _FARTHEST)
        np.divide(self._planes[body], facing, out=result, where=facing > 0.05)
        return result


def _place_rocks(count: int, terrain: Terrain, rng: np.random.Generator) -> tuple[Float64, Float64]:
    """Put stones on dry, level ground off the road, most of them inside the pit."""
    tries = rng.uniform(-0.96, 0.96, (count * 14 + 64, 2)) * (HALF_X, HALF_Y)
    ground = terrain.sample(tries[:, 0], tries[:, 1])
    wanted = np.where(ground.inside > 3.0, 1.0, 0.12)
    wanted *= (ground.road < 0.01) & (ground.water == 0.0) & (ground.pile < 0)
    wanted *= _level(terrain, tries, 1.2) < 1.5
    chosen = np.flatnonzero(rng.uniform(size=len(tries)) < wanted)[:count]
    size = 0.5 + 1.3 * rng.uniform(size=len(chosen)) ** 2.5
    radii = size[:, None] * rng.uniform(0.7, 1.2, (len(chosen), 3))
    centres = ground.positions[chosen].copy()
    centres[:, 2] += 0.35 * radii[:, 2]
    return centres, radii


def _place_plants(
    count: int,
    terrain: Terrain,
    noise: Noise,
    rng: np.random.Generator,
    size: tuple[float, float],
    tall: float,
    lift: float,
) -> tuple[Float64, Float64]:
    """Put plants on the plateau where the meadow noise is high, in groups."""
    tries = rng.uniform(-0.97, 0.97, (count * 14 + 64, 2)) * (HALF_X, HALF_Y)
    ground = terrain.sample(tries[:, 0], tries[:, 1])
    wanted = np.clip(0.25 + 1.6 * noise(tries[:, 0], tries[:, 1], wavelength=50.0, field=9), 0, 1)
    wanted *= (ground.inside < -7.0) & (ground.road < 0.01) & (ground.pile < 0)
    wanted *= _level(terrain, tries, 2.0) < 1.0
    chosen = np.flatnonzero(rng.uniform(size=len(tries)) < wanted)[:count]
    radius = rng.uniform(*size, size=(len(chosen), 1))
    radii = radius * np.concatenate(
        [rng.uniform(0.85, 1.15, (len(chosen), 2)), tall * rng.uniform(0.9, 1.2, (len(chosen), 1))],
        axis=1,
    )
    centres = ground.positions[chosen].copy()
    centres[:, 2] += lift * radius[:, 0]
    return centres, radii


def _level(terrain: Terrain, points: Float64, step: float) -> Float64:
    """Height difference across each place over 2 `step` in x and y."""
    u, v = points[:, 0], points[:, 1]
    z = [
        terrain.positions(u + du, v + dv)[:, 2]
        for du, dv in ((step, 0), (-step, 0), (0, step), (0, -step))
    ]
    result: Float64 = np.maximum(np.abs(z[0] - z[1]), np.abs(z[2] - z[3]))
    return result
