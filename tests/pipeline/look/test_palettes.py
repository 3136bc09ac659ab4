"""Palettes: neighbours far apart, stable under count, ramps monotone and gap-aware."""

from __future__ import annotations

import numpy as np

from terraport_pipeline.engines.palettes import (
    NO_VALUE,
    RAMP_STOPS,
    distinct_colours,
    ramp_colours,
    value_range,
)


def test_consecutive_numbers_get_colours_that_the_eye_tells_apart() -> None:
    colours = distinct_colours(500).astype(int)
    for step in (1, 2, 3):
        assert np.linalg.norm(colours[step:] - colours[:-step], axis=1).min() > 40


def test_a_numbers_colour_does_not_depend_on_how_many_there_are() -> None:
    np.testing.assert_array_equal(distinct_colours(7), distinct_colours(300)[:7])
    assert distinct_colours(0).shape == (0, 3)


def test_ramp_starts_and_ends_at_its_stops_and_clips() -> None:
    colours = ramp_colours(np.array([-5.0, 0.0, 10.0, 99.0]), 0.0, 10.0)
    hexes = ["#" + bytes(row).hex() for row in colours]
    assert hexes == [RAMP_STOPS[0], RAMP_STOPS[0], RAMP_STOPS[-1], RAMP_STOPS[-1]]


def test_missing_values_are_grey_and_a_flat_range_is_drawn() -> None:
    assert ramp_colours(np.array([np.nan, 3.0]), 3.0, 3.0).tolist() == [list(NO_VALUE), [68, 1, 84]]


def test_range_leaves_out_spikes_and_missing_values() -> None:
    values = np.concatenate([np.linspace(0, 1, 1000), [np.nan, 1e9]])
    low, high = value_range(values)
    assert 0 <= low < 0.02
    assert 0.98 < high <= 1.0
    assert value_range(np.array([np.nan])) == (0.0, 0.0)
