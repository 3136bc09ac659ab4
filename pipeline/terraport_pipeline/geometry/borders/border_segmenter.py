"""Regions whose borders follow what is seen on the ground: the engine of ``borders``.

1. Faces are summed up to cells, a twentieth of the region size wide (``cells.py``).
2. Every cell gets features of its near and wide surroundings and the contrast around it, every two
   neighbouring cells the step between them (``evidence.py``).
3. Cells are united to *seeds*, a fifth of the region size wide at most.
4. Seeds are united at rising cost, by the strength of their common border and the difference of
   their means (``unions.py``), several times with costs a little off. What these runs agree on is
   one tree (``consensus.py``); regions are what lasts longest in it (``lasting.py``). Small ones
   join a neighbour. Above that the unions go on, so that any granularity is read off the tree.

Every size is in metres and every threshold comes from the two units that it parts and from what
lies within some region sizes around, so the same ground is cut alike whatever else was flown. Where
there is a version before, its borders count as evidence (``unions.py``): what noise could tip stays
as it was.

With one tile or many the cells are the same, and so is all that follows: the result does not depend
on tiles, threads or the numbering of vertices.

PURE: no I/O, no clock. About 200 bytes per face while cells are summed up, then 750 per cell.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numba
import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Bool, Float64, Int32, Int64
from terraport_pipeline.geometry.borders.cells import (
    LAB_STEPS,
    LENGTH_STEPS,
    CellGraph,
    cells_of_faces,
)
from terraport_pipeline.geometry.borders.consensus import (
    COMMON_LEVELS,
    COST_OF_A_BORDER,
    AgreedTree,
    agreed_levels,
    agreed_tree,
)
from terraport_pipeline.geometry.borders.evidence import (
    Weights,
    cell_features,
    contrast,
    gradients,
)
from terraport_pipeline.geometry.borders.lasting import lasting_regions
from terraport_pipeline.geometry.borders.unions import CostRule, Units, unite_level, unite_seeds
from terraport_pipeline.geometry.graph.merge_tree import MergeTree, merge_tree
from terraport_pipeline.geometry.regions.colour import face_lab
from terraport_pipeline.geometry.regions.engine_options import BORDERS_SIZE_M
from terraport_pipeline.geometry.regions.mean_scale import ColourTotals, axis_index
from terraport_pipeline.geometry.regions.pool_refine import number_by_first
from terraport_pipeline.geometry.regions.segmenter import Segmentation, SegmenterMesh

__all__ = [
    "BorderCut",
    "BorderSegmenter",
    "Evidence",
    "RegionsBefore",
    "coarser_unions",
    "compared_steps",
]

_CELLS: Final = 20
"""Cells across the region size."""
_SEEDS: Final = 5
"""Seeds across the region size."""
_AROUND: Final = 4.0
"""Region sizes around a cell within which contrast is what it stands out against."""
_BARE_SLOPE: Final = 40.0
"""Units for a normal turned by a radian where there is no colour to look at."""
_LEAST_SHARE: Final = 0.35
"""Least area of a region, as a share of the region size squared."""
_LEAST_WIDTH: Final = 0.3
"""Least width of a region, as a share of the region size."""
_COARSER: Final = (1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, np.inf)
"""Costs of the unions above regions."""
_SQUARE_MM: Final = 1e6
_REACH_CELLS: Final = 2.0
"""A sample of the version before speaks for cells no farther than this."""
_SCALAR_RANGE: Final = 100.0
"""A scalar is scaled to 0 to this, as lightness runs."""


_WEIGHTS: Final = Weights()


@dataclass(frozen=True, slots=True, eq=False)
class RegionsBefore:
    """Samples of the surface of the version before, in the same frame."""

    points: Float64
    """(N, 3) metres."""
    regions: Int32
    """(N,) region of each."""


@dataclass(frozen=True, slots=True, eq=False)
class BorderCut:
    """Seeds and regions of cells, and the tree that both are read from."""

    seeds: Int32
    """(U,) seed of every cell, numbered by first cell."""
    regions: Int32
    """(U,) region of every cell, numbered by first cell."""
    tree: MergeTree
    """Over the seeds; a union's cost is 1 where regions are united no more."""
    before_joining: int
    """Number of regions before small ones joined."""
    unions: Int32
    """(M, 2) what unites regions to coarser pieces, as :func:`coarser_unions`."""
    union_costs: Float64
    """(M,)"""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What is seen at cells and between them."""

    near: Float64
    """(U, 7) features of what is near, weighed; see ``evidence.FEATURES``."""
    wide: Float64
    """(U, 7) the same of what is around."""
    steepness: Float64
    """(E,) of every pair."""
    around: Float64
    """(U,) contrast around every cell."""

    def units(self, cells: CellGraph, held: Float64) -> Units:
        """Make of cells what ``unions.py`` unites; `held` (E,) says what stood before."""
        features = np.column_stack([self.near[:, :3], self.wide[:, 3], self.near[:, 4:]])
        area = cells.sums[:, :1] / _SQUARE_MM
        length = cells.border / LENGTH_STEPS
        low, high = cells.pairs.T
        # Column by column: contacts of a large survey take more memory than all else.
        contact = np.empty((len(length), 3 + features.shape[1]))
        contact[:, 0] = length
        contact[:, 1] = length * self.steepness
        contact[:, 2] = length * held
        for column, values in enumerate(features.T, 3):
            contact[:, column] = length * (values[low] - values[high])
        return Units(
            np.column_stack([area, area * features]),
            np.column_stack([area[:, 0] * self.around, cells.sums[:, 5:8] / _SQUARE_MM]),
            np.zeros((cells.count, 2)),
            cells.pairs,
            contact,
            cells.keys,
        )


@dataclass(frozen=True, slots=True)
class BorderSegmenter:
    """Regions by their borders; sizes in metres."""

    region_size_m: float = BORDERS_SIZE_M
    """Width of the ground that regions are looked for on: evidence is taken over a fraction of it,
    and less than a third of its square joins a neighbour. Lower tells more apart. > 0."""
    strength: float = 1.0
    """Cost, in units of the automatic one, up to which regions unite. Lower tells more apart."""
    weights: Weights = _WEIGHTS
    count: int | None = None
    """So many regions, if the surface hangs together; None: as many as there seem to be."""

    def __post_init__(self) -> None:
        """Refuse values outside their range before any work."""
        for name in ("region_size_m", "strength"):
            value = getattr(self, name)
            if not 0.0 < value < np.inf:
                msg = f"{name} is {value}, expected a number above 0"
                raise ValueError(msg)

    @property
    def name(self) -> str:
        """Name of the engine in options and manifests: ``"borders"``."""
        return "borders"

    @property
    def cell_m(self) -> float:
        """Side of a cell, metres."""
        return self.region_size_m / _CELLS

    @property
    def rule(self) -> CostRule:
        """What decides whether two units are one region."""
        return CostRule(
            least_m2=_LEAST_SHARE * self.region_size_m**2,
            least_width_m=_LEAST_WIDTH * self.region_size_m,
        )

    def segment(self, mesh: SegmenterMesh) -> Segmentation:
        """Cut the mesh into regions and fine pools; see :class:`~.segmenter.Segmenter`.

        Where the mesh has a scalar, it is compared instead of colours; where it has neither, slope
        alone is.
        """
        if len(mesh.faces) == 0:
            none = np.zeros(0, np.int32)
            return Segmentation(none, 0, none, np.zeros(0, np.float32))
        steps = compared_steps(mesh)
        cells = cells_of_faces(mesh.vertices, mesh.faces, steps, mesh.edge_pairs(), self.cell_m)
        cut = self.cut(cells)
        regions, count = number_by_first(cut.regions[cells.labels])
        weight = np.array([self.weights.lightness, 1.0, 1.0]) / LAB_STEPS
        return Segmentation(
            regions=regions,
            region_count=count,
            fine=number_by_first(cut.seeds[cells.labels])[0],
            similarity=axis_index(steps, ColourTotals.of(steps), weight),
            facts={
                "region_size_m": self.region_size_m,
                "region_cells": cells.count,
                "region_seeds": cut.tree.leaf_count,
                "region_pools": cut.before_joining,
            },
        )

    def cut(self, cells: CellGraph, before: RegionsBefore | None = None) -> BorderCut:
        """Unite cells to seeds and regions.

        Parameters
        ----------
        cells : CellGraph
            Of the whole surface, at least one.
        before : RegionsBefore, optional

        Returns
        -------
        BorderCut
        """
        rule = replace(self.rule, contrast=self.rule.contrast * self.strength)
        rule = replace(rule, noise=rule.noise * self.strength)
        # (1) Seeds by the evidence. Nothing else holds the cells' units: of a large survey they
        # take gigabytes.
        most_m2 = (self.region_size_m / _SEEDS) ** 2
        seeds, seed_of = unite_seeds(self._units(cells, before), most_m2, rule)
        # (2) Unions that cost so little that nothing tips them.
        area = np.rint(seeds.sums[:, 0] * _SQUARE_MM).astype(np.int64)
        record = _TreeRecord(seeds.count)
        left = seeds
        for level in COMMON_LEVELS:
            left, rounds = unite_level(left, rule, COST_OF_A_BORDER * level)
            record.add(rounds, level)
        # (3) What several runs of rising cost agree on, and what lasts longest of it.
        agreed = agreed_tree(left, agreed_levels(left, rule), rule)
        node, count = record.add_regions(agreed, lasting_regions(agreed))
        left = left.united(node, count)
        pools = left.count
        # (4) Small ones join the neighbour of least cost; what touches nothing, the nearest.
        left, rounds = unite_level(left, rule, np.inf, small=True)
        record.add(rounds, 1.0)
        islands = left.outlines() < rule.least_m2
        for coarser in _COARSER:
            left, rounds = unite_level(left, rule, COST_OF_A_BORDER * coarser)
            record.add(rounds, coarser)
        tree = merge_tree(seeds.count, record.children(), record.costs(), area)
        if self.count is not None:
            of_seed, _ = tree.cut_by_count(self.count)
            return _cut(seed_of, of_seed, tree, pools)
        of_seed, _ = tree.cut_by_cost(1.0)
        if islands.any() and not islands.all():
            node, count = number_by_first(of_seed)
            small = seeds.united(node, count).outlines() < rule.least_m2
            of_seed = node
            regions = _join_nearest(cells.middles(self.cell_m), of_seed[seed_of], small)
            of_seed[seed_of] = regions
        return _cut(seed_of, of_seed, tree, pools)

    def _units(self, cells: CellGraph, before: RegionsBefore | None) -> Units:
        evidence = self.evidence(cells, cells.middles(self.cell_m))
        low, high = cells.pairs.T
        held = np.zeros(len(cells.pairs))
        if before is not None and len(before.points):
            distance, nearest = cKDTree(before.points).query(cells.middles(self.cell_m))
            region = before.regions[nearest]
            known = distance <= _REACH_CELLS * self.cell_m
            held = np.where(region[low] == region[high], -1.0, 1.0) * (known[low] & known[high])
        return evidence.units(cells, held)

    def evidence(self, cells: CellGraph, middles: Float64) -> Evidence:
        """Measure cells that are `cell_m` wide and lie at `middles`, (U, 3) metres, Y up."""
        weights = self.weights
        if not cells.sums[:, 1:4].any():
            weights = replace(weights, slope=_BARE_SLOPE)
        near, wide = cell_features(cells, weights, self.cell_m)
        seen = np.delete(near, 3, axis=1)  # texture is no colour
        around = contrast(
            seen, cells.sums[:, 0] / _SQUARE_MM, middles, cells.keys, _AROUND * self.region_size_m
        )
        return Evidence(near, wide, gradients(cells, near, wide), around)


class _TreeRecord:
    """Rounds of unions, written down as the merges of two that a tree consists of."""

    def __init__(self, leaves: int) -> None:
        self._node = np.arange(leaves, dtype=np.int32)
        self._next = leaves
        self._children: list[Int32] = [np.zeros((0, 2), np.int32)]
        self._costs: list[Float64] = [np.zeros(0)]

    def add(self, rounds: list[Int32], cost: float) -> None:
        """Add rounds, all at one cost."""
        for united in rounds:
            # Members of a union stand together, lowest first; every one but the first is a merge
            # of what the union is so far with it.
            order = np.argsort(united, kind="stable")
            is_first = np.append(True, united[order][1:] != united[order][:-1])
            merged = np.flatnonzero(~is_first)
            numbers = self._next + np.arange(len(merged), dtype=np.int32)
            so_far = self._node[order]
            previous = np.where(is_first[merged - 1], so_far[merged - 1], numbers - 1)
            self._children.append(np.stack([previous, so_far[merged]], axis=1).astype(np.int32))
            self._costs.append(np.full(len(merged), cost))
            top = so_far.copy()
            top[merged] = numbers
            last = np.append(is_first[1:], True)
            node = np.empty(int(united.max()) + 1, np.int32)
            node[united[order][last]] = top[last]
            self._node, self._next = node, self._next + len(merged)

    def add_regions(self, agreed: AgreedTree, regions: Int32) -> tuple[Int32, int]:
        """Add the unions within regions of a tree over what is there; say which one is in which.

        Returns
        -------
        node : ndarray of shape (U,), int32
            Region of every leaf of `agreed`, numbered by first leaf.
        count : int
        """
        leaves = len(self._node)
        top = np.full(len(agreed.area_m2), -1, np.int32)
        top[regions] = regions
        for merge in range(len(agreed.children) - 1, -1, -1):
            if top[leaves + merge] >= 0:
                top[agreed.children[merge]] = top[leaves + merge]
        kept = np.flatnonzero(top[leaves:] >= 0)
        name = np.empty(len(top), np.int32)
        name[:leaves] = self._node
        name[leaves + kept] = self._next + np.arange(len(kept), dtype=np.int32)
        self._children.append(name[agreed.children[kept]])
        # All of them are kept by a cut at the cost 1, whatever level they are of.
        self._costs.append(np.minimum(agreed.level[kept], 1.0))
        self._next += len(kept)
        node, count = number_by_first(top[:leaves])
        self._node = np.empty(count, np.int32)
        self._node[node] = name[top[:leaves]]
        return node, count

    def children(self) -> Int32:
        """Nodes united by every merge, (M, 2)."""
        return np.concatenate(self._children)

    def costs(self) -> Float64:
        """Cost of every merge, (M,)."""
        return np.concatenate(self._costs)


def _cut(seed_of: Int32, of_seed: Int32, tree: MergeTree, pools: int) -> BorderCut:
    """Make the result: regions numbered by first cell, and what unites them further."""
    regions, count = number_by_first(of_seed[seed_of])
    of_seed = of_seed.copy()
    of_seed[seed_of] = regions
    unions, costs = coarser_unions(tree, of_seed, count)
    return BorderCut(seed_of, regions, tree, pools, unions, costs)


def coarser_unions(tree: MergeTree, region: Int32, count: int) -> tuple[Int32, Float64]:
    """Read off a tree what unites regions to coarser pieces.

    Parameters
    ----------
    tree : MergeTree
    region : ndarray of shape (leaves,), int32
        Region of every leaf, 0 to ``count - 1``.
    count : int

    Returns
    -------
    unions : ndarray of shape (M, 2), int32
        Pieces united, cheapest first and lower number first: regions, or ``count + m`` of the union
        at place m. Unions at any cost whatever are left out, so several pieces may be left.
    costs : ndarray of shape (M,), float64
        Never falling.
    """
    # Children come before parents in the order of heights, too: equal heights keep theirs.
    order = np.argsort(tree.height, kind="stable")
    unions, merges = _coarser(tree.leaf_count, tree.children, tree.height, order, region, count)
    return unions, tree.height[merges]


@numba.njit(cache=True)
def _coarser(
    leaves: int, children: Int32, height: Float64, order: Int64, region: Int32, count: int
) -> tuple[Int32, Int64]:
    piece = np.empty(leaves + len(children), np.int32)
    piece[:leaves] = region
    top = np.arange(2 * count).astype(np.int32)
    unions = np.empty((count, 2), np.int32)
    merges = np.empty(count, np.int64)
    found = 0
    for merge in order:
        ends = np.empty(2, np.int32)
        for side in range(2):
            end = piece[children[merge, side]]
            while top[end] != end:
                top[end] = top[top[end]]
                end = top[end]
            ends[side] = end
        node = ends[0]
        if ends[0] != ends[1] and np.isfinite(height[merge]):
            node = count + found
            top[ends[0]] = node
            top[ends[1]] = node
            unions[found, 0], unions[found, 1] = ends.min(), ends.max()
            merges[found] = merge
            found += 1
        piece[leaves + merge] = node
    return unions[:found], merges[:found]


def compared_steps(mesh: SegmenterMesh) -> Int32:
    """Give what is compared as CIELAB in steps, (F, 3): a scalar counts as lightness."""
    if mesh.scalar is not None:
        value = mesh.scalar.astype(np.float64)
        if not np.isfinite(value).all():
            bad = int(np.flatnonzero(~np.isfinite(value))[0])
            msg = f"scalar of face {bad} is {value[bad]}, expected a finite number"
            raise ValueError(msg)
        value -= value.min(initial=0.0 if not len(value) else np.inf)
        value *= _SCALAR_RANGE / value.max() if value.max(initial=0.0) > 0.0 else 0.0
        steps = np.zeros((len(value), 3), np.int32)
        steps[:, 0] = np.rint(value * LAB_STEPS)
        return steps
    if mesh.colours is None:
        return np.zeros((len(mesh.faces), 3), np.int32)
    return face_lab(mesh.colours, mesh.faces, LAB_STEPS).astype(np.int32)


def _join_nearest(middles: Float64, regions: Int32, small: Bool) -> Int32:
    """Give every small region the region of the cell nearest to any of its own (tie: lower)."""
    lost = np.flatnonzero(small[regions])
    kept = np.flatnonzero(~small[regions])
    distance, nearest = cKDTree(middles[kept]).query(middles[lost])
    order = np.lexsort((nearest, distance, regions[lost]))
    owner = regions[lost][order]
    first = order[np.append(True, owner[1:] != owner[:-1])]
    mapping = np.arange(len(small), dtype=np.int32)
    mapping[regions[lost[first]]] = regions[kept[nearest[first]]]
    joined: Int32 = mapping[regions]
    return joined
