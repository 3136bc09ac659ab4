"""Passes over tiles: every tile's result once, in order, within the memory."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from terraport_pipeline.progress import NullProgress
from terraport_pipeline.stages.contract import Context, Stored
from terraport_pipeline.workflow.stage_runner import StageRunner
from terraport_pipeline.workflow.tile_runner import TilePass, run_pass, tiles_at_once
from terraport_pipeline.workflow.workdir import WorkDirectory

PASS = TilePass(
    "square", "terraport_pipeline.geometry.mesh.chunks", "squares", {"by": 2},
    [{"tile": str(i)} for i in range(5)], [10, 20, 30, 40, 50], 100,
)  # fmt: skip


class Bar(NullProgress):
    """Adds up what it is told."""

    def __init__(self) -> None:
        self.total: float | None = None
        self.done_so_far = 0.0

    def start(self, stage: str, total: float | None, unit: str) -> None:
        self.total = total

    def advance(self, amount: float) -> None:
        self.done_so_far += amount


@pytest.fixture
def runner(tmp_path: Path) -> StageRunner:
    work = tmp_path / "work"
    work.mkdir()
    return StageRunner(WorkDirectory(work), True, Bar(), 2, 2**33)


def squares(tile: int, context: Context) -> Stored:
    return Stored({"n": np.array([tile**2])}, {"tile": tile})


def test_every_tile_is_kept_and_told_in_order(runner) -> None:
    result = run_pass(runner, PASS, squares)
    assert [record.values["tile"] for record in result.records] == [0, 1, 2, 3, 4]
    assert runner.work.load(result.records[3]).arrays["n"].tolist() == [9]
    assert not result.taken_up
    assert (runner.progress.total, runner.progress.done_so_far) == (150.0, 150.0)


def test_only_what_is_missing_is_done_again(runner) -> None:
    run_pass(runner, PASS, squares)
    assert run_pass(runner, PASS, _never).taken_up
    inputs = [*PASS.inputs[:2], {"tile": "other"}, *PASS.inputs[3:]]
    seen = []
    result = run_pass(
        runner, replace(PASS, inputs=inputs), lambda tile, c: seen.append(tile) or squares(tile, c)
    )
    assert seen == [2]
    assert len(result.records) == 5
    assert runner.progress.done_so_far == 150.0 + 30.0


def test_what_a_build_with_more_tiles_left_goes(runner) -> None:
    run_pass(runner, PASS, squares)
    run_pass(runner, replace(PASS, inputs=PASS.inputs[:3], faces=PASS.faces[:3]), _never)
    assert runner.work.names("square-") == ["square-0000", "square-0001", "square-0002"]


def test_an_error_stops_the_pass_and_keeps_what_was_done(runner) -> None:
    def breaks(tile: int, context: Context) -> Stored:
        if tile == 2:
            raise ValueError("tile 2")
        return squares(tile, context)

    with pytest.raises(ValueError, match="tile 2"):
        run_pass(replace(runner, threads=1), PASS, breaks)
    seen = []
    run_pass(runner, PASS, lambda tile, c: seen.append(tile) or squares(tile, c))
    assert 0 not in seen
    assert 2 in seen


def test_as_many_tiles_as_fit(tmp_path) -> None:
    context = Context(tmp_path, threads=4, max_memory_bytes=10**12)
    assert tiles_at_once(10**6, 350, context) == 4
    assert tiles_at_once(10**6, 350, replace(context, max_memory_bytes=1)) == 1
    assert tiles_at_once(10**6, 350, replace(context, max_memory_bytes=None)) == 4


def _never(tile: int, context: Context) -> Stored:
    raise AssertionError(tile)


def test_what_tiles_share_is_left_free(tmp_path) -> None:
    context = Context(tmp_path, threads=8, max_memory_bytes=2**40)
    assert tiles_at_once(10, 2**34, context) == 6
    assert tiles_at_once(10, 2**34, context, shared_bytes=2**39) == 3
