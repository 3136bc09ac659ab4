from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terraport_pipeline.engines.readers.raw_survey import (
    apply_depth,
    choose_depth,
    find_colours,
    thinning_rows,
)


@given(st.integers(1, 5000), st.integers(1, 5000))
def test_thinning_keeps_exactly_the_bound_once_each_and_spread(count: int, bound: int) -> None:
    rows = thinning_rows(count, bound)
    if count <= bound:
        assert rows is None
        return
    assert rows is not None
    assert len(rows) == bound
    assert (np.diff(rows) > 0).all()
    assert rows[0] >= 0
    assert rows[-1] < count
    # One row in each run: no gap is longer than two runs.
    assert np.diff(rows).max(initial=0) < 2 * (count / bound + 1)


def test_thinning_is_the_same_each_time_and_off_without_a_bound() -> None:
    np.testing.assert_array_equal(thinning_rows(1000, 100), thinning_rows(1000, 100))
    assert thinning_rows(1000, None) is None


@pytest.mark.parametrize("factor", [1, 256, 257])
def test_eight_bit_colours_come_back_exactly_however_widened(factor: int) -> None:
    eight = np.arange(256).repeat(3).reshape(-1, 3)
    wide = (eight * factor).astype(np.uint16)
    rule, warnings = choose_depth(0.0, float(wide.max()), wide.dtype, where="rgb")
    assert rule is not None
    np.testing.assert_array_equal(apply_depth(wide, rule), eight)
    assert warnings == ()


def test_float_colours_within_one_are_scaled() -> None:
    colours = np.array([[0.0, 0.5, 1.0]], dtype=np.float32)
    assert choose_depth(0.0, 1.0, colours.dtype, where="rgb") == ("unit", ())
    assert apply_depth(colours, "unit").tolist() == [[0, 128, 255]]


def test_black_or_impossible_colours_are_none_and_said() -> None:
    rule, warnings = choose_depth(0.0, 0.0, np.dtype(np.uint16), where="r, g, b")
    assert rule is None
    assert warnings == ("The fields r, g, b are 0 in every point.",)
    rule, warnings = choose_depth(-2.5, 3.0, np.dtype(np.float64), where="r, g, b")
    assert rule is None
    assert "-2.5" in warnings[0]


def test_colour_names_are_found_in_any_case_and_spelling() -> None:
    assert find_colours(["x", "Red", "GREEN", "blue"]) == ("Red", "GREEN", "blue")
    assert find_colours(["diffuse_red", "diffuse_green", "diffuse_blue"]) is not None
    assert find_colours(["red", "green"]) is None
