"""Distances along the surface's normal, with an error that holds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pipeline.ground_pair import SCALE, WIDTH_M, Pair, hill, pair_of, wall

from terraport_payload.types import Float64
from terraport_pipeline.geometry.clouds.ground_distance import (
    LEAST,
    GroundDistance,
    measure_ground,
)


def measured(pair: Pair, threads: int = 1) -> GroundDistance:
    reach = SCALE.reach_m / WIDTH_M
    return measure_ground(pair.keys, pair.before, pair.after, reach=reach, threads=threads)


def test_errors_are_those_of_another_sample() -> None:
    """Over their errors, distances of ground that did not move spread by one."""
    result = measured(pair_of(hill(1), hill(2)))
    sure = ~np.isnan(result.distance)
    assert sure.mean() > 0.85
    ratio = result.distance[sure] / result.error[sure]
    assert ratio.std() == pytest.approx(1.0, abs=0.15)
    assert np.abs(ratio).max() < 6.0
    assert not (result.lost[sure] > 2).any()
    assert not (result.gained[sure] > 2).any()


@pytest.mark.parametrize("step_m", [0.1, 0.5, -0.3])
def test_a_hill_that_is_raised_lies_nearer_along_its_normal(step_m: float) -> None:
    before, after = hill(1), hill(2)
    after[:, 1] += step_m
    pair = pair_of(before, after)
    result = measured(pair)
    fair = ~np.isnan(result.distance) & (result.error * WIDTH_M < 0.03)
    # Slopes reach 40 degrees: the cosine is 1 to 0.77, and 0.87 in the mean.
    share = result.distance[fair] * WIDTH_M / step_m
    assert np.median(share) == pytest.approx(0.88, abs=0.07)
    assert (np.sign(result.distance[fair]) == np.sign(step_m)).mean() > 0.99


def test_a_wall_that_moved_is_judged_across() -> None:
    result = measured(pair_of(wall(1), wall(2, east_m=0.2)))
    fair = ~np.isnan(result.distance) & (result.error * WIDTH_M < 0.03)
    assert fair.sum() > 200
    assert np.median(result.distance[fair]) * WIDTH_M == pytest.approx(0.2, abs=0.02)


def test_ground_out_of_reach_is_counted_in_voxels() -> None:
    before, after = hill(1), hill(2)
    pair = pair_of(before, after[after[:, 0] < 0])
    result = measured(pair)
    gone = np.unique(pair.rows(before[before[:, 0] > 2 * WIDTH_M]))
    stays = np.unique(pair.rows(before[before[:, 0] < 0]))
    assert (result.lost[gone] >= 5).mean() > 0.8  # a cube's corner holds fewer
    assert result.lost[stays].max() <= 3
    assert not result.gained.any()
    swapped = measured(pair.swapped)
    np.testing.assert_array_equal(swapped.gained, result.lost)


def test_few_samples_have_no_distance() -> None:
    points = np.random.default_rng(0).uniform(0.1, 1.1, (LEAST - 1, 3))
    result = measured(pair_of(points, points))
    assert np.isnan(result.distance).all()


def test_samples_in_a_row_or_at_a_point_have_finite_distances() -> None:
    row = np.column_stack([np.linspace(0.1, 1.1, 30), np.full(30, 0.6), np.full(30, 0.6)])
    point = np.full((30, 3), 0.6)
    for before, after in ((row, row), (point, point), (row, point)):
        result = measured(pair_of(before, after))
        assert np.isfinite(result.distance).any()
        assert np.nanmax(np.abs(result.distance)) < 1.0


def clouds(seed: int) -> tuple[Float64, Float64]:
    rng = np.random.default_rng(seed)
    before, after = rng.uniform(-4, 4, (2, 1500, 3))
    flat = rng.uniform() < 0.5
    if flat:
        before[:, 1] *= 0.05
        after[:, 1] = 0.05 * after[:, 1] + rng.uniform(-1, 1)
    return before, after


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1))
def test_exchanged_surveys_change_the_sign_alone(seed: int) -> None:
    pair = pair_of(*clouds(seed))
    there, back = measured(pair), measured(pair.swapped, threads=2)
    np.testing.assert_array_equal(there.distance, -back.distance)
    np.testing.assert_array_equal(there.error, back.error)
    np.testing.assert_array_equal(there.scatter, back.scatter)
    np.testing.assert_array_equal(there.lost, back.gained)
    np.testing.assert_array_equal(there.gained, back.lost)
