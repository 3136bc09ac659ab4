"""What ended connections leave for the search for garbage, which stops the loop: nothing.

Rings of 20 (TCP) to 140 objects (a WebSocket) were left, and freed 40 ms at a time under a flood.
"""

from __future__ import annotations

import contextlib
import gc
import socket
from collections.abc import Callable, Iterator

import pytest
from eventually import eventually
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient

from terraport_server import BackgroundServer

TOKEN = "a-token-of-enough-characters"
MANY = 10
UPGRADE = (
    b"GET /scenes/grid/stream HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n"
    b"Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: terraport.v1.msgpack\r\n\r\n"
)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BackgroundServer]:
    folder = tmp_path_factory.mktemp("garbage")
    write_grid_scene(folder / "grid", cells=2)
    limits = {"token": TOKEN, "forwarded_allow_ips": "", "max_connections_per_ip": 1000}
    with BackgroundServer(folder, **limits) as running:
        yield running


def session(server: BackgroundServer) -> None:
    with PlainClient(server.scene_url("grid")) as client:
        client.hello(token=TOKEN)


def saying(data: bytes) -> Callable[[BackgroundServer], None]:
    def say(server: BackgroundServer) -> None:
        with socket.create_connection(("127.0.0.1", server.port)) as raw:
            raw.settimeout(0.1)
            raw.sendall(data)
            with contextlib.suppress(OSError):
                while raw.recv(1 << 16):
                    pass

    return say


@pytest.mark.parametrize(
    "come",
    [
        pytest.param(saying(b""), id="nothing"),
        pytest.param(saying(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n"), id="request"),
        pytest.param(saying(b"nonsense\r\n\r\n"), id="nonsense"),
        pytest.param(saying(UPGRADE), id="upgrade"),
        pytest.param(saying(UPGRADE + b"\x82\x80\0\0\0\0"), id="wrong hello"),
        pytest.param(saying(UPGRADE.replace(b"13", b"7")), id="wrong upgrade"),
        pytest.param(session, id="session"),
    ],
)
def test_ended_connections_are_no_garbage(
    server: BackgroundServer, come: Callable[[BackgroundServer], None]
) -> None:
    def come_and_go() -> None:
        for _ in range(MANY):
            come(server)
        state = server._server.server_state
        eventually(lambda: not state.connections and not state.tasks)

    come_and_go()  # what is made once is made
    gc.collect()
    gc.disable()
    try:
        come_and_go()
        found = gc.collect()
    finally:
        gc.enable()
    assert found < 10 * MANY, f"{found / MANY} objects a connection"
