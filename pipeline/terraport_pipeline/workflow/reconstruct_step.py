"""Reconstruction: samples handed out to tiles, each solved, all joined, and a base of them.

The stages, each kept in the work directory:

``measure_survey``  spacing and what is usual, in full density
``partition``       every tile's samples
``solve-00000``...  every tile's surface (side by side, or on a cluster)
``edges``           how much support ends the surface
``join``            what is shared
``weak-00000``...   every tile's weak places
``look-00000``...   every tile as it will be, but for what all of them settle
``settle``          that
``tile-00000``...   every tile as later stages read it
``base``            the base and its deviation
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from terraport_payload.types import Float32, UInt8
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.engines.tile_pool import TilePool
from terraport_pipeline.errors import SurveyError
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages import partition
from terraport_pipeline.stages.contract import Context, Facts, Stored
from terraport_pipeline.stages.tiles import (
    solve_tile,
    tiled_base,
)
from terraport_pipeline.stages.tiles.detail_tiles import DetailTiles, StoredTiles
from terraport_pipeline.stages.tiles.settle_tiles import Settled
from terraport_pipeline.stages.tiles.solve_tile import TileTask
from terraport_pipeline.workflow.join_step import join_solved, task_key
from terraport_pipeline.workflow.photo_input import camera_samples
from terraport_pipeline.workflow.runner import (
    Result,
    Runner,
    Stage,
    TileResults,
    TileStage,
    for_tiles,
)
from terraport_pipeline.workflow.tile_ground import Ground, tile_tasks
from terraport_pipeline.workflow.workdir import stage_key

__all__ = ["Reconstructed", "Surface", "reconstruct_tiles"]


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Two levels of one surface, the detail in tiles."""

    base: Mesh
    tiles: DetailTiles
    deviation_m: tuple[float, ...]
    """50th, 95th, 99th and 99.9th percentile of the distance of detail to base."""
    base_digest: str
    digest: str
    """Hash of base and tiles."""
    spacing_m: float = 0.0
    """Typical distance between the points; see :class:`pack.About`."""
    noise_m: float | None = None
    """Standard deviation of the points perpendicular to their surface; None for a mesh."""


@dataclass(frozen=True, slots=True, eq=False)
class Reconstructed:
    """The surface, and what later stages ask about the survey behind it."""

    surface: Surface
    facts: Facts
    points: int
    """Samples that the detail rests on: without copies and outliers."""
    samples: Float32
    """(N, 3) some of them, scene frame: what cameras are tried on."""
    sample_colours: UInt8 | None
    """(N, 3) theirs; None where the survey has none."""
    cell_m: float
    tile_depth: int


def reconstruct_tiles(runner: Runner, ground: Ground, cluster: str | None = None) -> Reconstructed:
    """Reconstruct a survey.

    Parameters
    ----------
    runner : Runner
    ground : Ground
        What is known before the first tile.
    cluster : str, optional
        Address of a Dask scheduler whose workers solve the tiles.

    Raises
    ------
    SurveyError
        The survey cannot be used.
    ResourceError
        The disk is full.
    EngineError
        The solver failed twice on a tile, or a worker was lost twice.
    """
    # (1) Solve and join tiles, in processes of their own where there are several.
    tasks, options = tile_tasks(ground), ground.options
    with TilePool(ground.forecast.workers if len(tasks) > 1 else 0, cluster) as pool:
        solved = _solve(runner, ground, tasks, pool)
        join, settled, finished = join_solved(runner, ground, tasks, solved, pool)
    tiles = _stored_tiles(runner, tasks, settled, finished, options.island_faces)
    join.release()
    # (2) The base, from all tiles and the thinned cloud.
    cleaned = ground.cleaned.value()
    share = tiled_base.first_share(tiles, options)
    thinned = runner.run_tiles(
        TileStage(
            "base-tile",
            tiled_base,
            "base: tiles",
            for_tiles(
                range(len(tasks)),
                lambda part, context: tiled_base.thin_tile(tiles, part, share, context),
            ),
            [{"tile": record.digest} for record in finished.records],
            [max(1, faces) for faces in tiles.base_faces],
            options={"share": share},
            bytes_per_unit=tiled_base.THIN_BYTES_PER_FACE,
        )
    )
    base = runner.run(
        Stage(
            tiled_base.NAME,
            tiled_base,
            lambda context: tiled_base.run(
                cleaned, tiles, thinned.every(), share, options, context
            ),
            tiled_base.FORM,
            asdict(options),
            {
                "tiles": tiles.digest, "thinned": thinned.digest, "cloud": ground.cleaned.digest,
            },
        )
    )  # fmt: skip
    base_result = base.value()
    # (3) Facts of all stages.
    counts = [record.values for record in solved.records]
    points = sum(int(c["core"]) for c in counts)
    facts = Facts(
        {
            "points": points,
            "spacing_m": ground.measured["spacing_m"],
            "noise_m": ground.measured["noise_m"],
            "smoothing_m": tasks[0].smoothing_m,
            "cell_m": ground.lattice.cell_m,
            "tiles": tiles.count,
            "detail_faces_solved": sum(int(c["faces_solved"]) for c in counts),
            "detail_faces": sum(tiles.faces),
            "detail_vertices": sum(tiles.vertices),
            "outliers_with_margins": sum(int(c["outliers"]) for c in counts),
            "shared_vertices": tiles.border_count,
            **join.record.facts.counts,
            **settled.record.facts.counts,
            **base_result.facts.counts,
        },
        choices=(*ground.choices, *settled.record.facts.choices, *base_result.facts.choices),
    )
    surface = Surface(
        base_result.base,
        tiles,
        base_result.deviation_m,
        base.digest,
        stage_key("surface", "", {}, {"base": base.digest, "tiles": tiles.digest}),
        float(ground.measured["spacing_m"]),
        float(ground.measured["noise_m"]),
    )
    cloud = cleaned.cloud
    reconstructed = Reconstructed(
        surface,
        facts,
        points,
        camera_samples(cloud.points).copy(),
        camera_samples(cloud.colours).copy() if cloud.has_colour else None,
        ground.lattice.cell_m,
        ground.plan.shape.depth,
    )
    ground.cleaned.release()
    return reconstructed


@dataclass(frozen=True, slots=True)
class _SolveTile:
    """Reconstruct one tile from its samples on disk."""

    task: TileTask
    samples: Path
    above: Path

    def __call__(self, context: Context) -> Stored:
        reader = NpyReader(self.samples)
        samples = reader.read(0, len(reader))
        return solve_tile.run(self.task, samples, np.load(self.above), context)


def _solve(
    runner: Runner, ground: Ground, tasks: Sequence[TileTask], pool: TilePool
) -> TileResults:
    """Reconstruct every tile by itself."""
    folder = runner.work.path / ground.samples.name
    paths = [
        (
            folder / f"{partition.samples_name(tile)}.npy",
            folder / f"{partition.above_name(tile)}.npy",
        )
        for tile in range(len(tasks))
    ]
    return runner.run_tiles(
        TileStage(
            "solve",
            solve_tile,
            f"tiles: solve {len(tasks)}, {min(pool.workers, len(tasks))} at a time",
            [_SolveTile(task, *files) for task, files in zip(tasks, paths, strict=True)],
            [
                {"task": task_key(task), "samples": digest}
                for task, digest in zip(tasks, ground.samples.values["digests"], strict=True)
            ],
            ground.samples.values["samples"],
            "points",
            forecast_s=ground.forecast.seconds,
        ),
        pool,
    )


def _stored_tiles(
    runner: Runner,
    tasks: Sequence[TileTask],
    settled: Result[Settled],
    finished: TileResults,
    island_faces: int,
) -> StoredTiles:
    """Give the tiles that have a surface, as later stages read them."""
    kept = [tile for tile, record in enumerate(finished.records) if record.values["faces"]]
    if not kept:
        raise SurveyError(
            f"no surface is left: every piece of it has fewer than {island_faces} faces, or "
            "stands beside the samples; are the points of one surface? lower --island-faces to see"
        )
    values = [record.values for record in finished.records]
    ids = settled.value().ids
    return StoredTiles(
        runner.work.path,
        tuple(finished.records[tile].name for tile in kept),
        np.array([values[tile]["box"] for tile in kept], dtype=np.float64).reshape(-1, 6),
        tuple(int(values[tile]["faces"]) for tile in kept),
        tuple(int(values[tile]["vertices"]) for tile in kept),
        tuple(finished.records[tile].digest for tile in kept),
        tasks[0].attributes,
        settled.value().count,
        tuple(ids[tile] for tile in kept),
        finished.digest,
        tuple(record.name for record in finished.records),
        tuple(int(value["base_faces"]) for value in values),
    )
