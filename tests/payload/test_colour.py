from __future__ import annotations

import numpy as np
import pytest

from terraport_payload.colour import linear16_to_srgb, srgb_to_linear16

LEVELS = np.arange(256, dtype=np.uint8)[:, None]


def test_all_256_levels_come_back() -> None:
    assert np.array_equal(linear16_to_srgb(srgb_to_linear16(LEVELS)), LEVELS)


def test_codes_ascend_from_black_to_white() -> None:
    codes = srgb_to_linear16(LEVELS).astype(int)
    assert codes[0] == 0
    assert codes[255] == 65535
    assert (np.diff(codes[:, 0]) > 0).all()


def test_codes_render_as_their_level() -> None:
    """A viewer that rounds our code to 8-bit sRGB shows the survey's level."""
    linear = (srgb_to_linear16(LEVELS) / 65535).astype(np.float32).astype(float)
    encoded = np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)
    assert np.array_equal(np.rint(encoded * 255).astype(int), LEVELS)


def test_plain_transfer_of_other_writers_comes_back() -> None:
    value = LEVELS / 255
    plain = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    assert np.array_equal(linear16_to_srgb(np.rint(plain * 65535).astype(np.uint16)), LEVELS)


def test_neighbours_share_their_low_byte() -> None:
    """The point of choosing codes: the noisy byte of bright colours is gone."""
    rng = np.random.default_rng(1)
    bright = rng.integers(160, 255, (1000, 3), dtype=np.uint8)
    codes = srgb_to_linear16(bright)
    assert np.array_equal(linear16_to_srgb(codes), bright)
    assert (np.ptp(codes & 0xFF, axis=0) == 0).all()


@pytest.mark.parametrize("count", [0, 1, 63, 64, 65, 200])
def test_colours_of_any_length_come_back(count: int) -> None:
    rng = np.random.default_rng(count)
    colours = rng.integers(0, 256, (count, 3), dtype=np.uint8)
    codes = srgb_to_linear16(colours)
    assert codes.shape == (count, 3)
    assert codes.dtype == np.uint16
    assert np.array_equal(linear16_to_srgb(codes), colours)
    assert (codes[colours == 0] == 0).all()
    assert (codes[colours == 255] == 65535).all()


def test_low_bytes_change_less_often_than_levels() -> None:
    """Ground of middling colour with noise, where one interval is narrower than a low byte's."""
    rng = np.random.default_rng(2)
    levels = np.clip(rng.normal(90, 6, (4096, 1)), 0, 255).astype(np.uint8)
    codes = srgb_to_linear16(levels)[:, 0].astype(int)
    changes = np.count_nonzero(np.diff(codes & 0xFF))
    assert changes < np.count_nonzero(np.diff(levels[:, 0].astype(int))) / 3
