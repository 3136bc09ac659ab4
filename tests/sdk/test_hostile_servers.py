"""The SDK against servers that misbehave: a clear error, no hang, no wrong data."""

from __future__ import annotations

import asyncio
import http.server
import json
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Any

import pytest
from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed

import terraport
from terraport import Timeouts, backoff
from terraport.address import Access, SceneUrl
from terraport.errors import (
    ConnectionFailedError,
    HttpError,
    LandingTimeoutError,
    ProtocolViolationError,
    ServerError,
    SessionClosedError,
    TerraportError,
)
from terraport.http import SceneHttp
from terraport_wire import SUBPROTOCOL, CloseCode, Limits, SceneFacts, Welcome, encode, frame_header

WELCOME = encode(
    Welcome(
        server="hostile",
        session="s",
        scene=SceneFacts(id="x", version="v", name="x", segment_count=10, base_faces=8, levels=1),
        limits=Limits(
            max_radius_m=500,
            max_message_bytes=1 << 20,
            max_messages_per_s=60,
            max_credit_bytes=1 << 20,
            idle_timeout_s=60,
            groups="none",
        ),
    ),
)
FRAME = frame_header(generation=1, key=3, offset=4, total=8) + b"mesh"

Behaviour = Callable[[ServerConnection], Awaitable[None]]


@pytest.fixture(autouse=True)
def _short_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backoff, "FIRST_WAIT_S", 0.01)


def run(work: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(work, 30))


@asynccontextmanager
async def hostile(behave: Behaviour) -> AsyncIterator[tuple[str, list[int]]]:
    """A WebSocket server that behaves so; gives its scene URL and the close codes it received."""
    closes: list[int] = []

    async def handle(connection: ServerConnection) -> None:
        try:
            await behave(connection)
            await connection.wait_closed()
        except ConnectionClosed:
            pass
        closes.append(connection.close_code or 0)

    async with serve(
        handle, "127.0.0.1", 0, subprotocols=[SUBPROTOCOL], max_size=1 << 20
    ) as server:
        yield f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}/scenes/x", closes


def says(*messages: bytes | str, welcome: bool = True) -> Behaviour:
    async def behave(connection: ServerConnection) -> None:
        await connection.recv()
        if welcome:
            await connection.send(WELCOME)
        for message in messages:
            await connection.send(message)

    return behave


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (b"\xc1", "msgpack|value"),
        (b"", "end of the message"),
        ("{}", "text message"),
        (FRAME, "got byte 4 of"),
        (FRAME[:10], "header"),
        (WELCOME, "second welcome"),
    ],
)
def test_junk_is_a_violation_and_closed_with_4400(message: bytes | str, text: str) -> None:
    async def work() -> None:
        async with hostile(says(message)) as (url, closes):
            async with terraport.connect(url) as session:
                with pytest.raises((ProtocolViolationError, SessionClosedError), match=text):
                    await (await session.land((0, 0, 0))).ready()
            await asyncio.sleep(0.05)
            assert closes == [CloseCode.MALFORMED]

    run(work())


def test_other_frames_and_messages_are_skipped() -> None:
    """A later version may send them."""

    async def work() -> None:
        unknown = b"\x81\xa4type\xa5dance"
        async with (
            hostile(says(unknown, b"\x7f-later-frame")) as (url, _),
            terraport.connect(url) as session,
        ):
            await asyncio.sleep(0.05)
            with pytest.raises(LandingTimeoutError, match=r"no plan within 0.05 s"):
                await session.land((0, 0, 0), timeout_s=0.05)

    run(work())


@pytest.mark.parametrize("welcome", [True, False])
def test_silence_ends_in_time(welcome: bool) -> None:
    """No welcome: the attempt fails. A welcome, then nothing: the wait for the plan ends."""

    async def work() -> None:
        timeouts = Timeouts(connect_s=0.2, plan_s=0.2, pick_s=0.2)
        async with hostile(says(welcome=welcome)) as (url, _):
            connecting = terraport.connect(url, timeouts=timeouts)
            if welcome:
                async with connecting as session:
                    with pytest.raises(LandingTimeoutError):
                        await session.land((0, 0, 0))
                    with pytest.raises(TimeoutError):
                        await session.pick((0, 0, 0))
            else:
                with pytest.raises(TerraportError):
                    await connecting.__aenter__()

    run(work())


@pytest.mark.parametrize("code", [4401, 4403, 4404, 4409, 4413])
def test_a_final_close_code_without_a_message_is_an_error_too(code: int) -> None:
    async def behave(connection: ServerConnection) -> None:
        await connection.close(code, "because")

    async def work() -> None:
        async with hostile(behave) as (url, _):
            with pytest.raises(ServerError, match="because") as caught:
                async with terraport.connect(url):
                    pass
            assert caught.value.code == CloseCode(code).name.lower()

    run(work())


def test_a_server_that_always_closes_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """It says welcome and closes, again and again: ``reconnect_s`` bounds it."""
    monkeypatch.setattr(backoff, "LONGEST_WAIT_S", 0.05)

    async def behave(connection: ServerConnection) -> None:
        await connection.recv()
        await connection.send(WELCOME)
        await connection.close(CloseCode.INTERNAL, "internal")

    async def work() -> None:
        async with hostile(behave) as (url, closes):
            async with terraport.connect(url, timeouts=Timeouts(reconnect_s=0.3)) as session:
                with pytest.raises((ConnectionFailedError, SessionClosedError)):
                    await (await session.land((0, 0, 0))).ready()
            assert len(closes) > 3

    run(work())


def test_a_web_page_is_no_scene() -> None:
    async def work() -> None:
        with pages({}) as server:
            with pytest.raises(ServerError, match="404"):
                async with terraport.connect(f"{server}/scenes/x"):
                    pass
            with pytest.raises(HttpError, match="answered 404"):
                async with terraport.connect(server):
                    pass

    run(work())


@pytest.mark.parametrize(
    ("answers", "error", "text"),
    [
        (
            {"/scenes/x": {"files": {}}, "/scenes/x/base.tsg": b"no mesh"},
            ProtocolViolationError,
            "base mesh: ",
        ),
        ({"/scenes/x": {"files": {}}}, HttpError, "answered 404"),
        ({"/scenes/x": b"[]"}, HttpError, "expected an object"),
        ({"/scenes/x": b"{"}, HttpError, "no JSON"),
    ],
)
def test_a_base_mesh_that_cannot_be_had_is_an_error(answers, error, text: str) -> None:
    async def work() -> None:
        with pages(answers) as server:
            http_side = SceneHttp(SceneUrl.parse(f"{server}/scenes/x"), Access(None), 5.0)
            try:
                with pytest.raises(error, match=text):
                    await http_side.base("v", None, frozenset)
            finally:
                await http_side.aclose()

    run(work())


def test_an_endless_answer_is_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("terraport.http._MAX_MANIFEST_BYTES", 1000)

    async def work() -> None:
        with (
            pages({"/scenes": b" " * 5000}) as server,
            pytest.raises(HttpError, match="more than 1000 bytes"),
        ):
            await terraport.connect(server).__aenter__()

    run(work())


@contextmanager
def pages(answers: dict[str, Any]) -> Iterator[str]:
    """An HTTP server with fixed answers."""

    class Handler(http.server.BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            answer = answers.get(self.path.partition("?")[0])
            body = answer if isinstance(answer, bytes) else json.dumps(answer).encode()
            self.send_response(404 if answer is None else 200)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_arguments: object) -> None:
            """No line per request in the output of the tests."""

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()
