"""The join: tiles that were solved, each by itself, become pieces of one surface.

Runs the passes of :mod:`~terraport_pipeline.stages.tiles.join_tiles`. Over a scene that is there,
what an earlier join decided of tiles that are as they were is held.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any, Self

import numpy as np

from terraport_payload.types import AnyArray, Float64
from terraport_pipeline.engines.tile_pool import TilePool
from terraport_pipeline.errors import SurveyError, WorkDirectoryError
from terraport_pipeline.geometry.clouds.edges import EdgeRule
from terraport_pipeline.geometry.tiles.tile_weld import HeldBorder, Seams, TileBorder, weld_tiles
from terraport_pipeline.stages.contract import STORED, Context, Facts, Stored
from terraport_pipeline.stages.tiles import (
    join_tiles,
    joined_tile,
    settle_tiles,
    tile_edges,
)
from terraport_pipeline.stages.tiles.join_tiles import Join, TileJoin
from terraport_pipeline.stages.tiles.settle_tiles import Forgiven, Look, Settled, SettledTile, Weak
from terraport_pipeline.stages.tiles.solve_tile import TileTask
from terraport_pipeline.stages.tiles.tile_edges import edge_rules, end_of_support
from terraport_pipeline.workflow.runner import (
    Result,
    Runner,
    Stage,
    TileResults,
    TileStage,
)
from terraport_pipeline.workflow.tile_ground import Ground
from terraport_pipeline.workflow.workdir import stage_key

__all__ = ["join_solved", "task_key"]


def task_key(task: TileTask) -> str:
    """Say by one text what a tile's stages are told, for their keys."""
    return stage_key("", "", asdict(task), {})


def join_solved(
    runner: Runner,
    ground: Ground,
    tasks: Sequence[TileTask],
    solved: TileResults,
    pool: TilePool,
) -> tuple[Result[Join], Result[Settled], TileResults]:
    """Weld the tiles, settle what only all of them decide, write them.

    Parameters
    ----------
    runner : Runner
    ground : Ground
    tasks : sequence of TileTask
        Of every tile.
    solved : TileResults
        Every tile's own surface.
    pool : TilePool
        Who works on the tiles.

    Returns
    -------
    join, settled
        What is shared; what all tiles decided.
    tiles : TileResults
        Every tile as later stages read it.

    Raises
    ------
    SurveyError
        No tile has a surface.
    """
    # (1) Borders of all tiles welded; the edge, from the support of all samples.
    options = ground.options
    faces = [int(record.values["faces"]) for record in solved.records]
    if not any(faces):
        raise SurveyError(
            f"no surface lies within {options.trim_spacings:g} spacings of the samples; are they "
            "scattered in space rather than on a surface? raise --trim-spacings to see"
        )
    edges = runner.run(
        Stage(
            "edges",
            tile_edges,
            lambda _: Stored(
                {}, {"threshold": end_of_support(_arrays(solved), options.trim_spacings)}
            ),
            STORED,
            {"largest": options.trim_spacings},
            {"solved": solved.digest},
            is_decision=True,
        )
    )
    before = _Earlier.of(runner, "join")
    welded = runner.run(
        Stage(
            join_tiles.NAME,
            joined_tile,
            lambda _: _weld(
                ground, tasks, solved, float(edges.value().values["threshold"]), before
            ),
            join_tiles.JOIN_FORM,
            {"largest": options.trim_spacings},
            {"solved": solved.digest, "edges": edges.digest, **before.input},
            also=(tile_edges,),
            is_remembered=True,
        )
    )
    join = welded.value()
    # (2) What it says of every tile, in numbers of the tile's own.
    numbers = range(len(tasks))
    joins = [join.tile(tile, *_core_m(ground, tile)) for tile in numbers]
    inputs = [
        {"task": task_key(task), "solved": record.digest, "join": each.digest()}
        for task, record, each in zip(tasks, solved.records, joins, strict=True)
    ]
    jobs = [_TileJob(task, solved.folder(t), joins[t]) for t, task in enumerate(tasks)]

    def tile_stage(
        name: str,
        code: ModuleType,
        title: str,
        run: Sequence[Callable[[Context], Stored]],
        inputs: Sequence[Mapping[str, str]],
    ) -> TileStage:
        return TileStage(name, code, title, run, inputs, [max(1, n) for n in faces])

    # (3) Weak places that reach across walls stay or go as one; then loose pieces.
    weak = runner.run_tiles(
        tile_stage(
            "weak", joined_tile, "tiles: weak places", [_WeakPlaces(job) for job in jobs], inputs
        ),
        pool,
    )
    forgiven = settle_tiles.forgive(join, [_weak_of(stored) for stored in weak.every()])
    inputs = [
        {**each, "forgiven": stays.digest()} for each, stays in zip(inputs, forgiven, strict=True)
    ]
    looks = runner.run_tiles(
        tile_stage(
            "look", joined_tile, "tiles: join",
            [_Look(job, stays) for job, stays in zip(jobs, forgiven, strict=True)], inputs,
        ),
        pool,
    )  # fmt: skip
    before = _Earlier.of(runner, "settle")
    settled = runner.run(
        Stage(
            "settle",
            joined_tile,
            lambda _: _settle(join, looks, options.island_faces, before),
            settle_tiles.SETTLED_FORM,
            {"island_faces": options.island_faces},
            {"join": welded.digest, "looks": looks.digest, **before.input},
            is_remembered=True,
        )
    )
    # (4) Every tile as later stages read it.
    finished = runner.run_tiles(
        tile_stage(
            "tile",
            joined_tile,
            "tiles: write",
            [
                _Finish(job, stays, tile)
                for job, stays, tile in zip(jobs, forgiven, settled.value().tiles, strict=True)
            ],
            [
                {**each, "settled": tile.digest()}
                for each, tile in zip(inputs, settled.value().tiles, strict=True)
            ],
        ),
        pool,
    )
    return welded, settled, finished


@dataclass(frozen=True, slots=True)
class _Earlier:
    """What was decided for all tiles of the scene before, where there is one."""

    stored: Stored | None = None
    input: Mapping[str, str] = field(default_factory=dict)
    """For the key of what is decided now."""

    @classmethod
    def of(cls, runner: Runner, name: str) -> Self:
        """Open a decision of the scene before."""
        record = None if runner.before is None else runner.before.find(name)
        if runner.before is None or record is None:
            return cls()
        return cls(runner.before.work.looked_up(record), {"before": record.digest})


def _same(before: Sequence[str], now: Sequence[str]) -> list[int]:
    """Tiles whose hash is what it was."""
    return [tile for tile, (a, b) in enumerate(zip(before, now, strict=False)) if a == b]


def _weld(
    ground: Ground,
    tasks: Sequence[TileTask],
    solved: TileResults,
    threshold: float,
    before: _Earlier,
) -> Join:
    """Weld the borders of all tiles."""
    # (1) Where the surface ends; what tiles that are as they were shared.
    arrays, options, plan = _arrays(solved), ground.options, ground.plan
    rules = edge_rules(
        arrays,
        ground.raster,
        threshold=threshold,
        largest=options.trim_spacings,
        spacing_m=ground.measured["spacing_m"],
    )
    digests = tuple(record.digest for record in solved.records)
    held: dict[int, TileJoin] = {}
    if before.stored is not None:
        earlier = join_tiles.JOIN_FORM.restore(before.stored, Facts())
        if len(earlier.attributes) == len(tasks[0].attributes):
            held = {
                tile: earlier.tile(tile, *_core_m(ground, tile))
                for tile in _same(earlier.solved, digests)
            }
    # (2) The seams.
    seams = weld_tiles(
        [_border(each) for each in arrays],
        plan.neighbours(),
        {
            tile: HeldBorder(
                join.rows, join.cells, join.ratio, join.fillers, plan.core(tile), rules[0].largest
            )
            for tile, join in held.items()
        },
    )
    names, codes = tasks[0].attributes, tasks[0].codes
    code_positions = tuple(position for position, name in enumerate(names) if name in codes)
    facts = _seam_facts(seams, rules[0])
    return Join.of(seams, arrays, len(names), code_positions, rules, facts, digests, held)


def _settle(join: Join, looks: TileResults, island_faces: int, before: _Earlier) -> Settled:
    """Settle what only all tiles decide."""
    digests = tuple(record.digest for record in looks.records)
    held: dict[int, SettledTile] = {}
    if before.stored is not None:
        earlier = settle_tiles.SETTLED_FORM.restore(before.stored, Facts())
        held = {tile: earlier.tiles[tile] for tile in _same(earlier.looks, digests)}
    return settle_tiles.settle(
        join, [Look.of(stored) for stored in looks.every()],
        min_faces=island_faces, digests=digests, held=held,
    )  # fmt: skip


def _core_m(ground: Ground, tile: int) -> tuple[Float64, Float64]:
    """Box of a tile's core, scene frame."""
    low, high = (
        np.array(ground.lattice.anchor_m) + corner * ground.lattice.cell_m
        for corner in ground.plan.core(tile)
    )
    return low, high


@dataclass(frozen=True, slots=True)
class _TileJob:
    """What every pass of the join needs of a tile; pickled to its worker."""

    task: TileTask
    solved: Path
    join: TileJoin


@dataclass(frozen=True, slots=True)
class _WeakPlaces:
    """Find the weak places of a tile."""

    job: _TileJob

    def __call__(self, _context: Context) -> Stored:
        job = self.job
        weak = joined_tile.weak_places(job.task, _TileArrays(job.solved), job.join)
        return Stored({"farthest": weak.farthest, "touch": weak.touch}, {})


@dataclass(frozen=True, slots=True)
class _Look:
    """Find everything else that must be settled over all tiles."""

    job: _TileJob
    forgiven: Forgiven

    def __call__(self, _context: Context) -> Stored:
        job = self.job
        return joined_tile.look(job.task, _TileArrays(job.solved), job.join, self.forgiven).stored()


@dataclass(frozen=True, slots=True)
class _Finish:
    """Write one tile as it is after the join."""

    job: _TileJob
    forgiven: Forgiven
    settled: SettledTile

    def __call__(self, _context: Context) -> Stored:
        job = self.job
        arrays, box = joined_tile.finish(
            job.task, _TileArrays(job.solved), job.join, self.forgiven, self.settled
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


def _arrays(tiles: TileResults) -> list[Mapping[str, AnyArray]]:
    return [stored.arrays for stored in tiles.every()]


def _weak_of(stored: Stored) -> Weak:
    return Weak(np.array(stored.arrays["farthest"]), np.array(stored.arrays["touch"]))


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


def _seam_facts(seams: Seams, rule: EdgeRule) -> Facts:
    gaps = seams.gaps if len(seams.gaps) else np.zeros(1)
    counts: dict[str, Any] = {
        "seam_fillers": sum(len(fillers) for fillers in seams.fillers),
        "seam_unmatched_vertices": seams.unmatched,
        "support_threshold": rule.threshold,
        "footprint_m2": rule.footprint.area_m2 if rule.footprint else 0.0,
    }
    for percentile in (50.0, 95.0, 99.0, 100.0):
        counts[f"seam_gap_p{percentile:g}_cells"] = float(np.percentile(gaps, percentile))
    return Facts(counts)
