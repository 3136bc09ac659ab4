"""Runs of unions with chance in them: what they agree on, and what their chance depends on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from terraport_pipeline.geometry.borders.consensus import agreed_levels, agreed_tree
from terraport_pipeline.geometry.borders.unions import CostRule, Units

RULE = CostRule(least_m2=4.0, least_width_m=0.5)
SIDE = 8
"""Units along a side; each is 10 m wide, so none is small."""


def chequered(colour):
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
        np.arange(SIDE * SIDE, dtype=np.int64) * 7,
    )


def noisy(seed):
    rng = np.random.default_rng(seed)
    value = rng.normal(0.0, 3.0, (SIDE, SIDE))
    return chequered(lambda column, row: value)


def test_a_clear_border_stands_in_every_run_and_none_within():
    units = chequered(lambda column, row: 40.0 * (column >= 4))
    level = agreed_levels(units, RULE)
    across = (units.pairs % SIDE >= 4).sum(axis=1) == 1
    assert across.sum() == SIDE
    assert level[across].min() == 2.0
    assert level[~across].max() < 0.5


def test_what_only_some_runs_unite_lies_between():
    """Many borders of nearly equal cost: which goes first is chance, the mean is not."""
    level = agreed_levels(noisy(3), RULE)
    assert len(np.unique(level)) > 20
    assert ((level > 0.4) & (level < 1.9)).mean() > 0.2


def test_chance_goes_by_places_and_not_by_the_order_of_units():
    units = noisy(4)
    turned = np.arange(units.count)[::-1]
    ends = turned[units.pairs]
    flipped = ends[:, 0] > ends[:, 1]
    contact = units.contact.copy()
    contact[flipped, 3:] *= -1.0
    other = replace(
        units, sums=units.sums[turned], around=units.around[turned], within=units.within[turned],
        pairs=np.sort(ends, axis=1), contact=contact, name=units.name[turned],
    )  # fmt: skip
    level = agreed_levels(units, RULE)
    assert_allclose(agreed_levels(other, RULE), level, rtol=1e-12)
    elsewhere = replace(units, name=units.name + 1_000_003)
    assert (agreed_levels(elsewhere, RULE) != level).any()


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


def test_the_tree_is_that_of_means_over_lengths():
    """Against uniting the best of all, one by one."""
    units = noisy(5)
    level = np.random.default_rng(6).uniform(0.3, 2.0, len(units.pairs))
    tree = agreed_tree(units, level, RULE)
    borders = {
        frozenset(pair): [10.0, 10.0 * value]
        for pair, value in zip(units.pairs.tolist(), level.tolist(), strict=True)
    }
    heights = []
    for number in range(units.count, 2 * units.count - 1):
        best = min(borders, key=lambda pair: borders[pair][1] / borders[pair][0])
        heights.append(borders[best][1] / borders[best][0])
        joined: dict[frozenset[int], list[float]] = {}
        for pair, (length, total) in borders.items():
            if pair == best:
                continue
            rest = pair - best
            key = pair if len(rest) == 2 else frozenset((*rest, number))
            row = joined.setdefault(key, [0.0, 0.0])
            row[0] += length
            row[1] += total
        borders = joined
    assert len(tree.children) == units.count - 1
    assert_allclose(np.sort(tree.level), heights)
    assert tree.area_m2[-1] == units.count * 100.0
    assert (tree.children < units.count + np.arange(units.count - 1)[:, None]).all()


def test_a_union_is_a_region_once_it_is_large_enough():
    units = chequered(lambda column, row: 40.0 * (column >= 4))
    wide = replace(RULE, least_m2=150.0)
    tree = agreed_tree(units, agreed_levels(units, wide), wide)
    assert (tree.is_region == (tree.area_m2 >= 150.0)).all()
