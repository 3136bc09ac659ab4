from __future__ import annotations

import numpy as np

from terraport_pipeline.synth.noise import Noise
from terraport_pipeline.synth.options import HALF_X, HALF_Y, QuarryOptions
from terraport_pipeline.synth.terrain import Terrain
from terraport_pipeline.synth.way import way_places


def terrain_of(options: QuarryOptions) -> Terrain:
    rng = np.random.default_rng([options.seed, 0])
    return Terrain(options, Noise(rng), rng)


def test_the_way_runs_on_the_road_from_the_edge_to_the_floor() -> None:
    for options in (QuarryOptions(), QuarryOptions(seed=3, benches=4, berm_width_m=8.0)):
        terrain = terrain_of(options)
        places, headings, length = way_places(terrain, 300)
        ground = terrain.sample(places[:, 0], places[:, 1])
        assert (ground.road > 0.9).mean() > 0.99
        # On the ramp it keeps to the middle; where the way in joins it, it crosses the ramp's end.
        assert (np.abs(ground.lane[100:]) < 0.2).all()
        np.testing.assert_allclose(ground.positions[:, 2], places[:, 2], atol=0.3)
        edge = np.abs(places[0, :2]) / (HALF_X, HALF_Y)
        assert edge.max() > 0.97
        assert places[-1, 2] < -0.95 * options.depth_design_m
        np.testing.assert_allclose(np.linalg.norm(headings, axis=1), 1.0)
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        # The way in meets the ramp in a corner, which a step cuts.
        assert (steps < 1.01 * length).all()
        assert (steps < 0.9 * length).sum() <= 2
        onward = np.diff(places[:, :2], axis=0) / steps[:, None]
        assert (np.sum(onward * headings[:-1], axis=1) < 0.9).sum() <= 2


def test_one_place_lies_half_way() -> None:
    terrain = terrain_of(QuarryOptions())
    (middle,), _, whole = way_places(terrain, 1)
    places, _, length = way_places(terrain, 101)
    np.testing.assert_allclose(places[50], middle, atol=1e-6)
    np.testing.assert_allclose(101 * length, whole)
