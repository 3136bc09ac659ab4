"""Tokens that end, renewed by a function: both cores against a service that looks at the clock."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from engines.programs import Client

from terraport_server import BackgroundServer
from terraport_server.auth.keys import TokenKey, write_keys
from terraport_server.auth.tokens import make_token

KEY = TokenKey("k1", "HS256", bytes(range(32)))
LAND = "land:30,1,30,22"
RENEWED = "pause:5500"
"""Longer than a token lasts, and the wait before the next connection with it."""


def token(valid_s: float) -> str:
    return make_token(
        KEY, name="anna", scenes=frozenset({"grid"}), expires_s=int(time.time() + valid_s)
    )


@pytest.fixture(scope="module")
def signed(scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of `grid` where signed tokens are asked for and looked at again ten a second."""
    keys = tmp_path_factory.mktemp("keys") / "keys"
    write_keys(keys, [KEY.line()])
    with BackgroundServer(
        scenes, token_keys_file=keys, token_leeway_s=0.0, access_check_s=0.1
    ) as server:
        yield server.scene_url("grid")


@contextmanager
def renewing(path: Path) -> Iterator[list[str]]:
    """A file with a token that lasts 2 to 3 s more, written anew twice a second."""
    issued: list[str] = []
    stopped = threading.Event()

    def write() -> None:
        issued.append(token(3))
        beside = path.with_suffix(".new")
        beside.write_text(issued[-1])
        beside.replace(path)

    def run() -> None:
        while not stopped.wait(0.5):
            write()

    write()
    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield issued
    finally:
        stopped.set()
        thread.join()


@pytest.mark.parametrize("threaded", [0, 1], ids=["pumped", "threaded"])
def test_a_session_outlives_its_tokens(
    client: Client, signed: str, threaded: int, tmp_path: Path
) -> None:
    path = tmp_path / "token"
    with renewing(path) as issued:
        landed = client.land(signed, LAND, RENEWED, LAND, threaded=threaded, token_file=path)
    assert (landed.exit_code, landed.failure) == (0, None), landed.output
    first, again = landed.landings
    assert first["payload_bytes"] > 0
    assert again["payload_bytes"] == 0, "what was held is not sent again"
    states = [link["state"] for link in landed.of("link")]
    assert states[:5] == ["connecting", "open", "waiting", "connecting", "open"]
    refused = next(link for link in landed.of("link") if link["state"] == "waiting")
    assert (refused["code"], refused["close_code"]) == ("unauthorised", 4401)
    assert not any(one in landed.output for one in issued)


def test_a_function_that_has_no_other_token_is_the_end(
    client: Client, signed: str, tmp_path: Path
) -> None:
    path = tmp_path / "token"
    path.write_text(token(2.5))
    landed = client.land(signed, LAND, RENEWED, LAND, token_file=path)
    assert landed.failure == f"{LAND}: closed: unauthorised"
    assert [link["state"] for link in landed.of("link")] == ["connecting", "open", "closed"]
    path.write_text("no-token-of-this-service")
    strange = client.land(signed, LAND, token_file=path)
    assert [link["state"] for link in strange.of("link")] == ["connecting", "closed"]
