from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.photos.lens import Lens, View
from terraport_pipeline.geometry.photos.photo_samples import SRGB_OFFSET, neutral_gains
from terraport_pipeline.geometry.textures.bake import (
    FaceColours,
    bake_photo_faces,
    bake_plain_faces,
)

VIEW = View("a", Lens(64, 48, 50.0, 50.0, 32.0, 24.0), np.eye(3), np.zeros(3))
TWO = np.array([[[0, 0], [32, 0], [0, 32]], [[32, 0], [32, 32], [0, 32]]], dtype=float)
"""A square of 32 texels as two faces."""


def colours(faces: int, **overrides: np.ndarray) -> FaceColours:
    values = {
        "view": np.zeros(faces, np.int32),
        "blend_view": np.full(faces, -1, np.int32),
        "blend_weight": np.zeros((faces, 3), np.float32),
        "correction": np.zeros((faces, 3, 3), np.float32),
        "colours": np.full((faces, 3, 3), 90, np.uint8),
    }
    return FaceColours(**(values | overrides))


def ramp(width: int = 64, height: int = 48) -> np.ndarray:
    """Levels that say where they are: red 2 x + 4 and green 3 y + 6 at a pixel's centre."""
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    return np.stack([2 * x + 4, 3 * y + 6, np.full_like(x, 50)], axis=2).astype(np.uint8)


def empty(side: int = 32) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((side, side, 3), np.uint8), np.zeros((side, side), np.uint8)


BOTH = np.arange(2, dtype=np.int32)


@pytest.mark.parametrize("stored", [1, 2])
def test_texels_are_the_pixels_that_the_corners_say(stored: int) -> None:
    image, covered = empty()
    pixels = np.add(TWO, [10.0, 5.0]).astype(np.float32)  # texel (i, j) is pixel (i + 10, j + 5)
    photo = ramp()
    if stored == 2:
        photo = photo.reshape(24, 2, 32, 2, 3).mean(axis=(1, 3)).astype(np.uint8)
    gains = neutral_gains(1)
    bake_photo_faces(image, covered, TWO, pixels, BOTH, colours(2), photo, VIEW.packed(), gains[0])
    assert covered.all()
    assert np.abs(image.astype(int) - ramp()[5:37, 10:42]).max() <= (0 if stored == 1 else 1)


def test_gain_correction_and_second_photo_are_as_the_choice_of_views_says() -> None:
    image, covered = empty()
    photo, other = np.full((48, 64, 3), 100, np.uint8), np.full((48, 64, 3), 160, np.uint8)
    gains = neutral_gains(2)
    gains[0, :3] = 1.2
    face_colours = colours(
        2,
        blend_weight=np.full((2, 3), 0.25, np.float32),
        correction=np.full((2, 3, 3), -7.0, np.float32),
    )
    points = np.zeros((2, 3, 3))
    points[:, :, 2] = 1.0
    bake_photo_faces(
        image, covered, TWO, TWO.astype(np.float32), BOTH, face_colours, photo, VIEW.packed(),
        gains[0], (other, VIEW.packed(), gains[1], points),
    )  # fmt: skip
    first = (100 + SRGB_OFFSET) * 1.2 - SRGB_OFFSET
    expected = round(0.75 * first + 0.25 * 160 - 7)
    assert (image == expected).all()


def test_levels_are_clipped() -> None:
    for level, add, expected in ((250, 40.0, 255), (5, -40.0, 0)):
        image, covered = empty()
        face_colours = colours(2, correction=np.full((2, 3, 3), add, np.float32))
        photo = np.full((48, 64, 3), level, np.uint8)
        bake_photo_faces(
            image, covered, TWO, TWO.astype(np.float32), BOTH, face_colours, photo, VIEW.packed(),
            neutral_gains(1)[0],
        )  # fmt: skip
        assert (image == expected).all()


def test_vertex_colours_are_interpolated() -> None:
    image, covered = empty()
    corners = np.zeros((2, 3, 3), np.uint8)
    corners[..., 0] = (TWO[..., 0] * 4).astype(np.uint8)
    bake_plain_faces(image, covered, TWO, BOTH, colours(2, colours=corners), neutral_gains(0)[0])
    assert covered.all()
    assert np.abs(image[..., 0].astype(float) - 4 * (np.arange(32) + 0.5)).max() <= 0.5 + 1e-9


def test_a_face_smaller_than_a_texel_colours_one() -> None:
    image, covered = empty()
    small = np.array([[[7.1, 9.1], [7.2, 9.1], [7.1, 9.2]]])
    bake_plain_faces(image, covered, small, BOTH[:1], colours(1), neutral_gains(0)[0])
    assert np.argwhere(covered).tolist() == [[9, 7]]
    assert (image[9, 7] == 90).all()


def test_no_texel_on_a_common_edge_is_left_out() -> None:
    rng = np.random.default_rng(4)
    for _ in range(50):
        a, b, c = (rng.integers(1, 31, 2).astype(float) + rng.choice([0.0, 0.5]) for _ in range(3))
        outer = np.array([[0.0, 0.0], [32.0, 0.0], [32.0, 32.0], [0.0, 32.0]])
        del b, c
        fan = np.array([[a, outer[k], outer[(k + 1) % 4]] for k in range(4)])
        image, covered = empty()
        which = np.arange(4, dtype=np.int32)
        bake_plain_faces(image, covered, fan, which, colours(4), neutral_gains(0)[0])
        assert covered.all()


def test_beyond_the_rim_the_photo_goes_on() -> None:
    image, covered = empty()
    inner = TWO * 0.5 + 8.0  # 16 texels, texel (i, j) is pixel (i, j)
    gain = neutral_gains(1)[0]
    for margin in (0.0, 1.4):
        bake_photo_faces(
            image, covered, inner, inner.astype(np.float32), BOTH, colours(2), ramp(),
            VIEW.packed(), gain, margin=margin,
        )  # fmt: skip
    drawn = np.argwhere(covered)
    # A texel on every side, and up to two more where two edges meet at a sharp corner.
    assert 5 <= drawn.min() <= 7
    assert 24 <= drawn.max() <= 26
    assert covered[7:25, 9:23].all()
    assert (image[covered > 0] == ramp()[:32, :32][covered > 0]).all()
