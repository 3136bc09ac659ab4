"""What a build would solve: the tiles over all ground that a survey must have."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.geometry.clouds.detail_cell import detail_cell_m, smoothing_radius_m
from terraport_pipeline.geometry.tiles.fill_blocks import fill_blocks
from terraport_pipeline.geometry.tiles.tile_plan import TilePlan
from terraport_pipeline.sample.local_share import GroundBoxes
from terraport_pipeline.sample.sampled_points import BLOCK_ROWS
from terraport_pipeline.stages import partition
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.workflow.build_forecast import VOXEL_CELLS, SolvedGround
from terraport_pipeline.workflow.tile_ground import choose_tiles, lattice_of

__all__ = ["plan_ground"]

_MOST_BLOCKS: Final = 60_000
"""Columns of blocks in a plan; wider blocks beyond it, or the choice of tiles takes a minute."""

_VOXEL_SPAN: Final = 1 << 21
"""Voxels along an axis that a key tells apart."""


def plan_ground(
    folder: Path,
    measured: Mapping[str, Any],
    origin: Float64,
    box: GroundBoxes,
    points: int,
    surface_m2: float,
    ground_m2: float,
    slant: float,
    max_memory_bytes: int,
    context: Context,
    *,
    is_sample: bool,
) -> SolvedGround:
    """Plan the tiles as a build does, over all ground that the survey must have."""
    spacing_m, noise_m = measured["surface_spacing_m"], measured["noise_m"]
    cell_m = detail_cell_m(spacing_m, noise_m)
    lattice = lattice_of(measured, cell_m)
    block_cells = partition.BLOCK_CELLS
    while ground_m2 / (block_cells * cell_m) ** 2 > _MOST_BLOCKS:
        block_cells *= 2
    blocks, counts = partition.count_blocks(folder, lattice, origin, block_cells, context)
    if is_sample:
        columns = math.ceil(ground_m2 / (block_cells * cell_m) ** 2)
        ground = box.columns(lattice, origin, block_cells)
        blocks, counts = fill_blocks(blocks, ground, columns, points)
    plan: TilePlan = choose_tiles(
        lattice, blocks, counts, points=points, surface_spacing_m=spacing_m,
        max_memory_bytes=max_memory_bytes, block_cells=block_cells,
    )  # fmt: skip
    radius_m = smoothing_radius_m(spacing_m, noise_m)
    voxel_m = VOXEL_CELLS * cell_m
    voxels = None if is_sample else _voxels(NpyReader(folder / "points.npy"), origin, voxel_m)
    others = [NpyReader(path) for path in folder.glob("*.npy") if path.name != "points.npy"]
    return SolvedGround(
        points=points,
        surface_m2=surface_m2,
        cell_m=cell_m,
        slant=slant,
        voxels=voxels,
        voxel_m=voxel_m,
        noise_m=noise_m,
        smoothing_spacings=radius_m / spacing_m,
        plan=plan,
        row_bytes=24 + sum(c.dtype.itemsize * math.prod(c.shape[1:]) for c in others),
        attributes=len(list(folder.glob("attribute-*.npy"))),
    )


def _voxels(points: NpyReader, origin: Float64, voxel_m: float) -> int:
    """Count occupied voxels, block by block: along the curve two blocks hardly share one."""
    count = 0
    for _, block in points.blocks(BLOCK_ROWS):
        cells = np.floor((block - origin) / voxel_m).astype(np.int64) + _VOXEL_SPAN // 2
        keys = (cells[:, 0] * _VOXEL_SPAN + cells[:, 1]) * _VOXEL_SPAN + cells[:, 2]
        count += len(np.unique(keys))
    return count
