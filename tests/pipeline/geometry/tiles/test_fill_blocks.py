"""Blocks where ground must be that nobody looked at."""

from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.tiles.fill_blocks import fill_blocks

GRID = np.stack(np.meshgrid(np.arange(10), np.arange(10)), axis=-1).reshape(-1, 2)


def test_nearest_columns_are_filled_at_the_height_of_the_nearest() -> None:
    blocks = np.array([[0, 5, 0], [9, 7, 9]])
    filled, counts = fill_blocks(blocks, GRID, 100, 2000)
    assert len(filled) == 100
    assert len(np.unique(filled[:, [0, 2]], axis=0)) == 100
    assert counts.sum() == 2000
    near = filled[:, 0] + filled[:, 2] < 8
    assert set(filled[near, 1].tolist()) == {5}


def test_no_more_than_the_ground_there_is() -> None:
    blocks = np.array([[0, 5, 0], [0, 6, 0], [1, 5, 0]])
    filled, counts = fill_blocks(blocks, GRID, 2, 600)
    assert filled.tolist() == blocks.tolist()
    assert counts.tolist() == [200, 200, 200]
    filled, _ = fill_blocks(blocks, GRID, 5, 600)
    assert len(filled) == 6
    assert np.abs(filled[3:, [0, 2]]).max() <= 2
