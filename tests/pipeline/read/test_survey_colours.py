from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.engines.readers.survey_colours import (
    apply_depth,
    choose_depth,
    find_colours,
)


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
