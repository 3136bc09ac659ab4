"""The SDK with payload that it fetches itself: from the service, from others, from liars."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import httpx
import pytest
from server.grid_scene import SIDE, GridScene, write_grid_scene

import terraport
from terraport.errors import LandingSupersededError
from terraport_server import BackgroundServer

MIDDLE = (30.0, 1.0, 30.0)
ALL_M = 100.0
CORNER = (5.0, 1.0, 5.0)


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> GridScene:
    return write_grid_scene(tmp_path_factory.mktemp("pull") / "pit", cells=4)


@pytest.fixture(scope="module")
def server(grid: GridScene) -> Iterator[BackgroundServer]:
    with BackgroundServer(grid.path.parent) as running:
        yield running


MOST_EXTRA_BYTES = 64 << 20


class PackServer:
    """Serves a pack by ranges, and does wrong as told: what stands in for a CDN."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.asked: list[tuple[str, str]] = []
        """Path and range of every request."""
        self.tokens: set[str | None] = set()
        self.spoil: Callable[[bytes, int], bytes] | None = None
        """Changes the bytes of an answer, given how many came before."""
        self.missing = False
        self.endless = False
        """Goes on behind what was asked for, up to `MOST_EXTRA_BYTES`."""
        self.extra_bytes = 0
        self.poured = 0
        """Such answers that are over."""
        self.gate = threading.Event()
        self.gate.set()

    @contextmanager
    def serving(self) -> Iterator[str]:
        packs = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self) -> None:
                packs.answer(self)

            def log_message(self, *_: object) -> None:
                """Say nothing."""

        http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        http.daemon_threads = True
        thread = threading.Thread(target=http.serve_forever, args=(0.02,))
        thread.start()
        try:
            yield f"http://127.0.0.1:{http.server_address[1]}"
        finally:
            self.gate.set()
            http.shutdown()
            thread.join()
            http.server_close()

    def answer(self, request: BaseHTTPRequestHandler) -> None:
        span = request.headers["Range"]
        self.asked.append((request.path, span))
        self.tokens.add(request.headers["Authorization"])
        if self.missing:
            request.send_error(404)
            return
        data = (self.folder / request.path.lstrip("/")).read_bytes()
        first, last = map(int, span.removeprefix("bytes=").split("-"))
        body = data[first : last + 1]
        request.send_response(206)
        request.send_header("Content-Range", f"bytes {first}-{last}/{len(data)}")
        if self.endless:
            request.send_header("Transfer-Encoding", "chunked")
        else:
            request.send_header("Content-Length", str(len(body)))
        request.end_headers()
        self.gate.wait(10)
        if self.spoil is not None:
            changed = self.spoil(body, len(self.asked) - 1)
            if len(changed) < len(body):
                request.close_connection = True
            body = changed
        if self.endless:
            self._pour(request, body)
        else:
            request.wfile.write(body)

    def _pour(self, request: BaseHTTPRequestHandler, body: bytes) -> None:
        more = bytes(1 << 16)
        with suppress(OSError):  # the client has enough
            request.wfile.write(b"%x\r\n%b\r\n" % (len(body), body))
            while self.extra_bytes < MOST_EXTRA_BYTES:
                request.wfile.write(b"%x\r\n%b\r\n" % (len(more), more))
                self.extra_bytes += len(more)
        self.poured += 1
        request.close_connection = True


@pytest.fixture
def packs(grid: GridScene) -> PackServer:
    return PackServer(grid.path.parent)


@pytest.fixture
def aside(grid: GridScene, packs: PackServer) -> Iterator[BackgroundServer]:
    """The service with its packs served by another; a token is asked for."""
    with (
        packs.serving() as url,
        BackgroundServer(
            grid.path.parent, pull_base_url=url, token="sixteen-characters"
        ) as running,
    ):
        yield running


def connect(server: BackgroundServer) -> terraport.Connecting:
    return terraport.connect(server.scene_url("pit"), "sixteen-characters", delivery="pull")


async def land_all(session: terraport.Session) -> dict[int, bytes]:
    landing = await session.land(MIDDLE, ALL_M)
    await landing.ready(timeout_s=30)
    return {segment.id: segment.payload async for segment in landing}


async def until(reached: Callable[[], object]) -> None:
    async with asyncio.timeout(20):
        while not reached():  # noqa: ASYNC110 - another thread says so, or nobody
            await asyncio.sleep(0.01)


def sent_bytes(server: BackgroundServer) -> float:
    """Payload bytes that the service sent in frames."""
    text = httpx.get(f"{server.url}/metrics", headers={"Authorization": "Bearer m" * 9}).text
    rows = [line for line in text.splitlines() if line.startswith("terraport_payload_bytes_total")]
    return sum(float(row.split()[-1]) for row in rows)


def test_the_service_itself_serves_the_pack(server: BackgroundServer, grid: GridScene) -> None:
    async def run() -> None:
        async with connect(server) as session:
            assert await land_all(session) == dict(enumerate(grid.payloads))
            stats = session.stats
            # A handful of ranges for 36 segments, and next to nothing on the WebSocket.
            assert stats.pull_requests <= 3
            assert stats.pulled_bytes < 1.1 * sum(map(len, grid.payloads)) + 64 * SIDE**2
            assert stats.received_bytes < 8192
            # The server knows what is held: nothing comes twice.
            again = await session.land(CORNER, 12.0)
            await again.ready(timeout_s=30)
            assert len(again.plan.load) == 0
            assert session.stats.pull_requests == stats.pull_requests

    asyncio.run(run())
    assert sent_bytes(server) == 0


def test_another_serves_it_and_never_sees_the_token(
    aside: BackgroundServer, packs: PackServer, grid: GridScene
) -> None:
    async def run() -> None:
        async with connect(aside) as session:
            assert await land_all(session) == dict(enumerate(grid.payloads))
            assert session.unreached_pack is None

    asyncio.run(run())
    pack = grid.manifest.files["segments.pack"].path
    assert {path for path, _ in packs.asked} == {f"/pit/{pack}"}
    assert packs.tokens == {None}


def test_a_prefetch_is_fetched_too(aside: BackgroundServer, packs: PackServer) -> None:
    async def run() -> None:
        async with connect(aside) as session:
            session.aim(CORNER, 12.0)
            await until(lambda: session.stats.prefetched_bytes)
            asked = len(packs.asked)
            landing = await session.land(CORNER, 12.0)
            await landing.ready(timeout_s=30)
            # The server was told of it before it planned.
            assert len(landing.plan.load) == 0
            assert len(packs.asked) == asked

    asyncio.run(run())


def test_a_newer_landing_ends_what_it_does_not_need(
    aside: BackgroundServer, packs: PackServer, grid: GridScene
) -> None:
    async def run() -> None:
        async with connect(aside) as session:
            packs.gate.clear()
            old = await session.land((55.0, 1.0, 55.0), 4.0)
            await until(lambda: packs.asked)
            new = await session.land(CORNER, 4.0)
            with pytest.raises(LandingSupersededError):
                await old.ready(timeout_s=30)
            packs.gate.set()
            await new.ready(timeout_s=30)
            shown = {segment.id: segment.payload async for segment in new}
            assert shown == {0: grid.payloads[0]}
            assert session.stats.payload_bytes == len(grid.payloads[0])

    asyncio.run(run())


def test_wrong_bytes_come_again_in_frames(
    aside: BackgroundServer, packs: PackServer, grid: GridScene
) -> None:
    """A cache that serves other bytes: the hash tells, and the service sends that segment."""
    packs.spoil = lambda body, before: body if before else b"\x00" * 99 + body[99:]

    async def run() -> None:
        async with connect(aside) as session:
            assert await land_all(session) == dict(enumerate(grid.payloads))
            assert session.stats.rejected == 1
            assert session.unreached_pack is None
            again = await session.land(CORNER, 12.0)
            assert len(again.plan.load) == 0

    asyncio.run(run())


def test_an_answer_that_ends_too_soon_is_asked_for_again(
    aside: BackgroundServer, packs: PackServer, grid: GridScene
) -> None:
    packs.spoil = lambda body, before: body if before else body[: len(body) // 2]

    async def run() -> None:
        async with connect(aside) as session:
            assert await land_all(session) == dict(enumerate(grid.payloads))
            assert session.unreached_pack is None
            assert session.stats.connections == 1

    asyncio.run(run())
    # What came of the first answer was kept.
    (_, first), (_, second) = packs.asked
    assert int(second.split("=")[1].split("-")[0]) > int(first.split("=")[1].split("-")[0])


def test_an_answer_without_end_is_left(
    aside: BackgroundServer, packs: PackServer, grid: GridScene
) -> None:
    packs.endless = True

    async def run() -> None:
        async with connect(aside) as session:
            assert await land_all(session) == dict(enumerate(grid.payloads))
            assert session.unreached_pack is None
            await until(lambda: packs.poured == len(packs.asked))

    asyncio.run(run())
    assert packs.extra_bytes < MOST_EXTRA_BYTES, "what nobody asked for was read to its end"


@pytest.mark.parametrize("way", ["missing", "truncated"])
def test_a_pack_out_of_reach_comes_in_frames(
    aside: BackgroundServer, packs: PackServer, grid: GridScene, way: str
) -> None:
    packs.missing = way == "missing"
    packs.spoil = lambda body, _before: body[:10]

    async def run() -> None:
        async with connect(aside) as session:
            assert await land_all(session) == dict(enumerate(grid.payloads))
            assert session.unreached_pack is not None
            assert session.stats.connections == 2

    asyncio.run(run())
