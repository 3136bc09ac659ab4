"""Two surveys of one ground as sums in cubes, for tests of what compares them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from terraport_payload.types import Float64, Int64, UInt8
from terraport_pipeline.geometry.clouds.ground_cells import GroundSums, cell_keys
from terraport_pipeline.geometry.clouds.ground_change import GroundScale, block_keys

WIDTH_M = 1.2
"""Of a cube; samples stand a quarter of a metre apart."""

SCALE = GroundScale(WIDTH_M, 0.25, 0.02)
CUBES = 4
"""Along a block."""


@dataclass(frozen=True)
class Pair:
    """Sums of two surveys in the same cubes."""

    keys: Int64
    blocks: Int64
    before: GroundSums
    after: GroundSums

    @property
    def swapped(self) -> Pair:
        return Pair(self.keys, self.blocks, self.after, self.before)

    def rows(self, points_m: Float64) -> Int64:
        """Rows of the cubes that points lie in."""
        return np.searchsorted(self.keys, cell_keys(points_m / WIDTH_M))


def pair_of(
    before_m: Float64,
    after_m: Float64,
    colours: tuple[UInt8, UInt8] | None = None,
) -> Pair:
    """Sum up two clouds, scene frame."""
    cells = before_m / WIDTH_M, after_m / WIDTH_M
    keys = np.unique(np.concatenate([cell_keys(some) for some in cells]))
    sums = []
    for number, some in enumerate(cells):
        ground = GroundSums.empty(len(keys))
        painted = None if colours is None else colours[number]
        ground.add(some, np.searchsorted(keys, cell_keys(some)), painted)
        sums.append(ground)
    _, blocks = np.unique(block_keys(keys, CUBES), return_inverse=True)
    return Pair(keys, blocks, *sums)


def hill(seed: int, *, side_m: float = 40.0, noise_m: float = 0.02) -> Float64:
    """A sample of one hill with slopes up to 40 degrees: 16 to a square metre in plan."""
    rng = np.random.default_rng(seed)
    x, z = rng.uniform(-side_m / 2, side_m / 2, (2, int(16 * side_m**2)))
    points = np.stack([x, 4 * np.sin(x / 7) * np.cos(z / 8) + 0.1 * x, z], axis=1)
    return points + rng.normal(0, noise_m, points.shape)


def wall(seed: int, *, east_m: float = 0.0) -> Float64:
    """A sample of an upright wall that faces east, 30 m long and 12 m high."""
    rng = np.random.default_rng(seed)
    y, z = rng.uniform(0, 12, 5760), rng.uniform(-15, 15, 5760)
    x = 0.4 * np.sin(z / 3) + 0.3 * np.sin(y / 2) + east_m
    return np.stack([x, y, z], axis=1) + rng.normal(0, 0.02, (5760, 3))
