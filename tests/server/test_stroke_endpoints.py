"""Painting over HTTP: who may, what is kept, what is refused."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from server.grid_scene import GridScene, write_grid_scene

from terraport_server import BackgroundServer
from terraport_store import read_strokes, write_taught

ANNA, BEN, GUEST = (
    "anna-has-sixteen-letters",
    "ben-has-sixteen-letters",
    "guest-has-sixteen-letters",
)
BODY: dict[str, Any] = {
    "name": "haul road",
    "colour": "#c08a2e",
    "width_m": 3,
    "line": [[1, 2], [3, 4]],
}
ADDRESS = "/scenes/grid/strokes"


@pytest.fixture
def grid(tmp_path: Path) -> GridScene:
    return write_grid_scene(tmp_path / "scenes" / "grid")


@pytest.fixture
def server(grid: GridScene, tmp_path: Path) -> Iterator[BackgroundServer]:
    tokens = tmp_path / "tokens"
    tokens.write_text(f"anna {ANNA} +teach\nben {BEN} +teach\nguest {GUEST}\n")
    with BackgroundServer(grid.path.parent, tokens_file=tokens) as running:
        yield running


def client(server: BackgroundServer, token: str) -> httpx.Client:
    return httpx.Client(base_url=server.url, headers={"Authorization": f"Bearer {token}"})


@pytest.fixture
def anna(server: BackgroundServer) -> Iterator[httpx.Client]:
    with client(server, ANNA) as http:
        yield http


@pytest.fixture
def ben(server: BackgroundServer) -> Iterator[httpx.Client]:
    with client(server, BEN) as http:
        yield http


@pytest.fixture
def guest(server: BackgroundServer) -> Iterator[httpx.Client]:
    with client(server, GUEST) as http:
        yield http


def test_several_paint_and_each_takes_back_their_own(
    anna: httpx.Client, ben: httpx.Client, grid: GridScene
) -> None:
    assert anna.get(ADDRESS).json() == {"strokes": [], "revision": ""}
    answer = anna.post(ADDRESS, json=BODY)
    assert answer.status_code == 201
    stroke = answer.json()["stroke"]
    assert stroke.items() >= BODY.items()
    assert (stroke["who"], stroke["yours"]) == ("anna", True)
    assert ben.post(ADDRESS, json={**BODY, "name": "bench"}).status_code == 201
    listed = ben.get(ADDRESS)
    assert [(row["who"], row["name"], row["yours"]) for row in listed.json()["strokes"]] == [
        ("anna", "haul road", False),
        ("ben", "bench", True),
    ]
    assert [one.who for one in read_strokes(grid.path).strokes] == ["anna", "ben"]
    etag = listed.headers["ETag"]
    assert ben.get(ADDRESS, headers={"If-None-Match": etag}).status_code == 304
    # Undo.
    refused = ben.delete(f"{ADDRESS}/{stroke['id']}")
    assert (refused.status_code, refused.json()["error"]["code"]) == (403, "forbidden")
    assert anna.delete(f"{ADDRESS}/{stroke['id']}").status_code == 200
    assert anna.delete(f"{ADDRESS}/{stroke['id']}").json()["error"]["code"] == "unknown_stroke"
    assert [one.who for one in read_strokes(grid.path).strokes] == ["ben"]


def test_scenes_that_are_mounted_read_only_offer_no_strokes(
    anna: httpx.Client, guest: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They were offered, and each stroke was answered with 503 and "try again later"."""
    assert anna.post(ADDRESS, json=BODY).status_code == 201
    monkeypatch.setattr(os, "access", lambda _path, mode: not mode & os.W_OK)  # tests run as root
    assert "strokes" not in anna.get("/scenes/grid").json()["links"]
    assert len(anna.get(ADDRESS).json()["strokes"]) == 1
    for answer in (anna.post(ADDRESS, json=BODY), anna.delete(f"{ADDRESS}/0")):
        assert (answer.status_code, answer.json()["error"]["code"]) == (409, "no_strokes")
        assert "cannot write" in answer.json()["error"]["message"]
    assert guest.post(ADDRESS, json=BODY).status_code == 403


def test_painting_is_a_right_of_its_own(
    server: BackgroundServer, anna: httpx.Client, guest: httpx.Client, grid: GridScene
) -> None:
    assert "strokes" in anna.get("/scenes/grid").json()["links"]
    assert "strokes" not in guest.get("/scenes/grid").json()["links"]
    for answer in (
        guest.get(ADDRESS), guest.post(ADDRESS, json=BODY), guest.delete(f"{ADDRESS}/0")
    ):  # fmt: skip
        assert (answer.status_code, answer.json()["error"]["code"]) == (403, "forbidden")
    assert httpx.post(f"{server.url}{ADDRESS}", json=BODY).status_code == 401
    assert not (grid.path / "strokes.geojson").exists()


def test_where_no_token_is_asked_for_only_this_machine_paints(grid: GridScene) -> None:
    with BackgroundServer(grid.path.parent) as own, httpx.Client(base_url=own.url) as http:
        assert http.post(ADDRESS, json=BODY).status_code == 201
    with BackgroundServer(grid.path.parent, allow_open=True) as everybody:
        assert httpx.post(f"{everybody.url}{ADDRESS}", json=BODY).status_code == 403


@pytest.mark.parametrize(
    ("sent", "status", "code"),
    [
        ({"json": {**BODY, "width_m": 1000}}, 400, "invalid_field"),
        ({"json": {**BODY, "name": "x" * 20_000}}, 413, "too_large"),
        ({"json": {**BODY, "line": [[0, 0]]}}, 400, "invalid_field"),
        ({"json": []}, 400, "invalid_field"),
        ({"content": b"{", "headers": {"Content-Type": "application/json"}}, 400, "invalid_field"),
        ({"content": b"[" * 9000, "headers": {"Content-Type": "application/json"}}, 400, None),
        ({"content": json.dumps(BODY).encode(), "headers": {"Content-Type": "text/plain"}},
         415, "invalid_field"),
        ({"json": BODY, "headers": {"Origin": "http://evil.example"}}, 403, "forbidden"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_refused_and_keeps_nothing(
    anna: httpx.Client, grid: GridScene, sent: dict[str, Any], status: int, code: str | None
) -> None:
    answer = anna.post(ADDRESS, **sent)
    assert answer.status_code == status
    if code is not None:
        assert answer.json()["error"]["code"] == code
    assert not (grid.path / "strokes.geojson").exists()
    assert anna.post(ADDRESS, json=BODY).status_code == 201, "the next one is taken"


def test_one_token_paints_no_faster_than_it_may(
    server: BackgroundServer, anna: httpx.Client, ben: httpx.Client
) -> None:
    answers = [anna.post(ADDRESS, json=BODY).status_code for _ in range(40)]
    assert answers.count(201) >= 20
    assert answers[-1] == 429
    assert ben.post(ADDRESS, json=BODY).status_code == 201


def test_what_was_taught(guest: httpx.Client, grid: GridScene) -> None:
    assert guest.get("/scenes/grid/taught").status_code == 204
    write_taught(grid.path, b'{"format": "terraport-taught"}')
    answer = guest.get("/scenes/grid/taught")
    assert answer.json() == {"format": "terraport-taught"}
    etag = answer.headers["ETag"]
    again = guest.get("/scenes/grid/taught", headers={"If-None-Match": etag})
    assert again.status_code == 304


def test_a_damaged_file_is_not_painted_over(anna: httpx.Client, grid: GridScene) -> None:
    (grid.path / "strokes.geojson").write_text("not JSON")
    answer = anna.post(ADDRESS, json=BODY)
    assert (answer.status_code, answer.json()["error"]["code"]) == (503, "strokes_unavailable")
    assert (grid.path / "strokes.geojson").read_text() == "not JSON"
