from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_pipeline.geometry.textures.atlas_pack import ALIGN, GUTTER, pack_charts


def check(sizes: np.ndarray, max_side: int) -> None:
    atlas = pack_charts(sizes, max_side=max_side)
    for side in (atlas.width, atlas.height):
        assert side <= max_side
        assert side & (side - 1) == 0
    x, y, width, height = atlas.cells.T.astype(int)
    assert (atlas.cells % ALIGN == 0).all()
    assert (x >= 0).all()
    assert (y >= 0).all()
    assert (x + width <= atlas.width).all()
    assert (y + height <= atlas.height).all()
    owner = np.zeros((atlas.height, atlas.width), int)
    for i in range(len(sizes)):
        owner[y[i] : y[i] + height[i], x[i] : x[i] + width[i]] += 1
    assert owner.max() == 1  # no two cells overlap
    across = np.where(atlas.turned[:, None], sizes[:, ::-1], sizes) * atlas.scale
    assert (across + 1 + 2 * GUTTER <= np.column_stack([width, height]) + 1e-9).all()
    assert 0 < atlas.use <= 1


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50)
def test_cells_are_apart_and_large_enough(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sizes = rng.exponential(rng.choice([3.0, 30.0, 200.0]), (int(rng.integers(1, 60)), 2))
    check(sizes, 512)


def test_nothing_is_shrunk_that_fits() -> None:
    atlas = pack_charts(np.array([[100.0, 40.0]]), max_side=2048)
    assert (atlas.scale, atlas.width, atlas.height) == (1.0, 128, 64)


def test_a_tenth_is_given_for_half_the_image() -> None:
    atlas = pack_charts(np.array([[126.0, 50.0]]), max_side=2048)
    assert (atlas.scale, atlas.width, atlas.height) == (0.9, 128, 64)


def test_too_large_a_chart_is_scaled_down() -> None:
    atlas = pack_charts(np.array([[5000.0, 3000.0], [10.0, 10.0]]), max_side=2048)
    assert max(atlas.width, atlas.height) == 2048
    assert 0.3 < atlas.scale < 0.42


def test_places_are_centres_of_texels_behind_the_gutter() -> None:
    atlas = pack_charts(np.array([[10.0, 40.0]]), max_side=256)
    uvs = np.array([[[0.0, 0.0], [10.0, 0.0], [0.0, 40.0]]])
    texels = atlas.to_texels(uvs, np.zeros(1, np.int32))
    assert texels.tolist() == [[[4.5, 4.5], [4.5, 14.5], [44.5, 4.5]]]  # turned


def test_what_cannot_be_packed() -> None:
    with pytest.raises(ValueError, match="0 charts"):
        pack_charts(np.zeros((0, 2)), max_side=256)
    with pytest.raises(ValueError, match="finite"):
        pack_charts(np.array([[np.nan, 1.0]]), max_side=256)
    with pytest.raises(ValueError, match="gutters alone"):
        pack_charts(np.zeros((400, 2)), max_side=256)


def test_many_charts_are_packed_tightly() -> None:
    rng = np.random.default_rng(3)
    atlas = pack_charts(rng.uniform(20, 120, (400, 2)), max_side=2048)
    cells = atlas.cells.astype(int)
    used_height = (cells[:, 1] + cells[:, 3]).max()
    assert (cells[:, 2] * cells[:, 3]).sum() > 0.85 * used_height * atlas.width
