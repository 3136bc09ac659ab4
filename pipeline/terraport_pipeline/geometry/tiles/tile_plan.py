"""Cut a survey into cubes of one octree lattice, each for a reconstruction of its own.

A Poisson solver works on an octree over a cube. Two solvers whose cubes have the same cell size and
whose corners differ by whole coarse cells refine the same lattice; where both see the same samples,
their surfaces cut the same edges of it. So every tile is a cube of ``2**depth`` cells::

    |<------------------------ cube: 2**depth cells ------------------------->|
    |  unused  |<------------- data: 1/1.1 of the cube ------------>|  unused  |
    |          | margin |<-------------- core -------------->| margin |        |

*cube*
    What the solver works on. It makes its own cube 1.1 times as wide as the samples' box, so
    two oriented points at opposite corners of the data box fix it (:func:`corner_points`).
*data*
    Samples in here are given to the solver.
*core*
    Of the surface, the tile keeps what lies in here. Cores fill space without gap or overlap,
    and their walls are walls of lattice cells: no triangle crosses one.

Everything is counted in whole units of ``2**(depth - 5)`` cells, the coarsest leaf that the solver
makes (it refines everything to depth 5).

PURE: no I/O, no clock.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import AnyFloat, Bool, Float32, Float64, Int64

__all__ = [
    "MARGIN_CELLS",
    "SCALE",
    "Lattice",
    "TilePlan",
    "TileShape",
    "corner_points",
    "count_tiles",
    "plan_tiles",
    "renew_plan",
    "tile_shape",
]


SCALE: Final = 1.1
"""The solver's cube is this much wider than its samples' box (PoissonRecon's default)."""

MARGIN_CELLS: Final = 40
"""Minimum width of the data beyond the core, cells (docs/decisions/tiled-builds.md)."""

_FULL_DEPTH: Final = 5
"""The solver refines everything to this depth, so no leaf is wider than 2**(depth - 5) cells."""

REACH_CELLS: Final = 16
"""A tile exists where samples lie within this many cells of its core: surface is kept up to twelve
spacings from a sample, and a cell is about one spacing."""


@dataclass(frozen=True, slots=True)
class Lattice:
    """The finest cells of the octree that all tiles share."""

    anchor_m: tuple[float, float, float]
    """Corner of cell (0, 0, 0), scene frame."""
    cell_m: float

    def cells(self, points: AnyFloat) -> Float64:
        """Convert metres (N, 3), scene frame, to cells (N, 3) float64."""
        cells: Float64 = (points.astype(np.float64) - np.array(self.anchor_m)) / self.cell_m
        return cells

    def metres(self, cells: AnyFloat) -> Float32:
        """Convert cells (N, 3) to metres (N, 3) float32, scene frame."""
        metres = cells * self.cell_m + np.array(self.anchor_m)
        return np.asarray(metres + 0.0, dtype=np.float32)


@dataclass(frozen=True, slots=True)
class TileShape:
    """How a tile of some depth is divided; widths in cells."""

    depth: int
    core: int
    """Width of the core."""
    pad: int
    """From the cube's wall to the core's, a whole number of units."""
    margin: float
    """Width of the data beyond the core, on every side."""

    @property
    def side(self) -> int:
        """Width of a tile's cube in cells: core and both margins."""
        return 1 << self.depth

    @property
    def unit(self) -> int:
        """Width of the coarsest leaf; cores and cubes begin at multiples of it."""
        return 1 << max(self.depth - _FULL_DEPTH, 0)


@dataclass(frozen=True, slots=True, eq=False)
class TilePlan:
    """Which tiles cover a survey, on one lattice, and how many samples each holds."""

    lattice: Lattice
    shape: TileShape
    offset: tuple[int, int, int]
    """Low corner of the core with index (0, 0, 0), in cells."""
    indices: Int64
    """(T, 3) index of every tile's core along x, y, z, ordered by (y, z, x) in a first plan."""
    points: Int64
    """(T,) samples in the tile's data box."""

    @property
    def count(self) -> int:
        """Number of tiles T; `indices` has a row for each."""
        return len(self.indices)

    def core(self, tile: int) -> tuple[Int64, Int64]:
        """Low and high corner of a core, (3,) cells; a point on the low wall belongs to it."""
        low = np.array(self.offset) + self.indices[tile] * self.shape.core
        return low, low + self.shape.core

    def cube(self, tile: int) -> tuple[Int64, int]:
        """Low corner (3,) and width of the solver's cube, cells."""
        return self.core(tile)[0] - self.shape.pad, self.shape.side

    def data(self, tile: int) -> tuple[Float64, Float64]:
        """Low and high corner of the data box, (3,) cells."""
        low, high = self.core(tile)
        inner: Float64 = low.astype(np.float64) - self.shape.margin
        outer: Float64 = high.astype(np.float64) + self.shape.margin
        return inner, outer

    def members(self, cells: Float64) -> Iterator[tuple[int, Int64]]:
        """Find which samples belong to which tile's data.

        Parameters
        ----------
        cells : ndarray of shape (N, 3), float64
            Positions in cells.

        Yields
        ------
        tile : int
            Ascending.
        rows : ndarray, int64
            Of `cells`, ascending; a sample near a wall belongs to several tiles.
        """
        low = (cells - self.offset - self.shape.margin) / self.shape.core
        high = (cells - self.offset + self.shape.margin) / self.shape.core
        first = np.ceil(low).astype(np.int64) - 1
        last = np.floor(high).astype(np.int64)
        rows_of_tile: dict[int, list[Int64]] = {}
        numbers = self._numbers()
        for index, rows in _between(first, last):
            unique, which = np.unique(_pack(index), return_inverse=True)
            order = np.argsort(which, kind="stable")
            edges = np.searchsorted(which[order], np.arange(len(unique) + 1))
            for group, key in enumerate(map(tuple, _unpack(unique).tolist())):
                tile = numbers.get(key)
                if tile is not None:
                    rows_of_tile.setdefault(tile, []).append(
                        rows[order[edges[group] : edges[group + 1]]]
                    )
        for tile in sorted(rows_of_tile):
            yield tile, np.sort(np.concatenate(rows_of_tile[tile]))

    def touched(self, blocks: Int64, block_cells: int) -> Bool:
        """Mark tiles with one of these blocks (B, 3) in their cores, (T,)."""
        low = blocks * block_cells - np.array(self.offset)
        if not len(low):
            return np.zeros(self.count, dtype=bool)
        cores, _ = _cores_touched(low, low + block_cells, self.shape.core)
        return np.isin(_pack(self.indices), _pack(cores))

    def neighbours(self) -> list[tuple[int, int, int]]:
        """List (tile, tile beyond its high wall, axis) for all tiles that share a wall."""
        numbers = self._numbers()
        pairs = []
        for tile, key in enumerate(map(tuple, self.indices.tolist())):
            for axis in range(3):
                beyond = tuple(k + (a == axis) for a, k in enumerate(key))
                if beyond in numbers:
                    pairs.append((tile, numbers[beyond], axis))
        return pairs

    def _numbers(self) -> dict[tuple[int, ...], int]:
        return {tuple(key): tile for tile, key in enumerate(self.indices.tolist())}


def tile_shape(depth: int, margin_cells: float = MARGIN_CELLS) -> TileShape:
    """Choose the widest core of a cube of ``2**depth`` cells that leaves the margin.

    Raises
    ------
    ValueError
        The cube is too small for a core of two units.

    Examples
    --------
    >>> shape = tile_shape(9)
    >>> shape.core, shape.pad, round(shape.margin, 1)
    (384, 64, 40.7)
    """
    side = 1 << depth
    unit = 1 << max(depth - _FULL_DEPTH, 0)
    for units in range(side // unit - 2, 0, -2):  # even, so that the pad is whole units
        core = units * unit
        margin = (side / SCALE - core) / 2
        if margin >= margin_cells:
            return TileShape(depth, core, (side - core) // 2, margin)
    raise ValueError(f"a cube of {side} cells has no core with a margin of {margin_cells} cells")


def corner_points(plan: TilePlan, tile: int) -> tuple[Float64, Float64]:
    """Two oriented points that fix the solver's cube.

    Returns
    -------
    points : ndarray of shape (2, 3), float64
        Cells: low and high corner of the data box.
    normals : ndarray of shape (2, 3), float64
        Unit, up.
    """
    low, high = plan.data(tile)
    return np.stack([low, high]), np.tile([0.0, 1.0, 0.0], (2, 1))


def plan_tiles(
    lattice: Lattice, shape: TileShape, blocks: Int64, counts: Int64, block_cells: int
) -> TilePlan:
    """Place the tiles so that there are as few as possible.

    Parameters
    ----------
    lattice : Lattice
    shape : TileShape
    blocks : ndarray of shape (B, 3), int64
        Indices of the occupied blocks of `block_cells` cells.
    counts : ndarray of shape (B,), int64
        Samples in each.
    block_cells : int
        Width of a block; the finer, the closer the count of samples.

    Returns
    -------
    TilePlan
        Of all offsets along each axis (tried one axis after the other, in steps of a unit) the
        one with the fewest tiles; ties go to the one whose most loaded tile holds least, then to
        the one that keeps the samples farthest from the outermost walls (the solver is best in the
        middle of its cube), then to the smallest offset.
    """
    offset = np.zeros(3, dtype=np.int64)
    for axis in (1, 2, 0):  # height first: a quarry's floor and rim fit one layer, or need two
        low, high = blocks[:, axis].min() * block_cells, (blocks[:, axis].max() + 1) * block_cells
        best: tuple[int, int, int, int] | None = None
        for step in range(0, shape.core, max(shape.unit, shape.core // 16)):
            tried = offset.copy()
            tried[axis] = step
            tiles, load = count_tiles(shape, tried, blocks, counts, block_cells)
            room = min(int((low - step) % shape.core), int((step - high) % shape.core))
            candidate = (len(tiles), int(load.max()), -room, step)
            best = candidate if best is None else min(best, candidate)
        assert best is not None
        offset[axis] = best[3]
    tiles, load = count_tiles(shape, offset, blocks, counts, block_cells)
    x, y, z = tiles.T
    order = np.lexsort((x, z, y))
    return TilePlan(
        lattice, shape, (int(offset[0]), int(offset[1]), int(offset[2])), tiles[order], load[order]
    )


def renew_plan(
    lattice: Lattice,
    shape: TileShape,
    offset: tuple[int, int, int],
    before: Int64,
    blocks: Int64,
    counts: Int64,
    block_cells: int,
) -> TilePlan:
    """Lay the tiles of an earlier plan over another survey of the same lattice.

    Parameters
    ----------
    lattice, shape, offset
        Of the earlier plan.
    before : ndarray of shape (T, 3), int64
        Its :attr:`TilePlan.indices`.
    blocks, counts, block_cells
        As in :func:`plan_tiles`.

    Returns
    -------
    TilePlan
        Tiles of the earlier plan keep their numbers, also where no sample is left; new ones follow.
    """
    tiles, load = count_tiles(shape, np.array(offset, np.int64), blocks, counts, block_cells)
    keys, earlier = _pack(tiles), _pack(before)
    x, y, z = tiles.T
    order = np.lexsort((x, z, y))
    fresh = order[~np.isin(keys[order], earlier)]
    load_of = dict(zip(keys.tolist(), load.tolist(), strict=True))
    loads = [load_of.get(key, 0) for key in earlier.tolist()]
    return TilePlan(
        lattice, shape, offset, np.concatenate([before, tiles[fresh]]),
        np.concatenate([np.array(loads, np.int64), load[fresh]]),
    )  # fmt: skip


def count_tiles(
    shape: TileShape, offset: Int64, blocks: Int64, counts: Int64, block_cells: int
) -> tuple[Int64, Int64]:
    """Count the samples of every tile by blocks.

    Returns
    -------
    tiles : ndarray of shape (T, 3), int64
        Cores that samples lie in or near (:data:`REACH_CELLS`), in lexicographic order.
    load : ndarray of shape (T,), int64
        Samples in the data box; whole blocks count where they touch it.
    """
    low = blocks * block_cells - offset
    high = low + block_cells
    near, _ = _cores_touched(low - REACH_CELLS, high + REACH_CELLS, shape.core)
    keys = np.unique(_pack(near))
    reached, row = _cores_touched(low - shape.margin, high + shape.margin, shape.core)
    reached_keys = _pack(reached)
    index = np.minimum(np.searchsorted(keys, reached_keys), len(keys) - 1)
    mine = keys[index] == reached_keys
    loads = np.bincount(index[mine], counts[row[mine]], minlength=len(keys))
    return _unpack(keys), loads.astype(np.int64)


_BITS: Final = 21
"""Per axis of an index packed into one integer: rows of three are slow to sort."""


def _pack(indices: Int64) -> Int64:
    """One integer per index (N, 3), in lexicographic order; each within a million of 0."""
    x, y, z = (indices + (1 << (_BITS - 1))).T
    packed: Int64 = (x << (2 * _BITS)) | (y << _BITS) | z
    return packed


def _unpack(keys: Int64) -> Int64:
    mask = (1 << _BITS) - 1
    fields = np.stack([keys >> (2 * _BITS), (keys >> _BITS) & mask, keys & mask], axis=1)
    return fields - (1 << (_BITS - 1))


def _cores_touched(low: AnyFloat | Int64, high: AnyFloat | Int64, core: int) -> tuple[Int64, Int64]:
    """Every core that each box overlaps: (index (K, 3), box (K,))."""
    first = np.floor(low / core).astype(np.int64)
    last = np.ceil(high / core).astype(np.int64) - 1
    batches = list(_between(first, last))
    return np.concatenate([index for index, _ in batches]), np.concatenate([r for _, r in batches])


def _between(first: Int64, last: Int64) -> Iterator[tuple[Int64, Int64]]:
    """Yield all indices from first to last of every row, in pieces: (index (K, 3), row (K,))."""
    if not len(first):
        return
    spans = (last - first).max(axis=0)
    for steps in itertools.product(*(range(int(span) + 1) for span in spans)):
        rows = np.flatnonzero((first + steps <= last).all(axis=1))
        if len(rows):
            yield first[rows] + steps, rows
