"""Clients below the level of messages: frames, pings, fragments, closing, and before `hello`."""

from __future__ import annotations

import contextlib
import logging
import socket
import struct
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from eventually import eventually
from server.plain_client import PlainClient, make_hello

from terraport_server import BackgroundServer
from terraport_server.stream.connection import (
    FRAMES_PER_MESSAGE,
    MAX_FIRST_FRAMES,
    MAX_FIRST_MESSAGE_BYTES,
)
from terraport_server.stream.limits import SessionCounts
from terraport_wire import HELD_DTYPE, MAX_HELD_SEGMENTS, SUBPROTOCOL, Picked, decode, encode
from terraport_wire import Direction as Wire

PING, CLOSE, BINARY, TEXT, CONT = 9, 8, 2, 1, 0
TOKEN = "a-token-of-enough-characters"
HELLO = encode(make_hello())


def frame(opcode: int, data: bytes, *, fin: bool = True) -> bytes:
    """A frame with a mask of zeros."""
    size = len(data)
    length = bytes([0x80 | size]) if size < 126 else b"\xff" + size.to_bytes(8, "big")
    return bytes([(0x80 if fin else 0) | opcode]) + length + bytes(4) + data


def connect(server: BackgroundServer, *headers: str, receive_bytes: int = 0) -> socket.socket:
    """A WebSocket of which nothing is read."""
    raw = socket.socket()
    if receive_bytes:
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
    raw.settimeout(10)
    raw.connect(("127.0.0.1", server.port))
    lines = "".join(f"{line}\r\n" for line in headers)
    raw.sendall(
        b"GET /scenes/grid/stream HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n"
        b"Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        b"Sec-WebSocket-Version: 13\r\n"
        + f"Sec-WebSocket-Protocol: {SUBPROTOCOL}\r\n{lines}\r\n".encode()
    )
    head = b""
    while not head.endswith(b"\r\n\r\n"):
        head += raw.recv(1)
    assert b" 101 " in head
    return raw


def drained(raw: socket.socket, *, answer: bool = True) -> bytes:
    """Everything until the service closes; its close frame is answered."""
    data = b""
    with contextlib.suppress(OSError):
        while more := raw.recv(1 << 16):
            data += more
            if answer and b"\x88" in more:
                raw.sendall(frame(CLOSE, b"\x03\xe8"))
    return data


def close_code(data: bytes) -> int:
    at = data.rindex(b"\x88")
    return int(struct.unpack("!H", data[at + 2 : at + 4])[0])


@pytest.fixture(scope="module")
def guarded(scenes_dir: Path) -> Any:
    with BackgroundServer(scenes_dir, token=TOKEN, max_sessions_per_ip=100) as running:
        yield running


@pytest.mark.parametrize("blob", [frame(PING, b"x" * 100), frame(CONT, b"", fin=False)])
def test_more_frames_than_messages_need_are_closed(scenes_dir: Path, blob: bytes) -> None:
    """10 s of the rate at once are taken; what is beyond is 4429."""
    with BackgroundServer(scenes_dir, max_messages_per_s=2.0) as server, connect(server) as raw:
        begin = frame(TEXT, b"{", fin=False) if blob[0] == CONT else b""
        raw.sendall(frame(BINARY, HELLO) + begin + blob * (20 * FRAMES_PER_MESSAGE + 50))
        assert close_code(drained(raw)) == 4429


def test_pongs_that_are_not_read_are_not_kept(scenes_dir: Path) -> None:
    with (
        BackgroundServer(scenes_dir, max_messages_per_s=1e6) as server,
        connect(server, receive_bytes=1 << 14) as raw,
    ):
        raw.sendall(frame(BINARY, HELLO))
        for _ in range(200):  # 13 MB
            raw.sendall(frame(PING, b"x" * 125) * 500)
        raw.sendall(frame(PING, b"last"))
        received, tail = 0, b""
        while b"\x8a\x04last" not in tail:
            more = raw.recv(1 << 20)
            assert more, "closed instead of answered"
            received += len(more)
            tail = tail[-200:] + more
    assert received < 9_000_000, "what the kernel holds, and little more"


def test_text_that_is_not_utf8_is_closed_and_logs_nothing(
    server: BackgroundServer, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        for bad in (b"\xff\xfe{}", b'{"type":"\xed\xa0\x80"}'):
            with connect(server) as raw:
                raw.sendall(frame(TEXT, bad))
                assert close_code(drained(raw)) == 1007
        with connect(server) as raw:
            raw.sendall(frame(3, b"no such opcode"))
            assert close_code(drained(raw)) == 1002
    assert not [record for record in caplog.records if record.levelno >= logging.ERROR]


def test_pings_are_answered_and_messages_may_come_in_any_pieces(server: BackgroundServer) -> None:
    with PlainClient(server.scene_url("grid")) as client:
        client.hello()
        assert client.socket.ping().wait(5)
    pick = {"type": "pick", "origin": [0.0, 0.0, 0.0]}
    picks = [msgpack.packb({**pick, "request": number}) for number in range(7)]
    together = b"".join(frame(BINARY, data) for data in [HELLO, *picks])
    with connect(server) as whole, connect(server) as single:
        whole.sendall(together)
        for number in together:
            single.sendall(bytes([number]))
        for raw in (whole, single):
            raw.sendall(frame(CLOSE, b"\x03\xe8"))
            data, answers = drained(raw), set[int]()
            while data[0] == 0x82:
                size, at = data[1], 2
                if size == 126:
                    size, at = int.from_bytes(data[2:4], "big"), 4
                message = decode(data[at : at + size], Wire.SERVER_TO_CLIENT)
                answers |= {message.request} if isinstance(message, Picked) else set()
                data = data[at + size :]
            assert answers <= set(range(7))
            assert close_code(data) == 1000


def test_nothing_follows_the_close(server: BackgroundServer) -> None:
    with connect(server) as raw:
        raw.sendall(frame(BINARY, HELLO) + frame(BINARY, b"no message"))
        data = b""
        while b"\x88" not in data or close_code(data) != 4400:
            data += raw.recv(1 << 16)
        at = data.rindex(b"\x88")
        end = at + 2 + data[at + 1]
        with contextlib.suppress(OSError):
            raw.sendall(frame(PING, b"late") + b"\x82\xff" + b"\xff" * 8 + bytes(5))
        data += drained(raw)
    assert len(data) == end


# Before `hello` is accepted.


@pytest.mark.parametrize(
    "message",
    [
        msgpack.packb({"type": "wave", "later": [None] * 200}),
        msgpack.packb({"later": [[0] * 16_000] * 30, "type": "wave"}),
        msgpack.packb({"type": "bye"}),
        b"",
    ],
    ids=["unknown", "large", "known", "empty"],
)
def test_anything_but_hello_ends_the_connection(guarded: BackgroundServer, message: bytes) -> None:
    with connect(guarded) as raw:
        with contextlib.suppress(OSError):
            for _ in range(20):
                raw.sendall(frame(BINARY, message))
        assert close_code(drained(raw)) == 4400


def test_what_is_sent_behind_a_refusal_is_not_read(guarded: BackgroundServer) -> None:
    sent, blob = 0, frame(BINARY, bytes(400_000))
    with connect(guarded) as raw, contextlib.suppress(OSError):
        while sent < 64 * len(blob):
            raw.sendall(blob)
            sent += len(blob)
    assert sent < 64 * len(blob)


@pytest.mark.parametrize(
    "blob", [frame(PING, b"x" * 32), frame(CONT, b"", fin=False)], ids=["pings", "fragments"]
)
def test_few_frames_are_allowed(guarded: BackgroundServer, blob: bytes) -> None:
    begin = frame(BINARY, b"\x80", fin=False) if blob[0] == CONT else b""
    with connect(guarded) as raw:
        raw.sendall(begin + blob * (MAX_FIRST_FRAMES - 2) + frame(PING, b"last"))
        pongs = b""
        while b"last" not in pongs:
            pongs += raw.recv(1 << 16)
            assert not pongs.endswith(b"\x11\x4d"), "closed with 4429"
    with connect(guarded) as raw:
        raw.sendall(begin + blob * (MAX_FIRST_FRAMES + 1))
        assert close_code(drained(raw)) == 4429


def test_the_longest_hello_is_accepted_and_a_longer_message_refused_by_its_header(
    guarded: BackgroundServer,
) -> None:
    table = np.zeros(MAX_HELD_SEGMENTS, dtype=HELD_DTYPE)
    table["id"] = np.arange(MAX_HELD_SEGMENTS)
    with PlainClient(guarded.scene_url("grid")) as client:
        assert client.hello(token=TOKEN, held=table).held_count == 0
    with connect(guarded) as raw:
        raw.sendall(frame(BINARY, bytes(MAX_FIRST_MESSAGE_BYTES + 1))[:100])
        assert b"\x03\xf1" in drained(raw), "1009"


@pytest.mark.parametrize("way", ["header", "hello"])
def test_a_refused_client_need_not_answer_the_close(guarded: BackgroundServer, way: str) -> None:
    wrong = ("Authorization: Bearer another-token-of-some-length",) if way == "header" else ()
    with connect(guarded, *wrong) as raw:
        if way == "hello":
            raw.sendall(frame(BINARY, HELLO))
        assert close_code(drained(raw, answer=False)) == 4401
    connections = guarded._server.server_state.connections
    eventually(lambda: not connections, 5)


def test_only_an_accepted_hello_takes_a_session(scenes_dir: Path) -> None:
    limits = {"max_sessions": 2, "max_sessions_per_ip": 2, "token": TOKEN}
    with BackgroundServer(scenes_dir, **limits) as server, ExitStack() as stack:
        for _ in range(6):
            stack.enter_context(connect(server))
        for _ in range(2):
            stack.enter_context(PlainClient(server.scene_url("grid"))).hello(token=TOKEN)
        third = stack.enter_context(PlainClient(server.scene_url("grid")))
        third.send(make_hello(token=TOKEN))
        error, closed = third.refused()
        assert (error.code, closed) == ("too_many", 4429)


def test_the_last_sessions_are_for_addresses_with_few() -> None:
    counts = SessionCounts(32, 16)
    for address in ("192.0.2.2", "192.0.2.3", "192.0.2.4"):
        while counts.add(address) is None:
            pass
    assert len(counts) == 30
    assert "from one address where 2 are left" in str(counts.refusal("192.0.2.4"))
    assert [counts.add("192.0.2.5"), counts.add("192.0.2.6")] == [None, None]
    counts = SessionCounts(32, 32)
    while counts.add("192.0.2.2") is None:
        pass
    assert len(counts) == 32, "where one address may have all, it has all"


def test_unauthenticated_clients_write_few_lines(
    scenes_dir: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with BackgroundServer(scenes_dir, token=TOKEN) as server, caplog.at_level(logging.INFO):
        caplog.clear()
        for _ in range(3):
            connect(server).close()
        for _ in range(3):
            with connect(server) as raw:
                raw.sendall(frame(BINARY, b"\x81\xa4type\xa3bye"))
                drained(raw)
        with PlainClient(server.scene_url("grid")) as client:
            client.hello(token=TOKEN)
        eventually(lambda: "session closed" in caplog.messages)
        assert caplog.messages == ["refused", "session opened", "session closed"]
