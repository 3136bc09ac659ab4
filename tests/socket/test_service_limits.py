"""Settings of a running service that no other test meets, each seen from outside."""

from __future__ import annotations

import json
import time
from pathlib import Path

import httpx
import pytest
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient, make_hello

from terraport_server import BackgroundServer
from terraport_server.auth.keys import TokenKey, write_keys
from terraport_server.auth.tokens import make_token
from terraport_server.logging import configure_logging, log
from terraport_wire import Error, Pick, Picked, Ready

POSITION = (30.0, 50.0, 30.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("limits")
    write_grid_scene(folder / "pit")
    return folder


def test_a_pick_beyond_its_time_fails_and_the_session_goes_on(folder: Path) -> None:
    with (
        BackgroundServer(folder, pick_timeout_s=1e-9) as server,
        PlainClient(server.scene_url("pit")) as client,
    ):
        client.hello()
        client.send(Pick(request=7, origin=POSITION))
        error = client.expect(Error)
        assert (error.code, error.fatal, error.request) == ("internal", False, 7)
        client.land(1, POSITION, 60.0)
        client.until(Ready)


@pytest.mark.parametrize("cache_bytes", [0, 1, 64 << 20])
def test_picks_are_right_whatever_is_kept_for_them(folder: Path, cache_bytes: int) -> None:
    with (
        BackgroundServer(folder, pick_cache_bytes=cache_bytes, pick_threads=2) as server,
        PlainClient(server.scene_url("pit")) as client,
    ):
        client.hello()
        hits = []
        for request in range(4):
            client.send(Pick(request=request, origin=POSITION))
            hits.append(client.expect(Picked).hit)
        assert hits[0] is not None
        assert {hit.segment for hit in hits if hit is not None} == {hits[0].segment}


def test_the_audience_is_the_setting(folder: Path, tmp_path: Path) -> None:
    key = TokenKey("k1", "HS256", bytes(32))
    write_keys(tmp_path / "keys", [key.line()])
    expires_s = int(time.time()) + 60
    with BackgroundServer(
        folder, token_keys_file=tmp_path / "keys", token_audience="pit-service"
    ) as server:
        url = f"{server.url}/scenes/pit/base.tsg"

        def ask(audience: str | None) -> int:
            token = make_token(
                key, name="anna", scenes=None, expires_s=expires_s, audience=audience
            )
            headers = {"Authorization": f"Bearer {token}"}
            return httpx.get(url, headers=headers).status_code

        assert ask(None) == 401
        assert ask("other") == 401
        assert ask("pit-service") == 200


def test_addresses_behind_a_trusted_proxy_count_for_themselves(folder: Path) -> None:
    with BackgroundServer(folder, max_sessions_per_ip=1) as server:
        url = server.scene_url("pit")

        def came(address: str) -> PlainClient:
            return PlainClient(url, additional_headers={"X-Forwarded-For": address})

        with came("192.0.2.1") as first, came("192.0.2.2") as second, came("192.0.2.1") as again:
            first.hello()
            second.hello()
            again.send(make_hello())
            assert again.refused()[1] == 4429
    with BackgroundServer(folder, max_sessions_per_ip=1, forwarded_allow_ips="192.0.2.9") as server:
        url = server.scene_url("pit")
        with came("192.0.2.1") as first, came("192.0.2.2") as second:
            first.hello()
            second.send(make_hello())
            assert second.refused()[1] == 4429, "anybody may write such a header"


def test_logs_as_json_are_one_object_a_line(
    folder: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import logging

    loggers = [logging.getLogger(name) for name in ("terraport", "uvicorn")]
    before = [(logger, logger.handlers, logger.propagate, logger.level) for logger in loggers]
    try:
        configure_logging("info", "json")
        with (
            BackgroundServer(folder, log_format="json") as server,
            PlainClient(server.scene_url("pit")) as client,
        ):
            welcome = client.hello()
            client.land(3, POSITION, 60.0)
            client.until(Ready)
        log("odd", text='quotes " and\nlines')
    finally:
        for logger, handlers, propagate, level in before:
            logger.handlers, logger.propagate = handlers, propagate
            logger.setLevel(level)
    lines = [json.loads(line) for line in capfd.readouterr().err.splitlines()]
    ready = next(line for line in lines if line["event"] == "landing ready")
    assert ready["landing"] == f"{welcome.session}-3"
    closed = next(line for line in lines if line["event"] == "session closed")
    assert (closed["session"], closed["landings"]) == (welcome.session, 1)
    assert closed["bytes"] == ready["bytes"]
    assert lines[-1]["text"] == 'quotes " and\nlines'
