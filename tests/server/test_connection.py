"""The WebSocket connection, by what a client sees on its socket."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import socket
import struct
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, cast

import msgpack
import numpy as np
import pytest
from eventually import eventually
from server.grid_scene import write_grid_scene
from server.plain_client import Piece, PlainClient, assemble, make_hello, make_land
from websockets.client import ClientProtocol
from websockets.frames import Frame, Opcode
from websockets.protocol import State
from websockets.typing import Subprotocol
from websockets.uri import parse_uri

from terraport_server import BackgroundServer
from terraport_server.stream.connection import (
    FRAMES_PER_MESSAGE,
    MAX_FIRST_FRAMES,
    MAX_FIRST_MESSAGE_BYTES,
    Connection,
)
from terraport_server.stream.frame_writer import FrameWriter, message_header
from terraport_wire import (
    MAX_TOKEN_BYTES,
    SUBPROTOCOL,
    Direction,
    Message,
    Plan,
    Ready,
    decode,
    decode_frame,
    encode,
    is_payload,
)

PING, CLOSE, BINARY, TEXT, CONT = 9, 8, 2, 1, 0
TOKEN = "a-token-of-enough-characters"
EVERYWHERE = make_land(1, (30.0, 0.0, 30.0), 500.0)


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    write_grid_scene(tmp_path / "grid", cells=2)
    return tmp_path


def frame(opcode: int, data: bytes, *, fin: bool = True) -> bytes:
    """Return a frame with a mask of zeros."""
    size = len(data)
    length = bytes([0x80 | size]) if size < 126 else b"\xff" + size.to_bytes(8, "big")
    return bytes([(0x80 if fin else 0) | opcode]) + length + bytes(4) + data


def raw_connect(port: int) -> socket.socket:
    """Open a WebSocket that is read and written by the byte."""
    raw = socket.create_connection(("127.0.0.1", port), 30)  # longer than a close may take
    raw.sendall(
        b"GET /scenes/grid/stream HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n"
        b"Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        b"Sec-WebSocket-Version: 13\r\n" + f"Sec-WebSocket-Protocol: {SUBPROTOCOL}\r\n\r\n".encode()
    )
    head = b""
    while not head.endswith(b"\r\n\r\n"):
        head += raw.recv(1)
    assert b" 101 " in head
    return raw


def drained(raw: socket.socket) -> bytes:
    """Return everything until the service closes."""
    data = b""
    try:
        while more := raw.recv(1 << 16):
            data += more
    except ConnectionResetError:
        pass
    return data


def close_code(data: bytes) -> int:
    at = data.rindex(b"\x88")
    return int(struct.unpack("!H", data[at + 2 : at + 4])[0])


class SlowClient:
    """Speaks WebSocket by the library's state machine over a socket that reads when told."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket()
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self.socket.settimeout(20)
        self.socket.connect(("127.0.0.1", port))
        uri = parse_uri(f"ws://127.0.0.1:{port}/scenes/pit/stream")
        names = [Subprotocol(SUBPROTOCOL)]
        self.protocol = ClientProtocol(uri, subprotocols=names, max_size=None)
        self.protocol.send_request(self.protocol.connect())
        self.flush()
        while self.protocol.state is not State.OPEN:
            self.fill()
        self.protocol.events_received()
        self.frames: list[Frame] = []

    def send(self, message: Message) -> None:
        self.protocol.send_binary(encode(message))
        self.flush()

    def ping(self, data: bytes) -> None:
        self.protocol.send_ping(data)

    def flush(self) -> None:
        for data in self.protocol.data_to_send():
            self.socket.sendall(data)

    def fill(self) -> None:
        data = self.socket.recv(1 << 16)
        assert data, "the server closed the connection"
        self.protocol.receive_data(data)

    def read(self) -> None:
        self.fill()
        self.frames += cast("list[Frame]", self.protocol.events_received())

    def payloads_until_ready(self) -> dict[int, bytes]:
        while not self._messages(Ready):
            self.read()
        (plan,) = self._messages(Plan)
        segments = dict(zip(plan.show["key"].tolist(), plan.show["id"].tolist(), strict=True))
        frames = [decode_frame(frame.data) for frame in self.frames if is_payload(frame.data)]
        return assemble(
            Piece(frame.generation, frame.key, segments[frame.key], frame.offset, frame.total,
                  bytes(frame.data))
            for frame in frames
            if frame is not None
        )  # fmt: skip

    def _messages(self, kind: type[Any]) -> list[Any]:
        messages = [
            decode(frame.data, Direction.SERVER_TO_CLIENT)
            for frame in self.frames
            if frame.opcode is Opcode.BINARY and not is_payload(frame.data)
        ]
        return [message for message in messages if isinstance(message, kind)]

    def pongs(self) -> list[bytes]:
        return [bytes(frame.data) for frame in self.frames if frame.opcode is Opcode.PONG]


@pytest.mark.parametrize("length", [0, 1, 125, 126, 127, 65_535, 65_536, 131_072])
def test_message_headers_are_those_of_the_library(length: int) -> None:
    data = b"x" * length
    assert message_header(length) + data == Frame(Opcode.BINARY, data).serialize(mask=False)


class TakesSoMuch:
    """A socket and the transport behind it: a ``writev`` takes so many bytes, twice."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.written: list[bytes] = []

    def fileno(self) -> int:
        return 99

    def get_extra_info(self, name: str) -> Any:
        return self if name == "socket" else None

    def set_write_buffer_limits(self, high: int, low: int) -> None:
        assert (high, low) == (0, 0)

    def writev(self, _descriptor: int, buffers: Sequence[bytes | memoryview]) -> int:
        data = b"".join(buffers)
        if not self.most:
            raise BlockingIOError
        self.written.append(data[: self.most])
        return min(self.most, len(data))

    def write(self, data: bytes) -> None:
        self.written.append(bytes(data))


def test_whatever_a_socket_takes_the_stream_is_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """Queued messages, then frames: what is reported as taken is sent whole, and nothing else."""
    payloads = [b"a" * 5, b"b" * 130, b"", b"c" * 40_000]
    headers = [message_header(4 + len(payload)) + b"head" for payload in payloads]
    pieces = [header + payload for header, payload in zip(headers, payloads, strict=True)]
    ends = np.cumsum([len(piece) for piece in pieces]).tolist()
    message = message_header(3) + b"say"
    total = len(message) + ends[-1]
    for most in [*range(200), 20_000, total - 1, total, total + 1]:
        socket_ = TakesSoMuch(most)
        monkeypatch.setattr(os, "writev", socket_.writev)
        writer = FrameWriter(cast("asyncio.Transport", socket_))
        writer.send_message(b"say")
        buffers: list[bytes | memoryview] = []
        for header, payload in zip(headers, payloads, strict=True):
            buffers += (header, memoryview(payload))
        taken = writer.send_frames(buffers, ends)
        writer.pause()
        socket_.most = 1 << 20
        writer.resume()
        assert b"".join(socket_.written) == message + b"".join(pieces[:taken])
        assert taken == len(pieces) or most < total


@pytest.mark.parametrize("way", ["writev", "transport"])
def test_pings_in_the_middle_of_a_frame_are_answered_between_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    """A client that does not read stalls a frame; its pings come then; the stream stays whole."""
    if way == "transport":
        monkeypatch.delattr(os, "writev")
    pit = write_grid_scene(tmp_path / "pit", cells=60)
    with BackgroundServer(tmp_path, max_radius_m=1e4) as server:
        client = SlowClient(server.port)
        client.send(make_hello())
        client.send(EVERYWHERE)
        time.sleep(0.3)  # the socket's buffers are full, a frame is under way
        for number in range(5):
            client.ping(b"%d" % number)
        client.flush()
        assert client.payloads_until_ready() == dict(enumerate(pit.payloads))
        client.socket.close()
    assert client.pongs() == [b"0", b"1", b"2", b"3", b"4"]


def test_of_pongs_that_are_not_read_the_newest_is_sent(tmp_path: Path) -> None:
    """Beyond 64 KiB of pongs the older ones are dropped; the connection stays."""
    pit = write_grid_scene(tmp_path / "pit", cells=60)
    with BackgroundServer(tmp_path, max_radius_m=1e4) as server:
        client = SlowClient(server.port)
        client.send(make_hello())
        client.send(EVERYWHERE)
        (connection,) = server._server.server_state.connections
        assert isinstance(connection, Connection)
        eventually(lambda: connection.writer.is_full)
        for number in range(2000):
            client.ping(b"%120d" % number)
        client.flush()
        assert client.payloads_until_ready() == dict(enumerate(pit.payloads))
        while client.pongs()[-1] != b"%120d" % 1999:
            client.read()
        client.socket.close()
    pongs = [int(pong) for pong in client.pongs()]
    assert len(pongs) < 1200
    assert pongs == sorted(pongs)


def test_a_client_that_vanishes_in_the_middle_of_a_frame_frees_everything(tmp_path: Path) -> None:
    write_grid_scene(tmp_path / "pit", cells=60)
    with BackgroundServer(tmp_path, max_radius_m=1e4) as server:
        before = len(list(Path("/proc/self/fd").iterdir()))
        for _ in range(5):
            client = SlowClient(server.port)
            client.send(make_hello())
            client.send(EVERYWHERE)
            time.sleep(0.1)
            client.socket.close()
        eventually(lambda: server.service.session_count == 0)
        open_now = len(list(Path("/proc/self/fd").iterdir()))
        assert open_now <= before + 3  # the map of the pack is one


@pytest.mark.parametrize("blob", [frame(PING, b"x" * 100), frame(CONT, b"", fin=False)])
def test_more_frames_than_messages_need_are_closed(scenes: Path, blob: bytes) -> None:
    """10 s of the rate at once are accepted; beyond is 4429."""
    with BackgroundServer(scenes, max_messages_per_s=2.0) as server:
        allowed = int(10 * 2.0 * FRAMES_PER_MESSAGE)
        with raw_connect(server.port) as raw:
            begin = frame(TEXT, b"{", fin=False) if blob[0] == CONT else b""
            raw.sendall(frame(BINARY, encode(make_hello())))
            raw.sendall(begin + blob * (allowed + 50))
            assert close_code(drained(raw)) == 4429


@pytest.mark.parametrize("blob", [frame(PING, b""), frame(CONT, b"", fin=False)])
def test_few_frames_are_accepted_before_hello(scenes: Path, blob: bytes) -> None:
    begin = frame(BINARY, b"\x80", fin=False) if blob[0] == CONT else b""
    with BackgroundServer(scenes, token=TOKEN) as server:
        with raw_connect(server.port) as raw:
            raw.sendall(begin + blob * (MAX_FIRST_FRAMES - 2) + frame(PING, b"last"))
            pongs = b""
            while b"last" not in pongs:
                pongs += raw.recv(1 << 16)
        with raw_connect(server.port) as raw:
            raw.sendall(begin + blob * (MAX_FIRST_FRAMES + 1))
            assert close_code(drained(raw)) == 4429


def test_a_first_message_that_announces_too_much_is_closed_at_once(scenes: Path) -> None:
    with BackgroundServer(scenes, token=TOKEN) as server, raw_connect(server.port) as raw:
        raw.sendall(frame(BINARY, bytes(MAX_FIRST_MESSAGE_BYTES + 1))[:100])
        assert close_code(drained(raw)) == 1009


def test_the_longest_hello_is_accepted(scenes: Path) -> None:
    with (
        BackgroundServer(scenes, token=TOKEN) as server,
        PlainClient(server.scene_url("grid")) as client,
    ):
        client.send_hello(client="🌍" * 128, token="🌍" * MAX_TOKEN_BYTES)
        assert client.refused()[0].code == "unauthorised"


@pytest.mark.parametrize("bad", [b"\xff\xfe{}", b'{"type":"\xed\xa0\x80"}'])
def test_text_that_is_not_utf8_is_closed_without_a_fault(
    scenes: Path, caplog: pytest.LogCaptureFixture, bad: bytes
) -> None:
    with (
        BackgroundServer(scenes, close_timeout_s=0.5) as server,
        caplog.at_level(logging.WARNING),
        raw_connect(server.port) as raw,
    ):
        raw.sendall(frame(TEXT, bad))
        assert close_code(drained(raw)) == 1007
    assert not [record for record in caplog.records if record.levelno >= logging.ERROR]


def test_a_client_that_does_not_close_is_closed_in_time(scenes: Path) -> None:
    with BackgroundServer(scenes, close_timeout_s=0.5) as server, raw_connect(server.port) as raw:
        raw.sendall(frame(TEXT, b"no message"))
        assert close_code(drained(raw)) == 4400


def test_no_pong_follows_the_close_frame(scenes: Path) -> None:
    with BackgroundServer(scenes) as server, raw_connect(server.port) as raw:
        raw.sendall(frame(BINARY, encode(make_hello())) + frame(BINARY, b"no message"))
        data = b""
        while b"\x88" not in data or close_code(data) != 4400:
            data += raw.recv(1 << 16)
        close_at = data.rindex(b"\x88")
        raw.sendall(frame(PING, b"late") + frame(CLOSE, b"\x03\xe8"))
        data += drained(raw)
        assert len(data) == close_at + 2 + data[close_at + 1]


def test_nothing_follows_the_close_frame_for_a_broken_frame(scenes: Path) -> None:
    """Its close frame must not leave with the pong of a ping before it, ahead of an answer."""
    with BackgroundServer(scenes) as server, raw_connect(server.port) as raw:
        broken = b"\x41\x80" + bytes(4)
        raw.sendall(frame(PING, b"x") + frame(TEXT, b"") + broken)
        data = drained(raw)
    close_at = data.rindex(b"\x88")
    assert close_code(data) == 1002
    assert len(data) == close_at + 2 + data[close_at + 1]


@pytest.mark.parametrize("by_the_byte", [True, False])
def test_messages_arrive_in_order_however_they_are_cut(scenes: Path, by_the_byte: bool) -> None:
    with BackgroundServer(scenes, close_timeout_s=0.5) as server, raw_connect(server.port) as raw:
        pick = {"type": "pick", "origin": [0.0, 0.0, 0.0]}
        picks = [msgpack.packb({**pick, "request": number}) for number in range(7)]
        messages = [encode(make_hello()), *picks, b"\x81\xa4type\xa3bye"]
        data = b"".join(frame(BINARY, message) for message in messages)
        for piece in [data[at : at + 1] for at in range(len(data))] if by_the_byte else [data]:
            raw.sendall(piece)
        assert close_code(drained(raw)) == 1000


def test_without_hello_no_session_is_taken(scenes: Path) -> None:
    limits = {"max_sessions": 2, "max_sessions_per_ip": 2, "token": TOKEN}
    with BackgroundServer(scenes, **limits) as server, ExitStack() as stack:
        for _ in range(6):
            stack.enter_context(raw_connect(server.port))
        url = server.scene_url("grid")
        for _ in range(2):
            stack.enter_context(PlainClient(url)).hello(token=TOKEN)
        assert server.service.session_count == 2
        third = stack.enter_context(PlainClient(url))
        third.send(make_hello(token=TOKEN))
        error, closed = third.refused()
        assert (error.code, closed) == ("too_many", 4429)
        stack.close()
        eventually(lambda: server.service.session_count == 0)


@pytest.mark.parametrize(
    "message",
    [
        msgpack.packb({"type": "wave", "later": [None] * 200}),
        msgpack.packb({"later": [[0] * 16_000] * 3, "type": "wave"}),
        msgpack.packb({"type": "bye"}),
        b"",
    ],
    ids=["unknown", "large", "known", "empty"],
)
def test_anything_but_hello_ends_the_connection(scenes: Path, message: bytes) -> None:
    with BackgroundServer(scenes, token=TOKEN) as server, raw_connect(server.port) as raw:
        with contextlib.suppress(OSError):
            for _ in range(20):
                raw.sendall(frame(BINARY, message))
        assert close_code(drained(raw)) == 4400


def test_data_after_a_refusal_is_not_read(scenes: Path) -> None:
    sent, blob = 0, frame(BINARY, bytes(400_000))
    with (
        BackgroundServer(scenes, token=TOKEN) as server,
        raw_connect(server.port) as raw,
        contextlib.suppress(OSError),
    ):
        while sent < 64 * len(blob):
            raw.sendall(blob)
            sent += len(blob)
    assert sent < 64 * len(blob)


def test_a_refused_client_writes_one_line_and_need_not_answer_the_close(
    scenes: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with BackgroundServer(scenes, token=TOKEN) as server, caplog.at_level(logging.INFO):
        caplog.clear()
        for _ in range(3):
            raw_connect(server.port).close()
            with raw_connect(server.port) as raw:
                raw.sendall(frame(BINARY, encode(make_hello())))
                assert close_code(drained(raw)) == 4401
        with PlainClient(server.scene_url("grid")) as client:
            client.hello(token=TOKEN)
        eventually(lambda: "session closed" in caplog.messages)
        assert caplog.messages == ["refused", "session opened", "session closed"]
