"""Runs one function over many jobs in other processes: of this machine, or of a Dask cluster.

Jobs and results are small (paths and numbers); what is large lies in files that every process can
reach. A job must be repeatable: one whose worker was lost is run again once.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Final, TypeVar

from terraport_pipeline.errors import EngineError, OptionError

__all__ = ["run_jobs"]

J = TypeVar("J")
R = TypeVar("R")

_ATTEMPTS: Final = 2


def run_jobs(
    function: Callable[[J], R],
    jobs: Sequence[J],
    *,
    workers: int,
    cluster: str | None = None,
    done: Callable[[int, R], None] = lambda _number, _result: None,
) -> None:
    """Run `function` on every job.

    Parameters
    ----------
    function : callable
        At the top of a module, so that other processes find it.
    jobs : sequence
        Picklable. Started in this order.
    workers : int
        Processes; 0 runs everything in this one.
    cluster : str, optional
        Address of a Dask scheduler instead, ``tcp://host:8786``. Its workers need the same release
        of terraport and the same paths.
    done : callable
        Told (number of the job, result) as jobs finish, in any order.

    Raises
    ------
    PipelineError
        Whatever a job raised; jobs that wait are given up, those that run are ended.
    EngineError
        A job's worker was lost twice, or the cluster cannot be reached.
    OptionError
        `cluster` is given and Dask is not installed.
    """
    if not jobs:
        return
    if cluster is not None:
        _run_on_cluster(function, jobs, cluster, done)
    elif workers < 1:
        for number, job in enumerate(jobs):
            done(number, function(job))
    else:
        _run_here(function, jobs, workers, done)


def _run_here(
    function: Callable[[J], R], jobs: Sequence[J], workers: int, done: Callable[[int, R], None]
) -> None:
    waiting = list(range(len(jobs)))
    lost = [0] * len(jobs)
    while waiting:
        pool = ProcessPoolExecutor(
            min(workers, len(waiting)),
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_start_worker,
            initargs=(os.getpid(),),
        )
        running: dict[Future[R], int] = {}
        try:
            while waiting or running:
                while waiting and len(running) < workers:
                    number = waiting.pop(0)
                    running[pool.submit(function, jobs[number])] = number
                finished, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in finished:
                    number = running[future]
                    result = future.result()
                    del running[future]
                    done(number, result)
        except BrokenProcessPool:
            # Which worker died cannot be told: all that ran are run again.
            for number in running.values():
                lost[number] += 1
            _refuse_twice_lost(lost)
            waiting = sorted(running.values()) + waiting
        finally:
            _end(pool)


def _refuse_twice_lost(lost: Sequence[int]) -> None:
    for number, times in enumerate(lost):
        if times >= _ATTEMPTS:
            raise EngineError(
                f"the process that worked on tile {number} was ended from outside, {times} times "
                "(out of memory?); lower --max-memory or --tile-depth so that tiles are smaller, "
                "and give the same command again: finished tiles are kept"
            )


def _end(pool: ProcessPoolExecutor) -> None:
    """Leave no process behind, also when jobs still run."""
    processes = list((getattr(pool, "_processes", None) or {}).values())
    pool.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        if process.is_alive():
            process.terminate()
    for process in processes:
        process.join()


def _start_worker(parent: int) -> None:
    """Prepare a worker: one thread, and gone with its parent."""
    import signal

    from terraport_pipeline.engines.poisson_child import die_with_parent

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the parent, which ends us
    die_with_parent(parent)


def _run_on_cluster(
    function: Callable[[J], R], jobs: Sequence[J], address: str, done: Callable[[int, R], None]
) -> None:
    try:
        import distributed
    except ImportError as error:
        raise OptionError(
            "--cluster needs Dask, which is not installed; install it with "
            "pip install 'terraport[cluster]'"
        ) from error
    try:
        client: Any = distributed.Client(address, timeout="30s", set_as_default=False)
    except (OSError, ValueError) as error:
        raise EngineError(
            f"no Dask scheduler answers at {address} ({error}); start one (dask scheduler) and "
            "workers, or leave out --cluster"
        ) from error
    try:
        # A worker that is lost takes its job to another one, once.
        futures = {
            client.submit(function, job, key=f"terraport-{os.getpid()}-{number}", retries=0): number
            for number, job in enumerate(jobs)
        }
        for future in distributed.as_completed(list(futures)):
            done(futures[future], _result_of(future, futures[future], distributed))
    finally:
        client.close()


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
