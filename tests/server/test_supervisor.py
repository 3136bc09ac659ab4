"""Several workers behind one port: signals, crashes, rolling restarts, one page of metrics."""

from __future__ import annotations

import asyncio
import os
import random
import re
import signal
import socket
from collections.abc import Iterator
from contextlib import AsyncExitStack, ExitStack
from pathlib import Path

import httpx
import pytest
from server.grid_scene import SIDE, TILE_M, GridScene, write_grid_scene
from server.plain_client import PlainClient, assemble
from server.supervised import Supervised, is_alive

import terraport
from terraport_server.errors import ServerError
from terraport_server.listeners import Listeners
from terraport_server.port_holder import _listening_inodes
from terraport_server.settings import Settings
from terraport_server.supervisor import Supervisor
from terraport_wire import Credit, Land, Notice, Plan, Ready

CENTRE = (SIDE * TILE_M / 2, 1.0, SIDE * TILE_M / 2)
EVERYWHERE_M = 100.0

pytestmark = pytest.mark.skipif(
    not Path("/proc/self").exists(), reason="looks at processes in /proc"
)


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `pit` (36 small segments) and `big` (36 of about 300 KB)."""
    return tmp_path_factory.mktemp("supervised") / "scenes"


@pytest.fixture(scope="module")
def pit(scenes: Path) -> GridScene:
    """The scene of 36 small segments."""
    return write_grid_scene(scenes / "pit")


@pytest.fixture(scope="module")
def big(scenes: Path) -> GridScene:
    """The scene of 36 segments of about 300 KB."""
    return write_grid_scene(scenes / "big", cells=80, compress=False, name="big")


@pytest.fixture(scope="module")
def service(pit: GridScene, big: GridScene) -> Iterator[Supervised]:
    """Two workers, for tests that leave two workers behind."""
    with Supervised(pit.path.parent, max_messages_per_s="10000") as running:
        yield running


def test_a_rolling_restart_costs_no_landing(
    service: Supervised, pit: GridScene, big: GridScene
) -> None:
    """Clients land all the time, one landing stays open: nothing fails, is lost or sent twice.

    Five rolls in a row, timed: benchmarks/rolling_restart.py.
    """
    before, old = service.metrics(), service.worker_pids()
    settings = service.directory / ".env"
    settings.write_text("TERRAPORT_MAX_RADIUS_M=400\n")

    async def client(number: int, over: asyncio.Event) -> tuple[int, int]:
        chance = random.Random(number)
        landings = 0
        # Credit for some segments only: a landing has many round trips in which to be rolled.
        async with terraport.connect(f"{service.url}/scenes/big", credit_bytes=700_000) as session:
            while not over.is_set():
                position = (chance.uniform(0, 60), 1.0, chance.uniform(0, 60))
                landing = await session.land(position, radius_m=chance.uniform(5, 25))
                segments = await landing.ready(30)
                assert [segment.payload for segment in segments] == [
                    big.payloads[segment.id] for segment in segments
                ]
                assert landing.stats.rejected == 0
                landings += 1
                await asyncio.sleep(0.02)
            assert session.stats.repeated_bytes == 0
            return landings, session.stats.connections

    async def work() -> list[tuple[int, int]]:
        over = asyncio.Event()
        clients = [asyncio.create_task(client(number, over)) for number in range(4)]
        asking = asyncio.create_task(ask(over))
        rolled = asyncio.create_task(asyncio.to_thread(roll))
        done, _ = await asyncio.wait(
            [rolled, asking, *clients], return_when=asyncio.FIRST_COMPLETED
        )
        for task in done:
            task.result()  # a client that failed says why
        over.set()
        await asking
        return await asyncio.gather(*clients)

    async def ask(over: asyncio.Event) -> None:
        """Ask on one connection, as a proxy's pool does: nothing but good answers.

        A connection that was idle beyond the grace (a test that stood still) may close in the
        moment of asking; HTTP clients ask again then.
        """
        async with httpx.AsyncClient() as kept:
            while not over.is_set():
                try:
                    answer = await kept.get(f"{service.url}/readyz")
                except httpx.RemoteProtocolError:
                    answer = await kept.get(f"{service.url}/readyz")
                answer.raise_for_status()
                await asyncio.sleep(0.01)

    def roll() -> None:
        """Roll; see a landing that is open finished by the worker that goes."""
        with PlainClient(f"{service.url}/scenes/pit") as open_one:
            assert open_one.hello(credit_bytes=20_000).limits.max_radius_m == 500.0
            open_one.send(Land(generation=1, position=(30.0, 0.0, 30.0), radius_m=100.0))
            open_one.expect(Plan)
            service.process.send_signal(signal.SIGHUP)
            # Told at once where its worker goes first, else some seconds later.
            service.until(lambda: service.log.count("draining") > 0, 60)
            notice, first, _ = open_one.until(Notice)
            assert notice.kind == "draining"
            # Who takes over is there already: back at once, in a row.
            assert notice.reconnect_after_ms is not None
            assert notice.reconnect_after_ms < 20
            # The service as a whole goes nowhere: proxies hear no different.
            assert httpx.get(f"{service.url}/readyz").status_code == 200
            open_one.send(Credit(bytes=1 << 30))
            ready, frames, _ = open_one.until(Ready)
            assert ready.delivered == 36
            assert assemble([*first, *frames]) == dict(enumerate(pit.payloads))
            assert open_one.closed() == 4503
        service.until(lambda: "rolling restart done" in service.log, 60)

    results = asyncio.run(asyncio.wait_for(work(), 120))
    assert all(landings > 10 for landings, _ in results), results
    # Every worker that held a client was replaced.
    assert all(connections >= 2 for _, connections in results), results
    assert not any(is_alive(pid) for pid in old)
    after = service.metrics()
    name = "terraport_landings_total{scene=big}"
    planned = after[name] - before.get(name, 0.0)
    # A landing that the roll interrupted is planned again; what a worker that is gone had counted
    # is still there.
    landings = sum(count for count, _ in results)
    assert landings <= planned <= landings + sum(count for _, count in results)
    assert after["terraport_rolling_restarts_total{}"] == 1.0
    assert after["terraport_worker_restarts_total{}"] == 0.0
    assert "Traceback" not in service.log
    with PlainClient(f"{service.url}/scenes/pit") as client_of_new:
        limits = client_of_new.hello().limits
        assert limits.max_radius_m == 400.0
        assert limits.groups == "query"  # by which all of a group come to one process
    # Settings that cannot be used change nothing.
    pids = service.worker_pids()
    settings.write_text("TERRAPORT_MAX_RADIUS_M=-1\n")
    service.process.send_signal(signal.SIGHUP)
    service.until(lambda: "rolling restart stopped" in service.log, 20)
    settings.unlink()
    assert service.worker_pids() == pids


def test_a_scrape_counts_all_workers_whoever_answers(service: Supervised, pit: GridScene) -> None:
    name = "terraport_sessions_active{scene=pit}"
    clients = [PlainClient(f"{service.url}/scenes/pit") for _ in range(12)]
    try:
        for client in clients:
            client.hello()
        scrapes = [service.metrics() for _ in range(6)]
        assert {metrics[name] for metrics in scrapes} == {12.0}
        assert scrapes[0]["terraport_workers{state=serving}"] == 2.0
        assert scrapes[0]["terraport_workers_wanted{}"] == 2.0
    finally:
        for client in clients:
            client.__exit__(None, None, None)


def test_a_worker_that_dies_is_replaced_and_its_clients_resume(
    service: Supervised, big: GridScene
) -> None:
    victims = service.worker_pids()[-2:]
    killed = []
    all_in = asyncio.Barrier(6)

    async def client(number: int) -> int:
        async with terraport.connect(f"{service.url}/scenes/big", credit_bytes=300_000) as session:
            await all_in.wait()  # a handshake with a worker that is killed fails, rightly
            landing = await session.land(CENTRE, radius_m=EVERYWHERE_M)
            seen = 0
            async for _ in landing:
                seen += 1
                # Nobody knows which of the two the first client sits on: if not on the one that
                # is killed first, then on the other one.
                if number == 0 and seen in {5, 20} and session.stats.connections == 1:
                    killed.append(victims[len(killed)])
                    os.kill(killed[-1], signal.SIGKILL)
            assert [segment.payload for segment in landing.segments] == big.payloads
            assert seen == 36
            assert session.stats.repeated_bytes == 0
            return session.stats.connections

    async def work() -> list[int]:
        return await asyncio.gather(*map(client, range(6)))

    before = service.metrics()
    connections = asyncio.run(asyncio.wait_for(work(), 60))
    assert connections[0] == 2
    service.until(lambda: service.metrics()["terraport_workers{state=serving}"] == 2.0, 30)
    after = service.metrics()
    name = "terraport_worker_restarts_total{}"
    assert after[name] - before[name] == len(killed)
    name = "terraport_landings_total{scene=big}"
    assert after[name] >= before[name]
    assert service.log.count("worker died") == len(killed)


def listening(process: int, port: int) -> int:
    """Sockets of the port that a process's event loop waits for."""
    inodes = _listening_inodes(port)
    watched = 0
    for descriptor in Path(f"/proc/{process}/fd").iterdir():
        if str(descriptor.readlink()) == "anon_inode:[eventpoll]":
            for line in Path(f"/proc/{process}/fdinfo/{descriptor.name}").read_text().splitlines():
                if line.startswith("tfd:"):
                    target = Path(f"/proc/{process}/fd/{line.split()[1]}")
                    watched += str(target.readlink()) in inodes
    return watched


def answers(port: int, count: int) -> list[str]:
    """Connect so often, all at once; return the first line of each answer."""
    lines = []
    with ExitStack() as stack:
        connections = [
            stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=60))
            for _ in range(count)
        ]
        for connection in connections:
            connection.sendall(b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        for connection in connections:
            lines.append(connection.recv(65536).decode().split("\r\n")[0])
    return lines


def test_who_connects_to_a_worker_that_hangs_is_served_by_the_others(pit: GridScene) -> None:
    """It is stopped all the while: nobody but the other worker can have answered."""
    with Supervised(pit.path.parent, worker_hang_s="3600") as running:
        victim = running.worker_pids()[0]
        # Both start at once: whose number is lower is chance.
        ready = re.search(rf"worker ready worker=(\d) process={victim}\n", running.log)
        assert ready is not None
        os.kill(victim, signal.SIGSTOP)
        try:
            # Half of them fall to the stopped one.
            assert answers(running.port, 24) == ["HTTP/1.1 200 OK"] * 24
            metrics = running.metrics()
        finally:
            os.kill(victim, signal.SIGCONT)
        assert metrics["terraport_workers{state=silent}"] == 1.0
        assert metrics["terraport_workers{state=serving}"] == 1.0
        assert metrics["terraport_worker_silences_total{}"] >= 1.0
        assert f"worker silent worker={ready[1]}\n" in running.log
        # Heard again, it is as before: each accepts from its own socket alone.
        running.until(lambda: running.metrics()["terraport_workers{state=serving}"] == 2.0, 30)
        assert running.metrics()["terraport_worker_restarts_total{}"] == 0.0
        running.until(lambda: listening(running.worker_pids()[1], running.port) == 1, 30)


def test_a_worker_that_hangs_for_long_is_replaced(pit: GridScene) -> None:
    with Supervised(pit.path.parent, worker_hang_s="1.5") as running:
        victim = running.worker_pids()[1]
        os.kill(victim, signal.SIGSTOP)
        running.until(lambda: "worker died" in running.log, 60)
        # While its successor starts, too.
        assert answers(running.port, 24) == ["HTTP/1.1 200 OK"] * 24
        running.until(lambda: len(running.worker_pids()) == 3, 60)
        assert not is_alive(victim)


def test_all_of_a_group_meet_in_one_worker(service: Supervised) -> None:
    """Whichever accepts them; so do those who come back, and those of another scene's group."""

    async def party(stack: AsyncExitStack, name: str) -> list[terraport.Group]:
        sessions = [
            await stack.enter_async_context(
                terraport.connect(f"{service.url}/scenes/pit", group=name if number % 2 else None)
            )
            for number in range(6)
        ]
        groups = [
            await session.join_group(name, role="member" if number else "guide")
            for number, session in enumerate(sessions)
        ]
        for group in groups:
            await group.members_present(6, 60)
        return groups

    async def work() -> None:
        async with AsyncExitStack() as stack:
            parties = [await party(stack, name) for name in ("tour", "inspection", "class-7b")]
            for groups in parties:
                call = await groups[0].land_group((30.0, 0.0, 30.0), 15.0)
                for group in groups:
                    landing_call = group.newest or await group.next_landing(60)
                    await landing_call.land()
                assert (await call.all_there(60)).complete
            metrics = await asyncio.to_thread(service.metrics)
            assert metrics["terraport_groups_active{}"] == 3.0
            assert metrics["terraport_group_members{}"] == 18.0

    before = service.metrics()["terraport_passed_connections_total{}"]
    asyncio.run(asyncio.wait_for(work(), 200))
    assert service.metrics()["terraport_passed_connections_total{}"] - before == 18


def test_every_line_says_which_worker(service: Supervised) -> None:
    """Of the service's own and of uvicorn's."""
    with PlainClient(f"{service.url}/scenes/pit") as client:
        client.hello()
    lines = [line for line in service.log.splitlines() if "Started server process" in line]
    assert {re.findall(r" worker=(\d)", line)[0] for line in lines} == {"0", "1"}
    service.until(lambda: "session closed" in service.log, 20)
    for line in service.log.splitlines():
        if " session=" in line:
            assert " worker=" in line


def test_workers_that_cannot_start_end_the_service(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """An unreadable certificate is found by the workers only."""
    for name in ("a.pem", "b.pem"):
        (tmp_path / name).write_text("no certificate")
    settings = Settings(
        scenes_dir=tmp_path, tls_certificate=tmp_path / "a.pem", tls_key=tmp_path / "b.pem"
    )

    async def work() -> None:
        await Supervisor(settings, Listeners("127.0.0.1", 0, 1)).run()

    with pytest.raises(ServerError, match="worker 0 ended before it was ready, expected it to"):
        asyncio.run(asyncio.wait_for(work(), 60))


def test_sigterm_finishes_open_landings_and_leaves_no_process(
    service: Supervised, pit: GridScene
) -> None:
    """The last one: it ends the service that all of these share."""
    pids = service.worker_pids()[-2:]
    with PlainClient(f"{service.url}/scenes/pit") as client:
        client.hello(credit_bytes=20_000)
        client.send(Land(generation=1, position=(30.0, 0.0, 30.0), radius_m=60.0))
        client.expect(Plan)
        service.process.send_signal(signal.SIGTERM)
        notice, before, _ = client.until(Notice)
        assert notice.reconnect_after_ms == 1000
        client.send(Credit(bytes=1 << 30))
        _, frames, _ = client.until(Ready)
        assert assemble([*before, *frames]) == dict(enumerate(pit.payloads))
        assert client.closed() == 4503
    assert service.process.wait(20) == 0
    assert not any(is_alive(pid) for pid in pids)
    assert "Traceback" not in service.log
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", service.port))
