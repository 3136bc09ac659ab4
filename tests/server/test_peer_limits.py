"""What a peer does below the level of messages, over real sockets."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import struct
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import msgpack
import numpy as np
import pytest
from eventually import eventually
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient, make_hello
from uvicorn.protocols.utils import ClientDisconnected

from terraport_server import BackgroundServer, client_addresses
from terraport_server.entrance import ADDRESS_SHARE
from terraport_server.peer_limits import (
    FRAMES_PER_MESSAGE,
    MAX_FIRST_BYTES,
    MAX_FIRST_FRAMES,
    BoundedPeer,
)
from terraport_server.stream import sender
from terraport_wire import (
    HELD_DTYPE,
    MAX_HELD_SEGMENTS,
    SUBPROTOCOL,
    Held,
    HeldChecked,
    decode,
    encode,
)

PING, CLOSE, BINARY, TEXT, CONT = 9, 8, 2, 1, 0
TOKEN = "a-token-of-enough-characters"


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    write_grid_scene(tmp_path / "grid", cells=2)
    return tmp_path


def frame(opcode: int, data: bytes, *, fin: bool = True) -> bytes:
    """A frame with a mask of zeros."""
    size = len(data)
    length = bytes([0x80 | size]) if size < 126 else b"\xff" + size.to_bytes(8, "big")
    return bytes([(0x80 if fin else 0) | opcode]) + length + bytes(4) + data


def raw(client: PlainClient) -> socket.socket:
    return client.socket.socket


def raw_connect(port: int, *lines: str, status: int = 101) -> socket.socket:
    """A WebSocket without anybody who reads it."""
    raw = socket.create_connection(("127.0.0.1", port), 5)
    more = "".join(f"{line}\r\n" for line in lines)
    raw.sendall(
        b"GET /scenes/grid/stream HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n"
        b"Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        b"Sec-WebSocket-Version: 13\r\n"
        + f"Sec-WebSocket-Protocol: {SUBPROTOCOL}\r\n{more}\r\n".encode()
    )
    head = b""
    while not head.endswith(b"\r\n\r\n"):
        head += raw.recv(1)
    assert f" {status} ".encode() in head
    return raw


def drained(raw: socket.socket) -> bytes:
    """Everything until the service closes."""
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


@pytest.mark.parametrize("blob", [frame(PING, b"x" * 100), frame(CONT, b"", fin=False)])
def test_more_frames_than_messages_would_need_are_closed(scenes: Path, blob: bytes) -> None:
    """10 s of the rate at once are taken; what is beyond is 4429."""
    with BackgroundServer(scenes, max_messages_per_s=2.0) as server:
        allowed = int(10 * 2.0 * FRAMES_PER_MESSAGE)
        with raw_connect(server.port) as raw:
            begin = frame(TEXT, b"{", fin=False) if blob[0] == CONT else b""
            raw.sendall(frame(BINARY, encode(make_hello())))
            raw.sendall(begin + blob * (allowed + 50))
            assert close_code(drained(raw)) == 4429


def test_a_client_that_pings_and_does_not_read_costs_no_memory(scenes: Path) -> None:
    """Pongs that nobody reads are not kept: the newest ping alone is answered, once it reads."""
    with BackgroundServer(scenes, max_messages_per_s=1e6, send_buffer_bytes=1 << 16) as server:
        connections = server._server.server_state.connections
        with raw_connect(server.port) as raw:
            raw.settimeout(5)
            raw.sendall(frame(BINARY, encode(make_hello())))
            raw.recv(1 << 16)
            most = 0
            for _ in range(80):
                raw.sendall(frame(PING, b"x" * 125) * 500)
                most = max(
                    most,
                    *(connection.transport.get_write_buffer_size() for connection in connections),
                )
            raw.sendall(frame(PING, b"last"))
            data = b""
            while b"\x8a\x04last" not in data:
                more = raw.recv(1 << 20)
                assert more, "closed instead of answered"
                data = data[-200:] + more
        # 5 MB of pings were sent; one read of the loop may add its pongs to what waits already.
        assert 0 < most < 1 << 20


def test_text_that_is_no_utf8_is_closed_without_a_trace(
    scenes: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with BackgroundServer(scenes) as server, caplog.at_level(logging.WARNING):
        for bad in (b"\xff\xfe{}", b'{"type":"\xed\xa0\x80"}'):
            with raw_connect(server.port) as raw:
                raw.sendall(frame(TEXT, bad))
                assert close_code(drained(raw)) == 1007
            with raw_connect(server.port) as raw:  # and says goodbye in the same piece
                raw.sendall(frame(TEXT, bad) + frame(CLOSE, b"\x03\xe8"))
                assert close_code(drained(raw)) == 1007
        assert not [record for record in caplog.records if record.levelno >= logging.ERROR]


def test_who_does_not_close_is_closed_in_time(scenes: Path) -> None:
    """After our close frame, close_timeout_s; the library's own ten seconds are not ours."""
    with (
        BackgroundServer(scenes, close_timeout_s=0.5) as server,
        raw_connect(server.port) as raw,
    ):
        raw.settimeout(5)
        began_s = time.monotonic()
        raw.sendall(frame(TEXT, b"no message"))
        assert close_code(drained(raw)) == 4400
        assert time.monotonic() - began_s < 4


def test_pings_between_messages_are_answered(scenes: Path) -> None:
    with BackgroundServer(scenes) as server, PlainClient(server.scene_url("grid")) as client:
        client.hello()
        for _ in range(20):
            assert client.socket.ping().wait(5)


def test_nothing_follows_the_close(scenes: Path) -> None:
    """The pong of a ping that came late would go out with whatever is written next."""
    with BackgroundServer(scenes) as server, raw_connect(server.port) as raw:
        raw.settimeout(5)
        raw.sendall(frame(BINARY, encode(make_hello())) + frame(BINARY, b"no message"))
        data = b""
        while b"\x88" not in data or close_code(data) != 4400:
            data += raw.recv(1 << 16)
        code_at = data.rindex(b"\x88")
        close_bytes = 2 + data[code_at + 1]
        raw.sendall(frame(PING, b"late"))
        raw.sendall(b"\x82\xff" + b"\xff" * 8 + bytes(5))  # longer than a frame may be
        data += drained(raw)
    assert len(data) == code_at + close_bytes


def test_an_answer_to_who_broke_the_rules_is_lost_not_misused(scenes: Path) -> None:
    """uvicorn has closed, the application does not know it yet and answers a message before that.

    Found by fuzz/server.py (one connection in thirty): it was logged as a failure of ours.
    """
    with BackgroundServer(scenes) as server, raw_connect(server.port) as raw:
        (connection,) = server._server.server_state.connections
        assert isinstance(connection, BoundedPeer)

        async def break_and_answer() -> None:
            connection.data_received(frame(3, b"no such opcode"))
            with pytest.raises(ClientDisconnected):
                await connection.send({"type": "websocket.send", "bytes": b"answer"})

        asyncio.run_coroutine_threadsafe(break_and_answer(), connection.loop).result(5)
        assert close_code(drained(raw)) == 1002


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Lengths of the messages that sessions decode."""
    lengths: list[int] = []

    def counting(data: Any, *arguments: Any, **options: Any) -> Any:
        lengths.append(len(data))
        return decode(data, *arguments, **options)

    monkeypatch.setattr(sender, "decode", counting)
    return lengths


@pytest.mark.parametrize(
    "message",
    [
        msgpack.packb({"type": "wave", "later": [None] * 200}),
        msgpack.packb({"type": "wave", "later": [[0] * 16_000] * 30}),
        msgpack.packb({"later": [[0] * 16_000] * 30, "type": "wave"}),
        msgpack.packb({"type": "bye"}),
        b"",
    ],
    ids=["unknown", "unknown and large", "type last", "known", "empty"],
)
@pytest.mark.parametrize("token", [None, TOKEN])
def test_of_a_stranger_one_message_is_decoded(
    scenes: Path, decoded: list[int], message: bytes, token: str | None
) -> None:
    """Whatever comes behind it, in the same piece or later."""
    with BackgroundServer(scenes, token=token) as server, raw_connect(server.port) as at:
        with contextlib.suppress(OSError):
            for _ in range(20):
                at.sendall(frame(BINARY, message))
        assert close_code(drained(at)) == 4400
    assert decoded == [len(message)]


def test_a_stranger_that_keeps_on_sending_is_not_read(scenes: Path, decoded: list[int]) -> None:
    """Nor does what it sent behind the close keep it from being closed."""
    sent, blob = 0, frame(BINARY, bytes(400_000))
    with BackgroundServer(scenes, token=TOKEN) as server, raw_connect(server.port) as at:
        with contextlib.suppress(OSError):
            while sent < 64 * len(blob):
                at.sendall(blob)
                sent += len(blob)
        eventually(lambda: not server._server.server_state.connections)
    assert decoded == [400_000]
    assert sent < 64 * len(blob)


def test_messages_that_come_in_one_piece_are_taken_one_by_one(
    scenes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between two of them is everybody else's turn, and none is lost or out of order."""
    waiting: list[int] = []
    receive = BoundedPeer.receive

    async def watched(self: BoundedPeer) -> Any:
        waiting.append(len(self.queue._items))
        return await receive(self)

    monkeypatch.setattr(BoundedPeer, "receive", watched)
    with (
        BackgroundServer(scenes, close_timeout_s=0.5) as server,
        raw_connect(server.port) as at,
    ):
        hello = encode(make_hello())
        pick = {"type": "pick", "origin": [0.0, 0.0, 0.0]}
        picks = [msgpack.packb({**pick, "request": number}) for number in range(7)]
        at.sendall(
            b"".join(frame(BINARY, data) for data in [hello, *picks, b"\x81\xa4type\xa3bye"])
        )
        data = drained(at)
        assert close_code(data) == 1000
    assert len(waiting) > 8
    assert max(waiting) <= 1


def test_of_many_clients_one_is_taken_in_a_step_of_the_loop(
    scenes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Eighty that say what they hold made a step as long as eighty tables of 32,768 rows."""
    taken: list[int] = []
    step = 0
    take = BoundedPeer._take_frames

    def watched(self: BoundedPeer) -> None:
        taken.append(step)
        take(self)

    def count() -> None:
        nonlocal step
        step += 1
        loop.call_soon(count)

    with BackgroundServer(scenes) as server, ExitStack() as stack:
        clients = [stack.enter_context(PlainClient(f"{server.url}/scenes/grid")) for _ in range(24)]
        for client in clients:
            client.hello()
        loop = server._server._loop
        assert loop is not None
        loop.call_soon_threadsafe(count)
        loop.call_soon_threadsafe(time.sleep, 0.5)  # all of them have come when it goes on
        monkeypatch.setattr(BoundedPeer, "_take_frames", watched)
        for client in clients:
            client.send(Held(segments=np.zeros(1, dtype=HELD_DTYPE)))
        for client in clients:
            client.expect(HeldChecked)
    assert len(taken) >= len(clients)
    assert len(set(taken)) == len(taken)


def test_a_frame_may_come_by_the_byte(scenes: Path) -> None:
    with BackgroundServer(scenes) as server, raw_connect(server.port) as at:
        for number in frame(BINARY, b"\x81\xa4type\xa3bye"):
            at.sendall(bytes([number]))
        assert close_code(drained(at)) == 4400


def test_a_websocket_counts_for_its_address_until_it_is_closed(scenes: Path) -> None:
    with (
        BackgroundServer(scenes, max_connections_per_ip=3, forwarded_allow_ips="") as server,
        ExitStack() as stack,
    ):
        for _ in range(3):
            stack.enter_context(raw_connect(server.port))
        answered = httpx.get(f"{server.url}/healthz")
        assert (answered.status_code, answered.json()["error"]["code"]) == (503, "connections")
        raw_connect(server.port, status=503).close()
        stack.close()
        eventually(lambda: not server._server.server_state.connections)
        assert httpx.get(f"{server.url}/healthz").status_code == 200


def test_behind_a_proxy_it_counts_for_the_clients_address(scenes: Path) -> None:
    first, second = "X-Forwarded-For: 192.0.2.1", "X-Forwarded-For: 192.0.2.2"
    with BackgroundServer(scenes, max_connections_per_ip=3) as server, ExitStack() as stack:
        for _ in range(3):
            stack.enter_context(raw_connect(server.port, first))
            stack.enter_context(raw_connect(server.port, second))
        for full in (first, second):
            with raw_connect(server.port, full, status=503) as at:
                assert b'"code":"connections"' in drained(at)
        for _ in range(4):  # the proxy itself speaks for many
            stack.enter_context(raw_connect(server.port))
        stack.close()
        eventually(lambda: not server._server.server_state.connections)
        raw_connect(server.port, first).close()


@pytest.mark.parametrize(
    ("settings", "code"),
    [({"token": TOKEN}, 4401), ({"max_sessions": 1}, 4429), ({"max_sessions_per_ip": 1}, 4429)],
)
def test_who_is_not_let_in_leaves_without_closing(
    scenes: Path, settings: dict[str, Any], code: int
) -> None:
    """It never answers the close; a known client would have `close_timeout_s`."""
    wrong = "Authorization: Bearer another-token-of-some-length"
    with (
        BackgroundServer(scenes, close_timeout_s=600.0, **settings) as server,
        ExitStack() as stack,
    ):
        connections = server._server.server_state.connections
        if code == 4429:
            stack.enter_context(PlainClient(server.scene_url("grid"))).hello()
        before = len(connections)
        refused = [stack.enter_context(raw_connect(server.port, wrong)) for _ in range(5)]
        eventually(lambda: len(connections) == before, 5)
        assert {close_code(drained(at)) for at in refused} == {code}


def test_whose_hello_is_refused_leaves_without_closing(scenes: Path) -> None:
    with (
        BackgroundServer(scenes, close_timeout_s=600.0, token=TOKEN) as server,
        raw_connect(server.port) as at,
    ):
        at.sendall(frame(BINARY, encode(make_hello())))
        eventually(lambda: not server._server.server_state.connections, 5)
        assert close_code(drained(at)) == 4401


@pytest.mark.parametrize(
    "blob", [frame(PING, b"x" * 32), frame(CONT, b"", fin=False)], ids=["pings", "fragments"]
)
def test_before_hello_a_few_frames_are_taken(scenes: Path, blob: bytes) -> None:
    begin = frame(BINARY, b"\x80", fin=False) if blob[0] == CONT else b""
    with BackgroundServer(scenes, token=TOKEN) as server:
        with raw_connect(server.port) as at:
            at.sendall(begin + blob * (MAX_FIRST_FRAMES - 1))
            at.sendall(frame(PING, b"last"))
            pongs = b""
            while b"last" not in pongs:
                pongs += at.recv(1 << 16)
                assert not pongs.endswith(b"\x11\x4d"), "closed with 4429"
        with raw_connect(server.port) as at:
            at.sendall(begin + blob * (MAX_FIRST_FRAMES + 1))
            assert close_code(drained(at)) == 4429


def test_a_first_message_that_says_it_is_too_large_is_not_waited_for(scenes: Path) -> None:
    """A megabyte was taken in before it was refused, of each of hundreds."""
    with BackgroundServer(scenes, token=TOKEN) as server, raw_connect(server.port) as at:
        at.sendall(frame(BINARY, bytes(MAX_FIRST_BYTES + 1))[:100])
        assert close_code(drained(at)) == 4413


def test_the_longest_hello_is_taken(scenes: Path) -> None:
    """In reads of 8 KB, each in its turn."""
    with (
        BackgroundServer(scenes, token=TOKEN, forwarded_allow_ips="") as server,
        PlainClient(server.scene_url("grid")) as client,
    ):
        table = np.zeros(MAX_HELD_SEGMENTS, dtype=HELD_DTYPE)
        table["id"] = np.arange(MAX_HELD_SEGMENTS)
        welcome = client.hello(token=TOKEN, held=table)
        assert welcome.held_count == 0


def test_who_says_no_hello_takes_no_session(scenes: Path) -> None:
    """Eight addresses with 32 each, without any token, kept everybody else out."""
    limits = {"max_sessions": 2, "max_sessions_per_ip": 2, "token": TOKEN}
    with BackgroundServer(scenes, **limits) as server, ExitStack() as stack:
        for _ in range(6):
            stack.enter_context(raw_connect(server.port))
        assert server.service.session_count == 0
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


def test_the_last_seats_are_for_those_who_have_few(scenes: Path) -> None:
    """Ten addresses with a token took all that they might: nobody else was let in."""
    limits = {"max_sessions": 32, "max_sessions_per_ip": 16, "forwarded_allow_ips": ""}
    with BackgroundServer(scenes, **limits) as server, ExitStack() as stack:
        service = server.service
        for address in ("127.0.0.2", "127.0.0.3", "127.0.0.4"):
            while service.admit(address) is None:
                pass
        assert service.session_count == 32 - 2
        assert "from one address where 2 are left" in str(service.fullness("127.0.0.4"))
        stack.enter_context(PlainClient(server.scene_url("grid"))).hello()
        with PlainClient(server.scene_url("grid")) as second:
            error, closed = second.refused()
        assert (error.code, closed) == ("too_many", 4429)
        assert service.fullness("127.0.0.5") is None, "the very last"


def test_where_one_address_may_have_all_it_has_all(scenes: Path) -> None:
    limits = {"max_sessions": 32, "max_sessions_per_ip": 32}
    with BackgroundServer(scenes, **limits) as server:
        while server.service.admit("127.0.0.2") is None:
            pass
        assert server.service.session_count == 32


def connect_from(port: int, address: str) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), 5, source_address=(address, 0))


def test_strangers_make_room(scenes: Path) -> None:
    """Whoever fills the service with silence, an honest client of another address comes in."""
    limits = {"max_connections": 8, "max_connections_per_ip": 4, "forwarded_allow_ips": ""}
    with BackgroundServer(scenes, **limits) as server, ExitStack() as stack:
        connections = server._server.server_state.connections
        for address in ("127.0.0.2", "127.0.0.3"):
            for _ in range(4):
                stack.enter_context(connect_from(server.port, address))
        eventually(lambda: len(connections) == 8)
        for _ in range(3):
            assert httpx.get(f"{server.url}/healthz").status_code == 200
        client = stack.enter_context(PlainClient(server.scene_url("grid")))
        client.hello()
        for _ in range(12):  # nor does he have to leave again
            stack.enter_context(connect_from(server.port, "127.0.0.4"))
        assert client.socket.ping().wait(5)
        assert len(connections) <= 16


def test_who_comes_in_vain_again_and_again_is_dropped_unheard(
    scenes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A few come to be refused; whoever gets what he wants may come again."""
    monkeypatch.setattr(client_addresses, "ARRIVALS_S", 1000.0)
    limits = {"max_connections_per_ip": 2, "forwarded_allow_ips": "", "token": TOKEN}
    with BackgroundServer(scenes, **limits) as server:
        url, headers = f"{server.url}/scenes", {"Authorization": f"Bearer {TOKEN}"}
        for _ in range(8):
            assert httpx.get(url, headers=headers).status_code == 200
        statuses = []
        soon = httpx.Timeout(5, connect=0.3)  # at last they are not even accepted
        for _ in range(8):
            with contextlib.suppress(httpx.TransportError):
                statuses.append(httpx.get(url, timeout=soon).status_code)
        assert statuses == [401] * 5
        with connect_from(server.port, "127.0.0.2") as at:  # somebody else
            at.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
            assert b"200 OK" in at.recv(1 << 16)


def test_strangers_write_no_lines(scenes: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Each handshake was "connection open", "session opened" and "session closed"."""
    with BackgroundServer(scenes, token=TOKEN) as server, caplog.at_level(logging.INFO):
        caplog.clear()
        for _ in range(3):
            raw_connect(server.port).close()
        with raw_connect(server.port) as at:
            at.sendall(frame(BINARY, b"\x81\xa4type\xa3bye"))
            drained(at)
        eventually(lambda: not server._server.server_state.connections)
        assert [record.message for record in caplog.records] == ["refused"]
        with PlainClient(server.scene_url("grid")) as client:
            client.hello(token=TOKEN)
        eventually(lambda: "session closed" in caplog.messages)
        assert caplog.messages == ["refused", "session opened", "session closed"]


def test_unfinished_messages_of_strangers_are_bounded(scenes: Path) -> None:
    limits = {"token": TOKEN, "max_connections_per_ip": 200, "forwarded_allow_ips": ""}
    with BackgroundServer(scenes, **limits) as server, ExitStack() as stack:
        connections = server._server.server_state.connections
        half = frame(BINARY, bytes(400_000))[:-1]
        for _ in range(20):
            at = stack.enter_context(raw_connect(server.port))
            with contextlib.suppress(OSError):
                at.sendall(half)
        eventually(lambda: len(connections) < 20)
        (entrance,) = {one._entrance for one in connections}
        most = server.service.settings.max_stranger_bytes // ADDRESS_SHARE
        assert most // 2 < entrance.strangers.total_bytes <= most
