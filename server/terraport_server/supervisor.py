"""Several worker processes behind one port: started, watched, replaced one by one, ended together.

Their listening sockets are opened and kept by this process (:mod:`terraport_server.listeners`): a
connection that waits while a worker is dead or hangs is accepted by the others, within a second.
A connection that names a group is handed through here to the worker where that group lives. This
process itself answers nobody.

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
import time
from collections.abc import Callable, Iterator
from typing import Any, Final

from terraport_server.errors import ServerError
from terraport_server.group_homes import GroupHomes
from terraport_server.listeners import Listeners
from terraport_server.logging import OncePerMinute, log
from terraport_server.mailbox import Parcel
from terraport_server.merged_metrics import EndedWorkers
from terraport_server.settings import Settings
from terraport_server.worker_process import TICK_S, WorkerProcess

__all__ = ["Supervisor"]

_START_TIMEOUT_S: Final = 120.0
"""A scene of a million segments takes some seconds to open; more than this is a hang."""
_FIRST_PAUSE_S: Final = 0.5
_LONGEST_PAUSE_S: Final = 30.0
_STEADY_S: Final = 60.0
"""A worker that lived so long did not fail at its start: the pauses begin anew."""
_MEASURE_TIMEOUT_S: Final = 2.0


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
        self._workers: dict[int, WorkerProcess] = {}
        self._leaving: set[WorkerProcess] = set()
        self._locks = [asyncio.Lock() for _ in range(settings.workers)]
        self._failures = [0] * settings.workers
        self._tasks: set[asyncio.Task[None]] = set()
        self._stopping = asyncio.Event()
        self._rolling = True
        """Nothing is rolled before all of them are ready for the first time."""
        self._collecting: asyncio.Task[str] | None = None
        self._counted = EndedWorkers()
        self._homes: GroupHomes[WorkerProcess] = GroupHomes()
        self._once = OncePerMinute()
        self._restarts = 0
        self._rolls = 0
        self._silences = 0
        self._passed = 0

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
        self._spawn(self._watch_silence())
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

    def _alive(self) -> list[WorkerProcess]:
        return [*self._workers.values(), *self._leaving]

    async def _start(self, slot: int) -> None:
        """Start a worker and wait until it is ready; the one in its place is not touched.

        Raises
        ------
        ServerError
            When it ends or stalls before that.
        """
        worker = await WorkerProcess.launch(slot, self._settings, self._listeners, self._pass_on)
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
        log("worker ready", worker=slot, process=worker.process.pid)
        if old is not None:
            self._leaving.add(old)
            self._homes.forget(old)
        self._share_out()

    def _share_out(self) -> None:
        """See to it that somebody accepts from every socket.

        Each worker accepts from its own; from those of workers that are dead, silent or start, all
        others do: whoever is idle is first. One that was silent by mistake, and accepts too, does
        no harm.
        """
        if self._stopping.is_set() or not self._listeners.is_dealt:
            return
        able = {slot for slot, worker in self._workers.items() if not worker.is_silent}
        orphans = set(range(len(self._locks))) - able
        for slot in able:
            self._workers[slot].listen(tuple(sorted({slot} | orphans)))

    async def _watch_silence(self) -> None:
        """Look at who says nothing; others take its new clients, and in the end its place."""
        while True:
            await asyncio.sleep(TICK_S)
            for worker in list(self._workers.values()):
                was_silent = worker.is_silent
                worker.tick()
                if worker.is_silent and not was_silent:
                    self._silences += 1
                    if self._once.first(("silent", str(worker.slot)), time.monotonic()):
                        log("worker silent", level=logging.WARNING, worker=worker.slot)
                    self._share_out()
                if worker.silent_s >= self._settings.worker_hang_s and not self._stopping.is_set():
                    after_s = worker.silent_s
                    log("worker hangs", level=logging.ERROR, worker=worker.slot, silent_s=after_s)
                    worker.heard()  # once
                    worker.kill()

    def _pass_on(self, parcel: Parcel) -> None:
        """Hand a connection to the worker where its group lives; close it where there is none."""
        with parcel.connection as connection:
            workers = self._workers.items()
            able = [(slot, worker) for slot, worker in workers if not worker.is_silent]
            home = self._homes.home_of(parcel.group, able)
            if home is not None and home.mailbox is not None:
                sent = home.mailbox.send(parcel.group, parcel.head, connection.fileno())
                self._passed += sent

    async def _hear(self, worker: WorkerProcess) -> None:
        """Take what a worker says until it is gone."""
        while (message := await worker.channel.hear()) is not None:
            if worker.heard():
                self._share_out()
            kind = message["kind"]
            if kind == "ready":
                worker.ready.set()
            elif kind == "groups":
                if self._workers.get(worker.slot) is worker:
                    self._homes.tell(worker, message["names"])
            elif kind == "page":
                worker.page = message["page"]
                worker.measured.set()
            elif kind == "scrape":
                self._spawn(self._answer(worker, message["number"]))
        worker.heard_out.set()
        # It is gone, or as good as: its process may take a while yet.
        if self._workers.get(worker.slot) is worker and not worker.is_expected_to_end:
            self._leave_out(worker)
        if worker.mailbox is not None:
            worker.mailbox.close()
        await worker.channel.close()

    def _leave_out(self, worker: WorkerProcess) -> None:
        """Let others take a worker's new clients, and its groups."""
        del self._workers[worker.slot]
        self._homes.forget(worker)
        self._leaving.add(worker)
        self._share_out()

    async def _watch(self, worker: WorkerProcess) -> None:
        """Wait for a worker's end; keep what it counted, and start another one in its place."""
        code = await worker.process.wait()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_MEASURE_TIMEOUT_S):
                await worker.heard_out.wait()
        if self._workers.get(worker.slot) is worker:
            self._leave_out(worker)
        self._counted.add(worker.page)
        worker.page = ""
        worker.ended.set()
        worker.measured.set()
        self._leaving.discard(worker)
        if worker.is_expected_to_end or self._stopping.is_set():
            log("worker ended", worker=worker.slot, process=worker.process.pid, code=code)
            return
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

    async def _retire(self, worker: WorkerProcess) -> None:
        worker.is_expected_to_end = True
        worker.channel.say("retire")
        await self._await_end(worker)

    async def _await_end(self, worker: WorkerProcess) -> None:
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

    async def _answer(self, worker: WorkerProcess, number: int) -> None:
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
        silent = sum(worker.is_silent for worker in self._workers.values())
        yield f'terraport_workers{{state="serving"}} {len(self._workers) - silent}'
        yield f'terraport_workers{{state="silent"}} {silent}'
        yield f'terraport_workers{{state="draining"}} {len(self._leaving) - starting}'
        yield f'terraport_workers{{state="starting"}} {starting}'
        yield "# HELP terraport_workers_wanted Worker processes that should serve"
        yield "# TYPE terraport_workers_wanted gauge"
        yield f"terraport_workers_wanted {len(self._locks)}"
        yield "# HELP terraport_worker_restarts_total Starts after a worker ended by itself"
        yield "# TYPE terraport_worker_restarts_total counter"
        yield f"terraport_worker_restarts_total {self._restarts}"
        yield "# HELP terraport_worker_silences_total Times that a worker said nothing for too long"
        yield "# TYPE terraport_worker_silences_total counter"
        yield f"terraport_worker_silences_total {self._silences}"
        yield "# HELP terraport_passed_connections_total Connections handed to their group's worker"
        yield "# TYPE terraport_passed_connections_total counter"
        yield f"terraport_passed_connections_total {self._passed}"
        yield "# HELP terraport_rolling_restarts_total Rolling restarts completed"
        yield "# TYPE terraport_rolling_restarts_total counter"
        yield f"terraport_rolling_restarts_total {self._rolls}"

    def _spawn(self, work: Any) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
