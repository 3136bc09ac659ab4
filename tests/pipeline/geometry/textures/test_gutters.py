from __future__ import annotations

import numpy as np
from pipeline.geometry.textures.test_bake import colours, empty

from terraport_pipeline.geometry.photos.photo_samples import neutral_gains
from terraport_pipeline.geometry.textures.atlas_pack import ALIGN, pack_charts
from terraport_pipeline.geometry.textures.bake import bake_plain_faces
from terraport_pipeline.geometry.textures.gutters import fill_cells


def test_gutters_take_their_own_chart_s_colour_and_mips_mix_nothing() -> None:
    """Two charts, black and white: no texel of the first four mips is grey within a cell."""
    rng = np.random.default_rng(7)
    sizes = rng.uniform(3, 40, (12, 2))
    atlas = pack_charts(sizes, max_side=512)
    image = np.full((atlas.height, atlas.width, 3), 77, np.uint8)
    covered = np.zeros((atlas.height, atlas.width), np.uint8)
    level = np.where(np.arange(12) % 2, 255, 0).astype(np.uint8)
    uvs = np.array([[[0, 0], [w, 0], [0, h]] for w, h in sizes])
    texels = atlas.to_texels(uvs, np.arange(12, dtype=np.int32))
    face_colours = colours(12, colours=np.repeat(level, 9).reshape(12, 3, 3))
    which = np.arange(12, dtype=np.int32)
    bake_plain_faces(image, covered, texels, which, face_colours, neutral_gains(0)[0])
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
