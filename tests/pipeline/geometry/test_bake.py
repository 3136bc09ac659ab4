from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.atlas_pack import ALIGN, pack_charts
from terraport_pipeline.geometry.bake import (
    FaceColours,
    bake_photo_faces,
    bake_plain_faces,
    fill_cells,
)
from terraport_pipeline.geometry.lens import Lens, View
from terraport_pipeline.geometry.photo_samples import SRGB_OFFSET, neutral_gains

VIEW = View("a", Lens(64, 48, 50.0, 50.0, 32.0, 24.0), np.eye(3), np.zeros(3))
TWO = np.array([[[0, 0], [32, 0], [0, 32]], [[32, 0], [32, 32], [0, 32]]], dtype=float)
"""A square of 32 texels as two faces."""


def colours(faces: int, **given: np.ndarray) -> FaceColours:
    values = {
        "view": np.zeros(faces, np.int32),
        "blend_view": np.full(faces, -1, np.int32),
        "blend_weight": np.zeros((faces, 3), np.float32),
        "correction": np.zeros((faces, 3, 3), np.float32),
        "colours": np.full((faces, 3, 3), 90, np.uint8),
    }
    return FaceColours(**(values | given))


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
    given = colours(
        2,
        blend_weight=np.full((2, 3), 0.25, np.float32),
        correction=np.full((2, 3, 3), -7.0, np.float32),
    )
    points = np.zeros((2, 3, 3))
    points[:, :, 2] = 1.0
    bake_photo_faces(
        image, covered, TWO, TWO.astype(np.float32), BOTH, given, photo, VIEW.packed(), gains[0],
        (other, VIEW.packed(), gains[1], points),
    )  # fmt: skip
    first = (100 + SRGB_OFFSET) * 1.2 - SRGB_OFFSET
    expected = round(0.75 * first + 0.25 * 160 - 7)
    assert (image == expected).all()


def test_levels_are_clipped() -> None:
    for level, add, expected in ((250, 40.0, 255), (5, -40.0, 0)):
        image, covered = empty()
        given = colours(2, correction=np.full((2, 3, 3), add, np.float32))
        photo = np.full((48, 64, 3), level, np.uint8)
        bake_photo_faces(
            image, covered, TWO, TWO.astype(np.float32), BOTH, given, photo, VIEW.packed(),
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


def test_gutters_take_their_own_chart_s_colour_and_mips_mix_nothing() -> None:
    """Two charts, black and white: no texel of the first four mips is grey within a cell."""
    rng = np.random.default_rng(7)
    sizes = rng.uniform(3, 40, (12, 2))
    atlas = pack_charts(sizes, max_side=512)
    image = np.full((atlas.height, atlas.width, 3), 77, np.uint8)
    covered = np.zeros((atlas.height, atlas.width), np.uint8)
    level = np.where(np.arange(12) % 2, 255, 0).astype(np.uint8)
    uvs = np.array([[[0, 0], [w, 0], [0, h]] for w, h in sizes])
    texels = atlas.place(uvs, np.arange(12, dtype=np.int32))
    given = colours(12, colours=np.repeat(level, 9).reshape(12, 3, 3))
    which = np.arange(12, dtype=np.int32)
    bake_plain_faces(image, covered, texels, which, given, neutral_gains(0)[0])
    fill_cells(image, covered, atlas.cells)
    mip = image[..., 0].astype(float)
    step = 1
    while True:
        for chart, (x, y, width, height) in enumerate(atlas.cells // step):
            assert (mip[y : y + height, x : x + width] == level[chart]).all()
        if step == ALIGN:
            break
        mip = mip.reshape(mip.shape[0] // 2, 2, mip.shape[1] // 2, 2).mean(axis=(1, 3))
        step *= 2
    # What a sampler reads anywhere in a chart lies within its cell, in all of these mips.
    reach = 0.5 * ALIGN
    for chart in range(12):
        x, y, width, height = atlas.cells[chart]
        low, high = texels[chart].min(axis=0), texels[chart].max(axis=0)
        assert (low - reach >= [x, y]).all()
        assert (high + reach <= [x + width, y + height]).all()


def test_what_belongs_to_no_chart_gets_the_mean() -> None:
    image, covered = empty()
    covered[:8, :8] = 1
    image[:8, :8] = 60
    fill_cells(image, covered, np.array([[0, 0, 8, 8]], np.int32))
    assert (image == 60).all()
