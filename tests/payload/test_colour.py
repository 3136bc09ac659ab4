from __future__ import annotations

import numpy as np

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
