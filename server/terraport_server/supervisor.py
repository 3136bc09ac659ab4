"""Several worker processes behind one port: started, watched, replaced one by one, ended together.

Their listening sockets are opened and kept by this process (:mod:`terraport_server.listeners`): a
connection that waits while a worker ends or dies is accepted by the next one. This process itself
answers nobody.

========= ======================================================================================
signal    what happens
========= ======================================================================================
SIGTERM,  no new sessions, open landings finish, everything ends within a bounded time; a second
SIGINT    one ends it at once
SIGHUP    settings are read again; worker by worker, a new one is ready before the old one drains
========= ======================================================================================
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, Final

from pydantic import SecretStr

from terraport_server.control import Channel
from terraport_server.errors import ServerError
from terraport_server.listeners import Listeners
from terraport_server.logs import log
from terraport_server.merged_metrics import EndedWorkers
from terraport_server.settings import Settings

__all__ = ["Supervisor"]

_START_TIMEOUT_S: Final = 120.0
"""A scene of a million segments takes some seconds to open; more than this is a hang."""
_FIRST_PAUSE_S: Final = 0.5
_LONGEST_PAUSE_S: Final = 30.0
_STEADY_S: Final = 60.0
"""A worker that lived so long did not fail at its start: the pauses begin anew."""
_MEASURE_TIMEOUT_S: Final = 2.0


class _Worker:
    """A worker process and its channel. Its tasks end with it."""

    def __init__(self, slot: int, process: asyncio.subprocess.Process, channel: Channel) -> None:
        self.slot = slot
        self.process = process
        self.channel = channel
        self.began_s = time.monotonic()
        self.ready = asyncio.Event()
        self.ended = asyncio.Event()
        self.is_expected_to_end = False
        self.page = ""
        """Its metrics as last heard."""
        self.measured = asyncio.Event()
        self.heard_out = asyncio.Event()
        """Its last word was read."""

    def kill(self) -> None:
        """Kill the process; nothing where it has ended."""
        with contextlib.suppress(ProcessLookupError):
            self.process.kill()


class Supervisor:
    """Runs ``settings.workers`` processes until a signal.

    Parameters
    ----------
    settings
        Checked; ``workers`` is at least 1.
    listeners
        For so many workers; closed at the end.
    reread
        Reads the settings again, for a rolling restart; host, port and the number of workers stay.
    """

    def __init__(
        self,
        settings: Settings,
        listeners: Listeners,
        reread: Callable[[], Settings] | None = None,
    ) -> None:
        self._settings = settings
        self._listeners = listeners
        self._reread = reread
        self._workers: dict[int, _Worker] = {}
        self._leaving: set[_Worker] = set()
        self._locks = [asyncio.Lock() for _ in range(settings.workers)]
        self._failures = [0] * settings.workers
        self._tasks: set[asyncio.Task[None]] = set()
        self._stopping = asyncio.Event()
        self._rolling = True
        """Nothing is rolled before all of them are ready for the first time."""
        self._collecting: asyncio.Task[str] | None = None
        self._counted = EndedWorkers()
        self._restarts = 0
        self._rolls = 0

    async def run(self) -> None:
        """Serve until SIGTERM or SIGINT, then end all workers.

        Needs the main thread: it takes the signals.

        Raises
        ------
        ServerError
            When a worker does not come up at the start; nothing is left running.
        """
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self._stop)
        loop.add_signal_handler(signal.SIGHUP, self._roll_soon)
        try:
            starts = [self._start(slot) for slot in range(self._settings.workers)]
            failures = await asyncio.gather(*starts, return_exceptions=True)
            if not self._stopping.is_set():
                for failure in failures:
                    if failure is not None:
                        raise failure
                log("workers ready", workers=len(self._workers))
                self._rolling = False
                await self._stopping.wait()
        finally:
            await self._end_all()

    def _stop(self) -> None:
        if self._stopping.is_set():
            for worker in self._alive():
                worker.kill()
        self._stopping.set()

    def _roll_soon(self) -> None:
        if self._rolling or self._stopping.is_set():
            return  # one is under way, or the first start: what comes up is new
        self._rolling = True
        self._spawn(self._roll())

    def _alive(self) -> list[_Worker]:
        return [*self._workers.values(), *self._leaving]

    async def _start(self, slot: int) -> None:
        """Start a worker and wait until it is ready; the one in its place is not touched.

        Raises
        ------
        ServerError
            When it ends or stalls before that.
        """
        ours, theirs = socket.socketpair()
        numbers = [listener.fileno() for listener in self._listeners.of(slot)]
        with theirs:
            process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "terraport_server.worker",
                str(theirs.fileno()),
                stdin=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(), *numbers),
                start_new_session=True,  # Ctrl-C is ours alone to hear
            )
        channel = await Channel.open(ours)
        channel.say("start", settings=_as_plain(self._settings), listeners=numbers)
        worker = _Worker(slot, process, channel)
        self._leaving.add(worker)
        self._spawn(self._hear(worker))
        self._spawn(self._watch(worker))
        events = (worker.ready, worker.ended, self._stopping)
        waits = {asyncio.ensure_future(event.wait()) for event in events}
        try:
            await asyncio.wait(waits, timeout=_START_TIMEOUT_S, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for wait in waits:
                wait.cancel()
            if not worker.ready.is_set() or worker.ended.is_set():
                worker.is_expected_to_end = True
                worker.kill()
        if worker.is_expected_to_end:
            what = f"was not ready in {_START_TIMEOUT_S:g} s"
            if worker.ended.is_set() or self._stopping.is_set():
                what = "ended before it was ready"
            raise ServerError(f"worker {slot} {what}, expected it to serve; its log says why")
        self._leaving.discard(worker)
        old, self._workers[slot] = self._workers.get(slot), worker
        log("worker ready", worker=slot, process=process.pid)
        if old is not None:
            self._leaving.add(old)

    async def _hear(self, worker: _Worker) -> None:
        """Take what a worker says until it is gone."""
        while (message := await worker.channel.hear()) is not None:
            kind = message["kind"]
            if kind == "ready":
                worker.ready.set()
            elif kind == "page":
                worker.page = message["page"]
                worker.measured.set()
            elif kind == "scrape":
                self._spawn(self._answer(worker, message["number"]))
        worker.heard_out.set()
        await worker.channel.close()

    async def _watch(self, worker: _Worker) -> None:
        """Wait for a worker's end; keep what it counted, and start another one in its place."""
        code = await worker.process.wait()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_MEASURE_TIMEOUT_S):
                await worker.heard_out.wait()
        self._counted.add(worker.page)
        worker.page = ""
        worker.ended.set()
        worker.measured.set()
        self._leaving.discard(worker)
        if worker.is_expected_to_end or self._stopping.is_set():
            log("worker ended", worker=worker.slot, process=worker.process.pid, code=code)
            return
        if self._workers.get(worker.slot) is worker:
            del self._workers[worker.slot]
        log(
            "worker died",
            level=logging.ERROR,
            worker=worker.slot,
            process=worker.process.pid,
            code=code,
        )
        if time.monotonic() - worker.began_s >= _STEADY_S:
            self._failures[worker.slot] = 0
        await self._revive(worker.slot)

    async def _revive(self, slot: int) -> None:
        async with self._locks[slot]:
            while not self._stopping.is_set() and slot not in self._workers:
                pause_s = min(_LONGEST_PAUSE_S, _FIRST_PAUSE_S * 2.0 ** self._failures[slot])
                self._failures[slot] = min(16, self._failures[slot] + 1)
                if self._failures[slot] > 1:
                    self._listeners.give_up(slot)
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(pause_s):
                        await self._stopping.wait()
                        return
                self._restarts += 1
                try:
                    await self._start(slot)
                except (ServerError, OSError) as error:
                    log("worker not started", level=logging.ERROR, worker=slot, reason=str(error))

    async def _roll(self) -> None:
        """Replace every worker, one at a time; stop at the first that does not come up."""
        try:
            self._read_settings()
            log("rolling restart", workers=len(self._locks))
            for slot, lock in enumerate(self._locks):
                async with lock:
                    if self._stopping.is_set():
                        return
                    old = self._workers.get(slot)
                    await self._start(slot)
                    if old is not None:
                        await self._retire(old)
            self._rolls += 1
            log("rolling restart done", workers=len(self._locks))
        except (ServerError, OSError) as error:
            log("rolling restart stopped", level=logging.ERROR, reason=str(error))
        finally:
            self._rolling = False

    def _read_settings(self) -> None:
        """Take settings that can be changed while running; raises where they cannot be used."""
        if self._reread is None:
            return
        fixed = {name: getattr(self._settings, name) for name in ("host", "port", "workers")}
        settings = self._reread().model_copy(update=fixed)
        settings.check()
        self._settings = settings

    async def _retire(self, worker: _Worker) -> None:
        worker.is_expected_to_end = True
        worker.channel.say("retire")
        await self._await_end(worker)

    async def _await_end(self, worker: _Worker) -> None:
        """Wait for a worker that was told to end, at most as long as it may take."""
        settings = self._settings
        bound_s = settings.drain_timeout_s + 2 * settings.close_timeout_s + 5.0
        try:
            async with asyncio.timeout(bound_s):
                await worker.ended.wait()
        except TimeoutError:
            log("worker killed", level=logging.ERROR, worker=worker.slot, after_s=bound_s)
            worker.kill()
            await worker.ended.wait()

    async def _end_all(self) -> None:
        self._stopping.set()
        for worker in self._alive():
            worker.is_expected_to_end = True
            if worker.ready.is_set():
                with contextlib.suppress(ProcessLookupError):
                    worker.process.terminate()
            else:
                worker.kill()
        await asyncio.gather(*(self._await_end(worker) for worker in self._alive()))
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._listeners.close()

    async def _answer(self, worker: _Worker, number: int) -> None:
        """Give a worker the metrics of all; scrapes at one time share one collection."""
        if self._collecting is None:
            self._collecting = asyncio.create_task(self._collect())
        try:
            page = await asyncio.shield(self._collecting)
        finally:
            self._collecting = None
        worker.channel.say("merged", number=number, page=page)

    async def _collect(self) -> str:
        asked = [worker for worker in self._alive() if worker.ready.is_set()]
        for worker in asked:
            worker.measured.clear()
            worker.channel.say("measure")
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_MEASURE_TIMEOUT_S):
                for worker in asked:
                    await worker.measured.wait()
        pages = [worker.page for worker in asked]
        return self._counted.merged_with(pages) + "".join(f"{line}\n" for line in self._own_page())

    def _own_page(self) -> Iterator[str]:
        starting = sum(not worker.ready.is_set() for worker in self._leaving)
        yield "# HELP terraport_workers Worker processes by what they do"
        yield "# TYPE terraport_workers gauge"
        yield f'terraport_workers{{state="serving"}} {len(self._workers)}'
        yield f'terraport_workers{{state="draining"}} {len(self._leaving) - starting}'
        yield f'terraport_workers{{state="starting"}} {starting}'
        yield "# HELP terraport_workers_wanted Worker processes that should serve"
        yield "# TYPE terraport_workers_wanted gauge"
        yield f"terraport_workers_wanted {len(self._locks)}"
        yield "# HELP terraport_worker_restarts_total Starts after a worker ended by itself"
        yield "# TYPE terraport_worker_restarts_total counter"
        yield f"terraport_worker_restarts_total {self._restarts}"
        yield "# HELP terraport_rolling_restarts_total Rolling restarts completed"
        yield "# TYPE terraport_rolling_restarts_total counter"
        yield f"terraport_rolling_restarts_total {self._rolls}"

    def _spawn(self, work: Any) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


def _as_plain(settings: Settings) -> dict[str, Any]:
    """Every setting as JSON has it, secrets included: for the worker's pair of sockets alone."""
    plain: dict[str, Any] = settings.model_dump(mode="json")
    for name in type(settings).model_fields:
        value = getattr(settings, name)
        if isinstance(value, SecretStr):
            plain[name] = value.get_secret_value()
    return plain
