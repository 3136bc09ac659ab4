"""Parts of a closed body united as people would: always the two that are likeliest one part.

How likely is a logistic function of the facts of two neighbours (:mod:`.part_table`), with the
weights of ``part_weights.json``. They were fitted on every fourth of the odd-numbered models of
Princeton's segmentation benchmark (``benchmarks/part_likelihood.py``): for all neighbours met while
parts are united, which share of the people has two of their faces in one part.

PURE: no I/O but reading the weights that lie beside, no clock.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Final

import numpy as np

from terraport_payload.types import Float64, Int32
from terraport_pipeline.geometry.graph.part_table import FACTS, BodyFacts, PartTable
from terraport_pipeline.geometry.regions.pool_refine import number_by_first

__all__ = ["LIKELY", "PartMerges", "PartWeights", "merge_parts", "part_weights"]

LIKELY: Final = 0.475
"""Parts are united while the likeliest two are one part for more than this share of people.
Chosen on the models that the weights were fitted on, each fourth of them by weights of the rest."""
_MOST_DEVIATIONS: Final = 4.0
"""Facts farther from their mean count as this far: bodies unlike all that were seen."""


@dataclass(frozen=True, slots=True, eq=False)
class PartWeights:
    """Weights of the logistic function over standardised facts."""

    mean: Float64
    """(D,) of the facts."""
    deviation: Float64
    """(D,) > 0."""
    weight: Float64
    """(D,)"""
    bias: float

    def likelihood(self, facts: Float64) -> Float64:
        """Share of people who have two neighbours in one part, (N,), for facts (N, D)."""
        far = np.clip((facts - self.mean) / self.deviation, -_MOST_DEVIATIONS, _MOST_DEVIATIONS)
        return np.asarray(1.0 / (1.0 + np.exp(-((far * self.weight).sum(axis=1) + self.bias))))


@cache
def part_weights() -> PartWeights:
    """Read the weights that were fitted."""
    text = (files(__package__) / "part_weights.json").read_text("utf-8")
    table = json.loads(text)
    rows = np.array([table["facts"][name] for name in fact_names()], np.float64)
    return PartWeights(rows[:, 0], rows[:, 1], rows[:, 2], float(table["bias"]))


def fact_names() -> list[str]:
    """Names of the facts, each with its place: several are alike but for what they follow."""
    return [f"{place:02} {name}" for place, name in enumerate(FACTS)]


@dataclass(frozen=True, slots=True, eq=False)
class PartMerges:
    """Parts in the order in which they were united, from which any number is read."""

    base: Int32
    """(F,) part of every face before any was united, 0..count-1."""
    count: int
    merges: Int32
    """(M, 2) part that stays and part that goes, in order."""
    likelihood: Float64
    """(M,) that the two are one part, when they were united."""

    def cut_by_likelihood(self, least: float) -> tuple[Int32, int]:
        """Undo all from the first union on that is less likely; labels (F,) and their number."""
        unlikely = np.flatnonzero(self.likelihood < least)
        return self._cut(int(unlikely[0]) if len(unlikely) else len(self.merges))

    def cut_by_count(self, count: int) -> tuple[Int32, int]:
        """Leave this many parts, or as near to it as there are."""
        return self._cut(min(max(self.count - count, 0), len(self.merges)))

    def _cut(self, done: int) -> tuple[Int32, int]:
        into = np.arange(self.count, dtype=np.int32)
        for kept, gone in self.merges[:done]:
            into[into == gone] = kept
        return number_by_first(into[self.base])


def merge_parts(
    body: BodyFacts, labels: Int32, count: int, weights: PartWeights | None = None
) -> PartMerges:
    """Unite parts, always the likeliest two, until none touch.

    Parameters
    ----------
    body : BodyFacts
    labels : ndarray of shape (F,), int32
        Parts to begin with, 0..count-1, finer than any that is wanted. Time grows with their
        square: some hundred.
    count : int
    weights : PartWeights, optional
        None: those that were fitted.

    Returns
    -------
    PartMerges
    """
    judge = weights or part_weights()
    table = PartTable(body, labels, count)
    likely = np.full((count, count), -1.0)
    a, b = table.neighbours()
    if len(a):
        likely[a, b] = judge.likelihood(table.facts(a, b))
    merges, paid = [], []
    # Invariant: `likely` holds, at (smaller, larger), every two parts that touch; -1 elsewhere.
    while len(a):
        small, large = np.unravel_index(int(np.argmax(likely)), likely.shape)
        if likely[small, large] < 0.0:
            break
        paid.append(float(likely[small, large]))
        merges.append((int(large), int(small)))
        table.merge(int(large), int(small))
        for gone in (small, large):
            likely[gone] = -1.0
            likely[:, gone] = -1.0
        one, other = table.neighbours_of(int(large))
        if len(one):
            likely[one, other] = judge.likelihood(table.facts(one, other))
    return PartMerges(
        labels, count, np.array(merges, np.int32).reshape(-1, 2), np.array(paid, np.float64)
    )
