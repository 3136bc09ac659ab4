"""What counts as a change of ground, and what does not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pipeline.ground_pair import SCALE, Pair, hill, pair_of, wall

from terraport_payload.types import Float64, UInt8
from terraport_pipeline.geometry.clouds.ground_change import GroundChange, find_changes


def changes(pair: Pair, *, has_colour: bool = False) -> GroundChange:
    return find_changes(
        pair.keys, pair.blocks, pair.before, pair.after, SCALE, has_colour=has_colour
    )


def brown(points: Float64, seed: int) -> UInt8:
    """Colours in stripes, with noise."""
    noise = np.random.default_rng(seed).normal(0, 6, (len(points), 3))
    stripes = 12 * np.sin(points[:, :1] / 2)
    return np.clip(np.array([150.0, 120, 90]) + stripes + noise, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("make", [hill, wall])
def test_another_sample_is_no_change(make) -> None:
    result = changes(pair_of(make(1), make(2)))
    assert not result.renewed.any()
    assert abs(result.shift_m) < 0.01
    assert result.density_ratio == pytest.approx(1.0, abs=0.05)


def test_outliers_and_thin_bushes_are_no_change() -> None:
    rng = np.random.default_rng(3)
    strays = rng.uniform((-20, 5, -20), (20, 15, 20), (200, 3))
    bush = rng.normal((0, 3, 0), 0.8, (40, 3))
    result = changes(pair_of(hill(1), np.concatenate([hill(2), strays, bush])))
    assert not result.renewed.any()


def test_a_survey_may_end_a_little_earlier() -> None:
    after = hill(2)
    result = changes(pair_of(hill(1), after[after[:, 0] < 19.4]))
    assert not result.renewed.any()


@pytest.mark.parametrize("depth_m", [0.5, -0.5, 6.0])
def test_a_pit_is_a_change_and_nothing_else(depth_m: float) -> None:
    before, after = hill(1), hill(2)
    deep = [
        depth_m * np.maximum(1 - (p[:, 0] ** 2 + p[:, 2] ** 2) / 25, 0) for p in (before, after)
    ]
    after[:, 1] -= deep[1]
    pair = pair_of(before, after)
    result = changes(pair)
    assert result.renewed[pair.rows(before[np.abs(deep[0]) > 0.15])].mean() > 0.98
    assert result.renewed[pair.rows(after[np.abs(deep[1]) > 0.15])].mean() > 0.98
    far = np.hypot(before[:, 0], before[:, 2]) > 5 + 4 * SCALE.width_m
    assert not result.renewed[pair.rows(before[far])].any()
    assert not result.painted.any()


def test_a_wall_pushed_back_is_a_change() -> None:
    before, after = wall(1), wall(2)
    after[np.abs(after[:, 2]) < 4, 0] -= 0.4
    pair = pair_of(before, after)
    result = changes(pair)
    assert result.moved[pair.rows(before[np.abs(before[:, 2]) < 3.5])].mean() > 0.9
    assert not result.renewed[pair.rows(before[np.abs(before[:, 2]) > 7])].any()


def test_gains_are_divided_out_and_paint_is_a_change() -> None:
    before, after = hill(1), hill(2)
    colours = brown(before, 1), brown(after, 2)
    redder = np.rint(colours[1] * np.array([1.06, 1.0, 0.97])).astype(np.uint8)
    pair = pair_of(before, after, (colours[0], redder))
    result = changes(pair, has_colour=True)
    np.testing.assert_allclose(result.gains, [1.06, 1.0, 0.97], atol=0.006)
    assert not result.renewed.any()
    inside = [np.hypot(p[:, 0] - 3, p[:, 2]) < 5 for p in (before, after)]
    redder[inside[1]] += np.array([0, 40, 0], np.uint8)
    pair = pair_of(before, after, (colours[0], redder))
    result = changes(pair, has_colour=True)
    assert result.renewed[pair.rows(before[inside[0]])].mean() > 0.98
    assert not result.moved.any()
    far = np.hypot(before[:, 0] - 3, before[:, 2]) > 5 + 6 * SCALE.width_m
    assert not result.renewed[pair.rows(before[far])].any()


def test_without_ground_in_common_all_is_a_change() -> None:
    after = hill(2)
    after[:, 0] += 100
    pair = pair_of(hill(1), after)
    result = changes(pair)
    assert result.renewed.mean() > 0.95
    assert result.density_ratio == 1.0


@pytest.mark.parametrize("share", [0.5, 0.1])
def test_the_ratio_of_densities_is_that_of_the_samples(share: float) -> None:
    after = hill(2)
    after = after[np.random.default_rng(0).random(len(after)) < share]
    pair = pair_of(hill(1), after)
    assert changes(pair).density_ratio == pytest.approx(share, rel=0.06)
    assert changes(pair.swapped).density_ratio == pytest.approx(1 / share, rel=0.06)


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), depth_m=st.floats(-3, 3))
def test_exchanged_surveys_change_the_same_ground(seed: int, depth_m: float) -> None:
    before, after = hill(seed, side_m=16.0), hill(seed + 1, side_m=16.0)
    after[np.hypot(after[:, 0], after[:, 2]) < 4, 1] += depth_m
    pair = pair_of(before, after, (brown(before, 1), brown(after, 2)))
    there, back = changes(pair, has_colour=True), changes(pair.swapped, has_colour=True)
    np.testing.assert_array_equal(there.moved, back.moved)
    np.testing.assert_array_equal(there.renewed, back.renewed)
    np.testing.assert_allclose(there.gains, 1 / back.gains, rtol=1e-6)
    assert there.shift_m == -back.shift_m
