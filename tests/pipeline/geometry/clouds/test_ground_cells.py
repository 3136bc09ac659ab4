"""Sums do not depend on the order of samples, and say what the samples say."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_pipeline.geometry.clouds.ground_cells import (
    COLOUR,
    COUNT,
    MEAN,
    PRODUCT,
    SQUARE,
    TICKS,
    GroundSums,
    axis_indices,
    cell_keys,
    coarser_keys,
    key_indices,
)


def test_keys_are_ordered_as_their_cubes() -> None:
    cells = np.array([[-2.0, -3, 9], [-1.5, 5, -9], [-0.5, -2.5, 3], [0, 0, 0], [0, 0, 1.9]])
    keys = cell_keys(cells)
    assert (np.diff(keys) > 0).all()
    np.testing.assert_array_equal(key_indices(keys), np.floor(cells))
    np.testing.assert_array_equal(axis_indices(keys, 1), [-3, 5, -3, 0, 0])


def test_strays_count_in_the_outermost_cubes_and_keep_neighbours() -> None:
    keys = cell_keys(np.array([[-1e12, 0, 0], [1e12, np.inf, -np.inf]]))
    index = key_indices(keys)
    assert np.abs(index).max() < 1 << 20
    np.testing.assert_array_equal(key_indices(keys + 1), index + np.array([0, 0, 1]))
    np.testing.assert_array_equal(key_indices(keys - 1), index - np.array([0, 0, 1]))


def test_wider_cubes_hold_the_narrow_ones() -> None:
    cells = np.random.default_rng(0).uniform(-9, 9, (500, 3))
    coarse = coarser_keys(np.unique(cell_keys(cells)))
    np.testing.assert_array_equal(coarse, np.unique(cell_keys(cells / 2)))


def test_sums_of_a_cube_are_those_of_its_samples() -> None:
    rng = np.random.default_rng(1)
    cells = rng.uniform(3, 4, (40, 3))
    colours = rng.integers(0, 256, (40, 3)).astype(np.uint8)
    ground = GroundSums.empty(2)
    ground.add(cells, np.ones(40, np.int64), colours)
    ticks = np.floor((cells - 3) * TICKS) - TICKS // 2
    [nothing, sums] = ground.sums
    assert not nothing.any()
    assert sums[COUNT] == 40
    np.testing.assert_array_equal(sums[MEAN:PRODUCT], ticks.sum(axis=0))
    for column, (a, b) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))):
        assert sums[PRODUCT + column] == (ticks[:, a] * ticks[:, b]).sum()
    np.testing.assert_array_equal(sums[COLOUR:SQUARE], colours.sum(axis=0, dtype=int))
    assert sums[SQUARE] == ((colours.astype(int) ** 2).sum(axis=1) // 16).sum()
    voxels = {int(x * 16 + y * 4 + z) for x, y, z in ((cells - 3) * 4).astype(int)}
    assert {bit for bit in range(64) if int(ground.voxels[1]) >> bit & 1} == voxels
    assert not ground.voxels[0]


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), cut=st.integers(0, 300))
def test_the_order_of_samples_does_not_count(seed: int, cut: int) -> None:
    rng = np.random.default_rng(seed)
    cells = rng.uniform(-2, 2, (300, 3))
    colours = rng.integers(0, 256, (300, 3)).astype(np.uint8)
    keys = np.unique(cell_keys(cells))
    rows = np.searchsorted(keys, cell_keys(cells))
    once, again = GroundSums.empty(len(keys)), GroundSums.empty(len(keys))
    once.add(cells, rows, colours)
    order = rng.permutation(300)
    for some in (order[:cut], order[cut:]):
        again.add(cells[some], rows[some], colours[some])
    np.testing.assert_array_equal(once.sums, again.sums)
    np.testing.assert_array_equal(once.voxels, again.voxels)
