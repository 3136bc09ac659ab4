"""Steps of a tiled build: one result per tile in the work directory, several tiles at a time.

Every tile's result is a stage of its own (``NAME-0007``) with its own key, so a build that was
interrupted goes on with the tile it was at.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Final

import psutil

from terraport_pipeline.code_digest import code_digest
from terraport_pipeline.measure import Measure
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.stages.contract import Context, Facts, Stored
from terraport_pipeline.workflow.stage_runner import StageRunner
from terraport_pipeline.workflow.workdir import Cost, StageRecord, stage_key

__all__ = ["TilePass", "run_pass", "tiles_at_once"]

_BASE_BYTES: Final = 300 * 2**20
"""What the process takes beside tiles: interpreter, libraries, compiled kernels, base mesh."""


@dataclass(frozen=True, slots=True)
class TilePass:
    """One pass over all tiles: its key per tile, its size, its need of memory."""

    name: str
    module: str
    """Where its code stands, for the keys."""
    title: str
    """Title of the step on the progress bar."""
    options: Mapping[str, Any]
    inputs: Sequence[Mapping[str, str]]
    """For every tile the digests of what goes in."""
    faces: Sequence[int]
    """Of every tile: what progress and memory go by."""
    bytes_per_face: int
    """Memory that computing a tile takes, with the tile."""
    shared_bytes: int = 0
    """Memory that all tiles together take beside that, and do not hold yet."""


@dataclass(frozen=True, slots=True)
class PassResult:
    """Records of a pass's results, one a tile, and what the pass cost."""

    records: tuple[StageRecord, ...]
    taken_up: bool
    """All of them were there."""
    cost: Cost


def tiles_at_once(faces: int, bytes_per_face: int, context: Context, shared_bytes: int = 0) -> int:
    """Say how many tiles of so many faces fit into memory beside each other, at least 1."""
    if context.max_memory_bytes is None:
        return context.threads
    held = max(_BASE_BYTES, int(psutil.Process().memory_info().rss))
    room = context.max_memory_bytes - held - shared_bytes
    return max(1, min(context.threads, room // max(1, faces * bytes_per_face)))


def run_pass(
    runner: StageRunner, chosen: TilePass, compute: Callable[[int, Context], Stored]
) -> PassResult:
    """Compute and keep every tile's result that is not there yet.

    Parameters
    ----------
    runner : StageRunner
    chosen : TilePass
    compute : callable
        Gets the tile and what it may use. Called from several threads, for different tiles.

    Returns
    -------
    PassResult
        The records in order of the tiles, whatever the order of the work.
    """
    # (1) What is there already, by key; what an earlier build with more tiles left is deleted.
    code = code_digest(chosen.module)
    keys = [stage_key(chosen.name, code, chosen.options, digests) for digests in chosen.inputs]
    names = [f"{chosen.name}-{tile:04d}" for tile in range(len(keys))]
    records = {
        tile: record
        for tile, (name, key) in enumerate(zip(names, keys, strict=True))
        if runner.resume and (record := runner.work.find(name, key)) is not None
    }
    for stale in set(runner.work.names(f"{chosen.name}-")) - set(names):
        runner.work.forget(stale)  # of a build with more tiles
    left = [tile for tile in range(len(keys)) if tile not in records]
    if not left:
        kept = [records[tile] for tile in range(len(keys))]
        return PassResult(
            tuple(kept),
            True,
            Cost(
                sum(record.cost.seconds for record in kept),
                max((record.cost.peak_bytes for record in kept), default=0),
            ),
        )
    # (2) As many tiles at once as fit into memory, the threads shared among them.
    progress = runner.progress
    progress.start(chosen.title, float(sum(chosen.faces[tile] for tile in left)), "faces")
    with runner.at(chosen.name), Measure() as measure, runner.work.scratch() as scratch:
        context = replace(runner.context(scratch), progress=NullProgress())
        largest = max(chosen.faces[tile] for tile in left)
        workers = tiles_at_once(largest, chosen.bytes_per_face, context, chosen.shared_bytes)
        each = replace(context, threads=max(1, context.threads // workers))

        def one(tile: int) -> StageRecord:
            with Measure() as watch:
                stored = compute(tile, each)
            cost = Cost(watch.seconds / workers, watch.peak_bytes)
            return runner.work.save(names[tile], keys[tile], stored, Facts(), cost)

        # (3) Results are recorded in order of the tiles. A tile is saved as soon as it is done,
        # so a build that is stopped here goes on with the others.
        with ThreadPoolExecutor(max_workers=workers) as pool:
            waiting: list[tuple[int, Future[StageRecord]]] = []
            try:
                waiting = [(tile, pool.submit(one, tile)) for tile in left]
                for tile, future in waiting:
                    records[tile] = future.result()
                    progress.advance(float(chosen.faces[tile]))
            finally:
                for _, future in waiting:
                    future.cancel()
    progress.done({"tiles": len(left)})
    return PassResult(
        tuple(records[tile] for tile in range(len(keys))),
        False,
        Cost(measure.seconds, measure.peak_bytes),
    )
