from __future__ import annotations

import io
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from threading import Event

import pytest
from rich.console import Console

from terraport_pipeline.progress import (
    ESTIMATE_UNIT,
    NullProgress,
    ProgressBehind,
    RichProgress,
)


def run(*, terminal: bool) -> str:
    out = io.StringIO()
    console = Console(file=out, force_terminal=terminal, width=180, color_system=None)
    with RichProgress(console) as progress:
        progress.start("clean: normals", 1000.0, "points")
        for _ in range(10):
            progress.advance(100)
        progress.done({"spread": 12345, "ratio": 0.123456, "closed": True, "name": "x"})
        progress.start("solve", 20.0, ESTIMATE_UNIT)
        progress.advance(500.0)
        progress.start("next", None, "faces")
    return out.getvalue()


def test_a_file_gets_one_line_per_finished_step() -> None:
    lines = run(terminal=False).splitlines()
    assert lines[0] == "clean: normals: done  spread 12,345  ratio 0.1235  closed yes  name x"
    assert lines[1].startswith("solve: done")
    assert len(lines) == 2


def test_a_terminal_sees_amount_unit_and_that_an_estimate_is_one() -> None:
    shown = run(terminal=True)
    assert "1,000/1,000 points" in shown
    assert "s (estimate)" in shown


def test_a_step_may_say_what_it_is_at() -> None:
    out = io.StringIO()
    console = Console(file=out, force_terminal=True, width=120, color_system=None)
    with RichProgress(console) as progress:
        progress.describe("nothing runs")
        progress.start("5 files", 10.0, "kB")
        progress.describe("base.glb 4/5")
        progress.done({})
    assert "base.glb 4/5" in out.getvalue()
    assert "nothing runs" not in out.getvalue()


def test_advance_and_done_without_a_step_are_harmless() -> None:
    progress = RichProgress(Console(file=io.StringIO()))
    progress.advance(3)
    progress.done({})
    NullProgress().start("x", None, "y")
    NullProgress().advance(1)
    NullProgress().done({})


class Told(NullProgress):
    """Takes down what it is told; a start lets the work behind it go on."""

    def __init__(self) -> None:
        self.steps: list[list[object]] = []
        self.started = Event()

    def start(self, stage: str, total: float | None, unit: str) -> None:
        self.steps.append([stage, total, unit, 0.0])
        self.started.set()

    def advance(self, n: float) -> None:
        self.steps[-1][3] += n  # type: ignore[operator]

    def done(self, facts: Mapping[str, object]) -> None:
        self.steps[-1].append(facts)


def test_work_on_another_thread_is_told_when_it_is_waited_for() -> None:
    behind, watcher, begun = ProgressBehind("proof"), Told(), Event()

    def work() -> int:
        behind.start("proof: rays", 10.0, "rays")
        behind.advance(4.0)
        begun.set()
        watcher.started.wait(60)
        behind.advance(6.0)
        behind.done({"holes": 0})
        return 7

    with ThreadPoolExecutor(1) as pool:
        doing = pool.submit(work)
        begun.wait(60)
        # Nothing is told before somebody waits: another step may run.
        assert watcher.steps == []
        behind.show(watcher, doing)
    assert doing.result() == 7
    assert watcher.steps == [["proof: rays", 10.0, "rays", 10.0, {"holes": 0}]]


def test_work_that_fails_behind_ends_its_step_and_keeps_its_error() -> None:
    behind, watcher = ProgressBehind("proof"), Told()
    with ThreadPoolExecutor(1) as pool:
        doing = pool.submit(lambda: 1 // 0)
        behind.show(watcher, doing)
    assert watcher.steps == [["proof", None, "", 0.0, {}]]
    with pytest.raises(ZeroDivisionError):
        doing.result()
