"""Payload over HTTP, asked of a running service: ranges, caches, clients that do not read."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from eventually import eventually
from server.grid_scene import GridScene, write_grid_scene

from terraport_server import BackgroundServer
from terraport_server.file_sender import FileSender

BIG = 12 << 20
"""More than the buffers of both sockets take."""


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> GridScene:
    return write_grid_scene(tmp_path_factory.mktemp("payload") / "pit", cells=4)


@pytest.fixture(scope="module", params=["sendfile", "memory"])
def server(grid: GridScene, request: pytest.FixtureRequest) -> Iterator[BackgroundServer]:
    """Once with `sendfile`, once as under TLS or on a system without it."""
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "memory":
            patch.setattr(FileSender, "can_serve", lambda _transport: False)
        with BackgroundServer(grid.path.parent, http_stall_timeout_s=0.6) as running:
            yield running


def test_a_segment_whole_and_in_parts(server: BackgroundServer, grid: GridScene) -> None:
    payload = grid.payloads[7]
    with httpx.Client(base_url=server.url) as http:
        path = f"/scenes/pit/segments/7.glb?v={grid.manifest.version}"
        whole = http.get(path)
        etag = whole.headers["etag"]
        assert whole.content == payload
        assert whole.headers["content-length"] == str(len(payload))
        assert whole.headers["accept-ranges"] == "bytes"
        assert whole.headers["cache-control"] == "public, max-age=31536000, immutable"
        assert not etag.startswith("W/")

        part = http.get(path, headers={"Range": "bytes=10-29", "If-Range": etag})
        assert (part.status_code, part.content) == (206, payload[10:30])
        assert part.headers["content-range"] == f"bytes 10-29/{len(payload)}"
        other = http.get(path, headers={"Range": "bytes=10-29", "If-Range": '"other"'})
        assert (other.status_code, other.content) == (200, payload)
        beyond = http.get(path, headers={"Range": f"bytes={len(payload)}-"})
        assert (beyond.status_code, beyond.content) == (416, b"")
        assert beyond.headers["content-range"] == f"bytes */{len(payload)}"
        same = http.get(path, headers={"If-None-Match": f'"x", {etag}'})
        assert (same.status_code, same.content) == (304, b"")
        head = http.head(path)
        assert (head.status_code, head.content) == (200, b"")
        assert head.headers["content-length"] == str(len(payload))
        assert head.headers["etag"] == etag
        # All of it on one connection: nothing was left over of any answer.
        assert http.get("/healthz").text == "ok\n"


def test_a_pack_and_ranges_of_it(server: BackgroundServer, grid: GridScene) -> None:
    pack = grid.manifest.files["segments.pack"]
    data = (grid.path / pack.path).read_bytes()
    url = f"{server.url}/scenes/pit/{pack.path}"
    whole = httpx.get(url)
    assert whole.content == data
    assert whole.headers["etag"] == f'"{pack.xxh3}"'
    assert whole.headers["cache-control"] == "public, max-age=31536000, immutable"
    assert whole.headers["content-type"] == "application/octet-stream"
    part = httpx.get(url, headers={"Range": "bytes=64-1063"})
    assert (part.status_code, part.content) == (206, data[64:1064])
    assert part.headers["content-range"] == f"bytes 64-1063/{len(data)}"
    assert httpx.head(url).headers["content-length"] == str(len(data))


@pytest.mark.parametrize(
    "path",
    [
        "scene.json",
        "v-000000000000/segments.pack",
        "{folder}/segments.idx",
        "{folder}/..%2fscene.json",
    ],
)
def test_nothing_else_of_the_folder_is_served(
    server: BackgroundServer, grid: GridScene, path: str
) -> None:
    folder = grid.manifest.files["segments.pack"].path.partition("/")[0]
    answer = httpx.get(f"{server.url}/scenes/pit/{path.format(folder=folder)}")
    assert answer.status_code == 404


def test_a_pack_asks_for_the_token(grid: GridScene) -> None:
    path = f"scenes/pit/{grid.manifest.files['segments.pack'].path}"
    token = "sixteen-characters"
    with BackgroundServer(grid.path.parent, token=token) as running:
        assert httpx.get(f"{running.url}/{path}").status_code == 401
        right = httpx.get(f"{running.url}/{path}", headers={"Authorization": f"Bearer {token}"})
        assert right.status_code == 200
        assert right.headers["cache-control"].startswith("private")


def test_the_newest_version_is_asked_about_again(server: BackgroundServer) -> None:
    answer = httpx.get(f"{server.url}/scenes/pit/segments/7.glb")
    assert answer.headers["cache-control"] == "no-cache"
    assert httpx.get(f"{server.url}/scenes/pit/segments/7.glb?v=other").status_code == 404


def test_the_hash_is_compared_once(
    server: BackgroundServer, grid: GridScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = f"{server.url}/scenes/pit/segments/9.glb"
    httpx.get(url)
    compared: list[int] = []
    import xxhash

    right = xxhash.xxh3_64_intdigest
    monkeypatch.setattr(
        xxhash, "xxh3_64_intdigest", lambda data: compared.append(len(data)) or right(data)
    )
    for _ in range(3):
        assert httpx.get(url).content == grid.payloads[9]
    assert not compared


def test_requests_sent_ahead_are_answered_in_order(
    server: BackgroundServer, grid: GridScene
) -> None:
    asked = range(8)
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as raw:
        for n in asked:
            last = b"Connection: close\r\n" if n == asked[-1] else b""
            raw.sendall(
                b"GET /scenes/pit/segments/%d.glb HTTP/1.1\r\nHost: localhost\r\n%b\r\n" % (n, last)
            )
        data = b""
        while piece := raw.recv(1 << 16):
            data += piece
    for n in asked:
        head, _, data = data.partition(b"\r\n\r\n")
        assert head.startswith(b"HTTP/1.1 200 OK\r\n")
        body, data = data[: len(grid.payloads[n])], data[len(grid.payloads[n]) :]
        assert body == grid.payloads[n]
    assert data == b""
    assert b"connection: close" in head


class Cycle:
    """What `FileSender` uses of a request."""

    def __init__(self) -> None:
        self.disconnected = self.response_started = self.response_complete = False
        self.waiting_for_100_continue = False
        self.keep_alive = True
        self.default_headers: list[tuple[bytes, bytes]] = []
        self.message_event = asyncio.Event()
        self.answered = 0

    def on_response(self) -> None:
        self.answered += 1


class Sends(asyncio.Protocol):
    """Sends one file to whoever connects."""

    def __init__(self, descriptor: int, promised: int) -> None:
        self.cycle = Cycle()
        self.most_waiting = 0
        self._descriptor, self._promised = descriptor, promised

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport, self.sender = transport, FileSender(transport)
        self.task = asyncio.create_task(self._send())

    def pause_writing(self) -> None:
        waiting = self.transport.get_write_buffer_size()
        self.most_waiting = max(self.most_waiting, waiting)

    def resume_writing(self) -> None:
        self.sender.on_room()

    def connection_lost(self, _error: Exception | None) -> None:
        self.sender.close()

    async def _send(self) -> None:
        start = {"status": 200, "headers": [(b"content-length", b"%d" % self._promised)]}
        message = {"file": self._descriptor, "offset": 0, "count": self._promised}
        cycle: Any = self.cycle
        with contextlib.suppress(OSError):
            await self.sender.answer(cycle, start, message, more_body=False)
        self.transport.close()


async def send_slowly(path: Path, *, promised: int) -> tuple[bytes, Sends]:
    """Send a file to a client that begins to read late; return what it got."""
    received: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
    descriptor = os.open(path, os.O_RDONLY)
    sends = Sends(descriptor, promised)
    server = await asyncio.get_running_loop().create_server(lambda: sends, "127.0.0.1", 0)
    async with server:
        reader, writer = await asyncio.open_connection(*server.sockets[0].getsockname()[:2])
        await asyncio.sleep(0.05)
        try:
            received.set_result(await reader.read(-1))
        except ConnectionResetError:
            received.set_result(b"")
        writer.close()
    os.close(descriptor)
    return received.result(), sends


def test_a_client_that_begins_to_read_late(tmp_path: Path) -> None:
    data = os.urandom(BIG)
    (tmp_path / "pack").write_bytes(data)
    received, sends = asyncio.run(send_slowly(tmp_path / "pack", promised=BIG))
    assert received == b"HTTP/1.1 200 OK\r\ncontent-length: %d\r\n\r\n" % BIG + data
    assert 0 < sends.most_waiting <= 17 << 10, "a small piece waits in memory, not the body"
    assert sends.cycle.response_complete
    assert sends.cycle.answered == 1


def test_a_file_that_is_shorter_than_it_was(tmp_path: Path) -> None:
    (tmp_path / "pack").write_bytes(b"x" * 1000)
    received, sends = asyncio.run(send_slowly(tmp_path / "pack", promised=2000))
    assert len(received) < 2000
    assert not sends.cycle.response_complete


def test_a_client_that_leaves_within_a_body(server: BackgroundServer, grid: GridScene) -> None:
    """Its connection ends, and its scene is let go: the next one is answered."""
    for _ in range(4):
        with socket.create_connection(("127.0.0.1", server.port), timeout=10) as raw:
            raw.sendall(b"GET /scenes/pit/segments/3.glb HTTP/1.1\r\nHost: localhost\r\n\r\n")
    eventually(lambda: not server._server.server_state.tasks)
    answer = httpx.get(f"{server.url}/scenes/pit/segments/3.glb")
    assert answer.content == grid.payloads[3]
