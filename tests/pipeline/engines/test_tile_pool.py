"""Jobs run in other processes, here and on a Dask cluster; a lost worker is noticed."""

from __future__ import annotations

import os
import signal
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest

from terraport_pipeline.engines import tile_pool
from terraport_pipeline.engines.tile_pool import TilePool
from terraport_pipeline.errors import EngineError, OptionError, ResourceError


@dataclass(frozen=True)
class Job:
    number: int
    folder: Path
    deaths: int = 0
    """Die this often before working."""


def work(job: Job) -> tuple[int, int]:
    for death in range(job.deaths):
        mark = job.folder / f"died-{job.number}-{death}"
        if not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
    return job.number**2, os.getpid()


def fail(job: Job) -> int:
    if job.number == 2:
        raise ResourceError("no room for job 2")
    return job.number


def test_without_workers_everything_runs_here(tmp_path: Path) -> None:
    results: dict[int, tuple[int, int]] = {}
    with TilePool(0) as pool:
        pool.run(work, [Job(3, tmp_path), Job(4, tmp_path)], results.__setitem__)
    assert results == {0: (9, os.getpid()), 1: (16, os.getpid())}


def test_an_error_of_a_job_is_raised(tmp_path: Path) -> None:
    with TilePool(0) as pool, pytest.raises(ResourceError, match="no room for job 2"):
        pool.run(fail, [Job(n, tmp_path) for n in range(4)])


def test_a_lost_worker_s_job_is_run_again_once(tmp_path: Path) -> None:
    results: dict[int, tuple[int, int]] = {}
    jobs = [Job(0, tmp_path), Job(1, tmp_path, deaths=1), Job(2, tmp_path)]
    with TilePool(1) as pool:
        pool.run(work, jobs, results.__setitem__)
        assert {number: result[0] for number, result in results.items()} == {0: 0, 1: 1, 2: 4}
        assert os.getpid() not in {pid for _, pid in results.values()}
        with pytest.raises(
            EngineError, match=r"job 0 of the tiles was ended from outside, 2 times"
        ):
            pool.run(work, [Job(7, tmp_path, deaths=2)])


def test_no_process_is_left(tmp_path: Path) -> None:
    results: dict[int, tuple[int, int]] = {}
    with TilePool(1) as pool:
        pool.run(work, [Job(1, tmp_path)], results.__setitem__)
    with pytest.raises(ProcessLookupError):
        os.kill(results[0][1], 0)


def test_dask_is_asked_for_only_when_it_is_wanted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with TilePool(0, "tcp://127.0.0.1:1") as pool, pytest.raises(OptionError, match="cluster"):
        pool.run(work, [Job(1, tmp_path)])


def test_a_scheduler_that_does_not_answer_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed (terraport[cluster])")
    monkeypatch.setattr("terraport_pipeline.engines.tile_pool._CONNECT_TIMEOUT", "1s")
    with (
        TilePool(0, "tcp://127.0.0.1:9") as pool,
        pytest.raises(EngineError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"),
    ):
        pool.run(work, [Job(1, tmp_path)])


def test_a_cluster_without_workers_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Client:
        """Has a worker when it is asked first, and none after."""

        loop = None
        asked = 0

        def __init__(self, *_: object, **__: object) -> None: ...

        def scheduler_info(self, **_: object) -> dict[str, object]:
            self.asked += 1
            return {"workers": {"tcp://127.0.0.1:9": {}} if self.asked == 1 else {}}

        def submit(self, *_: object, key: str) -> str:
            return key

        def cancel(self, futures: list[str]) -> None:
            cancelled.extend(futures)

        def close(self) -> None: ...

    class AsCompleted:
        """Nothing is ever ready."""

        def __init__(self, *_: object, **__: object) -> None: ...

        def is_empty(self) -> bool:
            return False

        def next_batch(self, *, block: bool) -> list[str]:
            assert not block
            return []

    cancelled: list[str] = []
    fake = SimpleNamespace(Client=Client, as_completed=AsCompleted)
    monkeypatch.setitem(sys.modules, "distributed", fake)
    monkeypatch.setattr(tile_pool, "_LOOK_S", 0.0)
    monkeypatch.setattr(tile_pool, "_ABANDONED_S", 0.2)
    with (
        TilePool(0, "tcp://127.0.0.1:8786") as pool,
        pytest.raises(EngineError, match=r"at tcp://127\.0\.0\.1:8786 has had no workers for 0 s"),
    ):
        pool.run(work, [Job(1, tmp_path), Job(2, tmp_path)])
    assert len(cancelled) == 2
