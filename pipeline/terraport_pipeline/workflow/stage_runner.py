"""Runs a build's stages, or takes their results up where nothing changed."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

from terraport_pipeline import stages
from terraport_pipeline.code_digest import code_digest
from terraport_pipeline.measure import Measure, StepClock
from terraport_pipeline.progress import Progress
from terraport_pipeline.stages.contract import Context, Facts, Stored
from terraport_pipeline.workflow.report import StageReport
from terraport_pipeline.workflow.workdir import Cost, StageRecord, WorkDirectory, stage_key

__all__ = ["StageRunner", "Step", "key_of"]

T = TypeVar("T")


def key_of(name: str, options: Mapping[str, Any], inputs: Mapping[str, str]) -> str:
    """Key of a stage's result: its code, its options and what went in."""
    return stage_key(name, code_digest(f"{stages.__name__}.{name}"), options, inputs)


@dataclass(slots=True)
class Step(Generic[T]):
    """A stage's result: in memory, or on disk until somebody asks."""

    record: StageRecord
    result: T | None
    load: Callable[[], T]

    def value(self) -> T:
        """Return the result; loads it from disk on the first call if it was taken up."""
        if self.result is None:
            self.result = self.load()
        return self.result

    def release(self) -> None:
        """Drop the result from memory; a later :meth:`value` loads it again."""
        self.result = None
        gc.collect()


@dataclass(slots=True)
class StageRunner:
    """Runs stages in order, or takes their results up where their keys are unchanged."""

    work: WorkDirectory
    resume: bool
    progress: Progress
    threads: int
    max_memory_bytes: int
    reports: list[StageReport] = field(default_factory=list)
    stage: str = "the build's start"
    """What is being done, or failed."""

    @contextlib.contextmanager
    def at(self, name: str) -> Iterator[None]:
        """Say what is done in the block; after an exception it is still said."""
        self.stage = f"stage {name}"
        yield
        self.stage = f"what follows stage {name}"

    def context(self, scratch: Path) -> Context:
        """Make what a stage may use while it runs."""
        return Context(scratch, self.progress, self.threads, self.max_memory_bytes)

    def step(
        self,
        name: str,
        key: str,
        compute: Callable[[Context], T],
        facts_of: Callable[[T], Facts],
        store: Callable[[T], Stored],
        restore: Callable[[Stored, Facts], T],
    ) -> Step[T]:
        """Take a stage's result up, or compute and keep it."""
        record = self.work.find(name, key) if self.resume else None
        result = None
        taken_up = record is not None
        if record is None:
            clock = StepClock(self.progress)
            with self.at(name):
                with Measure() as measure, self.work.scratch() as scratch:
                    result = compute(replace(self.context(scratch), progress=clock))
                    stored = store(result)
                cost = Cost(measure.seconds, measure.peak_bytes, tuple(clock.steps))
                record = self.work.save(name, key, stored, facts_of(result), cost)
        self.reports.append(StageReport(name, taken_up, record.cost, record.facts))
        saved = record
        return Step(saved, result, lambda: restore(self.work.load(saved), saved.facts))

    def folder_step(
        self,
        name: str,
        key: str,
        fill: Callable[[Path, Context], tuple[Mapping[str, Any], Facts]],
    ) -> StageRecord:
        """Take a result up, or have it written into a folder; for arrays larger than memory.

        Parameters
        ----------
        name, key : str
        fill : callable
            Writes ``.npy`` files into the folder it is given; returns the result's plain values
            and what to tell.
        """
        record = self.work.find(name, key) if self.resume else None
        taken_up = record is not None
        if record is None:
            clock = StepClock(self.progress)
            with self.at(name), self.work.beside(name) as folder:
                with Measure() as measure, self.work.scratch() as scratch:
                    values, facts = fill(folder, replace(self.context(scratch), progress=clock))
                cost = Cost(measure.seconds, measure.peak_bytes, tuple(clock.steps))
                record = self.work.seal(folder, name, key, values, facts, cost)
        self.reports.append(StageReport(name, taken_up, record.cost, record.facts))
        return record
