"""Where several runs of unions agree: a tree of regions that chance does not tip.

Uniting the cheapest first is chaotic where many costs are nearly equal: which of the last weak
borders stays is decided by a grey level of noise, and one border too few makes one region of two.
So units are united several times, each time with every cost off by some chance and every limit a
little elsewhere, and the limits at which a contact's two sides came together are averaged. A border
that only one order of unions had is faint in the mean; one that all had is not. By these means
alone, averaged over the common border, the two that agree best are then united, up to one tree.

The chance is a mix of the places of two units and the run's number: the same on every machine, for
any number of tiles, whatever else was flown.

PURE: no I/O, no clock.

References
----------
A. Strehl, J. Ghosh, "Cluster ensembles: a knowledge reuse framework for combining multiple
partitions", Journal of Machine Learning Research 3, 2002, averages partitions; here trees are, by
the height at which a contact disappears.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from terraport_payload.types import Bool, Float64, Int32
from terraport_pipeline.geometry.borders.unions import (
    CostRule,
    Units,
    mutual_choices,
    unite_level,
)

__all__ = ["COMMON_LEVELS", "COST_OF_A_BORDER", "AgreedTree", "agreed_levels", "agreed_tree"]

COST_OF_A_BORDER: Final = 4.0
"""Cost, as ``unions.py`` counts it, of a border: level 1. The mean over four drawn pieces of
surveys was least there (docs/decisions/region-engine.md)."""
_RUNS: Final = 6
_STEPS: Final = 16
"""Limits up to level 1."""
_STEPS_ABOVE: Final = 8
"""And from there to level 2."""
COMMON_LEVELS: Final = tuple(step / _STEPS for step in range(1, 5))
"""What costs so little is united once, for all runs."""
_MOST_LEVEL: Final = 2.0
"""A border that stands here counts as this, however much higher it is."""


@dataclass(frozen=True, slots=True, eq=False)
class AgreedTree:
    """Unions of two, best agreed first wherever they touch; node U + m is the union of merge m."""

    children: Int32
    """(M, 2) both below U + m."""
    level: Float64
    """(M,) at which it was united, in the mean; never below that of either child."""
    area_m2: Float64
    """(U + M,) of every node."""
    is_region: Bool
    """(U + M,) whether it is large and wide enough for a region."""


def agreed_levels(units: Units, rule: CostRule) -> Float64:
    """Let several runs unite the units, and average the level at which each contact disappeared.

    Parameters
    ----------
    units : Units
        What is left after :data:`COMMON_LEVELS`.
    rule : CostRule

    Returns
    -------
    ndarray of shape (E,), float64
        From the last of the common levels to 2.
    """
    total = np.zeros(len(units.pairs))
    for run in range(1, _RUNS + 1):
        total += _levels_of_run(units, replace(rule, run=run))
    mean: Float64 = total / _RUNS
    return mean


def agreed_tree(units: Units, level: Float64, rule: CostRule) -> AgreedTree:
    """Unite the two that agree best, as long as any touch.

    Parameters
    ----------
    units : Units
    level : ndarray of shape (E,)
        Of every contact; that of a union's is the mean over their length.
    rule : CostRule
        Says what is too small for a region.

    Returns
    -------
    AgreedTree
    """
    # Two that choose each other may be united at once, whatever else is: means over lengths never
    # bring a third nearer than it was to one of both.
    held = replace(units, contact=np.column_stack([units.contact, units.contact[:, 0] * level]))
    number = np.arange(units.count, dtype=np.int32)
    children = [np.zeros((0, 2), np.int32)]
    levels, areas = [np.zeros(0)], [units.sums[:, 0]]
    is_region, found = [~units.too_small(rule)], units.count
    while True:
        mean = held.contact[:, -1] / held.contact[:, 0]
        node, count = mutual_choices(held, mean)
        if count == held.count:
            break
        inner = np.flatnonzero(node[held.pairs[:, 0]] == node[held.pairs[:, 1]])
        # In order of their places among the contacts: the same on every machine.
        united = node[held.pairs[inner, 0]]
        new = found + np.arange(len(inner), dtype=np.int32)
        children.append(number[held.pairs[inner]])
        levels.append(mean[inner])
        next_number = np.empty(count, np.int32)
        next_number[node] = number
        next_number[united] = new
        held, number, found = held.united(node, count), next_number, found + len(inner)
        areas.append(held.sums[united, 0])
        is_region.append(~held.too_small(rule)[united])
    merged = np.concatenate(children)
    return AgreedTree(
        merged,
        _never_falling(merged, np.concatenate(levels), units.count),
        np.concatenate(areas),
        np.concatenate(is_region),
    )


def _never_falling(children: Int32, level: Float64, leaves: int) -> Float64:
    """Lift what rounding put below a child."""
    heights = np.concatenate([np.zeros(leaves), level])
    for merge, (one, other) in enumerate(children.tolist()):
        heights[leaves + merge] = max(heights[leaves + merge], heights[one], heights[other])
    return heights[leaves:]


def _levels_of_run(units: Units, rule: CostRule) -> Float64:
    """Level at which the sides of every contact came together in one run, (E,)."""
    shift = (rule.run - 0.5) / _RUNS
    levels = [(step + shift) / _STEPS for step in range(len(COMMON_LEVELS), _STEPS)]
    levels += [1.0 + (step + shift) / _STEPS_ABOVE for step in range(_STEPS_ABOVE)]
    low, high = units.pairs.T
    found = np.full(len(low), _MOST_LEVEL)
    owner: Int32 = np.arange(units.count, dtype=np.int32)
    left = units
    for level in levels:
        left, rounds = unite_level(left, rule, COST_OF_A_BORDER * level)
        for node in rounds:
            owner = node[owner]
        if rounds:
            found[(owner[low] == owner[high]) & (found == _MOST_LEVEL)] = level
    return found
