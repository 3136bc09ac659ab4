from __future__ import annotations

import numpy as np
import pytest
from photo_scene import LENS, expose, look_at

from terraport_pipeline.geometry.photos.photo_samples import (
    apply_gain,
    gain_at,
    neutral_gains,
    sample,
    sample_faces,
    sharpness_map,
)


@pytest.mark.parametrize("factor", [0.6, 0.9, 1.3])
def test_a_gain_is_a_factor_in_linear_light(factor: float) -> None:
    levels = np.arange(30.0, 180.0)
    after = [apply_gain(level, factor ** (1 / 2.4)) for level in levels]
    np.testing.assert_allclose(after, expose(levels, factor), atol=0.02)


def test_vignetting_is_nothing_in_the_middle_and_whole_in_the_corners() -> None:
    packed = look_at("a", (0, 10, 0), (0, 0, 0)).packed()
    gain = np.array([1, 1, 1, 0.2, 0.1], np.float32)
    assert gain_at(gain, packed, LENS.width / 2, LENS.height / 2) == 1.0
    assert gain_at(gain, packed, 0.0, 0.0) == pytest.approx(1.3)


def test_samples_are_exact_at_pixel_centres_and_linear_between() -> None:
    photo = np.zeros((2, 3, 3), np.uint8)
    photo[:, :, 1] = [[10, 20, 40], [30, 40, 80]]
    assert sample(photo, 0.5, 0.5, 1) == 10
    assert sample(photo, 2.5, 1.5, 1) == 80
    assert sample(photo, 1.0, 0.5, 1) == 15
    assert sample(photo, 0.5, 1.0, 1) == 20
    assert sample(photo, -5.0, 99.0, 1) == 30  # beyond the border its last pixel
    assert sample(photo[:1, :1], 0.2, 0.9, 1) == 10


def test_faces_are_read_from_photos_of_any_size() -> None:
    packed = look_at("a", (0, 10, 0), (0, 0, 0)).packed()
    uv = np.array([[100, 60], [120, 60], [110, 80]], np.float32)
    faces = np.array([[0, 1, 2]], np.int32)
    which = np.zeros(1, np.int32)
    for scale in (1, 4):
        photo = np.zeros((240 // scale, 320 // scale, 3), np.uint8)
        photo[:, :] = np.arange(320 // scale)[:, None] * scale // 2
        colour = sample_faces(photo, packed, neutral_gains(0)[0], faces, uv, which)
        assert np.abs(colour.astype(int) - 55).max() <= 1


def test_sharp_places_are_sharper() -> None:
    rng = np.random.default_rng(0)
    photo = np.full((96, 192, 3), 100, np.uint8)
    photo[:, 96:] += rng.integers(0, 100, (96, 96, 1)).astype(np.uint8)
    sharp = sharpness_map(photo)
    columns = sharp.shape[1]
    assert (sharp[:, : columns // 2 - 2] == 0).all()
    assert (sharp[:, columns // 2 + 2 :] > 20).all()
    assert sharpness_map(photo[:1, :1]).shape == (1, 1)
