"""Runs the stages of a build, once or tile by tile, or takes their results up where they are kept.

A stage is a value: what it is called, which code makes it, from which options and inputs, how it is
computed and in which form its result is kept. Its key is made of these here and nowhere else, so a
result is taken up if and only if code, options and inputs are what they were.
"""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Final, Generic, TypeVar

import psutil
import xxhash

from terraport_payload.types import AnyArray
from terraport_pipeline.code_digest import code_digest
from terraport_pipeline.engines.tile_pool import TilePool
from terraport_pipeline.kernel_threads import limit_threads
from terraport_pipeline.measure import Measure, StepClock
from terraport_pipeline.progress import ESTIMATE_UNIT, NullProgress, Progress
from terraport_pipeline.stages.contract import Context, Facts, Form, Json, Stored
from terraport_pipeline.workflow.before import SURVEY, Before, prepare, remember
from terraport_pipeline.workflow.report import StageReport
from terraport_pipeline.workflow.workdir import Cost, StageRecord, WorkDirectory, stage_key
from terraport_store.manifest import BuildInfo

__all__ = [
    "Group",
    "Result",
    "Runner",
    "Stage",
    "TileResults",
    "TileStage",
    "for_tiles",
    "tiles_at_once",
]

T = TypeVar("T")

_BASE_BYTES: Final = 300 * 2**20
"""What the process takes beside tiles: interpreter, libraries, compiled kernels, base mesh."""


@dataclass(frozen=True, slots=True)
class Stage(Generic[T]):
    """One step of a build that is done once."""

    name: str
    """In the work directory, in reports and in messages."""
    code: ModuleType
    """Whose code, with all that it imports of ours, decides the result."""
    run: Callable[[Context], T]
    form: Form[T]
    """How the result is kept."""
    options: Mapping[str, Json] = field(default_factory=dict)
    """All that change the result, none that do not."""
    inputs: Mapping[str, str] = field(default_factory=dict)
    """Digests of what goes in, by name."""
    also: Sequence[ModuleType] = ()
    """Further modules whose code decides the result: of what `run` calls beside `code`."""

    is_remembered: bool = False
    """The next survey over the scene is built with this result at hand."""
    is_decision: bool = False
    """Holds for later surveys over the scene as long as code and options are the same, and `stands`
    does not object; remembered."""
    stands: Callable[[T], bool] | None = None
    """Whether a decision of before can be kept with these inputs; None: always."""

    @property
    def key(self) -> str:
        """What identifies the result."""
        return self._key(self.inputs)

    @property
    def decision(self) -> str:
        """What identifies a decision: all but what it was taken from."""
        return self._key({})

    def _key(self, inputs: Mapping[str, str]) -> str:
        code = "-".join(code_digest(module.__name__) for module in (self.code, *self.also))
        return stage_key(self.name, code, self.options, inputs)


@dataclass(frozen=True, slots=True)
class TileStage:
    """One step of a build that is done for every tile; each result is kept by itself."""

    name: str
    """Results are called ``NAME-00007``."""
    code: ModuleType
    title: str
    """Of the step on the progress bar."""
    run: Sequence[Callable[[Context], Stored]]
    """For every tile what computes it; from several threads, or pickled to other processes."""
    inputs: Sequence[Mapping[str, str]]
    """For every tile the digests of what goes in."""
    sizes: Sequence[int]
    """Of every tile: what progress and memory go by, and the largest begin."""
    unit: str = "faces"
    """Of the sizes."""
    options: Mapping[str, Json] = field(default_factory=dict)
    bytes_per_unit: int = 0
    """Memory that computing a tile takes, with the tile, where tiles share this process."""
    shared_bytes: int = 0
    """Memory that all tiles together take beside that, and do not hold yet."""
    forecast_s: float | None = None
    """What a single tile is expected to take, where it tells how many seconds have gone by."""
    numbers: Sequence[int] | None = None
    """Number of every tile in the name of its result; None: they are counted."""

    def key(self, tile: int) -> str:
        """Make what identifies a tile's result."""
        code = code_digest(self.code.__name__)
        return stage_key(self.name, code, self.options, self.inputs[tile])

    def result_name(self, tile: int) -> str:
        """Name of a tile's result in the work directory."""
        number = tile if self.numbers is None else self.numbers[tile]
        return f"{self.name}-{number:05d}"


@dataclass(slots=True)
class Result(Generic[T]):
    """A stage's result: in memory, or on disk until somebody asks."""

    record: StageRecord
    _load: Callable[[], T]
    _value: T | None = None

    @property
    def digest(self) -> str:
        """Hash of the result, for the keys of what follows."""
        return self.record.digest

    def value(self) -> T:
        """Return the result; loads it from disk on the first call if it was taken up."""
        if self._value is None:
            self._value = self._load()
        return self._value

    def release(self) -> None:
        """Drop the result from memory; a later :meth:`value` loads it again."""
        self._value = None
        gc.collect()


@dataclass(frozen=True, slots=True)
class TileResults:
    """What a stage left of every tile, on disk."""

    work: WorkDirectory
    records: tuple[StageRecord, ...]

    @property
    def digest(self) -> str:
        """Hash of all results, for the keys of what follows."""
        return xxhash.xxh3_128_hexdigest("".join(r.digest for r in self.records).encode())

    def folder(self, tile: int) -> Path:
        """Where a tile's arrays lie, for workers in other processes."""
        return self.work.path / self.records[tile].name

    def array(self, tile: int, name: str) -> AnyArray:
        """Read one array of a tile."""
        return self.work.array(self.records[tile], name)

    def stored(self, tile: int) -> Stored:
        """Open a tile's result; each array is read while it is looked at."""
        return self.work.looked_up(self.records[tile])

    def every(self) -> list[Stored]:
        """Open the results of all tiles, in their order."""
        return [self.stored(tile) for tile in range(len(self.records))]


@dataclass(slots=True)
class Group:
    """Several stages that are reported as one."""

    facts: Facts = field(default_factory=Facts)
    """What to say of them together; the last stage's where nobody says it."""


@dataclass(slots=True)
class Runner:
    """Runs stages in order, or takes their results up where their keys are unchanged."""

    work: WorkDirectory
    resume: bool
    progress: Progress
    threads: int
    max_memory_bytes: int
    reports: list[StageReport] = field(default_factory=list)
    stage: str = "the build's start"
    """What is being done, or failed."""
    before: Before | None = None
    """What the scene's last version was built from; None where all is built anew."""
    _remembered: dict[str, str | None] = field(default_factory=dict)
    """Names of the results to remember; for decisions what identifies them."""

    @contextlib.contextmanager
    def at(self, name: str) -> Iterator[None]:
        """Say what is done in the block; after an exception it is still said."""
        self.stage = f"stage {name}"
        yield
        self.stage = f"what follows stage {name}"

    @contextlib.contextmanager
    def reported_as(self, name: str) -> Iterator[Group]:
        """Report the stages of the block as one: seconds add up, peaks do not."""
        group, outer = Group(), self.reports
        inner: list[StageReport] = []
        self.reports = inner
        try:
            yield group
        finally:
            self.reports = outer
        cost = Cost(
            sum(report.cost.seconds for report in inner),
            max((report.cost.peak_bytes for report in inner), default=0),
            tuple(step for report in inner for step in report.cost.steps),
        )
        facts = group.facts if group.facts != Facts() else inner[-1].facts
        outer.append(StageReport(name, all(report.taken_up for report in inner), cost, facts))

    def context(self, scratch: Path) -> Context:
        """Make what a stage may use while it runs."""
        return Context(
            scratch, self.progress, self.threads, self.max_memory_bytes, result_folder=scratch
        )

    def run(self, stage: Stage[T]) -> Result[T]:
        """Take a stage's result up, or compute and keep it."""
        if stage.is_remembered or stage.is_decision:
            self._remembered[stage.name] = stage.decision if stage.is_decision else None
        stage = self._as_decided(stage)
        record = self.take_up(stage.name, stage.key)
        value = None
        taken_up = record is not None
        if record is None:
            clock = StepClock(self.progress)
            with self.at(stage.name), self.work.beside(stage.name) as folder:
                with Measure() as measure, self.work.scratch() as scratch:
                    context = replace(self.context(scratch), progress=clock, result_folder=folder)
                    value = stage.run(context)
                    stored = stage.form.store(value)
                cost = Cost(measure.seconds, measure.peak_bytes, tuple(clock.steps))
                record = self.work.seal(
                    folder, stage.name, stage.key, stored, stage.form.facts(value), cost
                )
        self.reports.append(StageReport(stage.name, taken_up, record.cost, record.facts))
        saved = record
        return Result(saved, lambda: stage.form.restore(self.work.load(saved), saved.facts), value)

    def _as_decided(self, stage: Stage[T]) -> Stage[T]:
        """Let a decision that stands take the place of one that would be taken now."""
        before = self.before
        if not stage.is_decision or before is None:
            return stage
        record = before.decision(stage.name, stage.decision)
        if record is None:
            return stage
        decided = stage.form.restore(before.work.load(record), record.facts)
        if stage.stands is not None and not stage.stands(decided):
            return stage
        return replace(stage, run=lambda _: decided, inputs={"decided": record.digest})

    def prepare(self, build: BuildInfo, read: str, *, survey: str) -> None:
        """Keep what :meth:`remember` will, right before publishing.

        Parameters
        ----------
        build : BuildInfo
            As the manifest will have it.
        read, survey
            See :meth:`remember`.
        """
        names, decisions = self._to_remember(survey)
        prepare(self.work, names, decisions, build=build, survey=read, before=self.before)

    def remember(self, version: str, build: BuildInfo, read: str, *, survey: str) -> None:
        """Keep what the next survey over the scene goes by.

        Parameters
        ----------
        version : str
            What was published.
        build : BuildInfo
            As the manifest has it.
        read : str
            Digest of the survey as read.
        survey : str
            Name of the result that holds the survey that was worked on.
        """
        names, decisions = self._to_remember(survey)
        remember(
            self.work, names, decisions, version=version, build=build, survey=read,
            before=self.before,
        )  # fmt: skip

    def _to_remember(self, survey: str) -> tuple[dict[str, str], dict[str, str]]:
        """Names of results by the name that they are kept under, and keys of decisions."""
        names = {name: name for name in self._remembered} | {SURVEY: survey}
        decisions = {name: key for name, key in self._remembered.items() if key is not None}
        return names, decisions

    def take_up(self, name: str, key: str) -> StageRecord | None:
        """Look for a kept result; None where it is to be made."""
        return self.work.find(name, key) if self.resume else None

    def run_tiles(self, stage: TileStage, pool: TilePool | None = None) -> TileResults:
        """Take every tile's result up, or compute and keep it.

        Parameters
        ----------
        stage : TileStage
        pool : TilePool, optional
            Processes that do it; without one threads of this process, as many as fit into memory.

        Returns
        -------
        TileResults
            In order of the tiles, whatever the order of the work.
        """
        # (1) What is kept already, by key; what an earlier build with more tiles left is deleted.
        names = [stage.result_name(tile) for tile in range(len(stage.run))]
        records: dict[int, StageRecord] = {}
        for tile, name in enumerate(names):
            record = self.take_up(name, stage.key(tile))
            if record is not None:
                records[tile] = record
        for stale in set(self.work.names(f"{stage.name}-")) - set(names):
            self.work.forget(stale)
        # (2) The largest first: a large one begun last would leave cores idle.
        missing = sorted(
            (tile for tile in range(len(names)) if tile not in records),
            key=lambda tile: (-stage.sizes[tile], tile),
        )
        if missing:
            cost = self._compute(stage, pool, missing, records)
        else:  # what they took when they were made
            cost = Cost(
                sum(record.cost.seconds for record in records.values()),
                max((record.cost.peak_bytes for record in records.values()), default=0),
            )
        self.reports.append(StageReport(stage.name, not missing, cost, Facts()))
        return TileResults(self.work, tuple(records[tile] for tile in range(len(names))))

    def _compute(
        self,
        stage: TileStage,
        pool: TilePool | None,
        missing: Sequence[int],
        records: dict[int, StageRecord],
    ) -> Cost:
        """Compute the missing tiles into `records`. A tile is kept as soon as it is done."""
        clock = StepClock(self.progress)
        # A bar by tiles has no use where there is one, which may take minutes.
        by_time = len(missing) == 1 and pool is not None and not pool.is_apart and stage.forecast_s
        if by_time:
            clock.start(stage.title, by_time, ESTIMATE_UNIT)
        else:
            clock.start(stage.title, float(sum(stage.sizes[tile] for tile in missing)), stage.unit)
        with self.at(stage.name), Measure() as measure, contextlib.ExitStack() as stack:
            if pool is None:
                largest = max(stage.sizes[tile] for tile in missing)
                context = self.context(self.work.path)
                workers = tiles_at_once(largest * stage.bytes_per_unit, context, stage.shared_bytes)
                pool = stack.enter_context(TilePool.of_threads(workers if len(missing) > 1 else 0))
            if not self.resume:
                for tile in missing:
                    self.work.forget(stage.result_name(tile))
            jobs = [
                _TileJob(
                    self.work, stage.result_name(tile), stage.key(tile), stage.run[tile],
                    pool.threads_each(self.threads), self.max_memory_bytes, pool.workers,
                    clock if by_time else NullProgress(),
                )
                for tile in missing
            ]  # fmt: skip

            def done(number: int, record: StageRecord) -> None:
                records[missing[number]] = record
                if not by_time:
                    clock.advance(float(stage.sizes[missing[number]]))

            pool.run(_keep_alone if pool.is_apart else _keep, jobs, done)
        clock.done({"tiles": len(missing)})
        return Cost(measure.seconds, measure.peak_bytes, tuple(clock.steps))


def for_tiles(
    tiles: Sequence[int], run: Callable[[int, Context], Stored]
) -> list[Callable[[Context], Stored]]:
    """Bind a function of tile and context to every tile; for threads, as it is not pickled."""
    return [partial(run, tile) for tile in tiles]


def tiles_at_once(tile_bytes: int, context: Context, shared_bytes: int = 0) -> int:
    """Say how many tiles fit into memory beside each other, at least 1."""
    if context.max_memory_bytes is None:
        return context.threads
    held = max(_BASE_BYTES, int(psutil.Process().memory_info().rss))
    room = context.max_memory_bytes - held - shared_bytes
    return max(1, min(context.threads, room // max(1, tile_bytes)))


@dataclass(frozen=True, slots=True)
class _TileJob:
    """Order to compute one tile and keep it, as it goes to a thread or another process."""

    work: WorkDirectory
    name: str
    key: str
    run: Callable[[Context], Stored]
    threads: int
    max_memory_bytes: int
    beside: int
    """Tiles that are worked on at the same time: each gets its share of the seconds."""
    progress: Progress
    """Told only of a tile that is computed alone, in this process."""


def _keep(job: _TileJob) -> StageRecord:
    """Carry out a job, unless a worker that was lost had kept its result."""
    record = job.work.find(job.name, job.key)
    if record is not None:
        return record
    with Measure() as measure, job.work.scratch() as scratch:
        context = Context(scratch, job.progress, job.threads, job.max_memory_bytes)
        stored = job.run(context)
    cost = Cost(measure.seconds / job.beside, measure.peak_bytes)
    return job.work.save(job.name, job.key, stored, Facts(), cost)


def _keep_alone(job: _TileJob) -> StageRecord:
    """As :func:`_keep`, in a process that works on one tile at a time."""
    limit_threads(job.threads)
    return _keep(job)
