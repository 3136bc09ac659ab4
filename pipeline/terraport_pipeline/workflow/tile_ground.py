"""Everything about a survey that is known before the first tile is worked on.

Thins a copy of the survey as read, measures, plans the tiles, hands the samples out; each step
a result in the work directory.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.engines import poisson
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.engines.readers.raw_survey import thinning_rows
from terraport_pipeline.geometry.clouds.detail_cell import choose_cell, smoothing_radius_m
from terraport_pipeline.geometry.clouds.footprint import Occupancy, plan_occupancy
from terraport_pipeline.geometry.tiles.tile_plan import Lattice, TilePlan, plan_tiles, tile_shape
from terraport_pipeline.model import Crs, Survey
from terraport_pipeline.option import Option, check_options
from terraport_pipeline.stages import clean, measure_survey, partition, reconstruct
from terraport_pipeline.stages.clean import Cleaned
from terraport_pipeline.stages.contract import IN_FOLDER, STORED
from terraport_pipeline.stages.tiles import solve_tile
from terraport_pipeline.stages.tiles.tile_edges import BASE_GAP_SPACINGS
from terraport_pipeline.workflow.read_step import crs_of
from terraport_pipeline.workflow.runner import Result, Runner, Stage
from terraport_pipeline.workflow.tile_memory import TileForecast, choose_plan, forecast_tiles
from terraport_pipeline.workflow.workdir import StageRecord

__all__ = ["Ground", "TileOptions", "clean_thinned", "prepare", "raster_of", "tile_tasks"]

_KEPT_BEYOND: Final = 3.0
"""A tile keeps its surface until the join decides: so many spacings farther than any rule of the
join lets it reach (the base's hem is 1.5 wide)."""

_THINNED_POINTS: Final = 1_500_000
"""Samples of the thinned copy: four per cell of a base of depth 9, and 0.8 GB to clean."""


@dataclass(frozen=True, slots=True)
class TileOptions:
    """How large tiles are, and who works on them."""

    depth: Annotated[
        int | None,
        Option(flags=("--tile-depth",), least=7, most=12, unset="what --max-memory allows"),
    ] = None
    """Octree depth of a tile: 10 is about 1.1 million faces, 9 a quarter of that."""
    cluster: Annotated[str | None, Option(unset="processes of this machine")] = None
    """Address of a Dask scheduler whose workers solve the tiles: tcp://host:8786. They must see the
    same paths."""

    def __post_init__(self) -> None:
        check_options(self)


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Everything that is the same for all tiles: lattice, plan, samples, forecast of memory."""

    read: StageRecord
    cleaned: Result[Cleaned]
    """The thinned copy: origin, colours, codes."""
    origin: Float64
    """(3,) easting, northing, height of the scene's origin."""
    measured: dict[str, Any]
    lattice: Lattice
    plan: TilePlan
    samples: StageRecord
    forecast: TileForecast
    warnings: tuple[str, ...]
    clean_options: clean.Options
    options: reconstruct.Options

    @property
    def crs(self) -> Crs | None:
        """Coordinate reference system of the survey; None where it states none."""
        return crs_of(self.read)


def clean_thinned(runner: Runner, read: StageRecord, options: clean.Options) -> Result[Cleaned]:
    """Clean a thinned copy of the survey in memory: origin, colours, codes, the scene's frame."""
    source = runner.work.path / read.name
    return runner.run(
        Stage(
            clean.NAME,
            clean,
            lambda context: clean.run(_thinned(source, read), options, context),
            clean.FORM,
            asdict(options) | {"thinned": _THINNED_POINTS},
            {"survey": read.digest},
        )
    )


def prepare(
    runner: Runner,
    read: StageRecord,
    cleaned: Result[Cleaned],
    clean_options: clean.Options,
    options: reconstruct.Options,
    tiles: TileOptions,
    in_one_piece: str | None = None,
) -> Ground:
    """Measure the survey, plan its tiles and hand its samples out to them.

    Parameters
    ----------
    runner : Runner
    read : StageRecord
        The survey's columns on disk.
    cleaned : Result of Cleaned
        From :func:`clean_thinned`.
    clean_options, options, tiles
        As of the build.
    in_one_piece : str, optional
        What needs the surface as a single tile.

    Raises
    ------
    ResourceError
        Not even a small tile fits the memory allowed; the single tile does not.
    OptionError
        Tiles of the size that was asked for, where one must hold all.
    """
    # (1) Extent, spacing and noise of all samples.
    source = runner.work.path / read.name
    cloud = cleaned.value().cloud
    measured = runner.run(
        Stage(
            measure_survey.NAME,
            measure_survey,
            lambda context: measure_survey.run(
                source / "points.npy", cloud, clean_options.normal_neighbours, context
            ),
            STORED,
            asdict(clean_options),
            {"survey": read.digest, "cloud": cleaned.digest},
        )
    )
    values = dict(measured.value().values)
    # (2) The lattice, tiles on it that fit into memory, and each tile's samples. All tiles solve
    # on one lattice: their surfaces meet at the same planes.
    cell_m, warnings = choose_cell(
        options.detail_depth,
        poisson.SCALE * values["extent_m"],
        values["surface_spacing_m"],
        values["noise_m"],
    )
    lattice = _lattice(values, cell_m)
    origin = cloud.origin
    plan, forecast = _plan(runner, source, lattice, origin, values, tiles, in_one_piece)
    samples = runner.run(
        Stage(
            partition.NAME,
            partition,
            lambda context: partition.run(
                source, len(read.values["attributes"]), plan, origin, context
            ),
            IN_FOLDER,
            {"shape": asdict(plan.shape), "lattice": asdict(lattice), "offset": plan.offset},
            {"survey": read.digest, "cloud": cleaned.digest},
        )
    )
    return Ground(
        read, cleaned, origin, values, lattice, plan, samples.record, forecast,
        tuple(warnings), clean_options, options,
    )  # fmt: skip


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

    return Survey(
        column("points"),
        column("colours") if (source / "colours.npy").exists() else None,
        {name: column(f"attribute-{i}") for i, name in enumerate(read.values["attributes"])},
        crs_of(read),
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
    runner: Runner,
    source: Path,
    lattice: Lattice,
    origin: Float64,
    measured: dict[str, Any],
    tiles: TileOptions,
    in_one_piece: str | None,
) -> tuple[TilePlan, TileForecast]:
    with runner.work.scratch() as scratch:
        blocks, counts = partition.count_blocks(
            source, lattice, origin, partition.BLOCK_CELLS, runner.context(scratch)
        )
    area_m2 = measured["points"] * measured["surface_spacing_m"] ** 2
    plan = choose_plan(
        lambda depth: plan_tiles(lattice, tile_shape(depth), blocks, counts, partition.BLOCK_CELLS),
        points=measured["points"],
        area_m2=area_m2,
        max_memory_bytes=runner.max_memory_bytes,
        asked=tiles.depth,
        in_one_piece=in_one_piece,
    )
    return plan, forecast_tiles(
        plan, measured["points"], area_m2, runner.max_memory_bytes, runner.threads
    )


def tile_tasks(ground: Ground) -> list[solve_tile.TileTask]:
    """Write down for every tile what it needs to know."""
    clean_options, options = ground.clean_options, ground.options
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
