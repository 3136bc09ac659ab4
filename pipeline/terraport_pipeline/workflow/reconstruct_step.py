"""Reconstruction: samples handed out to tiles, each solved, all joined, and a base of them.

The stages, each kept in the work directory:

``measure_survey``  spacing and what is usual, in full density
``partition``       every tile's samples
``solve-00000``...  every tile's surface (side by side, or on a cluster)
``join``            what is shared
``tile-00000``...   every tile as later stages read it
``base``            the base and its deviation
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from terraport_payload.types import AnyArray, Float32, UInt8
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.engines.tile_pool import TilePool
from terraport_pipeline.errors import SurveyError, WorkDirectoryError
from terraport_pipeline.geometry.clouds.edges import EdgeRule
from terraport_pipeline.geometry.tiles.tile_weld import Seams, TileBorder, weld_tiles
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages import partition
from terraport_pipeline.stages.contract import Context, Facts, Form, Stored
from terraport_pipeline.stages.tiles import join_tiles, joined_tile, solve_tile, tiled_base
from terraport_pipeline.stages.tiles.detail_tiles import DetailTiles, StoredTiles
from terraport_pipeline.stages.tiles.join_tiles import Join, Look, Settled, Weak
from terraport_pipeline.stages.tiles.solve_tile import TileTask
from terraport_pipeline.stages.tiles.tile_edges import edge_rules
from terraport_pipeline.workflow.photo_input import camera_samples
from terraport_pipeline.workflow.runner import Result, Runner, Stage, TileResults, TileStage
from terraport_pipeline.workflow.tile_ground import Ground, raster_of, tile_tasks
from terraport_pipeline.workflow.workdir import StageRecord, WorkDirectory, stage_key

__all__ = ["Reconstructed", "Surface", "reconstruct_tiles"]

T = TypeVar("T")


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
        joined = _join(runner, ground, tasks, solved, pool)
        tiles = _finish(runner, tasks, solved, joined, pool)
    # (2) The base, from all tiles and the thinned cloud.
    cleaned = ground.cleaned.value()
    base = runner.run(
        Stage(
            tiled_base.NAME,
            tiled_base,
            lambda context: tiled_base.run(cleaned, tiles, options, context),
            tiled_base.FORM,
            asdict(options),
            {"tiles": tiles.digest, "cloud": ground.cleaned.digest},
        )
    )
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
            **joined.record.facts.counts,
            **base_result.facts.counts,
        },
        (*ground.warnings, *joined.record.facts.warnings, *base_result.facts.warnings),
    )
    surface = Surface(
        base_result.base,
        tiles,
        base_result.deviation_m,
        base.digest,
        stage_key("surface", "", {}, {"base": base.digest, "tiles": tiles.digest}),
        float(ground.measured["spacing_m"]),
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

    def __call__(self, context: Context) -> Stored:
        reader = NpyReader(self.samples)
        return solve_tile.run(self.task, reader.read(0, len(reader)), context)


def _solve(
    runner: Runner, ground: Ground, tasks: Sequence[TileTask], pool: TilePool
) -> TileResults:
    """Reconstruct every tile by itself."""
    folder = runner.work.path / ground.samples.name
    return runner.run_tiles(
        TileStage(
            "solve",
            solve_tile,
            f"tiles: solve {len(tasks)}, {min(pool.workers, len(tasks))} at a time",
            [
                _SolveTile(task, folder / f"{partition.samples_name(tile)}.npy")
                for tile, task in enumerate(tasks)
            ],
            [
                {"task": stage_key("", "", asdict(task), {}), "samples": digest}
                for task, digest in zip(tasks, ground.samples.values["digests"], strict=True)
            ],
            ground.samples.values["samples"],
            "points",
            forecast_s=ground.forecast.seconds,
        ),
        pool,
    )


_Joined = tuple[Join, Settled, Facts]


def _join(
    runner: Runner,
    ground: Ground,
    tasks: Sequence[TileTask],
    solved: TileResults,
    pool: TilePool,
) -> Result[_Joined]:
    """Weld the tiles and settle what only all of them decide; see :mod:`.join_tiles`."""
    options = ground.options
    if not any(int(record.values["faces"]) for record in solved.records):
        raise SurveyError(
            f"no surface lies within {options.trim_spacings:g} spacings of the samples; are they "
            "scattered in space rather than on a surface? raise --trim-spacings to see"
        )
    folders = [solved.folder(tile) for tile in range(len(tasks))]

    def compute(context: Context) -> _Joined:
        # (1) Borders of all tiles welded; the edge, from the support of all samples.
        arrays = [stored.arrays for stored in solved.every()]
        context.progress.start("tiles: join", 2.0 * len(tasks), "tiles")
        rules = edge_rules(
            arrays,
            raster_of(ground),
            largest=options.trim_spacings,
            spacing_m=ground.measured["spacing_m"],
        )
        seams = weld_tiles([_border(each) for each in arrays], ground.plan.neighbours())
        names, codes = tasks[0].attributes, tasks[0].codes
        code_positions = tuple(position for position, name in enumerate(names) if name in codes)
        join = Join.of(seams, arrays, len(names), code_positions, rules)
        del arrays

        def each(function: Callable[[_LookAtTile], T], join: Join, name: str) -> list[T]:
            """Run a function over every tile in the pool; results in order of the tiles."""
            path = context.scratch / name
            path.write_bytes(pickle.dumps(join))  # once, not once a job
            jobs = [
                _LookAtTile(tile, task, folder, path)
                for tile, (task, folder) in enumerate(zip(tasks, folders, strict=True))
            ]
            results: dict[int, T] = {}

            def done(number: int, result: T) -> None:
                results[number] = result
                context.progress.advance(1.0)

            pool.run(function, jobs, done)
            return [results[tile] for tile in range(len(tasks))]

        # (2) Weak places that reach across walls stay or go as one; then loose pieces.
        join = join_tiles.forgive(join, each(_weak_places, join, "weak"))
        settled = join_tiles.settle(
            each(_look, join, "look"), len(join.cells), min_faces=options.island_faces
        )
        facts = _seam_facts(seams, settled, rules[0])
        context.progress.done({"seam edges": settled.seam_edges, "cracks": settled.cracks})
        return join, settled, facts

    return runner.run(
        Stage(
            join_tiles.NAME,
            joined_tile,
            compute,
            Form(
                lambda result: join_tiles.to_stored(result[0], result[1]),
                lambda stored, facts: (*join_tiles.from_stored(stored), facts),
                lambda result: result[2],
            ),
            {"trim_spacings": options.trim_spacings, "island_faces": options.island_faces},
            {"solved": solved.digest},
        )
    )


@dataclass(frozen=True, slots=True)
class _FinishTile:
    """Write one tile as it is after the join."""

    tile: int
    task: TileTask
    solved: Path
    work: WorkDirectory
    join: StageRecord

    def __call__(self, _context: Context) -> Stored:
        join, settled = join_tiles.from_stored(self.work.load(self.join))
        arrays, box = joined_tile.finish(
            self.task, self.tile, _TileArrays(self.solved), join, settled
        )
        return Stored(
            arrays,
            {
                "faces": len(arrays["faces"]),
                "vertices": len(arrays["vertices"]),
                "base_faces": len(arrays["base-faces"]),
                "box": [float(side) for side in box],
            },
        )


def _finish(
    runner: Runner,
    tasks: Sequence[TileTask],
    solved: TileResults,
    joined: Result[_Joined],
    pool: TilePool,
) -> StoredTiles:
    """Write every tile as later stages read it."""
    joined.release()
    finished = runner.run_tiles(
        TileStage(
            "tile",
            joined_tile,
            "tiles: write",
            [
                _FinishTile(tile, task, solved.folder(tile), runner.work, joined.record)
                for tile, task in enumerate(tasks)
            ],
            # The join holds what is shared: other colours inside a tile leave it as it is.
            [{"join": joined.digest, "solved": record.digest} for record in solved.records],
            [max(1, int(record.values["faces"])) for record in solved.records],
        ),
        pool,
    )
    kept = [tile for tile, record in enumerate(finished.records) if record.values["faces"]]
    values = [record.values for record in finished.records]
    return StoredTiles(
        runner.work.path,
        tuple(finished.records[tile].name for tile in kept),
        np.array([values[tile]["box"] for tile in kept], dtype=np.float64).reshape(-1, 6),
        tuple(int(values[tile]["faces"]) for tile in kept),
        tuple(int(values[tile]["vertices"]) for tile in kept),
        tuple(finished.records[tile].digest for tile in kept),
        tasks[0].attributes,
        int(joined.record.facts.counts["shared_vertices"]),
        finished.digest,
        tuple(record.name for record in finished.records),
        tuple(int(value["base_faces"]) for value in values),
    )


@dataclass(frozen=True, slots=True)
class _LookAtTile:
    """Look at a tile as it will be after the join."""

    tile: int
    task: TileTask
    solved: Path
    join: Path
    """A pickled :class:`.Join`."""

    def loaded(self) -> Join:
        join: Join = pickle.loads(self.join.read_bytes())  # noqa: S301 - this build wrote it
        return join


def _weak_places(job: _LookAtTile) -> Weak:
    """Find the weak places of a tile; runs in a worker."""
    return joined_tile.weak_places(job.task, job.tile, _TileArrays(job.solved), job.loaded())


def _look(job: _LookAtTile) -> Look:
    """Find everything else that the join must know of a tile; runs in a worker."""
    return joined_tile.look(job.task, job.tile, _TileArrays(job.solved), job.loaded())


class _TileArrays(dict[str, AnyArray]):
    """Arrays of a result by name, each read when it is asked for."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder = folder

    def __missing__(self, name: str) -> AnyArray:
        try:
            self[name] = np.load(self._folder / f"{name}.npy", allow_pickle=False)
        except (OSError, ValueError, EOFError) as error:
            raise WorkDirectoryError(
                f"{self._folder / name}.npy cannot be read ({error}); build again with --no-resume"
            ) from None
        return self[name]


def _border(arrays: Mapping[str, AnyArray]) -> TileBorder:
    return TileBorder(
        arrays["border-rows"],
        arrays["border-cells"],
        arrays["border-ratio"],
        arrays["border-edges"],
        arrays["border-walls"],
    )


def _seam_facts(seams: Seams, settled: Settled, rule: EdgeRule) -> Facts:
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
