"""Volumes above and below a region's toe, and their uncertainty, against solids that are known."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from scipy.spatial import Delaunay

from terraport_pipeline.geometry.volumes.toe_volumes import SurveyNoise, ToeVolume, toe_volumes
from terraport_pipeline.geometry.volumes.top_surface import TopSurface

LINE = np.arange(-60.0, 60.5, 0.5)
X, Y = np.meshgrid(LINE, LINE)
ROUND = np.hypot(X, Y)
CONE_M3 = np.pi * 40.0**2 * 20.0 / 3.0
"""Of a cone 20 m high over a circle of 40 m radius."""


def cone(ground: np.ndarray) -> np.ndarray:
    return ground + np.maximum(20.0 - ROUND / 2, 0.0)


REGION = np.where(ROUND < 40.0, 2, 0)


@pytest.mark.parametrize("ground", [np.zeros_like(X), 0.3 * X - 0.1 * Y], ids=["flat", "slope"])
def test_a_pile_on_flat_and_sloping_ground(ground: np.ndarray) -> None:
    volume = toe_volumes(cone(ground), REGION, 0.5, [2])[2]
    assert volume.above_m3 == pytest.approx(CONE_M3, rel=0.01)
    assert volume.below_m3 < 0.001 * CONE_M3
    assert volume.objects_m3 == 0.0
    assert volume.uncertainty_m3 is None  # nothing is known of the points


def test_a_pit_is_below() -> None:
    volume = toe_volumes(-cone(np.zeros_like(X)), REGION, 0.5, [2])[2]
    assert volume.below_m3 == pytest.approx(CONE_M3, rel=0.01)
    assert volume.above_m3 < 0.001 * CONE_M3


def test_inner_borders_are_toe_too() -> None:
    """A ring around a pile spans between both circles: it is flat, and the pile not its own.

    Its toe is taken a metre up the pile; the uncertainty says so.
    """
    ring = np.where((ROUND > 40.0) & (ROUND < 55.0), 3, 0)
    volume = toe_volumes(cone(np.zeros_like(X)), ring, 0.5, [3], SurveyNoise(0.5, 0.0))[3]
    assert volume.uncertainty_m3 is not None
    assert volume.above_m3 + volume.below_m3 < volume.uncertainty_m3 < 0.05 * CONE_M3


def test_notches_and_specks_in_a_border_do_not_carry_the_reference() -> None:
    region = REGION.copy()
    region[np.abs(Y) < 0.9] = np.where(X[np.abs(Y) < 0.9] > 20, 0, region[np.abs(Y) < 0.9])
    region[np.hypot(X - 10, Y - 12) < 0.9] = 0
    volume = toe_volumes(cone(np.zeros_like(X)), region, 0.5, [2])[2]
    assert volume.above_m3 == pytest.approx(CONE_M3, rel=0.015)


def test_holes_specks_lines_and_unknown_numbers_are_left_out() -> None:
    heights = cone(np.zeros_like(X))
    region = np.zeros(X.shape, int)
    region[3, 3] = 1
    region[10, :] = 4
    heights[100:, :] = np.nan
    region[200:220, 20:60] = 5
    volumes = toe_volumes(heights, region, 0.5, [1, 4, 5, 9, -1])
    assert set(volumes) <= {4}
    assert all(np.isfinite(volume.above_m3) for volume in volumes.values())


def test_at_the_rim_of_the_raster_the_region_is_its_own_toe() -> None:
    volume = toe_volumes(np.full((40, 40), 7.0), np.zeros((40, 40), int), 1.0, [0])[0]
    assert (volume.above_m3, volume.below_m3) == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("steep", [0.9, 0.5])
def test_trees_on_a_pile_are_told_from_it(steep: float) -> None:
    """Crowns of 3 to 5 m across; the pile below, as steep as loose material holds, is not."""
    pile = np.maximum(steep * (25.0 - ROUND), 0.0)
    crowns = np.zeros_like(pile)
    for x, y, radius_m, tall_m in ((8.0, 3.0, 1.5, 3.0), (-9.0, -4.0, 2.5, 5.0), (0.0, 14.0, 2, 4)):
        away = np.hypot(X - x, Y - y) / radius_m
        crowns = np.maximum(crowns, tall_m * np.sqrt(np.maximum(1 - away**2, 0.0)))
    region = np.where(ROUND < 25.0, 1, 0)
    bare, grown = (toe_volumes(h, region, 0.5, [1])[1] for h in (pile, pile + crowns))
    trees_m3 = float(crowns.sum()) * 0.25
    assert bare.objects_m3 == 0.0
    assert grown.above_m3 - bare.above_m3 == pytest.approx(trees_m3, rel=0.01)
    assert grown.objects_m3 == pytest.approx(trees_m3, rel=0.2)


Surface = Callable[[np.ndarray, np.ndarray], np.ndarray]


def survey(surface: Surface, spacing_m: float, noise_m: float, seed: int) -> ToeVolume:
    """Measure what is within 10 m of the middle, by a triangulated cloud of random points."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-14, 14, (2, int((28 / spacing_m) ** 2)))
    heights = surface(x, y) + rng.normal(0, noise_m, len(x))
    faces = Delaunay(np.column_stack([x, y])).simplices
    vertices = np.column_stack([x, heights, y]).astype(np.float32)
    regions = (np.hypot(x[faces].mean(axis=1), y[faces].mean(axis=1)) < 10.0).astype(np.int32)
    top = TopSurface.over(vertices.min(axis=0), vertices.max(axis=0), 2, spacing_m)
    top.add(vertices, faces, regions)
    known = SurveyNoise(spacing_m, noise_m)
    return toe_volumes(top.height_m, top.region, top.cell_m, [1], known, top.empty_m)[1]


def body(
    x: np.ndarray, y: np.ndarray, top_m: float, rise_m: float, slope: tuple[float, float]
) -> np.ndarray:
    """A frustum with a base of 10 m radius on a slope; a cone where the top has no width."""
    flank = (10.0 - np.hypot(x, y)) / (10.0 - top_m)
    return slope[0] * x + slope[1] * y + rise_m * np.clip(flank, 0.0, 1.0)


SOLIDS = {
    "cone": (0.0, 6.0, (0.0, 0.0)),
    "frustum": (5.0, 4.0, (0.0, 0.0)),
    "cone on a slope": (0.0, 7.0, (0.25, -0.1)),
    "steep flanks": (9.0, 5.0, (0.0, 0.0)),
    "pit": (4.0, -5.0, (0.0, 0.0)),
    "pit in a slope": (3.0, -6.0, (-0.15, 0.1)),
    "level ground": (5.0, 0.0, (0.05, 0.02)),
}


def test_the_true_volume_is_within_the_interval_of_random_surveys() -> None:
    """A hundred and five surveys, sparse and dense, quiet and noisy; and the interval is narrow."""
    rng = np.random.default_rng(7)
    within = {}
    widths = []
    for name, (top_m, rise_m, slope) in SOLIDS.items():
        truth_m3 = np.pi * abs(rise_m) * (100 + 10 * top_m + top_m**2) / 3
        surface = partial(body, top_m=top_m, rise_m=rise_m, slope=slope)
        within[name] = 0
        for seed in range(15):
            spacing_m = rng.uniform(0.55, 1.2)
            volume = survey(surface, spacing_m, spacing_m * rng.uniform(0.0, 0.5), seed)
            measured_m3 = volume.below_m3 if rise_m < 0 else volume.above_m3
            assert volume.uncertainty_m3 is not None
            within[name] += abs(measured_m3 - truth_m3) <= volume.uncertainty_m3
            if rise_m:
                widths.append(volume.uncertainty_m3 / truth_m3)
    assert sum(within.values()) >= 0.9 * 105, within
    assert min(within.values()) >= 12, within
    assert np.median(widths) < 0.1
