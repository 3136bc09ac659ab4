"""Payload answered by the connection itself: the same as by the application, in the same bounds."""

from __future__ import annotations

import contextlib
import os
import re
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from eventually import eventually
from server.grid_scene import GridScene, write_grid_scene

from terraport_server import BackgroundServer
from terraport_server.file_sender import FileSender
from terraport_server.payload_connection import PayloadConnection
from terraport_server.short_answers import ShortAnswers

HOST = b"Host: localhost\r\n"
TOKEN = "sixteen-characters"
BIG = 3 << 20
"""Bytes of a range, more than small socket buffers take."""


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> GridScene:
    return write_grid_scene(tmp_path_factory.mktemp("short") / "pit", cells=4)


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Whether each request that asked for the short way was answered there."""
    found: list[bool] = []
    find = ShortAnswers.find

    def note(self: ShortAnswers, *arguments: object) -> object:
        answer = find(self, *arguments)  # type: ignore[arg-type]
        found.append(answer is not None)
        return answer

    monkeypatch.setattr(ShortAnswers, "find", note)
    return found


def ask(raw: socket.socket, path: str, *lines: str) -> bytes:
    """Send one request; return its answer as it came, but for the date."""
    head = "".join(f"{line}\r\n" for line in (f"GET {path} HTTP/1.1", "Host: localhost", *lines))
    raw.sendall(f"{head}\r\n".encode())
    return read_answer(raw)


def read_answer(raw: socket.socket) -> bytes:
    """Read one answer and nothing of the next."""
    data = b""
    while not data.endswith(b"\r\n\r\n"):
        byte = raw.recv(1)
        assert byte, data
        data += byte
    length = re.search(rb"content-length: (\d+)", data)
    left = int(length[1]) if length and b" 304 " not in data[:20] else 0
    while left:
        piece = raw.recv(min(left, 1 << 16))
        assert piece
        data += piece
        left -= len(piece)
    return re.sub(rb"date: [^\r]*\r\n", b"", data)


def connect(server: BackgroundServer) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.port), timeout=10)


def requests(grid: GridScene) -> list[tuple[str, ...]]:
    pack = grid.manifest.files["segments.pack"].path
    version = grid.manifest.version
    segment = f"/scenes/pit/segments/7.glb?v={version}"
    return [
        (segment,),
        ("/scenes/pit/segments/7.glb",),
        (segment, "Range: bytes=10-29"),
        (segment, "Range: bytes=-1"),
        (segment, "Range: bytes=99999999-"),
        (segment, "Range: bytes=0-1,4-5"),
        (segment, "Range: bytes=" + ",".join(["0-1"] * 20)),
        (segment, "Range: bytes=10-29", 'If-Range: "other"'),
        (segment, "If-None-Match: *"),
        (segment, "Accept-Encoding: gzip, br", "X-Forwarded-For: 192.0.2.1"),
        (segment, "Authorization: Bearer wrong"),
        (segment, f"Authorization: Bearer {TOKEN}"),
        ("/scenes/pit/segments/7.glb?v=other",),
        ("/scenes/pit/segments/9999.glb",),
        ("/scenes/other/segments/7.glb",),
        (f"/scenes/pit/{pack}",),
        (f"/scenes/pit/{pack}", "Range: bytes=64-1063"),
        (f"/scenes/pit/{pack}", f"Authorization: Bearer {TOKEN}", "Range: bytes=64-"),
        ("/scenes/pit/v-000000000000/segments.pack",),
        (segment, "Origin: https://viewer.example"),
        (segment, "Origin: https://stranger.example"),
    ]


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"token": TOKEN},
        {"allowed_origins": ("https://viewer.example",)},
    ],
    ids=["open", "token", "origins"],
)
@pytest.mark.parametrize("by", ["sendfile", "memory"])
def test_both_ways_say_the_same(
    grid: GridScene,
    found: list[bool],
    monkeypatch: pytest.MonkeyPatch,
    settings: dict[str, object],
    by: str,
) -> None:
    if by == "memory":  # as under TLS, or on a system without sendfile
        monkeypatch.setattr(FileSender, "can_serve", lambda _transport: False)
    with BackgroundServer(grid.path.parent, **settings) as running, connect(running) as raw:
        for lines in requests(grid):
            ask(raw, *lines)  # hashes are compared, metrics have their labels
        found.clear()
        short = [ask(raw, *lines) for lines in requests(grid)]
        assert any(found)
        counted = count_answers(running)
        with monkeypatch.context() as patch:
            patch.setattr(PayloadConnection, "_ask_short", lambda _self: None)
            found.clear()
            long = [ask(raw, *lines) for lines in requests(grid)]
            assert not found
        assert short == long
        # Metrics, too.
        again = count_answers(running)
    for status, count in again.items():
        assert count - counted[status] == sum(
            answer[9:10] == status[:1].encode() for answer in long
        )


def count_answers(server: BackgroundServer) -> dict[str, float]:
    metrics = server.service.metrics
    return {name: metrics._http[name]._value.get() for name in ("2xx", "3xx", "4xx")}


def test_a_foreign_host_is_refused_the_long_way(grid: GridScene, found: list[bool]) -> None:
    with BackgroundServer(grid.path.parent) as running:
        url = f"{running.url}/scenes/pit/segments/7.glb"
        for _ in range(2):
            assert httpx.get(url, headers={"Host": "evil.example"}).status_code == 421
        assert not any(found)
        for _ in range(2):
            assert httpx.get(url).status_code == 200
        assert found[-1]
        assert httpx.get(url, headers={"Host": "evil.example"}).status_code == 421


def test_requests_sent_ahead_take_turns_and_keep_their_order(
    grid: GridScene, found: list[bool]
) -> None:
    """Short and long ways mixed on one connection."""
    with BackgroundServer(grid.path.parent) as running, connect(running) as raw:
        for n in range(6):
            ask(raw, f"/scenes/pit/segments/{n}.glb")
        found.clear()
        head = b"GET /scenes/pit/segments/%d.glb HTTP/1.1\r\n" + HOST + b"\r\n"
        health = b"GET /healthz HTTP/1.1\r\n" + HOST + b"\r\n"
        raw.sendall(b"".join(head % n + (health if n % 2 else b"") for n in range(6)))
        for n in range(6):
            assert read_answer(raw).endswith(grid.payloads[n])
            if n % 2:
                assert read_answer(raw).endswith(b"ok\n")
        assert any(found)


def test_a_head_in_two_pieces(grid: GridScene) -> None:
    data = b"GET /scenes/pit/segments/7.glb HTTP/1.1\r\n" + HOST + b"\r\n"
    with BackgroundServer(grid.path.parent) as running, connect(running) as raw:
        for cut in (1, 5, 20, len(data) - 3, len(data) - 1):
            # The end of one and the beginning of the next in one read.
            raw.sendall(data[:cut])
            time.sleep(0.02)
            raw.sendall(data[cut:] + data[:cut])
            assert read_answer(raw).endswith(grid.payloads[7])
            time.sleep(0.02)
            raw.sendall(data[cut:])
            assert read_answer(raw).endswith(grid.payloads[7])


@pytest.fixture(scope="module")
def big(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene whose pack goes on with bytes that belong to no segment."""
    folder = tmp_path_factory.mktemp("big")
    grid = write_grid_scene(folder / "pit", cells=2)
    manifest = grid.path / "scene.json"
    pack = grid.manifest.files["segments.pack"]
    with (grid.path / pack.path).open("ab") as file:
        file.write(os.urandom(4 * BIG - pack.bytes))
    text = manifest.read_text()
    manifest.write_text(text.replace(f'"bytes": {pack.bytes}', f'"bytes": {4 * BIG}', 1))
    return folder


@pytest.fixture
def slow(big: Path) -> Iterator[tuple[BackgroundServer, str]]:
    limits = {"http_stall_timeout_s": 0.6, "http_keep_alive_s": 0.4}
    with BackgroundServer(big, **limits) as running:
        scene = running.service.registry.get("pit")
        if scene.scene.manifest.files["segments.pack"].bytes != 4 * BIG:
            pytest.skip("the manifest was written in another form")
        yield running, f"/scenes/pit/{scene.pack_path}"


def ask_slowly(server: BackgroundServer, path: str, room_bytes: int = 4096) -> socket.socket:
    raw = socket.socket()
    raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, room_bytes)
    raw.settimeout(10)
    raw.connect(("127.0.0.1", server.port))
    raw.sendall(
        b"GET %b HTTP/1.1\r\n" % path.encode() + HOST + b"Range: bytes=0-%d\r\n\r\n" % (BIG - 1)
    )
    return raw


def test_a_slow_reader_gets_everything(
    slow: tuple[BackgroundServer, str], found: list[bool]
) -> None:
    """Neither the time of silence nor that of a stall ends it: it takes something."""
    server, path = slow
    got = 0
    with ask_slowly(server, path, 1 << 18) as raw:
        began_s = time.monotonic()
        while time.monotonic() - began_s < 1.2 and got < BIG - (1 << 19):
            piece = raw.recv(1 << 16)
            assert piece
            got += len(piece)
            time.sleep(0.03)
        while got < BIG:
            piece = raw.recv(1 << 18)
            assert piece
            got += len(piece)
    assert found == [True]


def test_who_takes_nothing_is_dropped(
    slow: tuple[BackgroundServer, str], found: list[bool]
) -> None:
    server, path = slow
    with ask_slowly(server, path) as raw:
        eventually(lambda: found == [True])
        eventually(lambda: not server._server.server_state.connections, 8)
        with contextlib.suppress(ConnectionError):
            got = 0
            while piece := raw.recv(1 << 16):
                got += len(piece)
            assert got < BIG
    scene = server.service.registry.get("pit")
    eventually(lambda: scene._holders == 0)


def test_silence_after_an_answer_ends_the_connection(
    slow: tuple[BackgroundServer, str], found: list[bool]
) -> None:
    server, _ = slow
    with connect(server) as raw:
        for _ in range(4):
            ask(raw, "/scenes/pit/segments/1.glb")
            time.sleep(0.15)
        assert raw.recv(1) == b""
    assert found[-1]


def test_an_answer_under_way_is_finished_when_the_service_ends(
    slow: tuple[BackgroundServer, str], found: list[bool]
) -> None:
    server, path = slow
    with ask_slowly(server, path) as raw:
        eventually(lambda: found == [True])
        server._server.should_exit = True
        got = 0
        with contextlib.suppress(ConnectionError):
            while piece := raw.recv(1 << 18):
                got += len(piece)
        assert got > BIG


def test_a_pack_cut_short_ends_the_connection(big: Path, found: list[bool]) -> None:
    """The client was promised more, and hears it by the end of the connection."""
    with BackgroundServer(big) as running:
        served = running.service.registry.get("pit")
        pack = big / "pit" / served.pack_path
        with connect(running) as raw:
            ask(raw, "/scenes/pit/segments/1.glb")
            assert found
            os.truncate(pack, served.scene.manifest.files["segments.pack"].bytes - 1000)
            last = served.scene.manifest.files["segments.pack"].bytes - 1
            raw.sendall(
                b"GET /scenes/pit/%b HTTP/1.1\r\n" % served.pack_path.encode()
                + HOST
                + b"Range: bytes=%d-%d\r\n\r\n" % (last - 5000, last)
            )
            data = b""
            with contextlib.suppress(ConnectionError):
                while piece := raw.recv(1 << 16):
                    data += piece
            assert len(data) < 5000
