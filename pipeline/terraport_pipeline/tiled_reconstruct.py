"""Reconstruction of a survey that does not fit into memory: read, thin, plan, tiles, join, base.

The steps, each a result in the work directory:

``read``            the survey's columns on disk, a part at a time
``clean``           a thinned copy of it, cleaned as a small survey is: origin, base, codes
``measure_survey``  spacing and what is usual, in full density
``partition``       every tile's samples
``solve-00000``...  every tile's surface (side by side, or on a cluster)
``join_tiles``      what is shared
``tile-00000``...   every tile as later stages read it
``tiled_base``      the base and its deviation
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from terraport_payload.order import order_for_cache
from terraport_pipeline.build_report import StageReport
from terraport_pipeline.code_digest import code_digest
from terraport_pipeline.engines import poisson
from terraport_pipeline.engines.npy_columns import NpyReader
from terraport_pipeline.engines.tile_pool import run_jobs
from terraport_pipeline.errors import OptionError, ResourceError, SurveyError
from terraport_pipeline.geometry.edges import EdgeRule
from terraport_pipeline.geometry.footprint import Occupancy, plan_occupancy
from terraport_pipeline.geometry.tile_plan import Lattice, TilePlan, plan_tiles, tile_shape
from terraport_pipeline.geometry.tile_weld import Seams, TileBorder, weld_tiles
from terraport_pipeline.measure import Measure
from terraport_pipeline.model import Crs, Float64, Mesh, Survey
from terraport_pipeline.stage_runner import StageRunner, Step
from terraport_pipeline.stages import (
    clean,
    join_tiles,
    joined_tile,
    measure_survey,
    partition,
    read_streamed,
    reconstruct,
    solve_tile,
    tiled_base,
)
from terraport_pipeline.stages.clean import Cleaned
from terraport_pipeline.stages.contract import Context, Facts, Stored
from terraport_pipeline.tile_jobs import (
    FinishJob,
    LookJob,
    SolveJob,
    TileArrays,
    find_weak,
    finish_tile,
    look_at_tile,
    save_join,
    solve_name,
    solve_one,
    tile_name,
)
from terraport_pipeline.tile_memory import TileForecast, choose_depth, forecast_tiles
from terraport_pipeline.tiles import DetailTiles, StoredTiles
from terraport_pipeline.workdir import Cost, StageRecord, stage_key

__all__ = ["TileOptions", "TiledReconstructed", "run"]

T = TypeVar("T")

_KEPT_RATIO: Final = 8.0
"""Support ratio up to which a tile keeps its surface until the join decides."""

_THINNED_POINTS: Final = 1_500_000
"""Samples of the thinned copy: four per cell of a base of depth 9, and 0.8 GB to clean."""


@dataclass(frozen=True, slots=True)
class TileOptions:
    """How to go about a survey in tiles."""

    force: bool = False
    """Tiles although the whole would fit."""
    depth: int | None = None
    """Octree depth of a tile; by the memory allowed when None."""
    cluster: str | None = None
    """Address of a Dask scheduler; processes of this machine when None."""

    def __post_init__(self) -> None:
        if self.depth is not None and not 7 <= self.depth <= 12:
            raise OptionError(f"tile depth {self.depth}; expected 7 to 12")


@dataclass(frozen=True, slots=True, eq=False)
class TiledReconstructed:
    """One surface: a base in memory, the detail in tiles on disk."""

    base: Mesh
    tiles: DetailTiles
    deviation_m: tuple[float, ...]
    """Distance of detail vertices to the base: 50th, 95th, 99th and 99.9th percentile."""
    facts: Facts
    origin: Float64
    """(3,) CRS frame."""
    crs: Crs | None
    points: int
    """Samples that the detail rests on."""
    has_colour: bool
    codes: tuple[str, ...]
    spacing_m: float
    cell_m: float
    tile_depth: int
    digest: str
    """Of base and tiles."""


@dataclass(frozen=True, slots=True, eq=False)
class _Ground:
    """What is known before the first tile."""

    read: StageRecord
    cleaned: Step[Cleaned]
    origin: Float64
    measured: dict[str, Any]
    lattice: Lattice
    plan: TilePlan
    samples: StageRecord
    forecast: TileForecast
    warnings: tuple[str, ...]


def run(
    runner: StageRunner,
    survey: Path,
    file_key: str,
    *,
    max_points: int | None,
    clean_options: clean.Options,
    options: reconstruct.Options,
    tiles: TileOptions,
    check: Callable[[tuple[str, ...]], None] = lambda _names: None,
) -> TiledReconstructed:
    """Reconstruct a survey in tiles.

    Parameters
    ----------
    runner : StageRunner
        Keeps the results; its reports get one entry per step.
    survey : pathlib.Path
    file_key : str
        Identifies the survey's bytes.
    max_points : int or None
        Thin the survey to this many samples while reading.
    clean_options, options, tiles
        As of the build.
    check : callable
        Told the surface's attributes as soon as they are known; may refuse them.

    Returns
    -------
    TiledReconstructed

    Raises
    ------
    SurveyError, ReadError
        The survey cannot be used, or its format cannot be read in parts.
    ResourceError
        Not even a small tile fits the memory allowed, or the disk is full.
    EngineError
        The solver failed twice on a tile, or a worker was lost twice.
    """
    ground = _prepare(runner, survey, file_key, max_points, clean_options, options, tiles)
    check(tuple(ground.cleaned.record.values["attributes"]))
    tasks = _tasks(ground, clean_options, options)
    solved = _solve(runner, ground, tasks, tiles)
    stored, joined = _join(runner, ground, tasks, solved, options, tiles)
    cleaned = ground.cleaned.value()
    base_key = stage_key(
        tiled_base.NAME,
        code_digest(tiled_base.__name__),
        asdict(options),
        {"tiles": stored.digest, "cloud": ground.cleaned.record.digest},
    )
    base = runner.step(
        tiled_base.NAME,
        base_key,
        lambda context: tiled_base.run(cleaned, stored, options, context),
        lambda result: result.facts,
        tiled_base.store,
        tiled_base.restore,
    )
    made = base.value()
    ground.cleaned.release()
    crs = ground.read.values["crs"]
    counts = [record.values for record in solved]
    lost = sum(int(c["outliers"]) for c in counts)
    facts = Facts(
        {
            "points": int(ground.measured["points"]),
            "spacing_m": ground.measured["spacing_m"],
            "cell_m": ground.lattice.cell_m,
            "tiles": stored.count,
            "detail_faces": sum(stored.faces),
            "detail_vertices": sum(stored.vertices),
            "outliers_with_margins": lost,
            **joined.facts.counts,
            **made.facts.counts,
        },
        (*ground.warnings, *joined.facts.warnings, *made.facts.warnings),
    )
    return TiledReconstructed(
        made.base,
        stored,
        made.deviation_m,
        facts,
        ground.origin,
        Crs(**crs) if crs else None,
        int(ground.measured["points"]),
        cleaned.cloud.has_colour,
        cleaned.codes,
        float(ground.measured["spacing_m"]),
        ground.lattice.cell_m,
        ground.plan.shape.depth,
        stage_key("tiled", "", {}, {"base": base.record.digest, "tiles": stored.digest}),
    )


def _prepare(
    runner: StageRunner,
    survey: Path,
    file_key: str,
    max_points: int | None,
    clean_options: clean.Options,
    options: reconstruct.Options,
    tiles: TileOptions,
) -> _Ground:
    """Everything up to the samples of every tile."""
    read = runner.folder_step(
        read_streamed.NAME,
        stage_key(
            read_streamed.NAME,
            code_digest(read_streamed.__name__),
            {"max_points": max_points, "suffix": survey.suffix.lower()},
            {"file": file_key},
        ),
        lambda folder, context: read_streamed.run(survey, folder, context, max_points=max_points),
    )
    source = runner.work.path / read.name
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
    depth = poisson.depth_for(options.detail_depth, values["extent_m"], values["spacing_m"])
    warnings = []
    if depth < options.detail_depth:
        warnings.append(
            f"detail depth {depth} instead of {options.detail_depth}: there a cell is one sample "
            f"spacing ({values['spacing_m']:.3g} m); finer cells would only add noise"
        )
    lattice = _lattice(values, depth)
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
    return _Ground(read, cleaned, origin, values, lattice, plan, samples, forecast, tuple(warnings))


def _thinned(source: Path, read: StageRecord) -> Survey:
    """Every n-th sample or so of the survey as read, by the rule of ``--max-points``."""
    from terraport_pipeline.engines.raw_survey import thinning_rows

    total = len(NpyReader(source / "points.npy"))
    rows = thinning_rows(total, _THINNED_POINTS)

    def column(name: str) -> Any:
        parts = []
        for first, block in NpyReader(source / f"{name}.npy").blocks(1_000_000):
            if rows is None:
                parts.append(block)
            else:
                low, high = np.searchsorted(rows, (first, first + len(block)))
                parts.append(block[rows[low:high] - first])
        return np.concatenate(parts)

    crs = read.values["crs"]
    return Survey(
        column("points"),
        column("colours") if (source / "colours.npy").exists() else None,
        {name: column(f"attribute-{i}") for i, name in enumerate(read.values["attributes"])},
        Crs(**crs) if crs else None,
        read.values["format"],
    )


def _lattice(measured: dict[str, Any], depth: int) -> Lattice:
    """The lattice that a whole reconstruction would have had, about."""
    low, high = np.array(measured["low"]), np.array(measured["high"])
    side_m = poisson.SCALE * measured["extent_m"]
    anchor = (low + high) / 2 - side_m / 2
    return Lattice((float(anchor[0]), float(anchor[1]), float(anchor[2])), float(side_m / 2**depth))


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
    area_m2 = measured["points"] * measured["spacing_m"] ** 2
    found = choose_depth(
        lambda depth: plan_tiles(lattice, tile_shape(depth), blocks, counts, partition.BLOCK_CELLS),
        points=measured["points"],
        area_m2=area_m2,
        max_memory_bytes=runner.max_memory_bytes,
        asked=tiles.depth,
    )
    if found is None:
        raise ResourceError(
            f"{runner.max_memory_bytes / 2**30:.1f} GiB are too little even for the smallest "
            "tile; raise --max-memory to 2G or more"
        )
    plan = found
    return plan, forecast_tiles(
        plan, measured["points"], area_m2, runner.max_memory_bytes, runner.threads
    )


def _tasks(
    ground: _Ground, clean_options: clean.Options, options: reconstruct.Options
) -> list[solve_tile.TileTask]:
    plan, lattice = ground.plan, ground.lattice
    cleaned = ground.cleaned.value()
    raster = _raster(ground)
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
                origin=tuple(float(v) for v in ground.origin),  # type: ignore[arg-type]
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
                kept_ratio=max(_KEPT_RATIO, options.trim_spacings + 1.0),
                raster_low=raster.low,
                raster_cell_m=raster.cell_m,
                raster_shape=(raster.spacing_m.shape[0], raster.spacing_m.shape[1]),
            )
        )
    return tasks


def _raster(ground: _Ground) -> Occupancy:
    """The empty raster of the scene's footprint."""
    measured = ground.measured
    return plan_occupancy(
        np.array(measured["low"]), np.array(measured["high"]), measured["spacing_m"]
    )


def _solve(
    runner: StageRunner,
    ground: _Ground,
    tasks: list[solve_tile.TileTask],
    tiles: TileOptions,
) -> list[StageRecord]:
    """Reconstruct every tile that is not there yet, the largest first."""
    code = code_digest(solve_tile.__name__)
    folder = runner.work.path / ground.samples.name
    samples = ground.samples.values["samples"]
    records: dict[int, StageRecord] = {}
    jobs = []
    for tile, task in enumerate(tasks):
        key = stage_key(
            solve_name(tile), code, asdict(task), {"samples": f"{ground.samples.digest}-{tile}"}
        )
        record = runner.work.find(solve_name(tile), key) if runner.resume else None
        if record is not None:
            records[tile] = record
            continue
        if not runner.resume:
            runner.work.forget(solve_name(tile))
        file = folder / f"{partition.samples_name(tile)}.npy"
        limit = ground.forecast.tile_bytes * 2
        jobs.append(SolveJob(runner.work, tile, key, task, file, 1, limit))
    jobs.sort(key=lambda job: (-samples[job.tile], job.tile))
    taken_up = not jobs
    with Measure() as measure:
        if jobs:
            progress = runner.progress
            total = float(sum(samples[job.tile] for job in jobs))
            progress.start(
                f"tiles: {len(jobs)} of {len(tasks)}, {ground.forecast.workers} at a time",
                total,
                "points",
            )

            def done(number: int, record: StageRecord) -> None:
                records[jobs[number].tile] = record
                progress.advance(samples[jobs[number].tile])

            run_jobs(
                solve_one,
                jobs,
                workers=ground.forecast.workers,
                cluster=tiles.cluster,
                done=done,
            )
            progress.done({"tiles": len(jobs)})
    listed = [records[tile] for tile in range(len(tasks))]
    facts = Facts(
        {
            "tiles": len(tasks),
            "faces_solved": sum(int(r.values["faces_solved"]) for r in listed),
            "faces": sum(int(r.values["faces"]) for r in listed),
        }
    )
    seconds = sum(r.cost.seconds for r in listed) if taken_up else measure.seconds
    peak = max(r.cost.peak_bytes for r in listed) if taken_up else measure.peak_bytes
    runner.reports.append(StageReport("tiles", taken_up, Cost(seconds, peak), facts))
    return listed


@dataclass(frozen=True, slots=True)
class _Joined:
    facts: Facts


def _join(
    runner: StageRunner,
    ground: _Ground,
    tasks: list[solve_tile.TileTask],
    solved: list[StageRecord],
    options: reconstruct.Options,
    tiles: TileOptions,
) -> tuple[StoredTiles, _Joined]:
    """Weld, look, settle, finish."""
    work, plan = runner.work, ground.plan
    if not any(int(record.values["faces"]) for record in solved):
        raise SurveyError(
            "no surface lies near the samples of any tile; are they scattered in space rather "
            "than on a surface?"
        )
    key = stage_key(
        join_tiles.NAME,
        code_digest(joined_tile.__name__),
        {"trim_spacings": options.trim_spacings, "island_faces": options.island_faces},
        {solve_name(tile): record.digest for tile, record in enumerate(solved)},
    )
    workers = ground.forecast.workers

    def compute(context: Context) -> tuple[Stored, Facts]:
        arrays = [TileArrays(work.path / solve_name(tile)) for tile in range(plan.count)]
        borders = [_border(each) for each in arrays]
        context.progress.start("tiles: join", 2.0 * plan.count, "tiles")
        rule = join_tiles.edge_rule(
            arrays,
            _raster(ground),
            largest=options.trim_spacings,
            spacing_m=ground.measured["spacing_m"],
        )
        seams = weld_tiles(borders, plan.neighbours())
        names, codes = tasks[0].attributes, tasks[0].codes
        places = tuple(place for place, name in enumerate(names) if name in codes)
        join = join_tiles.Join.of(seams, arrays, len(names), places, rule)
        del arrays

        def each(function: Callable[[LookJob], T], join: join_tiles.Join, name: str) -> list[T]:
            """Look at every tile."""
            folder = context.scratch / name
            save_join(folder, join)
            jobs = [LookJob(work, tile, task, folder) for tile, task in enumerate(tasks)]
            found: dict[int, T] = {}

            def done(number: int, result: T) -> None:
                found[number] = result
                context.progress.advance(1.0)

            run_jobs(function, jobs, workers=workers, cluster=tiles.cluster, done=done)
            return [found[tile] for tile in range(plan.count)]

        join = join_tiles.forgive(join, each(find_weak, join, "weak"))
        settled = join_tiles.settle(
            each(look_at_tile, join, "look"), len(join.cells), min_faces=options.island_faces
        )
        facts = _seam_facts(seams, settled, rule)
        context.progress.done({"seam edges": settled.seam_edges, "cracks": settled.cracks})
        return join_tiles.to_stored(join, settled), facts

    joined = runner.step(
        join_tiles.NAME,
        key,
        compute,
        lambda result: result[1],
        lambda result: result[0],
        lambda stored, facts: (stored, facts),
    )
    joined.release()
    code = code_digest(joined_tile.__name__)
    jobs = [
        FinishJob(
            work,
            tile,
            stage_key(tile_name(tile), code, {"tile": tile}, {"join": joined.record.digest}),
            task,
            key,
        )
        for tile, task in enumerate(tasks)
    ]
    made: dict[int, StageRecord] = {}
    runner.progress.start("tiles: write", float(len(jobs)), "tiles")

    def finished(number: int, record: StageRecord) -> None:
        made[number] = record
        runner.progress.advance(1.0)

    waiting = []
    for tile, job in enumerate(jobs):
        record = work.find(tile_name(tile), job.key) if runner.resume else None
        if record is None:
            work.forget(tile_name(tile))
            waiting.append(job)
        else:
            made[tile] = record
    run_jobs(
        finish_tile,
        waiting,
        workers=workers,
        cluster=tiles.cluster,
        done=lambda number, record: finished(waiting[number].tile, record),
    )
    runner.progress.done({"tiles": len(jobs)})
    for stale in (*work.names("solve-"), *work.names("tile-")):
        if int(stale.split("-")[1]) >= plan.count:
            work.forget(stale)
    kept = [tile for tile in range(plan.count) if made[tile].values["faces"]]
    stored = StoredTiles(
        work.path,
        tuple(tile_name(tile) for tile in kept),
        np.array([made[tile].values["box"] for tile in kept], dtype=np.float64).reshape(-1, 6),
        tuple(int(made[tile].values["faces"]) for tile in kept),
        tuple(int(made[tile].values["vertices"]) for tile in kept),
        tasks[0].attributes,
        int(joined.record.facts.counts["shared_vertices"]),
        stage_key("tiles", "", {}, {tile_name(tile): made[tile].digest for tile in kept}),
    )
    return stored, _Joined(joined.record.facts)


def _border(arrays: TileArrays) -> TileBorder:
    return TileBorder(
        arrays["border-rows"],
        arrays["border-cells"],
        arrays["border-ratio"],
        arrays["border-edges"],
        arrays["border-walls"],
    )


def _seam_facts(seams: Seams, settled: join_tiles.Settled, rule: EdgeRule) -> Facts:
    gaps = seams.gaps if len(seams.gaps) else np.zeros(1)
    counts: dict[str, Any] = {
        "shared_vertices": len(seams.cells) + len(settled.pairs),
        "seam_edges": settled.seam_edges,
        "seam_cracks": settled.cracks,
        "seam_rims": settled.rims,
        "seam_fillers": sum(len(part) for part in seams.fillers),
        "seam_unmatched_vertices": seams.unmatched,
        "islands_dropped": settled.islands,
        "support_threshold": rule.threshold,
        "footprint_m2": rule.footprint.area_m2 if rule.footprint else 0.0,
    }
    for percentile in (50.0, 95.0, 99.0, 100.0):
        counts[f"seam_gap_p{percentile:g}_cells"] = float(np.percentile(gaps, percentile))
    warnings = ()
    if settled.cracks:
        warnings = (
            f"{settled.cracks} edges between tiles stay open; look at the seams in the report, "
            "and build with a larger --tile-depth if they show",
        )
    return Facts(counts, warnings)
