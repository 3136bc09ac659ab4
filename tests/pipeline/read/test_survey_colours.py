from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.engines.readers.survey_colours import (
    GREY,
    ColourCounts,
    brightness_warnings,
    choose_rule,
    find_colours,
)

RNG = np.random.default_rng(8)
LIT = RNG.integers(20, 230, (5000, 3))
"""8-bit colours of a survey in daylight."""


def read(colours: np.ndarray, *, limits=None, parts: int = 3):
    """Read colours as a survey is read: in parts, then by the rule for all."""
    counts = ColourCounts(limits)
    for part in np.array_split(colours, parts):
        counts.look(part)
    rule, warnings = choose_rule(counts, colours.dtype, where="r, g, b")
    return (None if rule is None else rule.apply(colours)), warnings, rule


@pytest.mark.parametrize("factor", [1, 256, 257])
def test_eight_bit_colours_come_back_exactly_however_widened(factor: int) -> None:
    eight = np.arange(256).repeat(3).reshape(-1, 3)
    got, warnings, _ = read((eight * factor).astype(np.uint16))
    np.testing.assert_array_equal(got, eight)
    assert warnings == ()


@pytest.mark.parametrize("dtype", [np.uint16, np.int32, np.float64])
@pytest.mark.parametrize("slip", [256, 300, 65535])
def test_one_value_does_not_decide_the_depth(dtype, slip: int) -> None:
    wide = LIT.astype(dtype)
    wide[7, 0] = slip
    got, warnings, _ = read(wide)
    np.testing.assert_array_equal(np.delete(got, 7, axis=0), np.delete(LIT, 7, axis=0))
    assert got[7, 0] == 255
    assert f"up to {slip}" in warnings[0]


@pytest.mark.parametrize("share", [0.004, 0.05, 0.5, 0.97])
@pytest.mark.parametrize("noise", [0, 100])
def test_each_point_of_a_mix_has_its_own_depth(share: float, noise: int) -> None:
    """Widened by 257, or with low bytes of their own."""
    is_wide = RNG.random(len(LIT)) < share
    mixed = np.where(is_wide[:, None], LIT * 257 + RNG.integers(0, noise + 1, LIT.shape), LIT)
    got, warnings, rule = read(mixed.astype(np.uint16))
    np.testing.assert_allclose(got, LIT, atol=1)
    assert rule.names == ("eight", "sixteen")
    assert f"{int((~is_wide).sum()):,} points have values up to 255" in warnings[0]


def test_dark_eight_bit_colours_among_widened_ones() -> None:
    dark = np.where(np.arange(5000)[:, None] % 3 == 0, LIT * 256, LIT // 8)
    got, warnings, _ = read(dark.astype(np.uint16))
    np.testing.assert_array_equal(got, np.where(np.arange(5000)[:, None] % 3 == 0, LIT, LIT // 8))
    assert "mix depths" in warnings[0]


@pytest.mark.parametrize(
    "colours",
    [
        LIT * 15,  # dusk; 12 bits would look the same
        RNG.integers(0, 2000, (5000, 3)),
        RNG.exponential(70, (5000, 3)),
        np.concatenate([RNG.exponential(900, (5000, 3)), RNG.uniform(4e4, 6e4, (200, 3))]),  # lamps
        np.clip(LIT * 257 - RNG.integers(0, 20_000, (5000, 3)), 0, 65535),  # deep shadows
    ],
)
def test_dark_colours_of_16_bits_are_not_brightened(colours: np.ndarray) -> None:
    wide = colours.astype(np.uint16)
    got, warnings, rule = read(wide)
    np.testing.assert_array_equal(got, wide >> 8)
    assert rule.names == ("sixteen",)
    assert warnings == ()


def test_a_scene_that_comes_out_nearly_black_is_told() -> None:
    def told(colours: np.ndarray) -> str:
        got, _, rule = read(colours.astype(np.uint16))
        counts = np.bincount(got.max(axis=1), minlength=256)[None]
        return " ".join(brightness_warnings(counts, ["a.las"], [rule]))

    assert told(LIT) == told(LIT * 257) == told(LIT * 100) == ""
    for bits in (10, 12, 14):
        assert "nearly black" in told(LIT * 2 ** (bits - 8))
    assert "read as 16 bits" in told(LIT * 4)
    assert "nearly black" in told(LIT // 12)
    half = np.where(np.arange(5000)[:, None] % 10 < 3, 0, LIT)
    assert told(half) == "30.0% of the points are black: without colour?"


def test_float_colours_within_one_are_scaled() -> None:
    got, warnings, _ = read(np.array([[0.0, 0.5, 1.0]], dtype=np.float32))
    assert got.tolist() == [[0, 128, 255]]
    assert warnings == ()


def test_float_colours_a_little_above_one_are_white() -> None:
    bright = LIT / 255.0
    bright[:400, 1] = RNG.uniform(1.0, 4.0, 400)  # not clipped by what rendered them
    got, warnings, _ = read(bright)
    np.testing.assert_array_equal(got[400:], LIT[400:])
    assert (got[:400, 1] == 255).all()
    assert "above 1 in 400 points" in warnings[0]


def test_float_colours_of_two_depths() -> None:
    is_unit = np.arange(5000)[:, None] % 2 == 0
    got, warnings, rule = read(np.where(is_unit, LIT / 255.0, LIT))
    np.testing.assert_array_equal(got, LIT)
    assert rule.names == ("unit", "eight")
    assert "mix depths" in warnings[0]


def test_fractions_of_eight_bits_are_no_unit_colours() -> None:
    dark = RNG.exponential(3.0, (5000, 3))
    dark[:3] = 200.0
    got, warnings, rule = read(dark)
    assert rule.names == ("eight",)
    assert got[3:].max() < 60
    assert warnings == ()


def test_points_without_a_possible_colour_are_grey() -> None:
    some = LIT.astype(np.float64)
    some[:30], some[30:60, 2], some[60:90, 0] = np.nan, -1.0, 99_999.0
    got, _, _ = read(some)
    assert (got[:90] == GREY).all()
    np.testing.assert_array_equal(got[90:], LIT[90:])


def test_black_or_impossible_colours_are_none_and_said() -> None:
    got, warnings, _ = read(np.zeros((10, 3), np.uint16))
    assert got is None
    assert warnings == ("The fields r, g, b are 0 in every point.",)
    got, warnings, _ = read(RNG.uniform(-2.5, 3.0, (100, 3)))
    assert got is None
    assert "which are no colours" in warnings[0]


def test_stated_limits_come_first() -> None:
    for top in (1.0, 100.0, 255.0, 1023.0, 4095.0, 65535.0):
        got, warnings, _ = read(LIT / 255.0 * top, limits=(0.0, top))
        np.testing.assert_allclose(got, LIT, atol=1)
        assert warnings == ()
    got, _, rule = read(LIT * 4.0 + 1000.0, limits=(1000.0, 2020.0))
    np.testing.assert_array_equal(got, LIT)
    assert rule.names == ("1000 to 2020",)


@pytest.mark.parametrize(("factor", "limit"), [(257, 255.0), (1, 65535.0), (1 / 255, 255.0)])
def test_limits_that_the_values_contradict_are_not_believed(factor: float, limit: float) -> None:
    got, warnings, _ = read(LIT * factor, limits=(0.0, limit))
    np.testing.assert_array_equal(got, LIT)
    assert "the stated range is ignored" in warnings[0]


def test_colour_names_are_found_in_any_case_and_spelling() -> None:
    assert find_colours(["x", "Red", "GREEN", "blue"]) == ("Red", "GREEN", "blue")
    assert find_colours(["diffuse_red", "diffuse_green", "diffuse_blue"]) is not None
    assert find_colours(["red", "green"]) is None
