"""Where several runs of unions agree: regions that chance does not tip.

Uniting the cheapest first is chaotic where many costs are nearly equal: which of the last weak
borders stays is decided by a grey level of noise, and one border too few makes one region of two.
So seeds are united several times, each time with every cost off by some chance and every limit a
little elsewhere, and the limits at which a contact's two sides came together are averaged. A border
that only one order of unions had is faint in the mean; one that all had is not. Then seeds are
united once more, by these means alone.

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

from dataclasses import replace
from typing import Final

import numpy as np

from terraport_payload.types import Float64, Int32
from terraport_pipeline.geometry.borders.unions import CostRule, Units, unite_level

__all__ = ["COMMON_LEVELS", "COST_OF_A_BORDER", "agreed", "agreed_level"]

COST_OF_A_BORDER: Final = 4.0
"""Cost, as ``unions.py`` counts it, of a clear border: level 1."""
_RUNS: Final = 6
_STEPS: Final = 16
"""Limits up to level 1."""
_STEPS_ABOVE: Final = 8
"""And from there to level 2."""
COMMON_LEVELS: Final = tuple(step / _STEPS for step in range(1, 5))
"""What costs so little is united once, for all runs."""
_MOST_LEVEL: Final = 2.0
"""A border that stands here counts as this, however much higher it is."""


def agreed(units: Units, rule: CostRule) -> Units:
    """Let several runs unite the units, and write down at what level each contact disappeared.

    Parameters
    ----------
    units : Units
        What is left after :data:`COMMON_LEVELS`.
    rule : CostRule

    Returns
    -------
    Units
        The same, with ``agreed``.
    """
    total = np.zeros(len(units.pairs))
    for run in range(1, _RUNS + 1):
        total += _levels_of_run(units, replace(rule, run=run))
    return replace(units, agreed=units.contact[:, 0] * total / _RUNS)


def agreed_level(units: Units, rule: CostRule) -> Float64:
    """Level at which the runs united over every contact, in the mean, (E,).

    Where none did, and above that, it is the level of the cost itself.
    """
    assert units.agreed is not None
    level = units.agreed / units.contact[:, 0]
    unknown = level >= _MOST_LEVEL * (1.0 - 1e-9)
    level[unknown] = np.maximum(units.cost(rule)[unknown] / COST_OF_A_BORDER, _MOST_LEVEL)
    return level


def _levels_of_run(units: Units, rule: CostRule) -> Float64:
    """Level at which the sides of every contact came together in one run, (E,)."""
    shift = (rule.run - 0.5) / _RUNS
    first = len(COMMON_LEVELS)
    levels = [(step + shift) / _STEPS for step in range(first, _STEPS)]
    levels += [1.0 + (step + shift) / _STEPS_ABOVE for step in range(_STEPS_ABOVE)]
    low, high = units.pairs.T
    found = np.full(len(low), _MOST_LEVEL)
    owner: Int32 = np.arange(units.count, dtype=np.int32)
    left = units
    for level in levels:
        left, rounds = unite_level(left, lambda u: u.cost(rule), COST_OF_A_BORDER * level)
        for node in rounds:
            owner = node[owner]
        if rounds:
            found[(owner[low] == owner[high]) & (found == _MOST_LEVEL)] = level
    return found
