"""The steps that work on tiles: solve each, join all, write each.

The results lie in the work directory, one per tile; these functions find out what is missing, hand
it to processes, and put together what the join needs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any, TypeVar

import numpy as np

from terraport_pipeline.code_digest import code_digest
from terraport_pipeline.engines.tile_pool import TilePool
from terraport_pipeline.errors import SurveyError
from terraport_pipeline.geometry.clouds.edges import EdgeRule
from terraport_pipeline.geometry.tiles.tile_weld import Seams, TileBorder, weld_tiles
from terraport_pipeline.measure import Measure
from terraport_pipeline.stages import partition, reconstruct
from terraport_pipeline.stages.contract import Context, Facts, Stored
from terraport_pipeline.stages.tiles import join_tiles, joined_tile, solve_tile
from terraport_pipeline.stages.tiles.detail_tiles import StoredTiles
from terraport_pipeline.stages.tiles.tile_edges import edge_rules
from terraport_pipeline.workflow.report import StageReport
from terraport_pipeline.workflow.stage_runner import StageRunner
from terraport_pipeline.workflow.tile_ground import Ground, raster_of
from terraport_pipeline.workflow.tile_jobs import (
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
from terraport_pipeline.workflow.workdir import Cost, StageRecord, stage_key

__all__ = ["join_all", "solve_all"]

T = TypeVar("T")


def solve_all(
    runner: StageRunner,
    ground: Ground,
    tasks: list[solve_tile.TileTask],
    pool: TilePool,
) -> list[StageRecord]:
    """Reconstruct every tile that is not there yet, the largest first."""
    # (1) What is there already; jobs for the rest.
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
    # (2) The largest first: a large one started last would leave cores idle.
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

            pool.run(solve_one, jobs, done)
            progress.done({"tiles": len(jobs)})
    # (3) Facts and cost; of results taken up, what they took when they were made.
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


def join_all(
    runner: StageRunner,
    ground: Ground,
    tasks: list[solve_tile.TileTask],
    solved: list[StageRecord],
    options: reconstruct.Options,
    pool: TilePool,
) -> tuple[StoredTiles, Facts]:
    """Weld the tiles, settle what only all of them decide, and write each as it will be."""
    # (1) Nothing to join: say so before anything is decided.
    work, plan = runner.work, ground.plan
    if not any(int(record.values["faces"]) for record in solved):
        raise SurveyError(
            "no surface lies near the samples of any tile; are they scattered in space rather "
            "than on a surface?"
        )
    # (2) What is decided for all tiles together: edge, welding, islands; see :mod:`.join_tiles`.
    key = stage_key(
        join_tiles.NAME,
        code_digest(joined_tile.__name__),
        {"trim_spacings": options.trim_spacings, "island_faces": options.island_faces},
        {solve_name(tile): record.digest for tile, record in enumerate(solved)},
    )

    def compute(context: Context) -> tuple[Stored, Facts]:
        arrays = [TileArrays(work.path / solve_name(tile)) for tile in range(plan.count)]
        borders = [_border(each) for each in arrays]
        context.progress.start("tiles: join", 2.0 * plan.count, "tiles")
        rules = edge_rules(
            arrays,
            raster_of(ground),
            largest=options.trim_spacings,
            spacing_m=ground.measured["spacing_m"],
        )
        seams = weld_tiles(borders, plan.neighbours())
        names, codes = tasks[0].attributes, tasks[0].codes
        code_positions = tuple(position for position, name in enumerate(names) if name in codes)
        join = join_tiles.Join.of(seams, arrays, len(names), code_positions, rules)
        del arrays

        def each(function: Callable[[LookJob], T], join: join_tiles.Join, name: str) -> list[T]:
            """Run a function over every tile in the pool; results in order of the tiles."""
            folder = context.scratch / name
            save_join(folder, join)
            jobs = [LookJob(work, tile, task, folder) for tile, task in enumerate(tasks)]
            results: dict[int, T] = {}

            def done(number: int, result: T) -> None:
                results[number] = result
                context.progress.advance(1.0)

            pool.run(function, jobs, done)
            return [results[tile] for tile in range(plan.count)]

        join = join_tiles.forgive(join, each(find_weak, join, "weak"))
        settled = join_tiles.settle(
            each(look_at_tile, join, "look"), len(join.cells), min_faces=options.island_faces
        )
        facts = _seam_facts(seams, settled, rules[0])
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
    # (3) Write every tile as it will be.
    code = code_digest(joined_tile.__name__)
    jobs = [
        FinishJob(
            work,
            tile,
            stage_key(
                tile_name(tile),
                code,
                {"tile": tile},
                # The join holds what is shared: other colours inside a tile leave it as it is.
                {"join": joined.record.digest, "solved": solved[tile].digest},
            ),
            task,
            key,
        )
        for tile, task in enumerate(tasks)
    ]
    records: dict[int, StageRecord] = {}
    runner.progress.start("tiles: write", float(len(jobs)), "tiles")

    def finished(number: int, record: StageRecord) -> None:
        records[number] = record
        runner.progress.advance(1.0)

    waiting = []
    for tile, job in enumerate(jobs):
        record = work.find(tile_name(tile), job.key) if runner.resume else None
        if record is None:
            work.forget(tile_name(tile))
            waiting.append(job)
        else:
            records[tile] = record
    pool.run(
        finish_tile,
        waiting,
        lambda number, record: finished(waiting[number].tile, record),
    )
    runner.progress.done({"tiles": len(jobs)})
    # (4) Forget what an earlier plan with more tiles left; keep the tiles with faces.
    for stale in (*work.names("solve-"), *work.names("tile-")):
        if int(stale.split("-")[1]) >= plan.count:
            work.forget(stale)
    kept = [tile for tile in range(plan.count) if records[tile].values["faces"]]
    stored = StoredTiles(
        work.path,
        tuple(tile_name(tile) for tile in kept),
        np.array([records[tile].values["box"] for tile in kept], dtype=np.float64).reshape(-1, 6),
        tuple(int(records[tile].values["faces"]) for tile in kept),
        tuple(int(records[tile].values["vertices"]) for tile in kept),
        tasks[0].attributes,
        int(joined.record.facts.counts["shared_vertices"]),
        stage_key(
            "tiles", "", {}, {tile_name(tile): records[tile].digest for tile in range(plan.count)}
        ),
        tuple(tile_name(tile) for tile in range(plan.count)),
        tuple(int(records[tile].values["base_faces"]) for tile in range(plan.count)),
    )
    return stored, joined.record.facts


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
        "seam_fillers": sum(len(fillers) for fillers in seams.fillers),
        "seam_unmatched_vertices": seams.unmatched,
        "islands_dropped": settled.islands,
        "support_threshold": rule.threshold,
        "footprint_m2": rule.footprint.area_m2 if rule.footprint else 0.0,
    }
    for percentile in (50.0, 95.0, 99.0, 100.0):
        counts[f"seam_gap_p{percentile:g}_cells"] = float(np.percentile(gaps, percentile))
    warnings: list[str] = []
    if settled.cracks:
        warnings.append(
            f"{settled.cracks} edges between tiles stay open; look at the seams in the report, "
            "and build with a larger --tile-depth if they show"
        )
    return Facts(counts, tuple(warnings))
