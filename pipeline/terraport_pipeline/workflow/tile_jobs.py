"""Work on one tile as a job for another process: paths and numbers in, a small answer out.

What a job makes, it puts into the work directory itself, whole or not at all; a job whose result is
already there has nothing to do. So a build that was killed goes on with the tiles that are done.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload.types import AnyArray
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.errors import WorkDirectoryError
from terraport_pipeline.kernel_threads import limit_threads
from terraport_pipeline.measure import Measure
from terraport_pipeline.stages.contract import Context, Facts, Stored
from terraport_pipeline.stages.tiles import join_tiles, joined_tile, solve_tile
from terraport_pipeline.stages.tiles.join_tiles import Join, Look, Weak
from terraport_pipeline.stages.tiles.solve_tile import TileTask
from terraport_pipeline.workflow.workdir import Cost, StageRecord, WorkDirectory

__all__ = [
    "FinishJob",
    "LookJob",
    "SolveJob",
    "TileArrays",
    "find_weak",
    "finish_tile",
    "join_name",
    "look_at_tile",
    "solve_name",
    "solve_one",
    "tile_name",
]


_VALUES: Final = "values.json"


def solve_name(tile: int) -> str:
    """Name the result of a tile as solved."""
    return f"solve-{tile:05d}"


def tile_name(tile: int) -> str:
    """Name the result of a tile as later stages read it."""
    return f"tile-{tile:05d}"


def join_name() -> str:
    """Name the result of the join."""
    return join_tiles.NAME


@dataclass(frozen=True, slots=True)
class SolveJob:
    """Order to reconstruct one tile, as it goes to a worker process."""

    work: WorkDirectory
    tile: int
    key: str
    task: TileTask
    samples: Path
    threads: int
    max_memory_bytes: int | None


@dataclass(frozen=True, slots=True)
class LookJob:
    """Look at a tile as it will be after the join."""

    work: WorkDirectory
    tile: int
    task: TileTask
    join: Path
    """A file with the join; :func:`save_join`."""


@dataclass(frozen=True, slots=True)
class FinishJob:
    """Order to write one tile as it is after the join, as it goes to a worker process."""

    work: WorkDirectory
    tile: int
    key: str
    task: TileTask
    join_key: str


def solve_one(job: SolveJob) -> StageRecord:
    """Reconstruct the tile of a :class:`SolveJob` and keep it; runs in a worker."""
    name = solve_name(job.tile)
    record = job.work.find(name, job.key)
    if record is not None:
        return record
    threads = limit_threads(job.threads)
    with Measure() as measure, job.work.scratch() as scratch:
        context = Context(scratch, threads=threads, max_memory_bytes=job.max_memory_bytes)
        reader = NpyReader(job.samples)
        stored = solve_tile.run(job.task, reader.read(0, len(reader)), context)
    cost = Cost(measure.seconds, measure.peak_bytes)
    return job.work.save(name, job.key, stored, solve_tile.facts_of(stored), cost)


def find_weak(job: LookJob) -> Weak:
    """Carry out a :class:`LookJob`: weak places."""
    arrays = TileArrays(job.work.path / solve_name(job.tile))
    return joined_tile.weak_places(job.task, job.tile, arrays, load_join(job.join))


def look_at_tile(job: LookJob) -> Look:
    """Carry out a :class:`LookJob`: everything else."""
    arrays = TileArrays(job.work.path / solve_name(job.tile))
    return joined_tile.look(job.task, job.tile, arrays, load_join(job.join))


def finish_tile(job: FinishJob) -> StageRecord:
    """Write the tile of a :class:`FinishJob`; runs in a worker."""
    name = tile_name(job.tile)
    record = job.work.find(name, job.key)
    if record is not None:
        return record
    joined = job.work.find(join_name(), job.join_key)
    if joined is None:
        raise WorkDirectoryError(f"{job.work.path}: the join is gone; build again")
    with Measure() as measure:
        join, settled = join_tiles.from_stored(job.work.load(joined))
        source = TileArrays(job.work.path / solve_name(job.tile))
        arrays, box = joined_tile.finish(job.task, job.tile, source, join, settled)
    values = {
        "faces": len(arrays["faces"]),
        "vertices": len(arrays["vertices"]),
        "base_faces": len(arrays["base-faces"]),
        "box": [float(side) for side in box],
    }
    cost = Cost(measure.seconds, measure.peak_bytes)
    return job.work.save(name, job.key, Stored(arrays, values), Facts(dict(values)), cost)


class TileArrays(dict[str, AnyArray]):
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


def save_join(folder: Path, join: Join) -> None:
    """Write the join where workers find it: once, not once a job."""
    stored = join_tiles.to_stored(join, None)
    folder.mkdir()
    for name, array in stored.arrays.items():
        np.save(folder / f"{name}.npy", array)
    (folder / _VALUES).write_text(json.dumps(dict(stored.values)), encoding="utf-8")


def load_join(folder: Path) -> Join:
    """Read the join that :func:`save_join` wrote."""
    arrays = {file.stem: np.load(file, allow_pickle=False) for file in folder.glob("*.npy")}
    values = json.loads((folder / _VALUES).read_text(encoding="utf-8"))
    return join_tiles.from_stored(Stored(arrays, values))[0]
