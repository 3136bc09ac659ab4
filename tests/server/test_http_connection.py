"""Bounds of HTTP connections, each met by a real socket that goes beyond it."""

from __future__ import annotations

import contextlib
import json
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest
from eventually import eventually
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient

from terraport_server import BackgroundServer
from terraport_server.bounded_requests import MAX_HEADERS, BoundedRequests
from terraport_server.small_reads import READ_BYTES

HOST = b"Host: localhost\r\n"
BIG = 24 << 20
"""Bytes of a report, more than the sockets' buffers of both sides take."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("http")
    grid = write_grid_scene(folder / "pit", cells=2)
    with (grid.path / "report.html").open("wb") as report:
        report.truncate(BIG)
    return folder


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[BackgroundServer]:
    limits = {
        "http_header_timeout_s": 0.5,
        "http_keep_alive_s": 0.4,
        "http_stall_timeout_s": 0.6,
        "http_header_bytes": 8192,
        "http_body_bytes": 1000,
        "max_connections": 12,
        "max_connections_per_ip": 12,
    }
    with BackgroundServer(folder, **limits) as running:
        yield running


def connect(server: BackgroundServer, **options: int) -> socket.socket:
    raw = socket.socket()
    for name, setting in options.items():
        raw.setsockopt(socket.SOL_SOCKET, getattr(socket, name), setting)
    raw.settimeout(10)
    raw.connect(("127.0.0.1", server.port))
    return raw


def answer(raw: socket.socket) -> bytes:
    """Read until the server closes."""
    data = b""
    try:
        while piece := raw.recv(1 << 16):
            data += piece
    except ConnectionResetError:
        pass
    return data


def refusal(data: bytes) -> tuple[int, str]:
    """Return status and code of a refusal in the form of all refusals."""
    head, _, body = data.partition(b"\r\n\r\n")
    assert b"connection: close" in head
    return int(head.split()[1]), json.loads(body)["error"]["code"]


def open_connections(server: BackgroundServer) -> int:
    return len(server._server.server_state.connections)


@pytest.mark.parametrize(
    "sent",
    [b"", b"GET / HTTP/1.1\r\n" + HOST, b"GET /scenes/pit/stream HTTP/1.1\r\nUpgrade: websocket"],
    ids=["silent", "half", "half a handshake"],
)
def test_a_request_that_is_never_whole(server: BackgroundServer, sent: bytes) -> None:
    began_s = time.monotonic()
    with connect(server) as raw:
        raw.sendall(sent)
        assert refusal(answer(raw)) == (408, "http_slow")
    assert 0.4 < time.monotonic() - began_s < 5


def test_a_request_by_the_byte(server: BackgroundServer) -> None:
    """Slow-loris: bytes that keep coming do not put the end off."""
    began_s = time.monotonic()
    with connect(server) as raw, contextlib.suppress(OSError):
        for _ in range(200):
            raw.sendall(b"X")
            time.sleep(0.05)
    assert time.monotonic() - began_s < 5


@pytest.mark.parametrize(
    "more",
    [b"Content-Length: 5\r\n\r\nhello", b"Transfer-Encoding: chunked\r\n\r\n1\r\nx\r\n0\r\n\r\n"],
    ids=["body", "chunks"],
)
def test_an_upgrade_that_is_no_handshake(server: BackgroundServer, more: bytes) -> None:
    """It got no answer, and its connection had no end."""
    with connect(server) as raw:
        raw.sendall(
            b"GET /scenes/pit/stream HTTP/1.1\r\n" + HOST + b"Connection: Upgrade\r\n"
            b"Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
            b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n" + more
        )
        assert refusal(answer(raw))[0] == 400
    eventually(lambda: open_connections(server) == 0)


def test_two_hosts_are_nobodys(server: BackgroundServer) -> None:
    """The last one counted, which is another one than a proxy in front may have looked at."""
    for hosts in (b"Host: evil\r\n" + HOST, HOST + b"Host: evil\r\n"):
        with connect(server) as raw:
            raw.sendall(b"GET /scenes HTTP/1.1\r\n" + hosts + b"Connection: close\r\n\r\n")
            assert answer(raw).startswith(b"HTTP/1.1 421 ")


def test_silence_after_an_answer(server: BackgroundServer) -> None:
    with connect(server) as raw:
        raw.sendall(b"GET /healthz HTTP/1.1\r\n" + HOST + b"\r\n")
        data = answer(raw)
    assert data.startswith(b"HTTP/1.1 200")
    assert data.endswith(b"ok\n")


def test_who_sends_no_body_is_not_told_to_go_on_with_it(server: BackgroundServer) -> None:
    with connect(server) as raw:
        for path in (b"/scenes/pit/regions.json", b"/healthz"):
            raw.sendall(b"GET %b HTTP/1.1\r\n" % path + HOST + b"Expect: 100-continue\r\n\r\n")
        assert b" 100 " not in answer(raw)


def test_half_a_second_request(server: BackgroundServer) -> None:
    with connect(server) as raw:
        raw.sendall(b"GET /healthz HTTP/1.1\r\n" + HOST + b"\r\n")
        data = b""
        while not data.endswith(b"ok\n"):
            data += raw.recv(1 << 16)
        raw.sendall(b"GET /hea")
        assert refusal(answer(raw)) == (408, "http_slow")


@pytest.mark.parametrize("ended", [True, False])
def test_headers_that_are_too_large(server: BackgroundServer, ended: bool) -> None:
    line = b"X-Filler: " + b"a" * 1000 + b"\r\n"
    with connect(server) as raw:
        raw.sendall(b"GET / HTTP/1.1\r\n" + HOST + line * 9 + (b"\r\n" if ended else b""))
        assert refusal(answer(raw)) == (431, "http_headers")
    with connect(server) as raw:
        raw.sendall(b"GET /" + b"a" * 9000 + b" HTTP/1.1\r\n" + HOST + b"\r\n")
        assert refusal(answer(raw)) == (414, "http_headers")


def test_endless_headers_hold_no_memory(server: BackgroundServer) -> None:
    sent = 0
    with connect(server) as raw, contextlib.suppress(OSError):
        raw.sendall(b"GET / HTTP/1.1\r\n" + HOST)
        while sent < 64 << 20:
            raw.sendall((b"X-Filler: " + b"a" * 1012 + b"\r\n") * 64)
            sent += 1 << 16
    assert sent < 32 << 20  # what the sockets' buffers take, and no more


def test_more_headers_than_anybody_sends(server: BackgroundServer) -> None:
    """Each takes some 150 bytes of memory, of whatever length."""
    many = b"".join(b"X-%d:\r\n" % number for number in range(MAX_HEADERS + 1))
    with connect(server) as raw:
        raw.sendall(b"GET / HTTP/1.1\r\n" + many + b"\r\n")
        assert refusal(answer(raw)) == (431, "http_headers")


@pytest.mark.parametrize(
    ("first", "again"),
    [
        (b"0\r\n", b"X-Trailer: y\r\n"),
        (b"", b"1\r\nx\r\n"),
        (b"1;", b"a" * 100),
    ],
    ids=["trailers", "chunks", "chunk extensions"],
)
def test_a_body_that_never_ends(server: BackgroundServer, first: bytes, again: bytes) -> None:
    """Trailers were kept without a bound, an extension was read without one."""
    sent = 0
    with connect(server) as raw, contextlib.suppress(OSError):
        raw.sendall(b"POST /scenes HTTP/1.1\r\nTransfer-Encoding: chunked\r\n" + HOST + b"\r\n")
        raw.sendall(first)
        while sent < 16 << 20:
            raw.sendall(again * 1000)
            sent += 1000 * len(again)
    assert sent < 8 << 20  # what the sockets' buffers take, and no more


def test_a_body_by_the_byte(server: BackgroundServer) -> None:
    """It put off the end of silence, byte by byte."""
    began_s = time.monotonic()
    with connect(server) as raw, contextlib.suppress(OSError):
        raw.sendall(b"POST /scenes HTTP/1.1\r\nContent-Length: 900\r\n" + HOST + b"\r\n")
        for _ in range(200):
            raw.sendall(b"X")
            time.sleep(0.05)
    assert time.monotonic() - began_s < 5


@pytest.mark.parametrize(
    "head",
    [b"Content-Length: 5000\r\n\r\n" + b"b" * 5000, b"Transfer-Encoding: chunked\r\n\r\n"],
    ids=["announced", "chunked"],
)
def test_a_body_that_is_too_large(server: BackgroundServer, head: bytes) -> None:
    chunks = b"" if b"Length" in head else (b"3e8\r\n" + b"c" * 1000 + b"\r\n") * 5
    with connect(server) as raw:
        # A route that takes its time, so that the body comes before the answer.
        raw.sendall(b"GET /scenes/pit/base.glb HTTP/1.1\r\n" + HOST + head + chunks)
        data = answer(raw)
    assert b"413" in data.split(b"\r\n")[0] or data == b"", data[:200]


def test_a_body_that_is_too_large_by_its_last_piece(server: BackgroundServer) -> None:
    """The piece that ended a body was not counted: 20 kB passed a bound of 16."""
    with connect(server) as raw:
        raw.sendall(b"POST /scenes HTTP/1.1\r\nContent-Length: 1001\r\n" + HOST + b"\r\n")
        raw.sendall(b"b" * 1001)
        assert refusal(answer(raw)) == (413, "http_body")
    with connect(server) as raw:  # of that length nobody knows before
        raw.sendall(b"POST /scenes HTTP/1.1\r\nTransfer-Encoding: chunked\r\n" + HOST)
        raw.sendall(b"\r\n3e9\r\n" + b"c" * 1001 + b"\r\n0\r\n\r\n")
        assert answer(raw) == b""


def test_a_body_of_as_much_as_may_be(server: BackgroundServer) -> None:
    with connect(server) as raw:
        raw.sendall(b"POST /scenes HTTP/1.1\r\nConnection: close\r\nContent-Length: 1000\r\n")
        raw.sendall(HOST + b"\r\n" + b"b" * 1000)
        assert answer(raw).split()[1] == b"405"


def test_what_is_no_http(server: BackgroundServer) -> None:
    for words in (b"\x16\x03\x01\x02\x00", b"GET\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n"):
        with connect(server) as raw:
            raw.sendall(words)
            assert refusal(answer(raw)) == (400, "http_malformed")


def test_requests_ahead_of_their_answers_wait(server: BackgroundServer) -> None:
    """They were taken apart up to the sixteenth, 100 KB of headers each, and the next dropped."""
    request = b"GET /scenes HTTP/1.1\r\n" + HOST + b"\r\n"
    with connect(server) as raw:
        raw.sendall(request * 500)
        most = 0
        while raw.recv(1 << 16):
            for one in list(server._server.server_state.connections):
                most = max(most, len(one.pipeline))
                assert len(one._unread) <= 2 * READ_BYTES
    assert most == 0


def test_an_answer_that_is_not_read(server: BackgroundServer) -> None:
    before = open_connections(server)
    with connect(server, SO_RCVBUF=4096) as raw:
        raw.sendall(b"GET /scenes/pit/report HTTP/1.1\r\n" + HOST + b"\r\n")
        eventually(lambda: open_connections(server) == before + 1)
        began_s = time.monotonic()
        eventually(lambda: open_connections(server) == before, 5)
        assert time.monotonic() - began_s < 4
        raw.settimeout(5)
        assert len(answer(raw)) < BIG


def test_a_slow_reader_gets_everything(server: BackgroundServer) -> None:
    """Progress counts, not the whole time."""
    got = 0
    with connect(server, SO_RCVBUF=1 << 20) as raw:
        raw.sendall(b"GET /scenes/pit/report HTTP/1.1\r\nConnection: close\r\n" + HOST + b"\r\n")
        began_s = time.monotonic()
        while piece := raw.recv(1 << 20):
            got += len(piece)
            time.sleep(0.05)
    assert time.monotonic() - began_s > 1.0
    assert got > BIG


def test_too_many_connections_of_one_address(folder: Path) -> None:
    with (
        BackgroundServer(folder, max_connections_per_ip=3, forwarded_allow_ips="") as running,
        ExitStack() as stack,
    ):
        for _ in range(3):
            stack.enter_context(connect(running))
        eventually(lambda: open_connections(running) == 3)
        answered = httpx.get(f"{running.url}/healthz")
        assert (answered.status_code, answered.json()["error"]["code"]) == (503, "connections")
        stack.close()
        eventually(lambda: open_connections(running) == 0)
        assert httpx.get(f"{running.url}/healthz").status_code == 200


def test_too_many_connections_and_the_flood_behind_them(server: BackgroundServer) -> None:
    eventually(lambda: open_connections(server) == 0)
    with ExitStack() as stack:
        for _ in range(12):
            stack.enter_context(connect(server))
        assert httpx.get(f"{server.url}/healthz").status_code == 503
        with pytest.raises(Exception, match="503"):
            PlainClient(server.scene_url("pit"))
        for _ in range(30):
            stack.enter_context(connect(server))
        # Twice as many at most are kept, whatever comes.
        eventually(lambda: 0 < open_connections(server) <= 24)
    eventually(lambda: open_connections(server) == 0)
    assert httpx.get(f"{server.url}/healthz").status_code == 200


def test_descriptors_are_given_back(server: BackgroundServer) -> None:
    eventually(lambda: open_connections(server) == 0)
    before = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(20):
        with connect(server) as raw:
            raw.sendall(b"nonsense\r\n\r\n")
            answer(raw)
    eventually(lambda: len(list(Path("/proc/self/fd").iterdir())) <= before)


def test_an_address_that_connects_and_leaves_again_and_again(folder: Path) -> None:
    """None of them is there for long, and each would cost a handshake."""
    with BackgroundServer(folder, max_connections_per_ip=2, forwarded_allow_ips="") as running:
        answered = 0
        for _ in range(40):
            with socket.socket() as raw, contextlib.suppress(OSError):
                raw.settimeout(5 if answered < 10 else 0.1)  # not even accepted at last
                raw.connect(("127.0.0.1", running.port))
                raw.sendall(b"GET /healthz HTTP/1.1\r\nConnection: close\r\n" + HOST + b"\r\n")
                answered += answer(raw).startswith(b"HTTP/1.1 200")
        assert 10 <= answered <= 20


def test_guesses_on_one_connection_come_to_an_end(folder: Path) -> None:
    """Each cost as much as a connection that leads nowhere, and none of them counted."""
    limits = {"max_connections_per_ip": 4, "forwarded_allow_ips": "", "token": "x" * 16}
    with BackgroundServer(folder, **limits) as running, connect(running) as raw:
        answers = b""
        with contextlib.suppress(OSError):
            for number in range(60):
                guess = b"Authorization: Bearer guess-%04d\r\n" % number
                raw.sendall(b"GET /scenes HTTP/1.1\r\n" + guess + HOST + b"\r\n")
                if not (came := raw.recv(1 << 16)):
                    break
                answers += came
        assert 8 <= answers.count(b"HTTP/1.1 401") <= 11
        with connect_from(running, "127.0.0.2") as other:  # somebody else guesses wrong twice
            for guess in (b"wrong", b"wrong too", b"x" * 16):
                line = b"Authorization: Bearer " + guess + b"\r\n"
                other.sendall(b"GET /scenes HTTP/1.1\r\n" + line + HOST + b"\r\n")
                status = other.recv(1 << 16)[9:12]
            assert status == b"200"


def connect_from(server: BackgroundServer, address: str) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.port), 10, source_address=(address, 0))


def test_one_first_request_is_taken_apart_in_a_step_of_the_loop(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What came at once on many connections was, at once: .3 ms each before anybody's turn."""
    many, step, parsed, parse = 8, 0, list[int](), BoundedRequests._parse_piece

    def count(connection: BoundedRequests) -> None:
        parsed.append(step)
        parse(connection)

    with BackgroundServer(folder, forwarded_allow_ips="") as server, ExitStack() as stack:
        loop = server._server._loop
        assert loop is not None

        def tick() -> None:
            nonlocal step
            step += 1
            if len(parsed) < many:
                loop.call_soon(tick)

        raws = [stack.enter_context(connect(server)) for _ in range(many)]
        eventually(lambda: open_connections(server) == many)
        monkeypatch.setattr(BoundedRequests, "_parse_piece", count)
        loop.call_soon_threadsafe(tick)
        loop.call_soon_threadsafe(time.sleep, 0.2)  # until all of them have been sent
        for raw in raws:
            raw.sendall(b"GET /healthz HTTP/1.1\r\nConnection: close\r\n" + HOST + b"\r\n")
        for raw in raws:
            assert b" 200 " in answer(raw)
    assert len(set(parsed)) == many, f"a step of the loop each, got {parsed}"
