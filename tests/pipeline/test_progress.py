from __future__ import annotations

import io

from rich.console import Console

from terraport_pipeline.progress import ESTIMATE_UNIT, NullProgress, RichProgress


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
