"""Stages: every result once, in order, within the memory, and taken up where nothing changed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from terraport_pipeline.engines.readers import point_order
from terraport_pipeline.engines.tile_pool import TilePool
from terraport_pipeline.geometry.mesh import chunks
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.stages.contract import IN_FOLDER, STORED, Context, Facts, Stored
from terraport_pipeline.workflow.before import Before
from terraport_pipeline.workflow.runner import (
    Runner,
    Stage,
    TileResults,
    TileStage,
    for_tiles,
    tiles_at_once,
)
from terraport_pipeline.workflow.workdir import Cost, WorkDirectory

COST = Cost(0.0, 0)


def squares(tile: int, context: Context) -> Stored:
    return Stored({"n": np.array([tile**2])}, {"tile": tile})


SQUARES = TileStage(
    "square", chunks, "squares", for_tiles(range(5), squares),
    [{"tile": str(i)} for i in range(5)], [10, 20, 30, 40, 50], options={"by": 2},
    bytes_per_unit=100,
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
def runner(tmp_path: Path) -> Runner:
    work = tmp_path / "work"
    work.mkdir()
    return Runner(WorkDirectory(work), True, Bar(), 2, 2**33)


def run(runner: Runner, function=squares, **changed: Any) -> TileResults:
    count = len(changed.get("inputs", SQUARES.inputs))
    return runner.run_tiles(replace(SQUARES, run=for_tiles(range(count), function), **changed))


def test_every_tile_is_kept_and_told_in_order(runner) -> None:
    results = run(runner)
    assert [record.values["tile"] for record in results.records] == [0, 1, 2, 3, 4]
    assert results.array(3, "n").tolist() == results.stored(3).arrays["n"].tolist() == [9]
    assert not runner.reports[-1].taken_up
    assert (runner.progress.total, runner.progress.done_so_far) == (150.0, 150.0)
    assert [step.name for step in runner.reports[-1].cost.steps] == ["squares"]


def test_only_what_is_missing_is_done_again(runner) -> None:
    run(runner)
    run(runner, _never)
    assert runner.reports[-1].taken_up
    inputs = [*SQUARES.inputs[:2], {"tile": "other"}, *SQUARES.inputs[3:]]
    seen = []
    results = run(runner, lambda tile, c: seen.append(tile) or squares(tile, c), inputs=inputs)
    assert seen == [2]
    assert len(results.records) == 5
    assert runner.progress.done_so_far == 150.0 + 30.0


def test_nothing_is_taken_up_where_that_is_not_wanted(runner) -> None:
    first = run(runner)
    seen = []
    again = run(
        replace(runner, resume=False), lambda tile, c: seen.append(tile) or squares(tile, c)
    )
    assert sorted(seen) == [0, 1, 2, 3, 4]
    assert again.digest == first.digest


def test_what_a_build_with_more_tiles_left_goes(runner) -> None:
    run(runner)
    run(runner, _never, inputs=SQUARES.inputs[:3], sizes=SQUARES.sizes[:3])
    assert runner.work.names("square-") == ["square-00000", "square-00001", "square-00002"]


def test_the_largest_tile_begins(runner) -> None:
    seen = []
    run(replace(runner, threads=1), lambda tile, c: seen.append(tile) or squares(tile, c))
    assert seen == [4, 3, 2, 1, 0]


def test_a_tile_alone_advances_the_bar_by_its_seconds(runner) -> None:
    def slow(tile: int, context: Context) -> Stored:
        for _ in range(3):
            context.progress.advance(0.5)
        return squares(tile, context)

    stage = replace(
        SQUARES,
        run=for_tiles(range(1), slow),
        inputs=SQUARES.inputs[:1],
        sizes=[10],
        forecast_s=2.0,
    )
    with TilePool(0) as pool:
        runner.run_tiles(stage, pool)
    assert (runner.progress.total, runner.progress.done_so_far) == (2.0, 1.5)


def test_an_error_stops_the_pass_and_keeps_what_was_done(runner) -> None:
    def breaks(tile: int, context: Context) -> Stored:
        if tile == 2:
            raise ValueError("tile 2")
        return squares(tile, context)

    with pytest.raises(ValueError, match="tile 2"):
        run(replace(runner, threads=1), breaks)
    seen = []
    run(runner, lambda tile, c: seen.append(tile) or squares(tile, c))
    assert 4 not in seen
    assert 2 in seen


def doubled(by: int, seen: list[int]) -> Stage[Stored]:
    def compute(context: Context) -> Stored:
        seen.append(by)
        return Stored({"n": np.arange(3) * by}, {"by": by})

    return Stage("double", chunks, compute, STORED, {"by": by})


def test_code_beside_a_stages_own_counts() -> None:
    stage = doubled(2, [])
    more = replace(stage, also=(point_order,))
    assert stage.key != more.key
    assert stage.decision != more.decision


def test_a_stage_is_taken_up_by_its_options(runner) -> None:
    seen: list[int] = []
    first = runner.run(doubled(2, seen))
    again = runner.run(doubled(2, seen))
    assert seen == [2]
    assert again.value().arrays["n"].tolist() == [0, 2, 4]
    assert again.digest == first.digest
    assert runner.run(doubled(3, seen)).digest != first.digest
    assert seen == [2, 3]
    assert [report.taken_up for report in runner.reports] == [False, True, False]
    assert runner.reports[0].facts.counts == {"by": 2}


def test_a_result_larger_than_memory_is_written_by_the_stage(runner) -> None:
    def fill(context: Context) -> tuple[dict[str, int], Facts]:
        np.save(context.folder / "n.npy", np.arange(4))
        return {"rows": 4}, Facts({"rows": 4})

    result = runner.run(Stage("rows", chunks, fill, IN_FOLDER))
    assert runner.work.array(result.record, "n").tolist() == [0, 1, 2, 3]
    assert result.record.values == {"rows": 4}
    same = runner.work.save("other", "k", Stored({"n": np.arange(4)}, {"rows": 4}), Facts(), COST)
    assert same.digest == result.digest


def test_stages_are_reported_as_one(runner) -> None:
    for taken_up in (False, True):
        with runner.reported_as("both") as group:
            run(runner)
            runner.run(doubled(2, []))
            group.facts = Facts({"all": 2})
        assert runner.reports[-1].name == "both"
        assert runner.reports[-1].taken_up == taken_up
        assert runner.reports[-1].facts.counts == {"all": 2}
    assert len(runner.reports) == 2


def test_a_stage_that_fails_leaves_the_reports_before_it(runner) -> None:
    run(runner)
    with pytest.raises(AssertionError), runner.reported_as("both"):
        run(runner, _never, options={"by": 3})
    assert [report.name for report in runner.reports] == ["square"]
    assert runner.stage == "stage square"


def test_as_many_tiles_as_fit(tmp_path) -> None:
    context = Context(tmp_path, threads=4, max_memory_bytes=10**12)
    assert tiles_at_once(350 * 10**6, context) == 4
    assert tiles_at_once(350 * 10**6, replace(context, max_memory_bytes=1)) == 1
    assert tiles_at_once(350 * 10**6, replace(context, max_memory_bytes=None)) == 4


def _never(tile: int, context: Context) -> Stored:
    raise AssertionError(tile)


def test_what_tiles_share_is_left_free(tmp_path) -> None:
    context = Context(tmp_path, threads=8, max_memory_bytes=2**40)
    assert tiles_at_once(10 * 2**34, context) == 6
    assert tiles_at_once(10 * 2**34, context, shared_bytes=2**39) == 3


def test_a_tile_is_kept_under_its_own_number(runner: Runner) -> None:
    three = replace(
        SQUARES, run=SQUARES.run[2:], inputs=SQUARES.inputs[2:], sizes=SQUARES.sizes[2:]
    )
    runner.run_tiles(SQUARES)
    kept = runner.run_tiles(replace(three, numbers=(2, 3, 4)))
    assert runner.reports[-1].taken_up
    assert [record.name for record in kept.records] == [f"square-0000{n}" for n in (2, 3, 4)]
    assert runner.work.names("square-") == [record.name for record in kept.records]


@pytest.mark.parametrize(("limit", "expected"), [(9, 7), (5, 4)])
def test_a_decision_stands_unless_it_does_not_fit(
    runner: Runner, tmp_path: Path, limit: int, expected: int
) -> None:
    """7 was decided before; now it would be 4."""

    def decide(value: int) -> Stage[Stored]:
        return Stage(
            "decided", chunks, lambda _: Stored({}, {"value": value}), STORED,
            inputs={"value": str(value)}, is_decision=True,
            stands=lambda decided: decided.values["value"] <= limit,
        )  # fmt: skip

    first = decide(7)
    runner.run(first)
    old = WorkDirectory(tmp_path / "work")
    later = (tmp_path / "later").absolute()
    later.mkdir()
    then = replace(
        runner, work=WorkDirectory(later), before=Before(old, "v", {"decided": first.decision})
    )
    assert then.run(decide(4)).value().values["value"] == expected
