"""The SDK and the command line with tokens that end, and traces, against a real server."""

from __future__ import annotations

import asyncio
import json
import time
from pathlib import Path

import pytest
from server.grid_scene import write_grid_scene
from typer.testing import CliRunner

import terraport
from terraport.cli import app
from terraport.errors import ServerError, SessionClosedError
from terraport_server import BackgroundServer
from terraport_server.auth.keys import TokenKey, write_keys
from terraport_server.auth.tokens import make_token

KEY = TokenKey("k1", "HS256", bytes(range(32)))
POSITION = (30.0, 0.0, 30.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tokens")
    write_grid_scene(folder / "pit")
    write_keys(folder.parent / f"{folder.name}.keys", [KEY.line()])
    return folder


def serving(folder: Path) -> BackgroundServer:
    return BackgroundServer(
        folder,
        token_keys_file=folder.parent / f"{folder.name}.keys",
        token_leeway_s=0.0,
        access_check_s=0.1,
    )


def token(valid_s: float) -> str:
    return make_token(
        KEY, name="anna", scenes=frozenset({"pit"}), expires_s=int(time.time() + valid_s)
    )


def test_a_session_outlives_its_tokens(folder: Path) -> None:
    issued: list[str] = []

    def present() -> str:
        # Each lasts 2 to 3 s; a new one from the moment when the old one has ended.
        if not issued or expiry(issued[-1]) <= time.time():
            issued.append(token(3))
        return issued[-1]

    def expiry(shown: str) -> float:
        import jwt

        return float(jwt.decode(shown, options={"verify_signature": False})["exp"])

    async def play(url: str) -> None:
        async with terraport.connect(url, present) as session:
            first = await session.land(POSITION, 30)
            await first.ready()
            assert first.stats.streamed_bytes > 0
            async with asyncio.timeout(20):
                while session.stats.connections < 2:  # noqa: ASYNC110 - there is no event for it
                    await asyncio.sleep(0.05)
            again = await session.land(POSITION, 30)
            await again.ready()
            assert again.stats.streamed_bytes == 0, "what was held is not sent again"
            assert await session.base() is not None

    with serving(folder) as server:
        asyncio.run(play(server.scene_url("pit")))
    assert len(issued) >= 2


def test_a_fixed_token_that_ends_ends_the_session(folder: Path) -> None:
    async def play(url: str) -> None:
        async with terraport.connect(url, token(2)) as session:
            landing = await session.land(POSITION, 30)
            await landing.ready()
            async with asyncio.timeout(20):
                while True:
                    await asyncio.sleep(0.05)
                    await session.pick(POSITION)

    with serving(folder) as server, pytest.raises((ServerError, SessionClosedError)) as caught:
        asyncio.run(play(server.scene_url("pit")))
    assert "expired" in str(caught.value)


def test_the_command_line_lands_with_a_signed_token_and_writes_a_trace(
    folder: Path, tmp_path: Path
) -> None:
    trace = tmp_path / "trace.json"
    with serving(folder) as server:
        arguments = ["land", server.scene_url("pit"), "30", "0", "30", "--radius", "30"]
        result = CliRunner().invoke(
            app,
            [*arguments, "--repeat", "2", "--trace", str(trace), "--json"],
            env={"TERRAPORT_TOKEN": token(60)},
        )
        assert result.exit_code == 0, result.output
        refused = CliRunner().invoke(app, arguments, env={"TERRAPORT_TOKEN": token(-60)})
        assert refused.exit_code == 1
        assert "unauthorised" in refused.output
    events = json.loads(trace.read_text())["traceEvents"]
    first = {event["name"]: event for event in events if event["pid"] == 1}
    for name in ("landing", "send", "wait for plan", "stream"):
        assert first[name]["ph"] == "X", name
    whole = first["landing"]
    facts = json.loads(result.stdout)
    assert whole["args"]["streamed_bytes"] == facts["landings"][0]["streamed_bytes"] > 0
    second = {event["name"]: event for event in events if event["pid"] == 2}
    assert second["landing"]["args"]["streamed_bytes"] == 0
    assert "stream" not in second
