"""Everything about a survey in tiles that is known before the first tile is worked on.

Thins a copy of the survey as read, measures, plans the tiles, hands the samples out; each step
a result in the work directory.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.code_digest import code_digest
from terraport_pipeline.engines import poisson
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.engines.readers.raw_survey import thinning_rows
from terraport_pipeline.errors import ResourceError
from terraport_pipeline.geometry.clouds.detail_cell import choose_cell, smoothing_radius_m
from terraport_pipeline.geometry.clouds.footprint import Occupancy, plan_occupancy
from terraport_pipeline.geometry.tiles.tile_plan import Lattice, TilePlan, plan_tiles, tile_shape
from terraport_pipeline.model import Crs, Survey
from terraport_pipeline.option import Option, check_options
from terraport_pipeline.stages import clean, measure_survey, partition, reconstruct
from terraport_pipeline.stages.clean import Cleaned
from terraport_pipeline.stages.tiles import solve_tile
from terraport_pipeline.stages.trim_detail import BASE_GAP_SPACINGS
from terraport_pipeline.workflow.stage_runner import StageRunner, Step
from terraport_pipeline.workflow.tile_memory import TileForecast, choose_depth, forecast_tiles
from terraport_pipeline.workflow.workdir import StageRecord, stage_key

__all__ = ["Ground", "TileOptions", "prepare", "raster_of", "tile_tasks"]

_KEPT_BEYOND: Final = 3.0
"""A tile keeps its surface until the join decides: so many spacings farther than any rule of the
join lets it reach (the base's hem is 1.5 wide)."""

_THINNED_POINTS: Final = 1_500_000
"""Samples of the thinned copy: four per cell of a base of depth 9, and 0.8 GB to clean."""


@dataclass(frozen=True, slots=True)
class TileOptions:
    """Whether to build in tiles, how large these are, and who works on them."""

    force: Annotated[bool, Option(flags=("--tiles",))] = False
    """Build in tiles although the whole would fit into the memory."""
    depth: Annotated[
        int | None,
        Option(flags=("--tile-depth",), least=7, most=12, unset="what --max-memory allows"),
    ] = None
    """Octree depth of a tile: 10 is about 1.1 million faces, 9 a quarter of that."""
    cluster: Annotated[str | None, Option(unset="processes of this machine")] = None
    """Address of a Dask scheduler that works on the tiles, as --tiles: tcp://host:8786. Its workers
    must see the same paths."""

    def __post_init__(self) -> None:
        check_options(self)

    @property
    def wanted(self) -> bool:
        """Whether to build in tiles whatever the memory."""
        return self.force or self.cluster is not None


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Everything that is the same for all tiles: lattice, plan, samples, forecast of memory."""

    read: StageRecord
    cleaned: Step[Cleaned]
    origin: Float64
    measured: dict[str, Any]
    lattice: Lattice
    plan: TilePlan
    samples: StageRecord
    forecast: TileForecast
    warnings: tuple[str, ...]


def prepare(
    runner: StageRunner,
    read: StageRecord,
    clean_options: clean.Options,
    options: reconstruct.Options,
    tiles: TileOptions,
) -> Ground:
    """Do everything up to the samples of every tile.

    Parameters
    ----------
    runner, read, clean_options, options, tiles
        As :func:`terraport_pipeline.workflow.tiled_reconstruct.run`.
    """
    # (1) The survey's columns on disk.
    source = runner.work.path / read.name
    # (2) A thinned copy in memory, for the origin, colours and the scene's frame.
    cleaned = runner.step(
        clean.NAME,
        stage_key(
            clean.NAME,
            code_digest(clean.__name__),
            asdict(clean_options) | {"thinned": _THINNED_POINTS},
            {"survey": read.digest},
        ),
        lambda context: clean.run(_thinned(source, read), clean_options, context),
        lambda result: result.facts,
        clean.store,
        clean.restore,
    )
    cloud = cleaned.value().cloud
    # (3) Extent, spacing and noise of all samples.
    measured = runner.step(
        measure_survey.NAME,
        stage_key(
            measure_survey.NAME,
            code_digest(measure_survey.__name__),
            asdict(clean_options),
            {"survey": read.digest, "cloud": cleaned.record.digest},
        ),
        lambda context: measure_survey.run(
            source / "points.npy", cloud, clean_options.normal_neighbours, context
        ),
        measure_survey.facts_of,
        lambda stored: stored,
        lambda stored, _facts: stored,
    ).value()
    values = dict(measured.values)
    # (4) The lattice, tiles on it that fit into memory, and each tile's samples. All tiles solve
    # on one lattice: their surfaces meet at the same planes.
    cell_m, warnings = choose_cell(
        options.detail_depth, values["extent_m"], values["surface_spacing_m"], values["noise_m"]
    )
    lattice = _lattice(values, cell_m)
    origin = cloud.origin
    plan, forecast = _plan(runner, source, lattice, origin, values, tiles)
    samples = runner.folder_step(
        partition.NAME,
        stage_key(
            partition.NAME,
            code_digest(partition.__name__),
            {"shape": asdict(plan.shape), "lattice": asdict(lattice), "offset": plan.offset},
            {"survey": read.digest, "cloud": cleaned.record.digest},
        ),
        lambda folder, context: partition.run(
            source, len(read.values["attributes"]), plan, origin, folder, context
        ),
    )
    return Ground(read, cleaned, origin, values, lattice, plan, samples, forecast, tuple(warnings))


def _thinned(source: Path, read: StageRecord) -> Survey:
    """Every n-th sample or so of the survey as read, by the rule of ``--max-points``."""
    total = len(NpyReader(source / "points.npy"))
    rows = thinning_rows(total, _THINNED_POINTS)

    def column(name: str) -> Any:
        blocks = []
        for first, block in NpyReader(source / f"{name}.npy").blocks(1_000_000):
            if rows is None:
                blocks.append(block)
            else:
                low, high = np.searchsorted(rows, (first, first + len(block)))
                blocks.append(block[rows[low:high] - first])
        return np.concatenate(blocks)

    crs = read.values["crs"]
    return Survey(
        column("points"),
        column("colours") if (source / "colours.npy").exists() else None,
        {name: column(f"attribute-{i}") for i, name in enumerate(read.values["attributes"])},
        Crs(**crs) if crs else None,
        read.values["format"],
        whole=tuple(read.values.get("whole", ())),
    )


def _lattice(measured: dict[str, Any], cell_m: float) -> Lattice:
    """Make the lattice of one octree over the whole survey."""
    low, high = np.array(measured["low"]), np.array(measured["high"])
    levels = np.log2(poisson.SCALE * measured["extent_m"] / cell_m)
    side_m = cell_m * 2.0 ** np.ceil(levels - 1e-9)  # an octree depth that was asked for stays
    anchor = (low + high) / 2 - side_m / 2
    return Lattice((float(anchor[0]), float(anchor[1]), float(anchor[2])), float(cell_m))


def _plan(
    runner: StageRunner,
    source: Path,
    lattice: Lattice,
    origin: Float64,
    measured: dict[str, Any],
    tiles: TileOptions,
) -> tuple[TilePlan, TileForecast]:
    with runner.work.scratch() as scratch:
        blocks, counts = partition.count_blocks(
            source, lattice, origin, partition.BLOCK_CELLS, runner.context(scratch)
        )
    area_m2 = measured["points"] * measured["surface_spacing_m"] ** 2
    choice = choose_depth(
        lambda depth: plan_tiles(lattice, tile_shape(depth), blocks, counts, partition.BLOCK_CELLS),
        points=measured["points"],
        area_m2=area_m2,
        max_memory_bytes=runner.max_memory_bytes,
        asked=tiles.depth,
    )
    if choice is None:
        raise ResourceError(
            f"{runner.max_memory_bytes / 2**30:.1f} GiB are too little even for the smallest "
            "tile; raise --max-memory to 2G or more"
        )
    plan = choice
    return plan, forecast_tiles(
        plan, measured["points"], area_m2, runner.max_memory_bytes, runner.threads
    )


def tile_tasks(
    ground: Ground, clean_options: clean.Options, options: reconstruct.Options
) -> list[solve_tile.TileTask]:
    """Write down for every tile what it needs to know."""
    plan, lattice = ground.plan, ground.lattice
    cleaned = ground.cleaned.value()
    raster = raster_of(ground)
    east, north, height = (float(v) for v in ground.origin)
    tasks = []
    for tile in range(plan.count):
        low, high = plan.core(tile)
        centre = (low + high) // 2
        tasks.append(
            solve_tile.TileTask(
                depth=plan.shape.depth,
                cell_m=lattice.cell_m,
                centre_cells=(float(centre[0]), float(centre[1]), float(centre[2])),
                anchor_m=lattice.anchor_m,
                core_cells=plan.shape.core,
                margin_cells=plan.shape.margin,
                origin=(east, north, height),
                spacing_m=ground.measured["spacing_m"],
                usual=(ground.measured["usual_log_m"], ground.measured["usual_deviation"]),
                columns=tuple(ground.read.values["attributes"]),
                attributes=tuple(cleaned.cloud.attributes),
                codes=cleaned.codes,
                has_colour=cleaned.cloud.has_colour,
                outlier_ratio=clean_options.outlier_ratio,
                outlier_deviations=clean_options.outlier_deviations,
                normal_neighbours=clean_options.normal_neighbours,
                point_weight=options.point_weight,
                kept_ratio=max(BASE_GAP_SPACINGS, options.trim_spacings) + _KEPT_BEYOND,
                raster_low=raster.low,
                raster_cell_m=raster.cell_m,
                raster_shape=(raster.spacing_m.shape[0], raster.spacing_m.shape[1]),
                noise_m=ground.measured["noise_m"],
                smoothing_m=smoothing_radius_m(
                    ground.measured["surface_spacing_m"], ground.measured["noise_m"]
                ),
            )
        )
    return tasks


def raster_of(ground: Ground) -> Occupancy:
    """Make the empty raster of the scene's footprint."""
    measured = ground.measured
    return plan_occupancy(
        np.array(measured["low"]), np.array(measured["high"]), measured["spacing_m"]
    )
