"""Reconstruction of a survey that does not fit into memory: thin, plan, tiles, join, base.

It begins with the survey's columns on disk (``read``). The steps, each a result in the work
directory:

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

from terraport_payload.types import Float32, Float64, UInt8
from terraport_pipeline.code_digest import code_digest
from terraport_pipeline.engines.tile_pool import TilePool
from terraport_pipeline.model import Crs, Mesh
from terraport_pipeline.stages import clean, reconstruct
from terraport_pipeline.stages.contract import Facts
from terraport_pipeline.stages.tiles import tiled_base
from terraport_pipeline.stages.tiles.detail_tiles import DetailTiles
from terraport_pipeline.workflow.photo_input import camera_samples
from terraport_pipeline.workflow.stage_runner import StageRunner
from terraport_pipeline.workflow.tile_ground import TileOptions, prepare, tile_tasks
from terraport_pipeline.workflow.tile_steps import join_all, solve_all
from terraport_pipeline.workflow.workdir import StageRecord, stage_key

__all__ = ["TileOptions", "TiledReconstructed", "run"]


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
    """Samples that the detail rests on: without copies and outliers."""
    samples: Float32
    """(N, 3) some of them, scene frame: what cameras are tried on."""
    sample_colours: UInt8 | None
    """(N, 3) theirs; None where the survey has none."""
    has_colour: bool
    codes: tuple[str, ...]
    spacing_m: float
    cell_m: float
    tile_depth: int
    digest: str
    """Hash of base and tiles."""


def run(
    runner: StageRunner,
    read: StageRecord,
    *,
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
    read : StageRecord
        The survey's columns on disk, from :func:`terraport_pipeline.workflow.read_step.read_once`.
    clean_options, options, tiles
        As of the build.
    check : callable
        Told the surface's attributes as soon as they are known; may refuse them.

    Returns
    -------
    TiledReconstructed

    Raises
    ------
    SurveyError
        The survey cannot be used.
    ResourceError
        Not even a small tile fits the memory allowed, or the disk is full.
    EngineError
        The solver failed twice on a tile, or a worker was lost twice.
    """
    # (1) Everything known before the first tile.
    ground = prepare(runner, read, clean_options, options, tiles)
    check(tuple(ground.cleaned.record.values["attributes"]))
    # (2) Solve and join tiles, in processes of their own.
    tasks = tile_tasks(ground, clean_options, options)
    with (
        runner.at(reconstruct.NAME),
        TilePool(ground.forecast.workers, tiles.cluster) as pool,
    ):
        solved = solve_all(runner, ground, tasks, pool)
        stored, joined = join_all(runner, ground, tasks, solved, options, pool)
    # (3) The base, from all tiles and the thinned cloud.
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
    # (4) Facts of all steps.
    base_result = base.value()
    ground.cleaned.release()
    crs = ground.read.values["crs"]
    counts = [record.values for record in solved]
    lost = sum(int(c["outliers"]) for c in counts)
    points = sum(int(c["core"]) for c in counts)  # without copies and outliers, as of the whole
    facts = Facts(
        {
            "points": points,
            "spacing_m": ground.measured["spacing_m"],
            "noise_m": ground.measured["noise_m"],
            "smoothing_m": tasks[0].smoothing_m,
            "cell_m": ground.lattice.cell_m,
            "tiles": stored.count,
            "detail_faces": sum(stored.faces),
            "detail_vertices": sum(stored.vertices),
            "outliers_with_margins": lost,
            **joined.counts,
            **base_result.facts.counts,
        },
        (*ground.warnings, *joined.warnings, *base_result.facts.warnings),
    )
    return TiledReconstructed(
        base_result.base,
        stored,
        base_result.deviation_m,
        facts,
        ground.origin,
        Crs(**crs) if crs else None,
        points,
        camera_samples(cleaned.cloud.points).copy(),
        camera_samples(cleaned.cloud.colours).copy() if cleaned.cloud.has_colour else None,
        cleaned.cloud.has_colour,
        cleaned.codes,
        float(ground.measured["spacing_m"]),
        ground.lattice.cell_m,
        ground.plan.shape.depth,
        stage_key("tiled", "", {}, {"base": base.record.digest, "tiles": stored.digest}),
    )
