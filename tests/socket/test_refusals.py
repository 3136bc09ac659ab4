"""Everything a client may do wrong, on real sockets: the documented error and close code."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import pytest
from eventually import eventually
from server.plain_client import PlainClient, make_hello
from websockets.exceptions import ConnectionClosed, InvalidStatus

from terraport_server import BackgroundServer
from terraport_wire import (
    SUBPROTOCOL,
    Credit,
    Error,
    Pick,
    Ready,
    encode,
    frame_header,
    token_subprotocol,
)

HERE = (30.0, 1.0, 30.0)

# What is sent raw after the welcome -> code, close code.
FATAL: dict[str, tuple[Callable[[], Any], str, int]] = {
    "no msgpack": (lambda: b"\xc1\xff", "malformed", 4400),
    "cut off": (lambda: packed({"type": "bye"})[:-1], "malformed", 4400),
    "bytes after it": (lambda: packed({"type": "bye"}) + b"\x00", "malformed", 4400),
    "no map": (lambda: packed([1, 2]), "malformed", 4400),
    "a key twice": (
        lambda: b"\x82\xa4type\xa3bye\xa4type\xa3bye",
        "malformed",
        4400,
    ),
    "far too deep": (lambda: b"\x91" * 5000 + b"\xc0", "malformed", 4400),
    "no type": (lambda: packed({"kind": "land"}), "malformed", 4400),
    "empty": (lambda: b"", "malformed", 4400),
    "text": (lambda: '{"type":"bye"}', "malformed", 4400),
    "a payload frame": (
        lambda: frame_header(generation=1, key=1, offset=0, total=4) + b"abcd",
        "malformed",
        4400,
    ),
    "promises 2^31 items": (lambda: b"\xdd\x80\x00\x00\x00", "malformed", 4400),
    "too large": (lambda: packed({"type": "dance", "x": b"a" * (1 << 20)}), "too_large", 4413),
    "second hello": (lambda: message(make_hello()), "out_of_order", 4400),
    "credit below 1": (lambda: packed({"type": "credit", "bytes": 0}), "invalid_field", 4400),
}

# Fields of a land that are refused while the session goes on -> code.
REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "radius below 0": ({"radius_m": -1.0}, "invalid_field"),
    "radius 0": ({"radius_m": 0.0}, "invalid_field"),
    "radius NaN": ({"radius_m": float("nan")}, "invalid_field"),
    "radius infinite": ({"radius_m": float("inf")}, "invalid_field"),
    "radius too large": ({"radius_m": 500.1}, "radius_too_large"),
    "radius beyond any": ({"radius_m": 1e12}, "invalid_field"),
    "radius text": ({"radius_m": "60"}, "invalid_field"),
    "radius missing": ({"radius_m": None}, "invalid_field"),
    "position NaN": ({"position": [0.0, float("nan"), 0.0]}, "invalid_field"),
    "position of two": ({"position": [0.0, 0.0]}, "invalid_field"),
    "inner beyond radius": ({"inner_radius_m": 20.0}, "invalid_field"),
    "keys cut": ({"have": b"abc"}, "invalid_field"),
    "too many keys": ({"have": bytes(8 * 4097)}, "invalid_field"),
}


def packed(plain: Any) -> bytes:
    data: bytes = msgpack.packb(plain, use_bin_type=True)
    return data


def message(value: Any) -> bytes:
    return encode(value)


def land_map(generation: int, **changed: Any) -> dict[str, Any]:
    plain = {"type": "land", "generation": generation, "position": list(HERE), "radius_m": 5.0,
             "have": b"", "taken_bytes": 0}  # fmt: skip
    return {key: value for key, value in (plain | changed).items() if value is not None}


@pytest.mark.parametrize("name", FATAL)
def test_fatal(server: BackgroundServer, name: str) -> None:
    make, code, close = FATAL[name]
    with PlainClient(server.scene_url("grid")) as client:
        client.hello()
        client.socket.send(make())
        error, closed = client.refused()
    assert (error.code, closed) == (code, close)
    assert "got" in error.message
    assert "Traceback" not in error.message


@pytest.mark.parametrize("name", REFUSED)
def test_a_bad_landing_is_refused_and_the_session_goes_on(
    server: BackgroundServer, name: str
) -> None:
    changed, code = REFUSED[name]
    with PlainClient(server.scene_url("grid")) as client:
        client.hello()
        client.socket.send(packed(land_map(1, **changed)))
        error = client.expect(Error)
        assert (error.code, error.fatal, error.generation) == (code, False, 1)
        client.socket.send(packed(land_map(2)))
        assert client.until(Ready)[0].generation == 2


def test_a_bad_pick_is_refused_and_the_session_goes_on(server: BackgroundServer) -> None:
    with PlainClient(server.scene_url("grid")) as client:
        client.hello()
        bad = {"type": "pick", "request": 5, "origin": [0, 0, 0], "direction": [0, 0, 0]}
        client.socket.send(packed(bad))
        error = client.expect(Error)
        assert (error.code, error.fatal, error.request) == ("invalid_field", False, 5)


@pytest.mark.parametrize("second", [1, 0])
def test_generations_out_of_order(server: BackgroundServer, second: int) -> None:
    with PlainClient(server.scene_url("grid")) as client:
        client.hello()
        client.socket.send(packed(land_map(1)))
        client.until(Ready)
        client.socket.send(packed(land_map(second)))
        error, closed = client.refused()
    assert (error.code, closed, error.generation) == ("out_of_order", 4400, second)


def test_something_before_hello(server: BackgroundServer) -> None:
    with PlainClient(server.scene_url("grid")) as client:
        client.send(Credit(bytes=5))
        error, closed = client.refused()
    assert (error.code, closed) == ("out_of_order", 4400)


@pytest.mark.parametrize(
    ("changed", "code", "close"),
    [
        ({"credit_bytes": -1}, "invalid_field", 4400),
        ({"budgets": {"max_bytes": -1}}, "invalid_field", 4400),
        ({"client": None}, "invalid_field", 4400),
    ],
)
def test_a_bad_hello(
    server: BackgroundServer, changed: dict[str, Any], code: str, close: int
) -> None:
    plain = msgpack.unpackb(encode(make_hello())) | changed
    with PlainClient(server.scene_url("grid")) as client:
        client.socket.send(packed(plain))
        error, closed = client.refused()
    assert (error.code, closed) == (code, close)


def test_no_common_subprotocol(server: BackgroundServer) -> None:
    for offered in (None, ["terraport.v9.msgpack"], ["terraport.v1.json"]):
        with PlainClient(server.scene_url("grid"), offered=offered) as client:
            assert client.socket.subprotocol is None
            assert client.closed() == 4409
            assert client.socket.close_reason == "offered: terraport.v2.msgpack"


def test_an_unknown_scene(server: BackgroundServer) -> None:
    with PlainClient(server.url + "/scenes/atlantis") as client:
        error, closed = client.refused()
    assert (error.code, closed) == ("unknown_scene", 4404)
    assert "'atlantis'" in error.message


def test_a_path_that_is_no_stream(server: BackgroundServer) -> None:
    with pytest.raises(InvalidStatus) as caught:
        PlainClient(server.url + "/nowhere")
    assert caught.value.response.status_code == 403


# Access.


@pytest.fixture(scope="module")
def guarded(scenes_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    tokens = tmp_path_factory.mktemp("tokens") / "tokens.txt"
    tokens.write_text("# people\nall everything-opens-here\n\ngrid-only only-the-grid-scene grid\n")
    with BackgroundServer(scenes_dir, tokens_file=tokens, max_sessions_per_ip=100) as running:
        yield running


def bearer(token: str) -> dict[str, Any]:
    return {"additional_headers": {"Authorization": f"Bearer {token}"}}


def offering(token: str) -> dict[str, Any]:
    return {"offered": [SUBPROTOCOL, token_subprotocol(token)]}


@pytest.mark.parametrize("way", [bearer, offering])
def test_a_token_in_the_handshake(guarded: BackgroundServer, way: Any) -> None:
    url = guarded.scene_url("grid")
    for token in ("everything-opens-here", "only-the-grid-scene"):
        with PlainClient(url, **way(token)) as client:
            assert client.socket.subprotocol == SUBPROTOCOL
            client.hello()
    with PlainClient(url, **way("a-token-that-nobody-has")) as client:
        error, closed = client.refused()
    assert (error.code, closed) == ("unauthorised", 4401)
    assert "nobody" not in error.message


def test_a_token_in_hello(guarded: BackgroundServer) -> None:
    url = guarded.scene_url("grid")
    with PlainClient(url) as client:
        client.hello(token="everything-opens-here")
    for token in (None, "", "a-token-that-nobody-has"):
        with PlainClient(url) as client:
            client.send(make_hello(token=token))
            error, closed = client.refused()
        assert (error.code, closed) == ("unauthorised", 4401)


def test_a_token_for_another_scene(guarded: BackgroundServer) -> None:
    url = guarded.scene_url("big")
    with PlainClient(url, **bearer("only-the-grid-scene")) as client:
        error, closed = client.refused()
    assert (error.code, closed) == ("forbidden", 4403)
    with PlainClient(url) as client:
        client.send(make_hello(token="only-the-grid-scene"))
        error, closed = client.refused()
    assert (error.code, closed) == ("forbidden", 4403)


def test_a_wrong_header_is_not_mended_by_hello(guarded: BackgroundServer) -> None:
    basic = {"additional_headers": {"Authorization": "Basic dXNlcjpwYXNz"}}
    for way in (bearer("wrong-wrong-wrong-wrong"), basic, offering("")):
        with PlainClient(guarded.scene_url("grid"), **way) as client:
            error, closed = client.refused()
        assert (error.code, closed) == ("unauthorised", 4401)


def test_a_foreign_web_page(scenes_dir: Path) -> None:
    with BackgroundServer(scenes_dir, allowed_origins=("https://viewer.example",)) as running:
        url = running.scene_url("grid")
        for origin in (running.url, "https://viewer.example", None):
            with PlainClient(url, origin=origin) as client:
                client.hello()
        with PlainClient(url, origin="https://evil.example") as client:
            error, closed = client.refused()
    assert (error.code, closed) == ("forbidden", 4403)


# Load.


def test_a_flood_of_messages(scenes_dir: Path) -> None:
    with (
        BackgroundServer(scenes_dir, max_messages_per_s=3.0) as running,
        PlainClient(running.scene_url("grid")) as client,
    ):
        client.hello()
        with contextlib.suppress(ConnectionClosed):  # it may close before the last is sent
            for _ in range(60):
                client.send(Credit(bytes=1))
        error, closed = client.refused()
    assert (error.code, closed) == ("too_many", 4429)


def test_a_message_beyond_all_bounds_is_cut_off(server: BackgroundServer) -> None:
    with PlainClient(server.scene_url("grid")) as client:
        client.hello()
        # The close frame (1009) may be lost: the system resets a connection with unread bytes.
        with pytest.raises(ConnectionClosed):  # noqa: PT012 - either call may be the one
            client.socket.send(b"\x81" + b"a" * (5 << 20))
            client.receive()
    with PlainClient(server.scene_url("grid")) as client:
        client.hello()


def test_a_client_that_floods_picks_and_never_reads_is_slowed(scenes_dir: Path) -> None:
    with BackgroundServer(
        scenes_dir, max_messages_per_s=1e6, max_picks=2, max_pending_actions=4
    ) as running:
        with PlainClient(running.scene_url("grid")) as flood:
            flood.hello()
            for request in range(300):
                flood.send(Pick(request=request, origin=HERE))
            with PlainClient(running.scene_url("grid")) as other:
                other.hello()
                other.land(1, HERE, 10.0)
                other.until(Ready)
            answered = {flood.receive().request for _ in range(300)}  # type: ignore[union-attr]
        assert answered == set(range(300))


def test_too_many_sessions(scenes_dir: Path) -> None:
    with BackgroundServer(scenes_dir, max_sessions=2) as running:
        url = running.scene_url("grid")
        with PlainClient(url) as first, PlainClient(url) as second:
            first.hello()
            second.hello()
            with PlainClient(url) as three:
                error, closed = three.refused()
            assert (error.code, closed) == ("too_many", 4429)
        eventually(lambda: running.service.session_count == 0)
        with PlainClient(url) as again:
            again.hello()


def test_too_many_sessions_from_one_address(scenes_dir: Path) -> None:
    with BackgroundServer(scenes_dir, max_sessions_per_ip=1) as running:
        url = running.scene_url("grid")
        with PlainClient(url) as first:
            first.hello()
            with PlainClient(url) as two:
                error, closed = two.refused()
    assert (error.code, closed) == ("too_many", 4429)
    assert "one address" in error.message


def test_no_hello_in_time(scenes_dir: Path) -> None:
    with (
        BackgroundServer(scenes_dir, handshake_timeout_s=0.1) as running,
        PlainClient(running.scene_url("grid")) as client,
    ):
        error, closed = client.refused()
    assert (error.code, closed) == ("timeout", 4408)


def test_pongs_keep_a_silent_session(scenes_dir: Path) -> None:
    with (
        # Longer than a busy machine keeps the client from answering a ping.
        BackgroundServer(scenes_dir, idle_timeout_s=1.0) as running,
        PlainClient(running.scene_url("grid")) as client,
    ):
        client.hello()
        with pytest.raises(TimeoutError):
            client.receive(timeout_s=2.5)
        client.land(1, HERE, 1.0)
        client.until(Ready)
