"""Sums of colours add up over parts to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from terraport_pipeline.geometry.regions.mean_scale import ColourTotals, axis_index

WEIGHT = np.array([0.25, 1.0, 1.0]) / 64.0


@pytest.fixture
def colour():
    return np.random.default_rng(2).integers(-6400, 6400, (1000, 3)).astype(np.int32)


def test_parts_add_up(colour) -> None:
    whole = ColourTotals.of(colour)
    joined = ColourTotals.of(colour[:300]).plus(ColourTotals.of(colour[300:]))
    assert joined.faces == whole.faces == 1000
    assert_array_equal(joined.whole, whole.whole)
    assert_array_equal(joined.products, whole.products)
    assert joined.spread(WEIGHT) == whole.spread(WEIGHT)


def test_the_spread_is_the_root_of_the_summed_variances(colour) -> None:
    spread = np.sqrt(((colour * WEIGHT).var(axis=0)).sum())
    assert ColourTotals.of(colour).spread(WEIGHT) == pytest.approx(spread, rel=1e-12)
    assert ColourTotals.of(colour[:0]).spread(WEIGHT) == 0.0


def test_the_index_runs_along_the_axis_of_most_spread() -> None:
    along = np.arange(100)
    colour = np.stack([0 * along, 64 * along, 0 * along], axis=1).astype(np.int32)
    index = axis_index(colour, ColourTotals.of(colour), WEIGHT)
    assert index[-1] - index[0] == pytest.approx(0.99, rel=1e-6)
    assert index.sum() == pytest.approx(0.0, abs=1e-4)
