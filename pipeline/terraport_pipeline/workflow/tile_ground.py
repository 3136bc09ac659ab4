"""Everything about a survey that is known before the first tile is worked on.

Thins a copy of the survey, measures, plans the tiles, hands the samples out; each step a result in
the work directory. Over a scene that is there its frame stands: origin, lattice, spacing and what
is usual are those of its first survey, and its tiles keep their numbers, so that a tile whose
samples are the same is the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import Float64, Int64
from terraport_pipeline.engines import poisson
from terraport_pipeline.engines.readers import point_order
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.engines.readers.point_order import thinning_rows
from terraport_pipeline.geometry.clouds import detail_cell, footprint
from terraport_pipeline.geometry.clouds.detail_cell import choose_cell, smoothing_radius_m
from terraport_pipeline.geometry.clouds.footprint import Occupancy, plan_occupancy
from terraport_pipeline.geometry.tiles import tile_plan
from terraport_pipeline.geometry.tiles.tile_plan import (
    Lattice,
    TilePlan,
    plan_tiles,
    renew_plan,
    tile_shape,
)
from terraport_pipeline.model import Crs, Survey
from terraport_pipeline.options import reconstruct
from terraport_pipeline.options.tiles import TileOptions
from terraport_pipeline.stages import clean, measure_survey, partition
from terraport_pipeline.stages.clean import Cleaned
from terraport_pipeline.stages.contract import IN_FOLDER, STORED, Stored
from terraport_pipeline.stages.tiles import solve_tile
from terraport_pipeline.stages.tiles.tile_edges import BASE_GAP_SPACINGS
from terraport_pipeline.workflow.before import Before
from terraport_pipeline.workflow.read_step import crs_of
from terraport_pipeline.workflow.runner import Result, Runner, Stage
from terraport_pipeline.workflow.tile_memory import (
    TileForecast,
    choose_plan,
    forecast_tiles,
    tiles_fit,
)
from terraport_pipeline.workflow.workdir import StageRecord

__all__ = [
    "FRAME",
    "Ground",
    "choose_tiles",
    "clean_thinned",
    "lattice_of",
    "prepare",
    "tile_tasks",
]

FRAME: Final = "frame"
"""Decision: origin, lattice and measures of a scene."""
_PLAN: Final = "plan"

_KEPT_BEYOND: Final = 3.0
"""A tile keeps its surface until the join decides: so many spacings farther than any rule of the
join lets it reach (the base's hem is 1.5 wide)."""

_THINNED_POINTS: Final = 1_500_000
"""Samples of the thinned copy: four per cell of a base of depth 9, and 0.8 GB to clean."""


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Everything that is the same for all tiles: lattice, plan, samples, forecast of memory."""

    survey: StageRecord
    """Columns of the survey, as read or renewed."""
    cleaned: Result[Cleaned]
    """The thinned copy: origin, colours, codes."""
    origin: Float64
    """(3,) easting, northing, height of the scene's origin."""
    measured: dict[str, Any]
    """Of the survey that the scene's frame was made for."""
    lattice: Lattice
    raster: Occupancy
    """Where the scene's footprint is drawn; empty."""
    plan: TilePlan
    samples: StageRecord
    forecast: TileForecast
    choices: tuple[str, ...]
    clean_options: clean.Options
    options: reconstruct.Options

    @property
    def crs(self) -> Crs | None:
        """Coordinate reference system of the survey; None where it states none."""
        return crs_of(self.survey)


def clean_thinned(runner: Runner, survey: StageRecord, options: clean.Options) -> Result[Cleaned]:
    """Clean a thinned copy of the survey in memory: origin, colours, codes, the scene's frame."""
    source = runner.work.path / survey.name
    origin = None if runner.before is None else _origin_before(runner.before)
    return runner.run(
        Stage(
            clean.NAME,
            clean,
            lambda context: clean.run(_thinned(source, survey), options, context, origin),
            clean.FORM,
            asdict(options)
            | {"thinned": _THINNED_POINTS, "origin": None if origin is None else origin.tolist()},
            {"survey": survey.digest},
            also=(point_order,),
        )
    )


def _origin_before(before: Before) -> Float64 | None:
    record = before.find(FRAME)
    return None if record is None else np.array(record.values["origin"], np.float64)


def prepare(
    runner: Runner,
    survey: StageRecord,
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
    survey : StageRecord
        Its columns on disk.
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
    # (1) Extent, spacing and noise of all samples; the frame that follows, or the scene's own.
    source = runner.work.path / survey.name
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
            {"survey": survey.digest, "cloud": cleaned.digest},
        )
    )
    frame = runner.run(
        Stage(
            FRAME,
            measure_survey,
            lambda _: Stored(
                {}, _frame(dict(measured.value().values), cloud.origin, options.detail_depth)
            ),
            STORED,
            {"detail_depth": options.detail_depth, **asdict(clean_options)},
            {"measured": measured.digest, "cloud": cleaned.digest},
            also=(detail_cell, footprint, poisson, tile_plan),
            is_decision=True,
        )
    ).value()
    values = frame.values
    lattice = Lattice(tuple(values["anchor_m"]), values["cell_m"])
    raster = Occupancy(
        tuple(values["raster_low"]), values["raster_cell_m"], values["measured"]["spacing_m"],
        np.zeros((0, 0), np.float32),
    )  # fmt: skip
    # (2) Tiles on the lattice that fit into memory, and each tile's samples. All tiles solve
    # on one lattice: their surfaces meet at the same planes.
    plan, forecast = _plan(
        runner, source, lattice, cloud.origin, dict(measured.value().values), tiles, in_one_piece
    )
    earlier, earlier_digest = _handed_out(runner, source)
    samples = runner.run(
        Stage(
            partition.NAME,
            partition,
            lambda context: partition.run(
                source, len(survey.values["attributes"]), plan, cloud.origin, context, earlier
            ),
            IN_FOLDER,
            {
                "shape": asdict(plan.shape),
                "lattice": asdict(lattice),
                "offset": plan.offset,
                "tiles": plan.indices.tolist(),
            },
            {"survey": survey.digest, "cloud": cleaned.digest, **earlier_digest},
            is_remembered=True,
        )
    )
    return Ground(
        survey, cleaned, cloud.origin, values["measured"], lattice, raster, plan, samples.record,
        forecast, tuple(values["choices"]), clean_options, options,
    )  # fmt: skip


def _handed_out(runner: Runner, source: Path) -> tuple[partition.Earlier | None, Mapping[str, str]]:
    """Open the tiles' samples of the version before, where it is known what changed since.

    Also what they add to the key of what is made with them.
    """
    record = None if runner.before is None else runner.before.find(partition.NAME)
    changed = source / "change-blocks.npy"
    if runner.before is None or record is None or not changed.exists():
        return None, {}
    folder = runner.before.work.path / record.name
    earlier = partition.Earlier(folder, record.values, np.load(changed))
    return earlier, {"before": record.digest}


def _frame(measured: dict[str, Any], origin: Float64, detail_depth: int | None) -> dict[str, Any]:
    """Decide what stands for all surveys over one scene, as plain values."""
    cell_m, choices = choose_cell(
        detail_depth,
        poisson.SCALE * measured["extent_m"],
        measured["surface_spacing_m"],
        measured["noise_m"],
    )
    raster = plan_occupancy(
        np.array(measured["low"]), np.array(measured["high"]), measured["spacing_m"]
    )
    return {
        "origin": origin.tolist(),
        "measured": measured,
        **asdict(lattice_of(measured, cell_m)),
        "raster_low": list(raster.low),
        "raster_cell_m": raster.cell_m,
        "choices": list(choices),
    }


def _thinned(source: Path, survey: StageRecord) -> Survey:
    """Every n-th sample or so of a survey, by the rule of ``--max-points``."""
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
        {name: column(f"attribute-{i}") for i, name in enumerate(survey.values["attributes"])},
        crs_of(survey),
        survey.values["format"],
        whole=tuple(survey.values.get("whole", ())),
    )


def lattice_of(measured: Mapping[str, Any], cell_m: float) -> Lattice:
    """Make the lattice of one octree over the whole survey, as `measure_survey` describes it."""
    low, high = np.array(measured["low"]), np.array(measured["high"])
    levels = np.log2(poisson.SCALE * measured["extent_m"] / cell_m)
    side_m = cell_m * 2.0 ** np.ceil(levels - 1e-9)  # an octree depth that was asked for stays
    anchor = (low + high) / 2 - side_m / 2
    return Lattice((float(anchor[0]), float(anchor[1]), float(anchor[2])), float(cell_m))


def choose_tiles(
    lattice: Lattice,
    blocks: Int64,
    counts: Int64,
    *,
    points: int,
    surface_spacing_m: float,
    max_memory_bytes: int,
    asked: int | None = None,
    in_one_piece: str | None = None,
    block_cells: int = partition.BLOCK_CELLS,
) -> TilePlan:
    """Choose the tiles of a survey that nothing was built from before.

    Parameters
    ----------
    lattice : Lattice
    blocks, counts, block_cells
        Occupied blocks and their samples, as :func:`plan_tiles` takes them.
    points : int
        Of the survey.
    surface_spacing_m : float
        Root of the area that a sample stands for.
    max_memory_bytes, asked, in_one_piece
        As :func:`choose_plan`.
    """
    return choose_plan(
        lambda depth: plan_tiles(lattice, tile_shape(depth), blocks, counts, block_cells),
        points=points,
        area_m2=points * surface_spacing_m**2,
        max_memory_bytes=max_memory_bytes,
        asked=asked,
        in_one_piece=in_one_piece,
    )


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
    points = measured["points"]
    area_m2 = points * measured["surface_spacing_m"] ** 2
    plan = _plan_before(runner, lattice, blocks, counts)
    memory = runner.max_memory_bytes
    if plan is not None and not (
        tiles.depth in (None, plan.shape.depth)
        and (in_one_piece is None or plan.count == 1)
        and tiles_fit(plan, points, area_m2, memory)
    ):
        plan = None
    if plan is None:
        plan = choose_tiles(
            lattice,
            blocks,
            counts,
            points=points,
            surface_spacing_m=measured["surface_spacing_m"],
            max_memory_bytes=memory,
            asked=tiles.depth,
            in_one_piece=in_one_piece,
        )
    values = {
        "depth": plan.shape.depth, "offset": list(plan.offset), "tiles": plan.indices.tolist(),
    }  # fmt: skip
    runner.run(
        Stage(_PLAN, partition, lambda _: Stored({}, values), STORED, values, is_remembered=True)
    )
    return plan, forecast_tiles(plan, points, area_m2, memory, runner.threads)


def _plan_before(runner: Runner, lattice: Lattice, blocks: Int64, counts: Int64) -> TilePlan | None:
    """Lay the tiles of the scene before over this survey; new ones are numbered behind them."""
    record = None if runner.before is None else runner.before.find(_PLAN)
    if record is None:
        return None
    values = record.values
    return renew_plan(
        lattice, tile_shape(values["depth"]), tuple(values["offset"]),
        np.array(values["tiles"], np.int64), blocks, counts, partition.BLOCK_CELLS,
    )  # fmt: skip


def tile_tasks(ground: Ground) -> list[solve_tile.TileTask]:
    """Write down for every tile what it needs to know."""
    clean_options, options = ground.clean_options, ground.options
    plan, lattice = ground.plan, ground.lattice
    cleaned = ground.cleaned.value()
    raster = ground.raster
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
                columns=tuple(ground.survey.values["attributes"]),
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
                noise_m=ground.measured["noise_m"],
                smoothing_m=smoothing_radius_m(
                    ground.measured["surface_spacing_m"], ground.measured["noise_m"]
                ),
            )
        )
    return tasks
