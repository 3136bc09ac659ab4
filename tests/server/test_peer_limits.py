"""What a peer does below the level of messages, over real sockets."""

from __future__ import annotations

import asyncio
import logging
import socket
import struct
import time
from pathlib import Path

import pytest
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient
from uvicorn.protocols.utils import ClientDisconnected

from terraport_server import BackgroundServer
from terraport_server.peer_limits import FRAMES_PER_MESSAGE, BoundedPeer

PING, CLOSE, TEXT, CONT = 9, 8, 1, 0


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    write_grid_scene(tmp_path / "grid", cells=2)
    return tmp_path


def frame(opcode: int, data: bytes, *, fin: bool = True) -> bytes:
    """A frame with a mask of zeros."""
    return bytes([(0x80 if fin else 0) | opcode, 0x80 | len(data)]) + bytes(4) + data


def raw(client: PlainClient) -> socket.socket:
    return client.socket.socket


def raw_connect(port: int) -> socket.socket:
    """A WebSocket without anybody who reads it."""
    found = socket.create_connection(("127.0.0.1", port), 5)
    found.sendall(
        b"GET /scenes/grid/stream HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n"
        b"Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: terraport.v1.json\r\n\r\n"
    )
    head = b""
    while not head.endswith(b"\r\n\r\n"):
        head += found.recv(1)
    assert b" 101 " in head
    return found


def drained(found: socket.socket) -> bytes:
    """Everything until the service closes."""
    data = b""
    try:
        while more := found.recv(1 << 16):
            data += more
    except ConnectionResetError:
        pass
    return data


def close_code(data: bytes) -> int:
    at = data.rindex(b"\x88")
    return int(struct.unpack("!H", data[at + 2 : at + 4])[0])


@pytest.mark.parametrize("blob", [frame(PING, b"x" * 100), frame(CONT, b"", fin=False)])
def test_more_frames_than_messages_would_need_are_closed(scenes: Path, blob: bytes) -> None:
    """10 s of the rate at once are taken; what is beyond is 4429."""
    with BackgroundServer(scenes, max_messages_per_s=2.0) as server:
        allowed = int(10 * 2.0 * FRAMES_PER_MESSAGE)
        with raw_connect(server.port) as found:
            begin = frame(TEXT, b"{", fin=False) if blob[0] == CONT else b""
            found.sendall(begin + blob * (allowed + 50))
            assert close_code(drained(found)) == 4429


def test_a_client_that_pings_and_does_not_read_costs_no_memory(scenes: Path) -> None:
    """Pongs that nobody reads are not kept: the newest ping alone is answered, once it reads."""
    with BackgroundServer(scenes, max_messages_per_s=1e6, send_buffer_bytes=1 << 16) as server:
        connections = server._server.server_state.connections
        with raw_connect(server.port) as found:
            found.settimeout(5)
            most = 0
            for _ in range(80):
                found.sendall(frame(PING, b"x" * 125) * 500)
                most = max(most, *(one.transport.get_write_buffer_size() for one in connections))
            found.sendall(frame(PING, b"last"))
            data = b""
            while b"\x8a\x04last" not in data:
                more = found.recv(1 << 20)
                assert more, "closed instead of answered"
                data = data[-200:] + more
        # 5 MB of pings were sent; one read of the loop may add its pongs to what waits already.
        assert 0 < most < 1 << 20


def test_text_that_is_no_utf8_is_closed_without_a_trace(
    scenes: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with BackgroundServer(scenes) as server, caplog.at_level(logging.WARNING):
        for bad in (b"\xff\xfe{}", b'{"type":"\xed\xa0\x80"}'):
            with raw_connect(server.port) as found:
                found.sendall(frame(TEXT, bad))
                assert close_code(drained(found)) == 1007
            with raw_connect(server.port) as found:  # and says goodbye in the same piece
                found.sendall(frame(TEXT, bad) + frame(CLOSE, b"\x03\xe8"))
                assert close_code(drained(found)) == 1000
        assert not [record for record in caplog.records if record.levelno >= logging.ERROR]


def test_who_does_not_close_is_closed_in_time(scenes: Path) -> None:
    """After our close frame, close_timeout_s; the library's own ten seconds are not ours."""
    with (
        BackgroundServer(scenes, close_timeout_s=0.5) as server,
        raw_connect(server.port) as found,
    ):
        found.settimeout(5)
        began_s = time.monotonic()
        found.sendall(frame(TEXT, b"no message"))
        assert close_code(drained(found)) == 4400
        assert time.monotonic() - began_s < 4


def test_pings_between_messages_are_answered(scenes: Path) -> None:
    with BackgroundServer(scenes) as server, PlainClient(server.scene_url("grid")) as client:
        client.hello()
        for _ in range(20):
            assert client.socket.ping().wait(5)


def test_an_answer_to_who_broke_the_rules_is_lost_not_misused(scenes: Path) -> None:
    """uvicorn has closed, the application does not know it yet and answers a message before that.

    Found by fuzz/server.py (one connection in thirty): it was logged as a failure of ours.
    """
    with BackgroundServer(scenes) as server, raw_connect(server.port) as found:
        (connection,) = server._server.server_state.connections
        assert isinstance(connection, BoundedPeer)

        async def break_and_answer() -> None:
            connection.data_received(frame(3, b"no such opcode"))
            with pytest.raises(ClientDisconnected):
                await connection.send({"type": "websocket.send", "bytes": b"answer"})

        asyncio.run_coroutine_threadsafe(break_and_answer(), connection.loop).result(5)
        assert close_code(drained(found)) == 1002
