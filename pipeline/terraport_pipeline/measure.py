"""How long a block takes, and each step of it, and how much memory it holds, children included."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import psutil

from terraport_pipeline.progress import Progress

__all__ = ["Measure", "StepClock", "StepCost"]

_INTERVAL_S = 0.05
"""Between two looks; shorter peaks can be missed."""

_LOOKS_PER_LISTING = 5
"""Looks by one list of children. Listing them reads all processes of the machine: 3 ms, which at
every look would be a tenth of a core."""


class Measure:
    """Watches time and resident memory of this process and its children.

    A context manager. Memory shared between parent and children counts once in each.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self.peak_bytes = 0
        self._process = psutil.Process()
        self._stop = threading.Event()
        self._watcher = threading.Thread(target=self._watch, name="memory watch", daemon=True)
        self._started = 0.0
        self._children: list[psutil.Process] = []
        self._looks = 0

    def __enter__(self) -> Self:
        self._started = time.monotonic()
        self._look()
        self._watcher.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._watcher.join()
        self._look()
        self.seconds = time.monotonic() - self._started

    def _watch(self) -> None:
        while not self._stop.wait(_INTERVAL_S):
            self._look()

    def _look(self) -> None:
        if self._looks % _LOOKS_PER_LISTING == 0:
            with contextlib.suppress(psutil.Error):
                self._children = self._process.children(recursive=True)
        self._looks += 1
        total = int(self._process.memory_info().rss)
        for child in self._children:
            with contextlib.suppress(psutil.Error):  # it may have ended
                total += int(child.memory_info().rss)
        self.peak_bytes = max(self.peak_bytes, total)


@dataclass(frozen=True, slots=True)
class StepCost:
    """Wall and CPU seconds of one step of a stage."""

    name: str
    """As the progress bar shows it."""
    seconds: float
    cpu_seconds: float
    """Of this process, all threads, and of the children that ended during the step."""


class StepClock:
    """A progress that passes everything on and notes what each step took.

    Parameters
    ----------
    progress : Progress
        Who is told.
    """

    def __init__(self, progress: Progress) -> None:
        self.steps: list[StepCost] = []
        self._progress = progress
        self._name: str | None = None
        self._begun = (0.0, 0.0)

    def start(self, stage: str, total: float | None, unit: str) -> None:
        """Begin a step; one that forgot ``done`` ends here."""
        self._end()
        self._name, self._begun = stage, (time.monotonic(), _cpu_seconds())
        self._progress.start(stage, total, unit)

    def advance(self, n: float) -> None:
        """Pass progress on to the watcher."""
        self._progress.advance(n)

    def done(self, facts: Mapping[str, object]) -> None:
        """Note the step's cost and pass its end on to the watcher."""
        self._end()
        self._progress.done(facts)

    def _end(self) -> None:
        if self._name is None:
            return
        seconds, cpu = self._begun
        self.steps.append(StepCost(self._name, time.monotonic() - seconds, _cpu_seconds() - cpu))
        self._name = None


def _cpu_seconds() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system
