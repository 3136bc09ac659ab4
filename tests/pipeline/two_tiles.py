"""A rolling sheet over two tiles of 8 x 8 cells, as `solve_tile` would have left them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from terraport_pipeline.geometry.clouds.edges import EdgeRule
from terraport_pipeline.geometry.tiles.tile_weld import weld_tiles
from terraport_pipeline.stages.tiles import solve_tile
from terraport_pipeline.stages.tiles.join_tiles import Join, TileJoin
from terraport_pipeline.stages.tiles.joined_tile import finish, look, weak_places
from terraport_pipeline.stages.tiles.settle_tiles import Forgiven, Look, Settled, forgive, settle
from terraport_pipeline.stages.tiles.solve_tile import TileTask

CORE = 8
CELL_M = 0.5
ANCHOR_M = (100.0, -3.0, 40.0)

Arrays = dict[str, npt.NDArray[np.generic]]


def task(tile: int) -> TileTask:
    """Core x from 8 to 16 cells for tile 1, from 0 for tile 0; y and z from 0 to 8."""
    return TileTask(
        depth=7,
        cell_m=CELL_M,
        centre_cells=(CORE * tile + CORE / 2, CORE / 2, CORE / 2),
        anchor_m=ANCHOR_M,
        core_cells=CORE,
        margin_cells=4.0,
        origin=(500_000.0, 6_000_000.0, 120.0),
        spacing_m=CELL_M,
        usual=(-1.0, 0.2),
        columns=("grade", "class"),
        attributes=("grade", "class"),
        codes=("class",),
        has_colour=True,
        outlier_ratio=3.0,
        outlier_deviations=6.0,
        normal_neighbours=12,
        point_weight=4.0,
        kept_ratio=8.0,
        raster_low=(90.0, 30.0),
        raster_cell_m=CELL_M,
    )


def piece(tile: int, *, lift_cells: float = 0.0, ratio: float = 0.5) -> Arrays:
    """The sheet inside a core, about its middle; `lift_cells` is what its solver did otherwise."""
    x, z = (g.ravel() for g in np.meshgrid(np.arange(CORE + 1), np.arange(CORE + 1), indexing="ij"))
    x = x + CORE * tile
    y = 4.3 + 0.6 * np.sin(x / 3.0) * np.cos(z / 2.0) + lift_cells
    cells = np.stack([x, y, z], axis=1)
    index = np.arange(len(x), dtype=np.int32).reshape(CORE + 1, CORE + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate(
        [np.stack(corner, -1).reshape(-1, 3) for corner in ((a, b, c), (a, c, d))]
    )
    own = task(tile)
    vertices = ((cells - np.array(own.centre_cells)) * CELL_M).astype(np.float32)
    ratios = np.full(len(vertices), ratio, np.float32)
    border = solve_tile.border_of(own, vertices, faces, ratios)
    return {
        "vertices": vertices,
        "faces": faces,
        "ratio": ratios,
        "colours": np.stack([10 * x, 20 * z, 0 * x], axis=1).astype(np.uint8),
        "attribute-0": (x / 16).astype(np.float32),
        "attribute-1": np.where(z > 4, 6, 2).astype(np.float32),
        "border-rows": border.rows,
        "border-cells": border.cells,
        "border-ratio": border.ratio,
        "border-edges": border.edges,
        "border-walls": border.walls,
    }


@dataclass
class Joined:
    """What the four passes made of two pieces."""

    join: Join
    joins: list[TileJoin]
    forgiven: tuple[Forgiven, ...]
    looks: list[Look]
    settled: Settled
    tiles: list[Arrays]


def join_of(pieces: list[Arrays], rule: EdgeRule) -> Join:
    """Read the borders of both tiles and weld them along their common wall."""
    borders = [
        solve_tile.TileBorder(
            *(arrays[f"border-{n}"] for n in ("rows", "cells", "ratio", "edges", "walls"))
        )
        for arrays in pieces
    ]
    return Join.of(weld_tiles(borders, [(0, 1, 0)]), pieces, 2, (1,), (rule, BASE_RULE))


RULE = EdgeRule(threshold=2.0, largest=4.0, spacing_m=CELL_M, footprint=None)
BASE_RULE = replace(RULE, largest=5.0, outward_m=CELL_M)


def joined(pieces: list[Arrays], *, rule: EdgeRule = RULE, min_faces: int = 1) -> Joined:
    """Join two tiles as a build does: weld, forgive weak places, look, settle, finish."""
    join = join_of(pieces, rule)
    joins = tile_joins(join)
    weak = [weak_places(task(t), each, joins[t]) for t, each in enumerate(pieces)]
    forgiven = forgive(join, weak)
    looks = [look(task(t), each, joins[t], forgiven[t]) for t, each in enumerate(pieces)]
    settled = settle(join, looks, min_faces=min_faces)
    tiles = [
        finish(task(t), each, joins[t], forgiven[t], settled.tiles[t])[0]
        for t, each in enumerate(pieces)
    ]
    return Joined(join, joins, forgiven, looks, settled, tiles)


def tile_joins(join: Join) -> list[TileJoin]:
    """Give each of the two tiles what the join says of it."""
    half_m = 0.5 * CORE * CELL_M
    return [join.tile(t, task(t).centre_m - half_m, task(t).centre_m + half_m) for t in range(2)]
