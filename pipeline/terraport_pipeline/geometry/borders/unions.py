"""Unions of cells: rounds that unite neighbours, and what a union of two would cost.

Units (a cell at first) hold their area, their mean features, the contrast around them, the steps
summed over their border with each neighbour, and the gradient summed over all that was united
within them. The cost of uniting two has no unit; it is

    sqrt(D sqrt(S G)) / (contrast + noise)   times   three factors

- D, the difference of the two mean features; G, the mean gradient along their common border; S, the
  length of the mean *step* over it. All are about as large along a border between two materials. A
  slow change of light has no G, a crack within one material no D; and steps that point here this
  way and there that way cancel in S: what lies along a patch of noise is no border, a weak line
  that goes on and on is one;
- *contrast*: how far colours spread within some region sizes around (``evidence.py``), the smaller
  of the two. People draw what stands out where it is: a bench beside its rock face is no border in
  a pit between grass and water, and is one where there is nothing but earth;
- *noise*: the mean gradient within the calmer of the two. Gravel is not told apart as finely as a
  road;
- size: a unit below the least area costs less, by the root of its share of it, as it must go
  somewhere. Large ones cost what small ones do;
- contact: the shorter perimeter over the common border, to a small power. Two fields that touch at
  a corner are two fields;
- what stood before: along borders of the version before a union costs more, within its regions
  less. What does not decide anything cannot tip a border that people know.

A unit's size is that of its outline, not of its surface (the length of its area vector): a tree's
crown has four times the surface of the ground that it stands on.

A round: every unit chooses the neighbour of least cost (ties: lower mix of their names). Units that
choose each other are united, and a unit joins its choice where that has at least four times its
area, and does not itself join another in that way.

PURE: no I/O, no clock. Each round is linear in what is left.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np

from terraport_payload.types import Bool, Float64, Int32, Int64
from terraport_pipeline.geometry.regions.mean_units import join_choices

__all__ = ["CostRule", "Units", "mutual_choices", "unite_level", "unite_seeds"]

_MOST_ROUNDS: Final = 1000
"""Far above what ever happens: a round unites something, or is the last."""
_SEED_FLOOR: Final = 0.05
"""Share of the area of a seed below which a unit is no more urgent."""


@dataclass(frozen=True, slots=True)
class CostRule:
    """What decides whether two units are one region; measures in metres and CIELAB units."""

    least_m2: float
    """Area below which a region joins a neighbour."""
    least_width_m: float
    """Width below which a strip joins a neighbour however long it is: where two materials meet,
    means over some cells blend, and the blend is no region."""
    contrast: float = 0.16
    """Share of the contrast around that is noticed on calm ground."""
    least_contrast: float = 3.0
    """Contrast, CIELAB units, below which ground counts as having that: less than half of what the
    plainest survey has."""
    noise: float = 0.18
    """Times the gradient within the calmer unit that is added to it."""
    width: float = 2.0
    """Gradient over a cell times this is a step's height: near means blur a step over two cells."""
    small_power: float = 0.5
    contact_power: float = 0.4
    run: int = 0
    """Number of the run; from 1 on every cost is off by a chance of its own (``consensus.py``)."""
    chance: float = 0.15
    """Standard deviation of the logarithm of that."""
    held_power: float = 0.7
    """Logarithm of the factor along a border that stood before, and against one within."""


@dataclass(frozen=True, slots=True, eq=False)
class Units:
    """Units and their contacts."""

    sums: Float64
    """(U, 1 + K): area in square metres; area times features."""
    around: Float64
    """(U, 4): area times the contrast around; area vector, square metres."""
    within: Float64
    """(U, 2): length of the contacts united within, metres; the same times gradient."""
    pairs: Int32
    """(E, 2) units in contact, lower first."""
    contact: Float64
    """(E, 3 + K): length in metres; length times gradient; length times +1 where the border stood
    before, -1 where both sides were one region, 0 where nothing is known; length times the step of
    the features from the lower unit to the other. What stands in columns beyond is summed up."""
    name: Int64
    """(U,) lowest key of a cell: a place, whatever else was flown."""

    @property
    def count(self) -> int:
        """Number of units."""
        return len(self.name)

    def united(self, node: Int32, count: int) -> Units:
        """Unite units: ``node[u]`` is the union of unit u."""
        ends = node[self.pairs]
        inner = ends[:, 0] == ends[:, 1]
        within = _sums(node, self.within, count)
        within += _sums(ends[inner, 0], self.contact[inner, :2], count)
        rows = np.flatnonzero(~inner)
        outer = ends[rows]
        turned = outer[:, 0] > outer[:, 1]
        outer.sort(axis=1)
        last_step = 2 + self.sums.shape[1]
        pairs, contact = _summed_contacts(outer, self.contact, rows, turned, last_step, count)
        name = np.full(count, np.iinfo(np.int64).max, np.int64)
        np.minimum.at(name, node, self.name)
        return Units(
            _sums(node, self.sums, count),
            _sums(node, self.around, count),
            within,
            pairs,
            contact,
            name,
        )

    def too_small(self, rule: CostRule) -> Bool:
        """Say which units are too small or nowhere wide enough, (U,).

        The perimeter of a strip is twice its area over its width.
        """
        thin = 2.0 * self.sums[:, 0] < rule.least_width_m * self.perimeters()
        small: Bool = (self.outlines() < rule.least_m2) | thin
        return small

    def outlines(self) -> Float64:
        """Size of every unit as seen from where it looks largest, square metres, (U,)."""
        vector = self.around[:, 1:]
        size: Float64 = np.sqrt((vector * vector).sum(axis=1))
        return size

    def perimeters(self) -> Float64:
        """Length that every unit shares with others, metres, (U,)."""
        low, high = self.pairs.T
        length = self.contact[:, 0]
        first, second = (np.bincount(side, length, self.count) for side in (low, high))
        perimeters: Float64 = np.asarray(first + second, np.float64)
        return perimeters

    def difference(self) -> Float64:
        """Distance of the mean features over every contact, (E,)."""
        mean = self.sums[:, 1:] / self.sums[:, :1]
        step = mean[self.pairs[:, 0]] - mean[self.pairs[:, 1]]
        distance: Float64 = np.sqrt((step * step).sum(axis=1))
        return distance

    def cost(self, rule: CostRule) -> Float64:
        """Cost of uniting over every contact, (E,)."""
        low, high = self.pairs.T
        length = self.contact[:, 0]
        gradient = rule.width * self.contact[:, 1] / length
        step = self.contact[:, 3:] / length[:, None]
        along = rule.width * np.sqrt((step * step).sum(axis=1))
        calm = rule.width * self.within[:, 1] / np.maximum(self.within[:, 0], 1e-9)
        around = np.maximum(self.around[:, 0] / self.sums[:, 0], rule.least_contrast)
        cost = np.sqrt(self.difference() * np.sqrt(along * gradient))
        cost /= rule.contrast * np.minimum(around[low], around[high]) + rule.noise * np.minimum(
            calm[low], calm[high]
        )
        areas = np.minimum(self.sums[low, 0], self.sums[high, 0]) / rule.least_m2
        cost *= np.minimum(areas, 1.0) ** rule.small_power
        perimeter = self.perimeters()
        shorter = np.minimum(perimeter[low], perimeter[high])
        cost *= (shorter / length) ** rule.contact_power
        cost *= np.exp(rule.held_power * self.contact[:, 2] / length)
        if rule.run:
            cost *= np.exp(rule.chance * _chances(self.name[low], self.name[high], rule.run))
        result: Float64 = cost
        return result


def unite_seeds(units: Units, seed_m2: float, rule: CostRule) -> tuple[Units, Int32]:
    """Unite cells to seeds of at most so much area, most alike and smallest first.

    Parameters
    ----------
    units : Units
        The cells.
    seed_m2 : float
        Most area of a seed.
    rule : CostRule

    Returns
    -------
    seeds : Units
    labels : ndarray of shape (U,), int32
        Seed of every cell.
    """
    labels = np.arange(units.count, dtype=np.int32)
    for _ in range(_MOST_ROUNDS):
        low, high = units.pairs.T
        area = units.sums[:, 0]
        length = units.contact[:, 0]
        gradient = rule.width * units.contact[:, 1] / length
        cost = np.sqrt(units.difference() ** 2 + gradient**2)
        smaller = np.minimum(area[low], area[high]) / seed_m2
        cost *= np.maximum(smaller, _SEED_FLOOR) ** 0.25
        cost *= np.exp(rule.held_power * units.contact[:, 2] / length)
        cost[area[low] + area[high] > seed_m2] = np.inf
        node, count = _chosen(units, cost, np.inf, np.ones(units.count))
        if count == units.count:
            break
        units, labels = units.united(node, count), node[labels]
    return units, labels


def unite_level(
    units: Units, rule: CostRule, limit: float, *, small: bool = False
) -> tuple[Units, list[Int32]]:
    """Unite as long as that costs at most ``limit``.

    Parameters
    ----------
    units : Units
    rule : CostRule
    limit : float
        Most cost of a union.
    small : bool
        Whether only unions count of which one side is too small.

    Returns
    -------
    units : Units
        What is left.
    rounds : list of ndarray
        For every round the union of each unit that was there before it.
    """
    rounds = []
    for _ in range(_MOST_ROUNDS):
        cost = units.cost(rule)
        if small:
            cost[~units.too_small(rule)[units.pairs].any(axis=1)] = np.inf
        node, count = _chosen(units, cost, limit, units.sums[:, 0])
        if count == units.count:
            break
        units = units.united(node, count)
        rounds.append(node)
    return units, rounds


def mutual_choices(units: Units, cost: Float64) -> tuple[Int32, int]:
    """Unite the units that choose each other, and no others.

    Parameters
    ----------
    units : Units
    cost : ndarray of shape (E,)
        Of every contact, finite.

    Returns
    -------
    node : ndarray of shape (U,), int32
        Union of every unit: of one or two.
    count : int
    """
    return _chosen(units, cost, np.inf, np.ones(units.count))


def _chosen(units: Units, cost: Float64, limit: float, size: Float64) -> tuple[Int32, int]:
    choice = _choose(units.count, units.pairs, cost, limit, units.name)
    node, count = join_choices(choice, size)
    return node, int(count)


def _sums(labels: Int32 | Int64, values: Float64, count: int) -> Float64:
    """Sum up columns over every label, (count, C); in order, so the same everywhere."""
    sums = np.empty((count, values.shape[1]))
    for column in range(values.shape[1]):
        sums[:, column] = np.bincount(labels, values[:, column], count)
    return sums


@numba.njit(cache=True, inline="always")
def _mixed(a: int, b: int, run: int) -> np.uint64:
    """Mix two names, in either order, and a number into 64 bits (finalisers of splitmix64)."""
    x = np.uint64(min(a, b)) + np.uint64(run) * np.uint64(0x9E3779B97F4A7C15)
    for other in (np.uint64(max(a, b)), np.uint64(0)):
        x ^= x >> np.uint64(30)
        x *= np.uint64(0xBF58476D1CE4E5B9)
        x ^= x >> np.uint64(27)
        x *= np.uint64(0x94D049BB133111EB)
        x ^= x >> np.uint64(31)
        x += other
    return x


@numba.njit(cache=True, nogil=True)
def _chances(first: Int64, second: Int64, run: int) -> Float64:
    """Numbers of mean 0 and deviation 1 by names and run, (E,): four parts of the mix summed."""
    chances = np.empty(len(first), np.float64)
    for row in range(len(first)):
        mixed = _mixed(first[row], second[row], run)
        total = 0.0
        for part in range(4):
            total += float((mixed >> np.uint64(16 * part)) & np.uint64(0xFFFF))
        chances[row] = (total / 65535.0 - 2.0) * np.sqrt(3.0)
    return chances


@numba.njit(cache=True, nogil=True)
def _summed_contacts(
    ends: Int32, contact: Float64, rows: Int64, turned: Bool, last_step: int, count: int
) -> tuple[Int32, Float64]:
    """Sum up contacts of equal ends, in order of the lower end, then the other.

    By counting, twice: half the time of sorting, and the sums are those to the last bit. Nothing
    is as large as the contacts but the result.

    Parameters
    ----------
    ends : ndarray of shape (N, 2), int32
        The lower end first.
    contact : ndarray of shape (E, C)
    rows : ndarray of shape (N,), int64
        Row of each in `contact`.
    turned : ndarray of shape (N,), bool
        Whether its steps, columns 3 to ``last_step - 1``, run from the higher end.
    last_step, count : int
    """
    order = np.arange(len(ends))
    for side in (1, 0):
        start = np.zeros(count + 1, np.int64)
        for unit in ends[:, side]:
            start[unit + 1] += 1
        start = np.cumsum(start)
        sorted_rows = np.empty_like(order)
        for row in order:
            sorted_rows[start[ends[row, side]]] = row
            start[ends[row, side]] += 1
        order = sorted_rows
    found = 0
    for place in range(len(order)):
        one, other = ends[order[place]], ends[order[max(place - 1, 0)]]
        if place == 0 or one[0] != other[0] or one[1] != other[1]:
            found += 1
    pairs = np.empty((found, 2), np.int32)
    sums = np.zeros((found, contact.shape[1]), np.float64)
    last = -1
    for row in order:
        if last < 0 or pairs[last, 0] != ends[row, 0] or pairs[last, 1] != ends[row, 1]:
            last += 1
            pairs[last] = ends[row]
        for column in range(contact.shape[1]):
            value = contact[rows[row], column]
            sums[last, column] += -value if turned[row] and 3 <= column < last_step else value
    return pairs, sums


@numba.njit(cache=True, nogil=True)
def _choose(count: int, pairs: Int32, cost: Float64, limit: float, name: Int64) -> Int32:
    """Choose for every unit the neighbour of least finite cost; of equals the lower mix."""
    choice = np.full(count, -1, np.int32)
    least = np.full(count, np.inf)
    for i in range(len(pairs)):
        if not cost[i] <= limit or cost[i] == np.inf:
            continue
        for side in range(2):
            u, v = pairs[i, side], pairs[i, 1 - side]
            if cost[i] < least[u] or (
                cost[i] == least[u]
                and _mixed(name[u], name[v], 0) < _mixed(name[u], name[choice[u]], 0)
            ):
                least[u] = cost[i]
                choice[u] = v
    return choice
