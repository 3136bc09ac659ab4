"""Samples per cell, gaps, and a map of characters."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.clouds.density_map import (
    DensityMap,
    count_samples,
    draw_text,
    find_gaps,
    widened,
)


def test_every_sample_is_in_the_cell_that_it_lies_in() -> None:
    # Two columns, three rows from the north; the eastern and the southern rim belong to the last.
    points = np.array([[0.5, 2.5, 9], [1.5, 2.5, 9], [1.5, 2.9, 9], [2.0, 0.0, 9], [0.0, 3.0, 9]])
    made = count_samples([points[:2], points[2:]], np.zeros(3), np.array([2.0, 3.0, 9.0]), 1.0)
    assert made.counts.tolist() == [[2, 2], [0, 0], [0, 1]]
    assert (made.west, made.north, made.cell_m) == (0.0, 3.0, 1.0)
    assert made.area_m2 == 3.0


def test_samples_outside_the_box_are_left_out() -> None:
    points = np.array([[-0.1, 0.5, 0], [1.1, 0.5, 0], [0.5, 1.1, 0], [0.5, -0.1, 0], [0.5, 0.5, 0]])
    made = count_samples([points], np.zeros(3), np.ones(3), 1.0)
    assert made.counts.tolist() == [[1]]


@pytest.mark.parametrize("factor", [1, 2, 3, 5])
def test_a_wider_map_has_the_same_samples(factor: int) -> None:
    counts = np.random.default_rng(1).integers(0, 9, (7, 5))
    wide = widened(DensityMap(counts, 3.0, 4.0, 2.0), factor)
    assert wide.counts.sum() == counts.sum()
    assert wide.counts[0, 0] == counts[:factor, :factor].sum()
    assert wide.cell_m == 2.0 * factor


def test_density_is_that_of_cells_with_samples_all_around() -> None:
    counts = np.full((5, 5), 4)
    counts[0] = 1
    assert np.argwhere(DensityMap(counts, 0, 0, 1).inner).min() == 1
    lone = DensityMap(np.array([[0, 3, 0]]), 0, 0, 1)
    assert lone.inner.tolist() == [[False, True, False]]


def test_a_few_samples_spread_thinly_hardly_count() -> None:
    counts = np.zeros((10, 10), np.int64)
    counts[:2, :5] = 100
    assert DensityMap(counts, 0, 0, 2.0).effective_m2 == 40.0
    counts[counts == 0] = 1
    assert DensityMap(counts, 0, 0, 2.0).effective_m2 == pytest.approx(40.0, rel=0.2)
    assert DensityMap(counts, 0, 0, 2.0).area_m2 == 400.0
    assert DensityMap(0 * counts, 0, 0, 2.0).effective_m2 == 0.0


def test_gaps_are_what_samples_lie_all_around() -> None:
    counts = np.ones((9, 9), np.int64)
    counts[2:4, 2:5] = 0  # 6 cells
    counts[6, 6] = 0  # 1 cell
    counts[0, 3] = 0  # open to the outside
    large, small = find_gaps(DensityMap(counts, 100.0, 50.0, 2.0), 1)
    assert (large.area_m2, small.area_m2) == (24.0, 4.0)
    assert (small.east, small.north) == (113.0, 37.0)
    assert 104.0 < large.east < 110.0
    assert 42.0 < large.north < 46.0
    assert [gap.area_m2 for gap in find_gaps(DensityMap(counts, 0, 0, 2.0), 2)] == [24.0]
    assert find_gaps(DensityMap(np.ones((2, 2), np.int64), 0, 0, 1.0), 1) == []


def test_characters_are_darker_where_samples_are_denser() -> None:
    counts = np.array([[0, 1, 2, 3, 4]] * 2)
    assert draw_text(DensityMap(counts, 0, 0, 1)) == [" ░▒▓█"]
    assert draw_text(DensityMap(np.zeros((3, 2), np.int64), 0, 0, 1)) == ["  ", "  "]
