"""Runs one function over many jobs: in threads, in processes, or on a Dask cluster.

Jobs and results are small (paths and numbers); what is large lies in files that every process can
reach. A job must be repeatable: one whose worker was lost is run again once.
"""

from __future__ import annotations

import multiprocessing
import os
import secrets
import signal
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from types import TracebackType
from typing import Any, Final, Self, TypeVar

from terraport_pipeline.engines.poisson_child import die_with_parent
from terraport_pipeline.errors import EngineError, OptionError

__all__ = ["TilePool"]

J = TypeVar("J")
R = TypeVar("R")

_ATTEMPTS: Final = 2

_CONNECT_TIMEOUT: Final = "20s"

_ABANDONED_S: Final = 60.0
"""A cluster without a worker for so long is given up: one that starts its workers again does it
within seconds, and no build waits for ever."""

_LOOK_S: Final = 5.0
"""Between two looks at a cluster's workers: each asks the scheduler."""

_POLL_S: Final = 0.1


class TilePool:
    """Workers that stay for many calls; a context manager, which leaves none behind.

    Parameters
    ----------
    workers : int
        Processes, started when they are needed; 0 runs everything in this one.
    cluster : str, optional
        Address of a Dask scheduler instead, ``tcp://host:8786``. Its workers need the same release
        of terraport and the same paths.
    threads : bool
        Threads of this process instead of processes.
    """

    def __init__(self, workers: int, cluster: str | None = None, *, threads: bool = False) -> None:
        self._workers = workers
        self._cluster = cluster
        self._threads = threads
        self._pool: ProcessPoolExecutor | ThreadPoolExecutor | None = None
        self._client: Any = None

    @classmethod
    def of_threads(cls, workers: int) -> Self:
        """Make a pool of threads; jobs need not be picklable."""
        return cls(workers, threads=True)

    @property
    def is_apart(self) -> bool:
        """Whether jobs run in other processes, each by itself."""
        return self._cluster is not None or (self._workers > 0 and not self._threads)

    @property
    def workers(self) -> int:
        """How many jobs share this machine; on a cluster each worker counts for itself."""
        return 1 if self._cluster is not None else max(1, self._workers)

    def threads_each(self, threads: int) -> int:
        """Share this machine's threads among the workers; a cluster's workers have one each."""
        return 1 if self._cluster is not None else max(1, threads // self.workers)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._end_pool()
        if self._client is not None:
            self._client.close()
            self._client = None

    def run(
        self,
        function: Callable[[J], R],
        jobs: Sequence[J],
        done: Callable[[int, R], None] = lambda _number, _result: None,
    ) -> None:
        """Run `function` on every job.

        Parameters
        ----------
        function : callable
            At the top of a module, so that other processes find it.
        jobs : sequence
            Picklable. Started in this order.
        done : callable
            Told (number of the job, result) as jobs finish, in any order.

        Raises
        ------
        PipelineError
            Whatever a job raised; jobs that wait are given up, those that run are ended.
        EngineError
            A job's worker was lost twice, or the cluster cannot be reached.
        OptionError
            A cluster is wanted and Dask is not installed.
        """
        if not jobs:
            return
        if self._cluster is not None:
            self._run_on_cluster(function, jobs, done)
        elif self._workers < 1:
            for number, job in enumerate(jobs):
                done(number, function(job))
        else:
            self._run_here(function, jobs, done)

    def _run_here(
        self, function: Callable[[J], R], jobs: Sequence[J], done: Callable[[int, R], None]
    ) -> None:
        waiting = deque(range(len(jobs)))
        lost = [0] * len(jobs)
        running: dict[Future[R], int] = {}
        while waiting or running:
            try:
                while waiting and len(running) < self._workers:
                    number = waiting[0]
                    running[self._executor().submit(function, jobs[number])] = number
                    waiting.popleft()
                finished, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in finished:
                    result = future.result()
                    done(running.pop(future), result)
            except BrokenProcessPool:
                # Which worker died cannot be told: all that ran are run again.
                for number in running.values():
                    lost[number] += 1
                    _refuse_twice_lost(number, lost[number])
                waiting.extendleft(sorted(running.values(), reverse=True))
                running.clear()
                self._end_pool()

    def _executor(self) -> ProcessPoolExecutor | ThreadPoolExecutor:
        if self._pool is None and self._threads:
            self._pool = ThreadPoolExecutor(self._workers)
        elif self._pool is None:
            self._pool = ProcessPoolExecutor(
                self._workers,
                mp_context=multiprocessing.get_context("spawn"),
                initializer=_start_worker,
                initargs=(os.getpid(),),
            )
        return self._pool

    def _end_pool(self) -> None:
        """Leave no process behind, also when jobs still run."""
        if self._pool is None:
            return
        processes = list((getattr(self._pool, "_processes", None) or {}).values())
        self._pool.shutdown(wait=self._threads, cancel_futures=True)  # no thread can be ended
        for process in processes:
            if process.is_alive():
                process.terminate()
        for process in processes:
            process.join()
        self._pool = None

    def _run_on_cluster(
        self, function: Callable[[J], R], jobs: Sequence[J], done: Callable[[int, R], None]
    ) -> None:
        distributed = _import_dask()
        if self._client is None:
            self._client = _connect(distributed, str(self._cluster))
        # Keys are new each time: the scheduler would hand out an older result of an equal key.
        # A job runs again only when the worker that had it was lost.
        token = secrets.token_hex(4)
        futures = {
            self._client.submit(function, job, key=f"terraport-{token}-{number}"): number
            for number, job in enumerate(jobs)
        }
        try:
            completed = distributed.as_completed(list(futures), loop=self._client.loop)
            seen = looked = time.monotonic()
            while not completed.is_empty():
                for future in completed.next_batch(block=False):
                    done(futures[future], _result_of(future, futures[future], distributed))
                time.sleep(_POLL_S)
                now = time.monotonic()
                if now - looked > _LOOK_S:
                    looked = now
                    if self._client.scheduler_info(n_workers=-1)["workers"]:
                        seen = now
                    _refuse_abandoned(str(self._cluster), now - seen)
        except BaseException:
            self._client.cancel(list(futures))
            raise


def _refuse_twice_lost(number: int, times: int) -> None:
    if times >= _ATTEMPTS:
        raise EngineError(
            f"the process that worked on job {number} of the tiles was ended from outside, "
            f"{times} times (out of memory?); lower --max-memory or --tile-depth so that tiles "
            "are smaller, and give the same command again: finished tiles are kept"
        )


def _refuse_abandoned(cluster: str, without_workers_s: float) -> None:
    if without_workers_s > _ABANDONED_S:
        raise EngineError(
            f"the Dask scheduler at {cluster} has had no workers for {without_workers_s:.0f} s; "
            f"start some (dask worker {cluster}) and give the same command again: finished tiles "
            "are kept"
        )


def _start_worker(parent: int) -> None:
    """Prepare a worker: it ends with its parent, and leaves Ctrl-C to it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    die_with_parent(parent)


def _import_dask() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise OptionError(
            "--cluster needs Dask, which is not installed; install it with "
            "pip install 'terraport[cluster]'"
        ) from error
    return distributed


def _connect(distributed: Any, address: str) -> Any:
    try:
        client = distributed.Client(address, timeout=_CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise EngineError(
            f"no Dask scheduler answers at {address} ({error}); start one (dask scheduler) and "
            "workers (dask worker), or leave out --cluster"
        ) from error
    if not client.scheduler_info(n_workers=-1)["workers"]:
        client.close()
        raise EngineError(
            f"the Dask scheduler at {address} has no workers; start some: dask worker {address}"
        )
    return client


def _result_of(future: Any, number: int, distributed: Any) -> Any:
    try:
        return future.result()
    except distributed.KilledWorker as error:
        raise EngineError(
            f"the cluster lost the worker of tile {number} again and again ({error}); look at the "
            "workers' memory limits, and give the same command again: finished tiles are kept"
        ) from error
    except distributed.client.FutureCancelledError as error:
        raise EngineError(
            f"the cluster went away while tile {number} was worked on ({error}); give the same "
            "command again: finished tiles are kept"
        ) from error
