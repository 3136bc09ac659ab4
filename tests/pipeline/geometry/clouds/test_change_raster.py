"""Volumes between two surveys, and the raster that they come from."""

from __future__ import annotations

import numpy as np
import pytest
from pipeline.ground_pair import SCALE, WIDTH_M, Pair, hill, pair_of

from terraport_payload.types import Float64
from terraport_pipeline.geometry.clouds import change_raster
from terraport_pipeline.geometry.clouds.change_raster import ChangeRaster, make_raster
from terraport_pipeline.geometry.clouds.ground_change import find_changes
from terraport_pipeline.geometry.regions.region_changes import ChangeMap, region_volumes


def raster_of(pair: Pair) -> ChangeRaster:
    change = find_changes(pair.keys, pair.blocks, pair.before, pair.after, SCALE, has_colour=False)
    return make_raster(pair.keys, pair.before, pair.after, change.moved, SCALE)


def seen_of(raster: ChangeRaster) -> ChangeMap:
    return ChangeMap(
        raster.low, raster.cell_m, raster.dz_m, raster.lod_m, raster.moved, SCALE.registration_m
    )


def volumes_of(raster: ChangeRaster) -> tuple[float, float]:
    whole = region_volumes(seen_of(raster), [])[2]
    return whole.cut_m3, whole.fill_m3


def bowl(points: Float64, radius_m: float, depth_m: float) -> Float64:
    """Depth below the ground as it was: a paraboloid."""
    return depth_m * np.maximum(1 - (points[:, 0] ** 2 + points[:, 2] ** 2) / radius_m**2, 0)


@pytest.mark.parametrize("depth_m", [2.0, -3.0])
def test_volumes_of_a_pit_and_of_a_pile(depth_m: float) -> None:
    after = hill(2)
    after[:, 1] -= bowl(after, 6.0, depth_m)
    pair = pair_of(hill(1), after)
    raster = raster_of(pair)
    volume_m3 = np.pi * 36 * abs(depth_m) / 2
    cut_m3, fill_m3 = volumes_of(raster)
    right, wrong = (cut_m3, fill_m3) if depth_m > 0 else (fill_m3, cut_m3)
    assert right == pytest.approx(volume_m3, rel=0.03)
    assert wrong < 0.01 * volume_m3
    swapped = raster_of(pair.swapped)
    assert volumes_of(swapped) == (fill_m3, cut_m3)
    np.testing.assert_array_equal(swapped.dz_m, -raster.dz_m)
    np.testing.assert_array_equal(swapped.lod_m, raster.lod_m)


def test_ground_that_did_not_move_is_within_its_level() -> None:
    raster = raster_of(pair_of(hill(1), hill(2)))
    sure = ~np.isnan(raster.dz_m)
    assert sure.mean() > 0.9
    assert (np.abs(raster.dz_m[sure]) < raster.lod_m[sure]).mean() > 0.97
    assert not raster.moved.any()
    assert volumes_of(raster) == (0.0, 0.0)


def test_cells_lie_where_their_ground_is() -> None:
    after = hill(2)
    after[:, 1] += np.where((np.abs(after[:, 0] - 9) < 3) & (np.abs(after[:, 2] + 6) < 2), 1.0, 0)
    raster = raster_of(pair_of(hill(1), after))
    row, column = np.nonzero(np.nan_to_num(raster.dz_m) > 0.5)
    x = (np.array(raster.low[0]) + (row + 0.5)) * WIDTH_M
    z = (np.array(raster.low[1]) + (column + 0.5)) * WIDTH_M
    assert (x.mean(), z.mean()) == pytest.approx((9, -6), abs=0.4)
    assert raster.cell_m == WIDTH_M


def test_ground_that_one_survey_has_alone_is_counted() -> None:
    after = hill(2)
    raster = raster_of(pair_of(hill(1), after[np.hypot(after[:, 0], after[:, 2]) > 6]))
    lost, gained = raster.only
    assert lost * WIDTH_M**2 == pytest.approx(np.pi * 36, rel=0.25)  # whole cells only
    assert gained == 0
    assert volumes_of(raster)[0] < 2.0


def test_a_raster_is_bounded(monkeypatch) -> None:
    """Wider cells, the same volume; a lone point a kilometre away does not count."""
    after = hill(2)
    after[:, 1] -= bowl(after, 6.0, 2.0)
    after = np.concatenate([after, [[1000.0, 0, 1000]]])
    fine = raster_of(pair_of(hill(1), after))
    assert max(fine.dz_m.shape) < 40
    monkeypatch.setattr(change_raster, "MAX_RASTER_CELLS", 400)
    monkeypatch.setattr(change_raster, "_AT_ONCE", 50)
    coarse = raster_of(pair_of(hill(1), after))
    assert coarse.dz_m.size <= 400
    assert coarse.cell_m == 2 * WIDTH_M
    assert volumes_of(coarse)[0] == pytest.approx(volumes_of(fine)[0], rel=0.04)


def test_the_true_volume_is_within_the_interval_of_random_surveys() -> None:
    """Surveys that are apart by up to a few centimetres throughout; the interval is no excuse.

    Taken from what the samples could tell it was ten times the error of well tied surveys.
    """
    rng = np.random.default_rng(3)
    within, widths, errors = 0, [], []
    for survey in range(50):
        drift_m = rng.choice([0.0, 0.01])
        before, after = (hill(2 * survey + side, side_m=50.0) for side in (100, 101))
        depth_m = rng.uniform(0.5, 3.0)
        after[:, 1] += bowl(after, 8.0, depth_m) + rng.normal(0, drift_m)
        seen = seen_of(raster_of(pair_of(before, after)))
        whole = region_volumes(seen, [])[2]
        error_m3 = abs(whole.fill_m3 - np.pi * 32 * depth_m)
        within += error_m3 <= whole.uncertainty_m3
        widths.append(whole.uncertainty_m3)
        errors.append(error_m3)
    assert within >= 45
    assert np.median(widths) < 6 * np.percentile(errors, 68)
