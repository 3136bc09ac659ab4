"""Connections whose packets are lost: the session times out and frees all its resources."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from eventually import eventually
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient

from terraport_server import BackgroundServer
from terraport_wire import Plan, Ready

IDLE_S = 1.5
CLOSE_S = 0.5
MOST_S = IDLE_S + CLOSE_S + 3.0
"""Including the delays of a busy machine."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("half-open")
    write_grid_scene(folder / "pit")
    return folder


@pytest.fixture
def server(folder: Path) -> Iterator[BackgroundServer]:
    with BackgroundServer(folder, idle_timeout_s=IDLE_S, close_timeout_s=CLOSE_S) as running:
        # With the first connection the loop opens a descriptor of its own, and keeps it.
        assert httpx.get(f"{running.url}/healthz").status_code == 200
        # And with the first landing the pack is mapped.
        with PlainClient(running.scene_url("pit")) as client:
            client.hello()
            client.land(1, (0.0, 0.0, 0.0), 20.0)
            client.until(Ready)
        eventually(lambda: not running._server.server_state.connections)
        yield running


def held_resources(server: BackgroundServer) -> tuple[int, int, int, float]:
    """Return sessions, descriptors, holders of the scene, and stalled sessions."""
    service = server.service
    served = service.registry.get("pit")
    return (
        service.session_count,
        len(list(Path("/proc/self/fd").iterdir())),
        served._holders,
        service.metrics.stalled._value.get(),
    )


def closed(server: BackgroundServer, reason: str) -> float:
    return float(server.service.metrics.sessions_closed.labels(reason)._value.get())


class Hole:
    """A proxy that can stop carrying bytes, in both directions, without closing anything."""

    def __init__(self, port: int) -> None:
        self._target = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._open = threading.Event()
        self._open.set()
        self._sockets: list[socket.socket] = []
        self._threads = [threading.Thread(target=self._accept, daemon=True)]
        self._threads[0].start()

    def swallow(self) -> None:
        """From now on nothing arrives any more, on either side."""
        self._open.clear()

    def close(self) -> None:
        for sock in (self._listener, *self._sockets):
            with contextlib.suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)
            sock.close()
        self._open.set()
        for thread in self._threads:
            thread.join(5)

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                downstream, _ = self._listener.accept()
                upstream = socket.create_connection(("127.0.0.1", self._target))
                self._sockets += [downstream, upstream]
                for source, target in ((downstream, upstream), (upstream, downstream)):
                    thread = threading.Thread(
                        target=self._carry, args=(source, target), daemon=True
                    )
                    self._threads.append(thread)
                    thread.start()

    def _carry(self, source: socket.socket, target: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(1 << 16):
                self._open.wait()
                target.sendall(data)


@pytest.mark.parametrize("credit", [0, 1 << 30], ids=["idle", "streaming"])
def test_a_link_that_swallows_everything(server: BackgroundServer, credit: int) -> None:
    before = held_resources(server)
    hole = Hole(server.port)
    try:
        url = f"http://127.0.0.1:{hole.port}/scenes/pit"
        with PlainClient(url, ping_interval=None) as client:
            client.hello(credit_bytes=credit)
            client.land(1, (0.0, 0.0, 0.0), 200.0)
            client.expect(Plan)
            hole.swallow()
            began_s = time.monotonic()
            eventually(lambda: server.service.session_count == 0, MOST_S)
            assert IDLE_S / 2 < time.monotonic() - began_s < MOST_S
            assert closed(server, "timeout") == 1
            hole.close()
    finally:
        hole.close()
    eventually(lambda: held_resources(server) == before)
