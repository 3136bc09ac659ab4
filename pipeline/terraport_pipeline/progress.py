"""How long work tells how far it is: one small protocol, a terminal bar and a silent twin.

A step calls :meth:`Progress.start` once, :meth:`Progress.advance` as often as it likes (from one
thread), and :meth:`Progress.done` once. Steps do not nest; the next ``start`` ends a step that
forgot ``done``.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future, wait
from types import TracebackType
from typing import Any, Protocol, Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import (
    Progress as Bars,
)
from rich.text import Text

__all__ = [
    "ESTIMATE_UNIT",
    "NullProgress",
    "Progress",
    "ProgressBehind",
    "RichProgress",
    "format_fact",
]

ESTIMATE_UNIT = "s (estimate)"
"""Unit of a step whose engine reports nothing: it advances by the clock against a forecast, and
says so."""

_LOOK_S = 0.2
"""Between two looks at work on another thread."""

_LARGEST_ESTIMATE = 0.99
"""An estimated step stops here until the engine really ends, so that the bar never claims to be
complete."""


_THOUSAND = 1000
"""Numbers from this on are formatted with thousands separators and without decimals."""


class Progress(Protocol):
    """What a stage needs from whoever watches it."""

    def start(self, stage: str, total: float | None, unit: str) -> None:
        """Begin a step.

        Parameters
        ----------
        stage : str
            What is being done, as the user reads it, for example ``"clean: normals"``.
        total : float or None
            Amount of work in `unit`; None when it cannot be known.
        unit : str
            For example ``"points"``; :data:`ESTIMATE_UNIT` when the amount is a forecast of
            seconds.
        """
        ...

    def advance(self, n: float) -> None:
        """Add `n` units to the step that runs."""
        ...

    def done(self, facts: Mapping[str, object]) -> None:
        """End the step; `facts` are shown beside it, name by value."""
        ...


class NullProgress:
    """Progress for callers that watch nothing."""

    def start(self, stage: str, total: float | None, unit: str) -> None:
        """Ignore the start of a step."""

    def advance(self, n: float) -> None:
        """Ignore the progress of a step."""

    def done(self, facts: Mapping[str, object]) -> None:
        """Ignore the end of a step."""


class ProgressBehind:
    """Takes down how far work on another thread is, and tells it when that is waited for.

    Parameters
    ----------
    stage : str
        What is said while the work has not begun yet.
    """

    def __init__(self, stage: str) -> None:
        self._stage = stage
        self._total: float | None = None
        self._unit = ""
        self._amount = 0.0
        self._facts: Mapping[str, object] = {}

    def start(self, stage: str, total: float | None, unit: str) -> None:
        """Take down the start of a step."""
        self._stage, self._total, self._unit, self._amount = stage, total, unit, 0.0

    def advance(self, n: float) -> None:
        """Take down the progress of a step."""
        self._amount += n

    def done(self, facts: Mapping[str, object]) -> None:
        """Take down the end of a step."""
        self._facts = facts

    def show(self, watcher: Progress, work: Future[Any]) -> None:
        """Wait for the work, and show what is left of it; an error is its result's to raise."""
        watcher.start(self._stage, self._total, self._unit)
        shown, ended = 0.0, False
        while not ended:
            ended = bool(wait([work], timeout=_LOOK_S).done)
            now = self._amount
            watcher.advance(now - shown)
            shown = now
        watcher.done(self._facts)


class RichProgress:
    """One bar per step with an ETA on a terminal; one line per finished step elsewhere.

    A context manager: the terminal is given back on exit, also after an exception.

    Parameters
    ----------
    console : rich.console.Console, optional
        Where to draw; standard error by default, so that standard output stays machine-readable.
    """

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True)
        self._bars = Bars(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            _AmountColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[facts]}"),
            console=self._console,
            disable=not self._console.is_terminal,
        )
        self._task: TaskID | None = None
        self._stage = ""
        self._total: float | None = None
        self._estimate = False
        self._amount = 0.0

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bars.stop()

    def start(self, stage: str, total: float | None, unit: str) -> None:
        """Begin a step; see :meth:`Progress.start`."""
        if self._task is not None:
            self.done({})
        self._stage, self._total, self._amount = stage, total, 0.0
        self._estimate = unit == ESTIMATE_UNIT
        self._task = self._bars.add_task(stage, total=total, unit=unit, facts="")

    def describe(self, stage: str) -> None:
        """Say of the step that runs what it is at now."""
        if self._task is not None:
            self._bars.update(self._task, description=stage)

    def advance(self, n: float) -> None:
        """Add `n` units to the step that runs."""
        if self._task is None:
            return
        self._amount += n
        if self._estimate and self._total is not None:
            shown = min(self._amount, _LARGEST_ESTIMATE * self._total)
            self._bars.update(self._task, completed=shown)
        else:
            self._bars.update(self._task, completed=self._amount)

    def done(self, facts: Mapping[str, object]) -> None:
        """End the step; `facts` are shown beside it."""
        if self._task is None:
            return
        total = self._total if self._total is not None else max(self._amount, 1.0)
        text = "  ".join(f"{name} {format_fact(value)}" for name, value in facts.items())
        self._bars.update(self._task, total=total, completed=total, facts=text)
        self._bars.stop_task(self._task)
        if not self._console.is_terminal:
            self._console.print(f"{self._stage}: done  {text}".rstrip(), highlight=False)
        self._task = None


class _AmountColumn(ProgressColumn):
    """Completed of total with its unit; only the unit while the total is unknown."""

    def render(self, task: Task) -> Text:
        unit = str(task.fields.get("unit", ""))
        if task.total is None:
            return Text(f"{task.completed:,.0f} {unit}", style="progress.download")
        return Text(f"{task.completed:,.0f}/{task.total:,.0f} {unit}", style="progress.download")


def format_fact(value: object) -> str:
    """Format a value in human-readable form: thousands with commas, other numbers to four digits.

    Examples
    --------
    >>> format_fact(3925.8813691526675), format_fact(1 / 6), format_fact(12), format_fact(True)
    ('3,926', '0.1667', '12', 'yes')
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= _THOUSAND else f"{value:.4g}"
    return str(value)
