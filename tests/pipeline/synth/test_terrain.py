from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.synth.noise import Noise
from terraport_pipeline.synth.options import HALF_X, HALF_Y, QuarryOptions
from terraport_pipeline.synth.surface import Surface
from terraport_pipeline.synth.terrain import _PIT, _WALL_AZIMUTH, Terrain


def make(**options: float) -> Terrain:
    rng = np.random.default_rng(3)
    return Terrain(QuarryOptions(**options), Noise(rng), rng)


def grid(step: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    u, v = np.meshgrid(np.arange(-HALF_X, HALF_X, step), np.arange(-HALF_Y, HALF_Y, step))
    return u.ravel(), v.ravel()


def test_pit_plateau_lake_road_and_piles_are_there() -> None:
    ground = make().sample(*grid())
    z = ground.positions[:, 2]
    assert abs(np.median(z[ground.inside < -20])) < 3.0
    assert z.min() == pytest.approx(-45.6, abs=0.8)  # lake level: 45 m deep, 4 m bowl, 3.4 m water
    wet = ground.water > 0
    assert 1500 < wet.sum() < 9000
    np.testing.assert_allclose(z[wet], -45.6, atol=1e-9)
    assert len(np.unique(ground.pile[ground.pile >= 0])) == 8
    assert ground.road.max() == pytest.approx(1.0)


def test_the_road_falls_evenly_from_rim_to_floor() -> None:
    """Along the middle of the ramp no step is steeper than a truck climbs."""
    ground = make().sample(*grid(0.5))
    middle = (ground.road > 0.99) & (np.abs(ground.lane) < 0.3) & (ground.inside > -6)
    x, y, z = ground.positions[middle].T
    angle = np.mod(np.arctan2(y - _PIT[1], x - _PIT[0]) - np.radians(130.0), 2 * np.pi)
    bins = np.linspace(0.35, np.radians(275.0), 60)
    level = [z[np.abs(angle - at) < 0.03].mean() for at in bins]
    steps = -np.diff(level)
    assert (steps > 0).all()
    assert level[0] > -4.5
    assert level[-1] < -42.0
    drop_per_m = steps / (np.diff(bins) * 90.0)
    assert drop_per_m.max() < 0.16


def test_the_highwall_really_overhangs() -> None:
    """Somewhere on the wall the ground lies above itself, which no height field can."""
    surface = Surface(QuarryOptions(seed=7, rocks=0, trees=0, bushes=0))
    _, _, positions, faces = surface.triangles(1.6)
    a, b, c = positions[faces].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    area = 0.5 * np.linalg.norm(normal, axis=1)
    under = normal[:, 2] < -0.1 * np.linalg.norm(normal, axis=1)
    assert area[under].sum() > 100.0
    middle = (a + b + c)[under] / 3.0
    out = (middle[:, :2] - _PIT) @ [np.cos(_WALL_AZIMUTH), np.sin(_WALL_AZIMUTH)]
    assert out.min() > 60.0  # all of them on the wall's side of the pit


def test_notches_reach_deep_into_the_wall() -> None:
    def deepest(overhangs: int) -> float:
        u, v = grid()
        z = np.full(len(u), -18.0)
        x, y = make(seed=7, overhangs=overhangs)._warp(u, v, z)
        return float(np.hypot(x - u, y - v).max())

    assert deepest(0) < 1.5  # ledges and roughness alone
    assert deepest(12) > 2.5


def test_the_warp_is_one_to_one() -> None:
    """Along the wall's direction, places at one height keep their order: no self-intersection."""
    terrain = make(seed=7, overhangs=12)
    nx, ny = np.cos(_WALL_AZIMUTH), np.sin(_WALL_AZIMUTH)
    out = np.linspace(40.0, 170.0, 2000)
    for height in np.linspace(-36.0, -0.5, 25):
        for side in np.linspace(-60.0, 60.0, 25):
            u = _PIT[0] + out * nx - side * ny
            v = _PIT[1] + out * ny + side * nx
            x, y = terrain._warp(u, v, np.full(len(u), height))
            along = (x - _PIT[0]) * nx + (y - _PIT[1]) * ny
            assert (np.diff(along) > 0).all()


def test_options_shape_the_pit() -> None:
    shallow = make(benches=3, bench_height_m=6.0).sample(*grid(2.0)).positions[:, 2].min()
    assert shallow == pytest.approx(-18.6, abs=0.8)
