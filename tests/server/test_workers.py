"""`terraport serve --workers N` as processes: landings, metrics, crashes, restarts."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from eventually import eventually
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient, assemble
from server.test_serving import serving
from websockets.exceptions import ConnectionClosed

from terraport_wire import Ready

pytestmark = pytest.mark.skipif(not Path("/proc/self").exists(), reason="reads /proc")


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[int, str]]:
    """Two workers: the parent's process id, and the address."""
    scenes = tmp_path_factory.mktemp("workers") / "scenes"
    write_grid_scene(scenes / "pit")
    with serving(str(scenes), "--workers", "2") as (process, url):
        eventually(lambda: len(workers(process.pid)) == 2, 60)
        yield process.pid, url


def workers(parent: int) -> list[int]:
    """Return the worker processes of a service."""
    found = []
    for number in Path(f"/proc/{parent}/task/{parent}/children").read_text().split():
        line = Path(f"/proc/{number}/cmdline").read_bytes()
        if b"spawn_main" in line:
            found.append(int(number))
    return found


def land(url: str) -> int:
    with PlainClient(f"{url}/scenes/pit") as client:
        client.hello()
        client.land(1, (30.0, 0.0, 30.0), 500.0)
        _, frames, _ = client.until(Ready)
        return len(assemble(frames))


def metric(url: str, name: str) -> float:
    page = httpx.get(f"{url}/metrics").raise_for_status().text
    return sum(float(value) for value in re.findall(rf"^{name}(?:{{.*?}})? (\S+)$", page, re.M))


def test_metrics_are_those_of_all_workers(service: tuple[int, str]) -> None:
    _, url = service
    before = metric(url, "terraport_landings_total")
    assert [land(url) for _ in range(8)] == [36] * 8
    eventually(lambda: metric(url, "terraport_landings_total") == before + 8)
    eventually(lambda: metric(url, "terraport_sessions_active") == 0)


def test_groups_cannot_be_joined(service: tuple[int, str]) -> None:
    _, url = service
    with PlainClient(f"{url}/scenes/pit") as client:
        assert client.hello().limits.groups == "none"


def test_killed_workers_are_replaced_and_their_sessions_leave_the_metrics(
    service: tuple[int, str],
) -> None:
    parent, url = service
    clients = [PlainClient(f"{url}/scenes/pit") for _ in range(6)]
    for client in clients:
        client.hello()
    assert metric(url, "terraport_sessions_active") == 6
    victims = set(workers(parent))
    for victim in victims:
        os.kill(victim, signal.SIGKILL)
    eventually(lambda: len(workers(parent)) == 2 and not victims & set(workers(parent)), 60)
    assert land(url) == 36  # waits in the socket's queue until a worker accepts
    eventually(lambda: metric(url, "terraport_sessions_active") == 0, 30)
    for client in clients:
        client.socket.close()


def test_sighup_replaces_the_workers_one_by_one(service: tuple[int, str]) -> None:
    parent, url = service
    before = set(workers(parent))
    os.kill(parent, signal.SIGHUP)
    until_s = time.monotonic() + 60
    while before & set(workers(parent)):
        with contextlib.suppress(ConnectionClosed):  # 4503: come again
            assert land(url) == 36
        assert time.monotonic() < until_s
        time.sleep(0.2)  # nobody reads the log: its pipe must not fill
    eventually(lambda: len(workers(parent)) == 2, 30)
