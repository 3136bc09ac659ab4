from __future__ import annotations

import numpy as np

from terraport_pipeline.synth.fine_pattern import paint_fine_pattern
from terraport_pipeline.synth.materials import Material
from terraport_pipeline.synth.noise import Noise
from terraport_pipeline.synth.surface import SurfacePoints

NOISE = Noise(np.random.default_rng(0))


def ground(x: np.ndarray, y: np.ndarray, material: Material = Material.BENCH) -> SurfacePoints:
    count = len(x)
    zero = np.zeros(count)
    return SurfacePoints(
        np.stack([x, y, zero], axis=1),
        np.tile([0.0, 0.0, 1.0], (count, 1)),
        np.full(count, material, dtype=np.uint8),
        zero,
        zero,
        np.zeros(count, dtype=bool),
    )


def painted(points: SurfacePoints, **options) -> np.ndarray:
    colours = np.full((len(points.material), 3), 128.0)
    targets = options.pop("targets", np.empty((0, 2)))
    paint_fine_pattern(colours, points, NOISE, targets, strength=1.0, **options)
    return colours[:, 0]


def test_it_varies_within_a_decimetre_and_fades_where_a_pixel_is_wider() -> None:
    x = np.arange(4000) * 0.03
    near = painted(ground(x, 0.4 * x))
    assert 8.0 < near.std() < 40.0
    assert np.abs(np.diff(near)).mean() > 2.0
    wide = painted(ground(x, 0.4 * x), footprint=0.4)
    assert np.abs(np.diff(wide)).mean() < 0.5 * np.abs(np.diff(near)).mean()
    # A pixel wider than every wavelength sees only the cracks' share of it.
    assert painted(ground(x, 0.4 * x), footprint=3.0).std() < 2.0


def test_water_is_smooth() -> None:
    x = np.linspace(0, 9, 100)
    assert painted(ground(x, x, Material.WATER)).std() == 0.0


def test_a_target_is_black_and_white_in_quarters() -> None:
    corners = np.array([[0.3, 0.3], [-0.3, 0.3], [-0.3, -0.3], [0.3, -0.3]])
    values = painted(ground(*(corners + np.array([5.0, 6.0])).T), targets=np.array([[5.0, 6.0]]))
    assert values.tolist() == [235.0, 28.0, 235.0, 28.0]
