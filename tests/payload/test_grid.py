from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from terraport_payload import (
    AttributeScale,
    PayloadError,
    choose_attribute_scale,
    choose_step_m,
    snap,
)
from terraport_payload.grid import decode_attribute, encode_attribute, grid_codes


@pytest.mark.parametrize(
    ("widest", "farthest", "step"),
    [
        (0.0, 0.0, 2.0**-12),
        (65534 * 2.0**-12, 0.0, 2.0**-12),
        (65534 * 2.0**-12 + 0.001, 0.0, 2.0**-11),
        (100.0, 0.0, 2.0**-9),
        (1.0, 4096.0, 2.0**-11),
        (1.0, 4095.9, 2.0**-12),
    ],
)
def test_step_is_the_smallest_that_fits(widest: float, farthest: float, step: float) -> None:
    assert choose_step_m(widest, farthest) == step


@pytest.mark.parametrize(
    ("spacing_m", "widest_m", "step"),
    [
        (0.0, 10.0, 2.0**-12),
        (0.015, 10.0, 2.0**-12),
        (0.05, 10.0, 2.0**-10),  # error 0.49 mm of at most 0.78 mm
        (0.12, 10.0, 2.0**-9),
        (0.17, 10.0, 2.0**-8),
        (50.0, 10.0, 2.0**-8),  # never beyond 2.5 mm of error
        (0.05, 100.0, 2.0**-9),  # the widest segment decides
    ],
)
def test_step_follows_the_spacing(spacing_m: float, widest_m: float, step: float) -> None:
    step_m = choose_step_m(widest_m, 0.0, spacing_m)
    assert step_m == step
    assert step_m / 2 <= max(0.0025, 2.0**-13)


@pytest.mark.parametrize("bad", [-1.0, math.nan, math.inf])
def test_step_refuses_senseless_lengths(bad: float) -> None:
    with pytest.raises(PayloadError, match="expected a finite length >= 0"):
        choose_step_m(bad)
    with pytest.raises(PayloadError, match="farthest_m"):
        choose_step_m(1.0, bad)


@given(
    hnp.arrays(np.float32, (5, 3), elements=st.floats(-4000, 4000, width=32)),
    st.integers(-12, 2),
)
def test_snap_is_within_half_a_step_and_stays(positions: np.ndarray, exponent: int) -> None:
    step = 2.0**exponent
    snapped = snap(positions, step)
    assert np.abs(snapped.astype(float) - positions).max() <= step / 2
    assert np.array_equal(snap(snapped, step), snapped)
    assert np.array_equal(snapped.astype(float) / step, np.rint(snapped.astype(float) / step))


@pytest.mark.parametrize("step", [0.0, -1.0, 0.3, math.nan, math.inf])
def test_grid_refuses_steps_that_are_no_power_of_two(step: float) -> None:
    with pytest.raises(PayloadError, match="expected a positive power of two"):
        grid_codes(np.zeros((1, 3), dtype=np.float32), step)


@pytest.mark.parametrize("bad", [4096.0, math.nan, math.inf])
def test_grid_refuses_positions_beyond_float32(bad: float) -> None:
    with pytest.raises(PayloadError, match="below 2\\^24 steps"):
        grid_codes(np.array([[0, bad, 0]], dtype=np.float32), 2.0**-12)


@pytest.mark.parametrize(("offset", "step"), [(math.nan, 1), (0, 0), (0, -1), (math.inf, 1)])
def test_scale_refuses_senseless_numbers(offset: float, step: float) -> None:
    with pytest.raises(PayloadError, match="expected finite numbers and step > 0"):
        AttributeScale(offset, step)


@given(
    hnp.arrays(
        np.float32,
        st.integers(1, 40),
        elements=st.floats(-1e6, 1e6, width=32) | st.just(math.nan),
    )
)
def test_attributes_come_back_within_half_a_step(values: np.ndarray) -> None:
    scale = choose_attribute_scale(values)
    decoded = decode_attribute(encode_attribute(values, scale), scale)
    assert np.array_equal(np.isnan(decoded), np.isnan(values))
    present = ~np.isnan(values)
    rounding = np.spacing(np.abs(values[present])).astype(float)
    error = np.abs(decoded[present].astype(float) - values[present])
    assert (error <= scale.step / 2 + rounding).all()


@given(hnp.arrays(np.int64, st.integers(1, 40), elements=st.integers(-32767, 32767)))
def test_whole_numbers_come_back_exactly(numbers: np.ndarray) -> None:
    """Intensity, class and return numbers of a LAS file lose nothing."""
    values = numbers.astype(np.float32)
    scale = choose_attribute_scale(values)
    assert scale.step == 1.0
    assert np.array_equal(decode_attribute(encode_attribute(values, scale), scale), values)


def test_attribute_without_any_value() -> None:
    values = np.full(3, np.nan, dtype=np.float32)
    scale = choose_attribute_scale(values)
    assert np.isnan(decode_attribute(encode_attribute(values, scale), scale)).all()


def test_constant_attribute_has_a_scale() -> None:
    assert choose_attribute_scale(np.full(3, 0.25, dtype=np.float32)) == AttributeScale(0.25, 1.0)


def test_infinite_attribute_is_refused() -> None:
    with pytest.raises(PayloadError, match="infinite"):
        choose_attribute_scale(np.array([1, np.inf], dtype=np.float32))


def test_attribute_outside_its_scale_is_refused_not_clamped() -> None:
    with pytest.raises(PayloadError, match=r"attribute values -1.0 to 2.0, expected within"):
        encode_attribute(np.array([-1, 2, np.nan], dtype=np.float32), AttributeScale(0, 1))
