"""Frame headers against the websockets library, and the socket's options."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient, assemble, make_hello
from websockets.client import ClientProtocol
from websockets.frames import Frame, Opcode
from websockets.protocol import State
from websockets.typing import Subprotocol
from websockets.uri import parse_uri

from terraport_server import BackgroundServer
from terraport_server.stream.client_turns import ClientTurns
from terraport_server.transport import (
    TCP_CONGESTION,
    TCP_NOTSENT_LOWAT,
    Connection,
    _frame_header,
    connection_of,
    protocol_class,
)
from terraport_wire import (
    SUBPROTOCOL,
    Direction,
    Land,
    Message,
    PayloadFrame,
    Ready,
    decode,
    decode_frame,
    encode,
    is_payload,
)


@pytest.mark.parametrize("length", [0, 1, 125, 126, 127, 65_535, 65_536, 131_072])
def test_frame_headers_are_those_of_the_library(length: int) -> None:
    data = b"x" * length
    assert _frame_header(length) + data == Frame(Opcode.BINARY, data).serialize(mask=False)


def test_a_scope_of_another_server_has_no_connection() -> None:
    assert connection_of({"extensions": {}}) is None
    assert connection_of({}) is None


def test_socket_options_are_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[int, int]] = []
    connection_made = Connection.connection_made

    def spy(self: Connection, transport: object) -> None:
        connection_made(self, transport)  # type: ignore[arg-type]
        raw = self.transport.get_extra_info("socket")
        seen.append(
            (
                raw.getsockopt(socket.IPPROTO_TCP, TCP_NOTSENT_LOWAT),
                raw.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF),
            )
        )

    monkeypatch.setattr(Connection, "connection_made", spy)
    write_grid_scene(tmp_path / "pit", cells=2)
    with (
        BackgroundServer(tmp_path, notsent_lowat_bytes=64_000, send_buffer_bytes=100_000) as server,
        PlainClient(server.scene_url("pit")) as client,
    ):
        client.hello()
    ((lowat, send_buffer),) = seen
    assert lowat == 64_000
    assert send_buffer >= 100_000


def test_each_service_has_its_own_options() -> None:
    first = protocol_class(ClientTurns(), notsent_lowat_bytes=1, send_buffer_bytes=2)
    second = protocol_class(ClientTurns(), notsent_lowat_bytes=3, send_buffer_bytes=4)
    assert (first.notsent_lowat_bytes, second.notsent_lowat_bytes) == (1, 3)
    assert Connection.notsent_lowat_bytes == 0


def is_ready(frame: Frame) -> bool:
    if frame.opcode is not Opcode.BINARY or is_payload(frame.data):
        return False
    message = decode(frame.data, Direction.SERVER_TO_CLIENT)
    return isinstance(message, Ready)


def open_descriptors() -> int:
    folder = Path("/proc/self/fd")
    return len(list(folder.iterdir())) if folder.is_dir() else 0


class SlowClient:
    """Speaks WebSocket by the library's own state machine over a socket that reads when told."""

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
        data = encode(message)
        assert isinstance(data, bytes)
        self.protocol.send_binary(data)
        self.flush()

    def flush(self) -> None:
        for data in self.protocol.data_to_send():
            self.socket.sendall(data)

    def fill(self) -> None:
        data = self.socket.recv(1 << 16)
        assert data, "the server closed the connection"
        self.protocol.receive_data(data)

    def read_until_ready(self) -> None:
        while not any(
            frame.opcode is Opcode.BINARY
            and not is_payload(frame.data)
            and isinstance(decode(frame.data, Direction.SERVER_TO_CLIENT), Ready)
            for frame in self.frames[-3:]
        ):
            self.read()

    def pongs(self) -> list[bytes]:
        return [bytes(frame.data) for frame in self.frames if frame.opcode is Opcode.PONG]

    def read(self) -> None:
        self.fill()
        for event in self.protocol.events_received():
            assert isinstance(event, Frame)
            self.frames.append(event)


@pytest.mark.parametrize("source", ["file", "mmap"])
def test_pings_in_the_middle_of_a_frame_are_answered_between_frames(
    tmp_path: Path, source: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A client that does not read stalls a frame; its pings come then; the stream stays whole."""
    sent: list[list[int]] = []
    send_direct = Connection._send_direct

    def counted(self: Connection, frames: Sequence[tuple[bytes, memoryview]]) -> int:
        count = send_direct(self, frames)
        sent.append([len(payload) for _, payload in frames[:count]])
        return count

    monkeypatch.setattr(Connection, "_send_direct", counted)
    pit = write_grid_scene(tmp_path / "pit", cells=60, compress=False)
    with BackgroundServer(tmp_path, payload_source=source, max_radius_m=1e4) as server:
        client = SlowClient(server.port)
        client.send(make_hello())
        client.send(Land(generation=1, position=(30.0, 0.0, 30.0), radius_m=500.0))
        time.sleep(0.3)  # the socket's buffers are full, a frame is under way
        for number in range(5):
            client.protocol.send_ping(b"%d" % number)
            client.flush()
        time.sleep(0.1)
        client.read_until_ready()
        client.socket.close()
    assert client.pongs() == [b"0", b"1", b"2", b"3", b"4"]
    frames = [decode_frame(frame.data) for frame in client.frames if is_payload(frame.data)]
    got = assemble([frame for frame in frames if isinstance(frame, PayloadFrame)])
    assert got == dict(enumerate(pit.payloads))
    assert sum(map(sum, sent)) == sum(map(len, pit.payloads))
    assert max(map(len, sent)) > 1  # several frames in one call


def test_a_client_that_pings_and_does_not_read_gets_the_newest_pong(tmp_path: Path) -> None:
    """Beyond 64 KiB of pongs the rest is dropped, not kept; the connection stays."""
    pit = write_grid_scene(tmp_path / "pit", cells=60, compress=False)
    with BackgroundServer(tmp_path, max_radius_m=1e4) as server:
        client = SlowClient(server.port)
        client.send(make_hello())
        client.send(Land(generation=1, position=(30.0, 0.0, 30.0), radius_m=500.0))
        time.sleep(0.3)
        for number in range(20):
            for other in range(100):
                client.protocol.send_ping(b"%120d" % (100 * number + other))
            client.flush()
            time.sleep(0.01)
        client.read_until_ready()
        while client.pongs()[-1] != b"%120d" % 1999:
            client.read()  # a busy service may read the last pings after it sent ready
        client.socket.close()
    pongs = [int(pong) for pong in client.pongs()]
    assert 0 < len(pongs) < 1200  # 540 at once, and what the kernel took in between
    assert pongs == sorted(pongs)
    assert pongs[-1] == 1999
    frames = [decode_frame(frame.data) for frame in client.frames if is_payload(frame.data)]
    got = assemble([frame for frame in frames if isinstance(frame, PayloadFrame)])
    assert got == dict(enumerate(pit.payloads))


def test_a_client_that_vanishes_in_the_middle_of_a_frame_frees_everything(tmp_path: Path) -> None:
    write_grid_scene(tmp_path / "pit", cells=60, compress=False)
    with BackgroundServer(tmp_path, max_radius_m=1e4) as server:
        before = open_descriptors()
        for _ in range(5):
            client = SlowClient(server.port)
            client.send(make_hello())
            client.send(Land(generation=1, position=(30.0, 0.0, 30.0), radius_m=500.0))
            time.sleep(0.1)
            client.socket.close()
        until_s = time.monotonic() + 10
        while server.service.session_count and time.monotonic() < until_s:
            time.sleep(0.02)
        assert server.service.session_count == 0
        assert open_descriptors() <= before + 2


def test_the_congestion_control_is_the_one_that_was_set(tmp_path: Path) -> None:
    """Reno is in every kernel; a name that the system does not know changes nothing."""
    write_grid_scene(tmp_path / "grid", cells=2)
    names = {}
    for name in (None, "reno", "no_such_thing"):
        with (
            BackgroundServer(tmp_path, congestion_control=name) as server,
            PlainClient(server.scene_url("grid")) as client,
        ):
            client.hello()
            (connection,) = server._server.server_state.connections
            raw = connection.transport.get_extra_info("socket")
            set_to = raw.getsockopt(socket.IPPROTO_TCP, TCP_CONGESTION, 16)
            names[name] = set_to.rstrip(b"\0").decode()
    assert names["reno"] == "reno"
    assert names["no_such_thing"] == names[None]


class TakesSoMuch:
    """A socket, and the transport behind it: one write to the socket takes so many bytes."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.written: list[bytes] = []

    def fileno(self) -> int:
        return -1

    def writev(self, _descriptor: int, buffers: Sequence[bytes | memoryview]) -> int:
        data = b"".join(buffers)
        if not self.most:
            raise BlockingIOError
        self.written.append(data[: self.most])
        return min(self.most, len(data))

    def write(self, data: bytes) -> None:
        self.written.append(bytes(data))

    def get_write_buffer_size(self) -> int:
        return 0

    def close(self) -> None:
        pass


def test_whatever_a_socket_takes_the_stream_is_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """Messages that wait, then frames; what is said to be sent is all there, and nothing else."""
    payloads = [b"a" * 5, b"b" * 130, b"", b"c" * 40]
    frames = [(b"head", memoryview(payload)) for payload in payloads]
    pieces = [_frame_header(4 + len(payload)) + b"head" + payload for payload in payloads]
    message = _frame_header(3) + b"say"
    for most in range(len(message) + sum(map(len, pieces)) + 2):
        both = TakesSoMuch(most)
        connection = Connection.__new__(Connection)
        connection.transport = both  # type: ignore[assignment]
        connection._raw = both
        monkeypatch.setattr(os, "writev", both.writev)
        connection._may_go_direct = True
        connection.send_buffer_bytes = 1
        connection.send_message(b"say")
        sent = connection.send_frames(frames)
        assert b"".join(both.written) == message + b"".join(pieces[:sent])
        assert sent >= 1
        assert (sent == len(frames)) == (most >= len(message) + sum(map(len, pieces[:3])))


def test_without_writev_frames_go_through_the_transport(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The buffer that all clients share is copied then: what waits there must not change."""
    pit = write_grid_scene(tmp_path / "pit", cells=60, compress=False)
    monkeypatch.delattr(os, "writev")
    with BackgroundServer(tmp_path, max_radius_m=1e4) as server:
        client = SlowClient(server.port)
        client.send(make_hello())
        client.send(Land(generation=1, position=(30.0, 0.0, 30.0), radius_m=500.0))
        client.read_until_ready()
        client.socket.close()
    frames = [decode_frame(frame.data) for frame in client.frames if is_payload(frame.data)]
    got = assemble([frame for frame in frames if isinstance(frame, PayloadFrame)])
    assert got == dict(enumerate(pit.payloads))
