"""Bring a survey up to date with a newer one of the same ground: new samples where it changed.

The ground is compared cube by cube (:mod:`~terraport_pipeline.geometry.clouds.ground_change`).
Blocks of the lattice where it changed take the newer survey's samples, all others keep theirs, bit
by bit, and so does what is computed of them. What the newer survey does not cover is gone.

Geometry and colour decide. Attributes do not: they are not named here, and those of a flight (time,
scan angle, source) differ everywhere.

Three passes over both surveys, each over blocks of rows: which cubes are occupied; sums of each;
rows out. Memory: one block of rows, and for every occupied cube 12 bytes of key and block, 128 of
sums and some 50 while they are compared; 16 samples of a survey to a cube, so 1.4 GB for 100 M.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyArray, Bool, Float64, Int32, Int64, UInt8, UInt64
from terraport_pipeline.engines.readers.npy_columns import NpyReader, NpyWriter
from terraport_pipeline.engines.readers.point_order import point_hashes
from terraport_pipeline.geometry.clouds.change_raster import make_raster
from terraport_pipeline.geometry.clouds.ground_cells import (
    GroundSums,
    cell_keys,
    coarser_keys,
    key_indices,
)
from terraport_pipeline.geometry.clouds.ground_change import (
    GroundChange,
    GroundScale,
    block_keys,
    find_changes,
)
from terraport_pipeline.geometry.clouds.height_changes import HeightChanges
from terraport_pipeline.geometry.regions.region_changes import ChangeMap, region_volumes
from terraport_pipeline.geometry.tiles.tile_plan import Lattice
from terraport_pipeline.stages.contract import Context, Facts, Json
from terraport_pipeline.stages.partition import BLOCK_CELLS
from terraport_pipeline.stages.survey_change import load_height_changes, save_height_changes

__all__ = ["NAME", "run"]

NAME: Final = "renew"

_BLOCK_ROWS: Final = 500_000
"""Samples in memory at once: about 150 MB with what is computed of them."""

MAX_CUBES: Final = 6_500_000
"""Cubes compared at most, about 1.5 GB; cubes twice as wide are taken beyond it."""

_CUBE_SPACINGS: Final = 4.8
"""Width of a cube, about: some 23 samples of a survey on level ground. With lattice cells of 1.2
spacings it is a quarter of a block."""

_CUBE_NOISE: Final = 3.0
"""Least width in deviations of the noise, so that a column of three holds what lies within four."""

_COLOUR_SHARE: Final = 0.3
"""Of blocks renewed for their colour alone, from which the light was another."""

_UNCOUNTED_SHARE: Final = 0.05
"""Share of the measured ground above which ground that is in one survey only gives a warning."""

_MIXER: Final = np.uint64(0x9E3779B97F4A7C15)


class _Columns:
    """A survey's columns, read in parts."""

    def __init__(self, folder: Path, attributes: int) -> None:
        self.points = NpyReader(folder / "points.npy")
        path = folder / "colours.npy"
        self.colours = NpyReader(path) if path.exists() else None
        self.attributes = [NpyReader(folder / f"attribute-{i}.npy") for i in range(attributes)]

    def __len__(self) -> int:
        return len(self.points)

    def parts(self) -> Iterator[tuple[slice, Float64]]:
        """Yield rows and the positions in them."""
        for first, points in self.points.blocks(_BLOCK_ROWS):
            yield slice(first, first + len(points)), points

    def colour(self, rows: slice) -> UInt8 | None:
        """Colours of some rows."""
        return None if self.colours is None else self.colours.read(rows.start, rows.stop)

    def values(self, rows: slice, dtypes: list[np.dtype[Any]]) -> list[AnyArray]:
        """Attributes of some rows."""
        pairs = zip(self.attributes, dtypes, strict=True)
        return [column.read(rows.start, rows.stop).astype(dtype) for column, dtype in pairs]


class _Cubes:
    """The cubes that a pair of surveys is compared in, and the blocks that hold them."""

    def __init__(self, lattice: Lattice, origin: Float64, per_block: int) -> None:
        self.lattice, self.origin = lattice, origin
        self.per_block = per_block
        """Cubes along a block: a power of two."""
        self.keys: Int64 = np.zeros(0, np.int64)
        self.block: Int32 = np.zeros(0, np.int32)
        """Number of each cube's block."""
        self.blocks: Int64 = np.zeros(0, np.int64)
        """Keys of the blocks."""

    @property
    def width_m(self) -> float:
        """Of a cube."""
        return self.lattice.cell_m * BLOCK_CELLS / self.per_block

    def positions(self, points: Float64) -> Float64:
        """CRS frame to widths of a cube; walls of blocks lie where the partition has them."""
        local = points - self.origin
        scene = np.stack([local[:, 0], local[:, 2], -local[:, 1]], axis=1)
        return self.lattice.cells(scene) * (self.per_block / BLOCK_CELLS)

    def take(self, keys: Int64) -> None:
        """Compare in these cubes, or wider ones where they are too many."""
        while len(keys) > MAX_CUBES and self.per_block > 1:
            keys, self.per_block = coarser_keys(keys), self.per_block // 2
        self.keys = keys
        owners = block_keys(keys, self.per_block)
        self.blocks = np.unique(owners)
        self.block = np.searchsorted(self.blocks, owners).astype(np.int32)


def run(
    before: Path,
    after: Path,
    attributes: int,
    lattice: Lattice,
    origin: Float64,
    spacing_m: float,
    noise_m: float,
    context: Context,
) -> tuple[Mapping[str, Json], Facts]:
    """Write the columns of the survey as it is now.

    Parameters
    ----------
    before, after : pathlib.Path
        Folders with the columns of the read stage; all or none with colours.
    attributes : int
        Columns ``attribute-<i>.npy`` in each, of the same attributes.
    lattice : Lattice
    origin : ndarray of shape (3,), float64
        Of the scene, CRS frame.
    spacing_m : float
        Root of the area that a sample of `before` stands for, along the surface.
    noise_m : float
        Standard deviation of its samples across the surface.
    context : Context
        Its `folder` gets the columns: rows of `before` in blocks that are as they were, in their
        order, then rows of `after` in blocks that changed. Further ``change-dz.npy``,
        ``change-lod.npy`` (metres) and ``change-moved.npy``: the raster (nx, nz) of
        :class:`~terraport_pipeline.geometry.clouds.change_raster.ChangeRaster`;
        ``change-blocks.npy``: indices (C, 3) of blocks that changed, int64; and the last change of
        all ground, that of earlier surveys among it, for :func:`.load_height_changes`.

    Returns
    -------
    values, facts
        ``blocks``, ``changed_blocks``, ``kept_rows``, ``new_rows``, ``gains`` (of the colours, new
        over old), ``density_ratio`` (samples, new over old, of blocks with both) and
        ``raster``: ``low_m`` (x and z of its corner, scene frame), ``cell_m``, ``shape`` and
        ``registration_m``, by which all of its heights may be off together.

    Raises
    ------
    ValueError
        One survey has colours and the other none.
    """
    old, new = _Columns(before, attributes), _Columns(after, attributes)
    if (old.colours is None) != (new.colours is None):
        raise ValueError(f"{before} and {after}: colours in one of them, expected in both or none")
    pairs = zip(old.attributes, new.attributes, strict=True)
    dtypes = [np.result_type(a.dtype, b.dtype) for a, b in pairs]
    widened = sum(a.dtype != dtype for a, dtype in zip(old.attributes, dtypes, strict=True))
    scale_m = max(_CUBE_SPACINGS * spacing_m, _CUBE_NOISE * noise_m)
    halvings = np.clip(np.rint(np.log2(BLOCK_CELLS * lattice.cell_m / scale_m)), 0, 4)
    columns = 1 << int(halvings)
    cubes = _Cubes(lattice, origin, columns)
    # (1) Which cubes are occupied, then the sums of each.
    cubes.take(_occupied((old, new), cubes, context))
    sums, same = _add_up(old, new, cubes, dtypes, context)
    # (2) What changed. A block with the same rows stays, though its neighbour changed.
    scale = GroundScale(cubes.width_m, spacing_m, noise_m)
    change = find_changes(
        cubes.keys, cubes.block, *sums, scale,
        has_colour=old.colours is not None, threads=context.threads,
    )  # fmt: skip
    raster = make_raster(cubes.keys, *sums, change.moved, scale)
    del sums
    changed = _blocks_with(change.renewed, cubes) & ~same
    # (3) Rows out.
    kept_rows, new_rows = _write(old, new, cubes, changed, dtypes, context)
    np.save(context.folder / "change-dz.npy", raster.dz_m)
    np.save(context.folder / "change-lod.npy", raster.lod_m)
    np.save(context.folder / "change-moved.npy", raster.moved)
    blocks = key_indices(cubes.blocks[changed])
    np.save(context.folder / "change-blocks.npy", blocks)
    earlier = load_height_changes(before)
    if earlier is None or earlier.per_block != columns:
        earlier = HeightChanges.none(columns)
    heights = earlier.renewed(raster, columns // cubes.per_block, blocks)
    save_height_changes(context.folder, heights)
    anchor_m = np.array(lattice.anchor_m)[[0, 2]]
    low_m = anchor_m + np.array(raster.low) * scale.width_m
    seen = ChangeMap(
        (float(low_m[0]), float(low_m[1])), raster.cell_m, raster.dz_m, raster.lod_m, raster.moved,
        scale.registration_m,
    )  # fmt: skip
    values = {
        "blocks": len(changed),
        "changed_blocks": int(changed.sum()),
        "kept_rows": kept_rows,
        "new_rows": new_rows,
        "gains": change.gains.tolist(),
        "density_ratio": change.density_ratio,
        "raster": {
            "low_m": low_m.tolist(),
            "cell_m": raster.cell_m,
            "shape": list(raster.dz_m.shape),
            "registration_m": scale.registration_m,
        },
    }
    colour_alone = changed & ~_blocks_with(change.shifted, cubes)
    return values, _facts(values, change, seen, raster.only, int(colour_alone.sum()), widened)


def _occupied(surveys: tuple[_Columns, _Columns], cubes: _Cubes, context: Context) -> Int64:
    """Keys of the cubes that hold samples of either survey, sorted."""
    context.progress.start("renew: ground", float(sum(map(len, surveys))), "points")
    parts = [np.zeros(0, np.int64)]
    for survey in surveys:
        for _, points in survey.parts():
            keys = cell_keys(cubes.positions(points))
            # Rows follow a curve: those of one cube mostly follow each other.
            parts.append(np.unique(keys[np.flatnonzero(np.diff(keys, prepend=-1))]))
            context.progress.advance(len(points))
    keys = np.unique(np.concatenate(parts))
    context.progress.done({"cubes": len(keys)})
    return keys


def _add_up(
    old: _Columns, new: _Columns, cubes: _Cubes, dtypes: list[np.dtype[Any]], context: Context
) -> tuple[tuple[GroundSums, GroundSums], Bool]:
    """Add up both surveys in every cube; find blocks whose rows are the same in both."""
    context.progress.start("renew: compare", float(len(old) + len(new)), "points")
    sums: list[GroundSums] = []
    rows_of_block, hash_of_block = [], []
    for survey in (old, new):
        ground = GroundSums.empty(len(cubes.keys))
        rows = np.zeros(len(cubes.blocks), np.int64)
        hashes = np.zeros(len(cubes.blocks), np.uint64)
        for part, points in survey.parts():
            positions = cubes.positions(points)
            cube = np.searchsorted(cubes.keys, cell_keys(positions))
            colours = survey.colour(part)
            ground.add(positions, cube, colours)
            block = cubes.block[cube]
            rows += np.bincount(block, minlength=len(rows))
            # Added up, so that the order of the rows does not count.
            np.add.at(hashes, block, _row_hashes(points, colours, survey.values(part, dtypes)))
            context.progress.advance(len(points))
        sums.append(ground)
        rows_of_block.append(rows)
        hash_of_block.append(hashes)
    same = (rows_of_block[0] == rows_of_block[1]) & (hash_of_block[0] == hash_of_block[1])
    context.progress.done({"blocks": len(same), "same": int(same.sum())})
    return (sums[0], sums[1]), same


def _row_hashes(points: Float64, colours: UInt8 | None, values: list[AnyArray]) -> UInt64:
    """Hash whole rows, (N,)."""
    hashes = point_hashes(points)
    columns = list(values) if colours is None else [*colours.T, *values]
    for column in columns:
        hashes ^= column.view(f"u{column.dtype.itemsize}").astype(np.uint64)
        hashes *= _MIXER
        hashes ^= hashes >> np.uint64(29)
    return hashes


def _blocks_with(marked: Bool, cubes: _Cubes) -> Bool:
    """Blocks with a marked cube."""
    blocks = np.zeros(len(cubes.blocks), dtype=bool)
    blocks[cubes.block[marked]] = True
    return blocks


def _write(
    old: _Columns,
    new: _Columns,
    cubes: _Cubes,
    changed: Bool,
    dtypes: list[np.dtype[Any]],
    context: Context,
) -> tuple[int, int]:
    """Write the rows of both surveys that stay; return how many of each."""
    context.progress.start("renew: samples", float(len(old) + len(new)), "points")
    folder = context.folder
    points = NpyWriter(folder / "points.npy", np.float64, (3,))
    colours = NpyWriter(folder / "colours.npy", np.uint8, (3,)) if old.colours else None
    columns = [NpyWriter(folder / f"attribute-{i}.npy", dtype) for i, dtype in enumerate(dtypes)]
    counts = []
    for survey, taken in ((old, ~changed), (new, changed)):
        first = points.rows
        for part, positions in survey.parts():
            cube = np.searchsorted(cubes.keys, cell_keys(cubes.positions(positions)))
            rows = np.flatnonzero(taken[cubes.block[cube]])
            context.progress.advance(len(positions))
            if not len(rows):
                continue
            points.append(positions[rows])
            colour = survey.colour(part)
            if colours is not None and colour is not None:
                colours.append(colour[rows])
            for writer, values in zip(columns, survey.values(part, dtypes), strict=True):
                writer.append(values[rows])
        counts.append(points.rows - first)
    for writer in (points, *([colours] if colours else []), *columns):
        writer.close()
    context.progress.done({"points": points.rows, "new": counts[1]})
    return counts[0], counts[1]


def _facts(
    values: Mapping[str, Json],
    change: GroundChange,
    seen: ChangeMap,
    only: tuple[int, int],
    colour_alone: int,
    widened: int,
) -> Facts:
    whole = region_volumes(seen, [])[2]
    gone_m2, added_m2 = (cells * seen.cell_m**2 for cells in only)
    counts = {
        "blocks": values["blocks"],
        "changed_blocks": values["changed_blocks"],
        "changed_share": values["changed_blocks"] / max(values["blocks"], 1),
        "colour_alone_blocks": colour_alone,
        "kept_points": values["kept_rows"],
        "new_points": values["new_rows"],
        "gains": [round(gain, 4) for gain in values["gains"]],
        "density_ratio": change.density_ratio,
        "shift_m": change.shift_m,
        "survey_distance_m": seen.shared_m,
        "moved_m2": whole.area_m2,
        "gone_m2": gone_m2,
        "added_m2": added_m2,
        "cut_m3": whole.cut_m3,
        "fill_m3": whole.fill_m3,
        "volume_uncertainty_m3": whole.uncertainty_m3,
    }
    warnings = []
    if gone_m2 + added_m2 > _UNCOUNTED_SHARE * whole.area_m2:
        warnings.append(
            f"{gone_m2 + added_m2:,.0f} m2 of changed ground are in only one of the surveys: cut "
            f"and fill cover only the {whole.area_m2:,.0f} m2 that are in both."
        )
    if abs(change.shift_m) > seen.registration_m:
        warnings.append(
            f"The new survey lies {abs(change.shift_m):.2g} m beside the one before throughout, "
            f"more than the {seen.registration_m:.2g} m that samples tell: check how both are "
            "tied to their control points."
        )
    choices = []
    if colour_alone > _COLOUR_SHARE * values["blocks"]:
        choices.append(
            f"{colour_alone:,} of {values['blocks']:,} blocks are renewed for their colour alone: "
            "the new survey was taken in another light."
        )
    if widened:
        choices.append(
            f"{widened} attributes hold values that their columns before have no room for: all "
            "tiles are built anew."
        )
    return Facts(counts, tuple(warnings), choices=tuple(choices))
