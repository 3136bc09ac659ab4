"""Regions against drawings, by figures worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_research.plan_scores import CELL_M, drawn_regions, inside_ring, plan_score

GROUND = np.ones((40, 40), np.bool_)


def halves(at: int) -> np.ndarray:
    """Two regions that meet at a column."""
    return np.repeat((np.arange(40) >= at).astype(np.int32)[None], 40, axis=0)


def test_even_odd():
    """A square with its middle, its outside and a notch."""
    ring = np.array([[0, 0], [4, 0], [4, 4], [2, 1], [0, 4], [0, 0]], float)
    points = np.array([[1, 1], [2, 3], [3.5, 2], [5, 1], [-1, 1]], float)
    assert inside_ring(points, ring).tolist() == [True, False, True, False, False]


def test_later_rings_lie_over_earlier_ones():
    field = np.array([[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]], float)
    hut = np.array([[2, 2], [4, 2], [4, 4], [2, 4], [2, 2]], float)
    middles, regions = drawn_regions([field, hut, hut - 2], [0, 1, -1], (0, 0, 10, 12))
    assert regions.shape == (24, 20)
    assert middles[0, 0].tolist() == [CELL_M / 2, CELL_M / 2]
    counts = {number: int((regions == number).sum()) for number in (-1, 0, 1)}
    assert counts == {-1: 16 + 80, 0: 400 - 32, 1: 16}


def test_the_drawing_itself_is_perfect():
    score = plan_score(halves(20), halves(20), GROUND)
    assert (score.rand_error, score.recall, score.precision) == (0.0, (1.0, 1.0), (1.0, 1.0))
    assert score.regions_per_drawn == 1.0
    assert 0.8 < score.drawn_share < 1.0  # a metre on both sides of the border is not scored


@pytest.mark.parametrize(("cells", "near"), [(3, (1.0, 1.0)), (5, (0.0, 1.0)), (8, (0.0, 0.0))])
def test_a_border_that_is_off(cells, near):
    score = plan_score(halves(20), halves(20 + cells), GROUND)
    assert score.recall == score.precision == near
    assert score.f_score(1) == pytest.approx(near[1], abs=1e-9)


def test_one_region_finds_no_border():
    score = plan_score(halves(20), np.zeros((40, 40), np.int32), GROUND)
    assert (score.recall, score.precision) == ((0.0, 0.0), (1.0, 1.0))
    assert (score.largest_share, score.regions_per_drawn) == (1.0, 0.5)
    assert score.rand_error == pytest.approx(0.5, abs=0.02)


def test_a_border_in_a_gap_lies_midway():
    drawn = halves(20)
    drawn[:, 18:22] = -1
    assert plan_score(drawn, halves(20), GROUND).recall == (1.0, 1.0)
    drawn[:, 8:32] = -1  # too wide to say where
    assert plan_score(drawn, np.zeros((40, 40), np.int32), GROUND).recall == (1.0, 1.0)
