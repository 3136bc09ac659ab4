"""Hand a survey's samples out to tiles, a block at a time.

First pass: samples per block of the lattice, for the plan. Second pass: every sample goes to the
file of each tile whose data box it lies in, in file order; and what lies above the box is told as
one height for each column. Memory: one block of the survey, one number per occupied block, and one
per column of the survey's ground (:mod:`terraport_pipeline.geometry.tiles.sky_raster`).

Over a scene that is there, a tile in whose core nothing changed keeps the samples that it had, also
those of its margins: a margin only steadies the surface within, and a change in it would make the
neighbours of every changed tile anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import xxhash

from terraport_payload.types import AnyArray, Float64, Int64
from terraport_pipeline.engines.readers.npy_columns import NpyReader, NpyWriter, link_or_copy
from terraport_pipeline.geometry.tiles.sky_raster import SkyRaster
from terraport_pipeline.geometry.tiles.tile_plan import Lattice, TilePlan
from terraport_pipeline.stages.contract import Context, Facts, Json
from terraport_pipeline.stages.tiles.solve_tile import sample_type

__all__ = ["BLOCK_CELLS", "NAME", "Earlier", "above_name", "count_blocks", "run", "samples_name"]

NAME: Final = "partition"


_BLOCK_ROWS: Final = 500_000
"""Samples in memory at once: about 100 MB with what is computed of them."""

BLOCK_CELLS: Final = 16
"""Width of the blocks that the plan counts in: small beside any core but the least."""

_KEY_SPAN: Final = 1 << 20
"""Blocks along an axis, at most, and half of them may lie below the anchor."""


def samples_name(tile: int) -> str:
    """Stem of the file that holds a tile's samples."""
    return f"samples-{tile:05d}"


def above_name(tile: int) -> str:
    """Stem of the file that holds what lies above a tile's box, :meth:`.SkyRaster.above`."""
    return f"above-{tile:05d}"


def count_blocks(
    folder: Path, lattice: Lattice, origin: Float64, block_cells: int, context: Context
) -> tuple[Int64, Int64]:
    """Count samples per block.

    Parameters
    ----------
    folder : pathlib.Path
        Of the read stage.
    lattice : Lattice
    origin : ndarray of shape (3,), float64
        Of the scene, CRS frame.
    block_cells : int
        Width of a block.

    Returns
    -------
    blocks : ndarray of shape (B, 3), int64
        Indices of occupied blocks; stray samples more than half a million blocks away are left
        out.
    counts : ndarray of shape (B,), int64
    """
    reader = NpyReader(folder / "points.npy")
    context.progress.start("tiles: plan", float(len(reader)), "points")
    keys, counts = np.zeros(0, np.int64), np.zeros(0, np.int64)
    for _, points in reader.blocks(_BLOCK_ROWS):
        block = np.floor(_cells(points, lattice, origin) / block_cells) + _KEY_SPAN // 2
        block = block[((block >= 0) & (block < _KEY_SPAN)).all(axis=1)].astype(np.int64)
        key = (block[:, 0] * _KEY_SPAN + block[:, 1]) * _KEY_SPAN + block[:, 2]
        fresh, fresh_counts = np.unique(key, return_counts=True)
        keys, which = np.unique(np.concatenate([keys, fresh]), return_inverse=True)
        counts = np.bincount(which, np.concatenate([counts, fresh_counts])).astype(np.int64)
        context.progress.advance(len(points))
    context.progress.done({"blocks": len(keys)})
    split = np.stack(
        [keys // _KEY_SPAN**2, keys // _KEY_SPAN % _KEY_SPAN, keys % _KEY_SPAN], axis=1
    )
    return split - _KEY_SPAN // 2, counts


@dataclass(frozen=True, slots=True)
class Earlier:
    """What was handed out for the version of the scene before, and where the ground has changed."""

    folder: Path
    values: Mapping[str, Json]
    """As :func:`run` returned them."""
    changed: Int64
    """(C, 3) indices of the blocks that changed since."""


def run(
    source: Path,
    attributes: int,
    plan: TilePlan,
    origin: Float64,
    context: Context,
    earlier: Earlier | None = None,
) -> tuple[Mapping[str, Json], Facts]:
    """Write every tile's samples.

    Parameters
    ----------
    source : pathlib.Path
        Of the read stage.
    attributes : int
        Columns ``attribute-<i>.npy`` there.
    plan : TilePlan
    origin : ndarray of shape (3,), float64
    context : Context
        Its `folder` gets one ``samples-<tile>.npy`` and one ``above-<tile>.npy`` per tile.
    earlier : Earlier, optional
        Tiles in whose core nothing changed get what they had.

    Returns
    -------
    values, facts
        ``samples``: per tile, how many; ``digests``: per tile, the hash of both; ``laid``
        and ``tiles``: how the tiles lie, and the index of each.
    """
    # (1) Columns in, one file of rows per tile out; one buffered block each.
    points = NpyReader(source / "points.npy")
    has_colour = (source / "colours.npy").exists()
    colours = NpyReader(source / "colours.npy") if has_colour else None
    columns = [NpyReader(source / f"attribute-{i}.npy") for i in range(attributes)]
    dtype = sample_type([("", column.dtype.str) for column in columns], has_colour=has_colour)
    laid = repr((plan.shape, plan.lattice, plan.offset, dtype.descr, "above"))
    kept = _kept(plan, laid, earlier)
    digests = [xxhash.xxh3_128(repr(dtype.descr).encode()) for _ in range(plan.count)]
    writers = {
        tile: NpyWriter(context.folder / f"{samples_name(tile)}.npy", dtype)
        for tile in range(plan.count)
        if tile not in kept
    }
    sky = SkyRaster(plan)
    context.progress.start("tiles: samples", float(len(points)), "points")
    # (2) Block by block. Invariant: a tile's new file holds its core and margin samples of all
    # blocks so far, in file order.
    for first, block in points.blocks(_BLOCK_ROWS):
        rows: AnyArray = np.zeros(len(block), dtype=dtype)
        last = first + len(block)
        rows["position"] = block
        if colours is not None:
            rows["colour"] = colours.read(first, last)
        for number, column in enumerate(columns):
            rows[f"a{number}"] = column.read(first, last)
        cells = _cells(block, plan.lattice, origin)
        sky.add(cells)
        for tile, mine in plan.members(cells):
            if tile in kept:
                continue
            samples = rows[mine]
            writers[tile].append(samples)
            digests[tile].update(samples.view(np.uint8).data)
        context.progress.advance(len(block))
    for tile, writer in writers.items():
        writer.close()
        above = sky.above(tile)
        np.save(context.folder / f"{above_name(tile)}.npy", above)
        digests[tile].update(above.view(np.uint8).data)
    hashes = [digest.hexdigest() for digest in digests]
    counts = [writers[tile].rows if tile in writers else 0 for tile in range(plan.count)]
    if earlier is not None:
        for tile in kept:
            for stem in (samples_name(tile), above_name(tile)):
                link_or_copy(earlier.folder / f"{stem}.npy", context.folder / f"{stem}.npy")
            hashes[tile] = earlier.values["digests"][tile]
            counts[tile] = earlier.values["samples"][tile]
    # (3) What the margins cost.
    context.progress.done({"tiles": plan.count, "with margins": sum(counts)})
    facts = {
        "tiles": plan.count,
        "tile_depth": plan.shape.depth,
        "core_cells": plan.shape.core,
        "margin_cells": round(plan.shape.margin, 1),
        "cell_m": plan.lattice.cell_m,
        "samples": sum(counts),
        "largest_tile_samples": max(counts),
        "overlap": sum(counts) / len(points),
        "kept_tiles": len(kept),
    }
    values = {
        "samples": counts, "digests": hashes, "laid": laid, "tiles": plan.indices.tolist(),
    }  # fmt: skip
    return values, Facts(facts)


def _kept(plan: TilePlan, laid: str, earlier: Earlier | None) -> frozenset[int]:
    """Tiles that keep their samples."""
    if earlier is None or earlier.values.get("laid") != laid:
        return frozenset()
    touched = plan.touched(earlier.changed, BLOCK_CELLS)
    pairs = zip(plan.indices.tolist(), earlier.values["tiles"], strict=False)
    return frozenset(
        tile for tile, (index, before) in enumerate(pairs) if index == before and not touched[tile]
    )


def _cells(points: Float64, lattice: Lattice, origin: Float64) -> Float64:
    """CRS frame to lattice cells, float64 all the way."""
    local = points - origin
    return lattice.cells(np.stack([local[:, 0], local[:, 2], -local[:, 1]], axis=1))
