"""Runs of unions with chance in them: what they agree on, and what their chance depends on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from terraport_pipeline.geometry.borders.consensus import agreed, agreed_level
from terraport_pipeline.geometry.borders.unions import CostRule, Units

RULE = CostRule(least_m2=4.0, least_width_m=0.5)
SIDE = 8
"""Units along a side; each is 10 m wide, so none is small."""


def chequered(colour, keys=None):
    """SIDE x SIDE square units in rows, of lightness ``colour(column, row)``."""
    column, row = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    value = colour(column, row).astype(np.float64).ravel()
    number = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    pairs = np.concatenate(
        [
            np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1),
            np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1),
        ]
    ).astype(np.int32)
    step = value[pairs[:, 0]] - value[pairs[:, 1]]
    length = np.full(len(pairs), 10.0)
    area = np.full(SIDE * SIDE, 100.0)
    upward = np.zeros((SIDE * SIDE, 3))
    upward[:, 1] = area
    return Units(
        np.stack([area, area * value], axis=1),
        np.column_stack([area * 8.0, upward]),
        np.tile([10.0, 1.0], (SIDE * SIDE, 1)),
        pairs,
        np.stack([length, length * np.abs(step) / 2, 0 * length, length * step / 2], axis=1),
        np.arange(SIDE * SIDE, dtype=np.int64) * 7 if keys is None else keys,
    )


def test_a_clear_border_stands_in_every_run_and_none_within():
    units = agreed(chequered(lambda column, row: 40.0 * (column >= 4)), RULE)
    level = agreed_level(units, RULE)
    across = (units.pairs % SIDE >= 4).sum(axis=1) == 1
    assert across.sum() == SIDE
    assert level[across].min() >= 2.0
    assert level[~across].max() < 0.5


def test_what_only_some_runs_unite_lies_between():
    """Many borders of nearly equal cost: which goes first is chance, the mean is not."""
    rng = np.random.default_rng(3)
    units = agreed(chequered(lambda column, row: rng.normal(0.0, 3.0, column.shape)), RULE)
    level = units.agreed / units.contact[:, 0]
    assert len(np.unique(level)) > 20
    assert ((level > 0.4) & (level < 1.9)).mean() > 0.2


def test_chance_goes_by_places_and_not_by_the_order_of_units():
    rng = np.random.default_rng(4)
    value = rng.normal(0.0, 3.0, (SIDE, SIDE))
    units = chequered(lambda column, row: value)
    turned = np.arange(units.count)[::-1]
    ends = turned[units.pairs]
    flipped = ends[:, 0] > ends[:, 1]
    contact = units.contact.copy()
    contact[flipped, 3:] *= -1.0
    other = replace(
        units, sums=units.sums[turned], around=units.around[turned], within=units.within[turned],
        pairs=np.sort(ends, axis=1), contact=contact, name=units.name[turned],
    )  # fmt: skip
    assert_allclose(agreed(other, RULE).agreed, agreed(units, RULE).agreed, rtol=1e-12)
    elsewhere = replace(units, name=units.name + 1_000_003)
    assert (agreed(elsewhere, RULE).agreed != agreed(units, RULE).agreed).any()


def test_above_what_any_run_united_the_cost_itself_counts():
    units = agreed(chequered(lambda column, row: np.where(column >= 4, 40.0, 0.0)), RULE)
    steeper = agreed(chequered(lambda column, row: np.where(column >= 4, 90.0, 0.0)), RULE)
    assert agreed_level(steeper, RULE).max() > agreed_level(units, RULE).max() > 2.0


@pytest.mark.parametrize("run", [1, 2, 6])
def test_a_runs_chance_has_no_bias_and_the_deviation_of_the_rule(run):
    units = chequered(lambda column, row: 5.0 * column + 3.0 * row)
    names = np.random.default_rng(run).integers(0, 2**61, units.count)
    off = [
        np.log(replace(units, name=names + shift).cost(replace(RULE, run=run)))
        - np.log(units.cost(RULE))
        for shift in range(40)
    ]
    assert abs(np.mean(off)) < 0.01
    assert np.std(off) == pytest.approx(RULE.chance, rel=0.05)


def test_united_units_keep_what_was_agreed_on_by_length():
    units = agreed(chequered(lambda column, row: 40.0 * (column >= 4)), RULE)
    halves = ((np.arange(units.count) % SIDE) >= 4).astype(np.int32)
    two = units.united(halves, 2)
    across = (units.pairs % SIDE >= 4).sum(axis=1) == 1
    assert_array_equal(two.pairs, [[0, 1]])
    assert_allclose(two.agreed, units.agreed[across].sum())
    assert_allclose(two.contact[0, 0], 10.0 * SIDE)
