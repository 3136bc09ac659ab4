"""Plans over HTTP: the same as those of the stream, with the places of the payloads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx
import pytest
from server.grid_scene import SIDE, TILE_M, GridScene
from server.plain_client import PlainClient

from terraport_server import BackgroundServer
from terraport_store import Scene
from terraport_wire import Budgets, Direction, Plan, decode

CENTRE = (SIDE * TILE_M / 2, 1.0, SIDE * TILE_M / 2)


def keys_of(grid: GridScene) -> dict[int, bytes]:
    """Payloads by key, as the scene on disk has them."""
    with Scene.open(grid.path) as scene:
        hashes = scene.rows.xxh3.tolist()
    return dict(zip(hashes, grid.payloads, strict=True))


def test_a_plan_over_http_and_its_ranges(server: BackgroundServer, grid: GridScene) -> None:
    folder = grid.manifest.files["segments.pack"].path.partition("/")[0]
    url = f"{server.scene_url('grid')}/{folder}/plan"
    query = {"x": CENTRE[0], "y": CENTRE[1], "z": CENTRE[2], "radius_m": 12.0}
    answer = httpx.get(url, params=query | {"inner_radius_m": 4.0})
    assert "immutable" in answer.headers["cache-control"]
    plan = decode(answer.content, Direction.SERVER_TO_CLIENT)
    assert isinstance(plan, Plan)
    with PlainClient(server.scene_url("grid")) as client:
        client.hello()
        client.land(1, CENTRE, 12.0, inner_radius_m=4.0)
        streamed = client.expect(Plan)
    assert (plan.show == streamed.show).all()
    assert (plan.hidden, plan.inner_hidden) == (streamed.hidden, streamed.inner_hidden)
    assert plan.inner_count == streamed.inner_count
    assert plan.offsets is not None
    assert plan.pack is not None
    payloads = keys_of(grid)
    for row, offset in zip(plan.show.tolist(), plan.offsets.tolist(), strict=True):
        span = {"Range": f"bytes={offset}-{offset + row[2] - 1}"}
        data = httpx.get(httpx.URL(url).join(plan.pack), headers=span)
        assert (data.status_code, data.content) == (206, payloads[row[0]])
    # Without what cannot be had, and within a budget.
    first, second = (f"{key:016x}" for key in plan.show["key"][:2].tolist())
    less = {"without": f"{first},{second}", "max_segments": 3}
    cut = decode(httpx.get(url, params=query | less).content, Direction.SERVER_TO_CLIENT)
    assert isinstance(cut, Plan)
    assert cut.show["key"].tolist() == plan.show["key"][2:5].tolist()
    assert cut.omitted_by == "max_segments"
    # Budgets of the GPU as the stream counts them.
    gpu = {"max_gpu_bytes": 60_000, "gpu_vertex_bytes": 77}
    narrow = decode(httpx.get(url, params=query | gpu).content, Direction.SERVER_TO_CLIENT)
    assert isinstance(narrow, Plan)
    with PlainClient(server.scene_url("grid")) as client:
        client.hello(budgets=Budgets(**gpu))
        client.land(1, CENTRE, 12.0)
        streamed = client.expect(Plan)
    assert (narrow.omitted_by, len(narrow.show)) == ("max_gpu_bytes", len(streamed.show))
    assert 0 < len(narrow.show) < len(plan.show)


@pytest.mark.parametrize(
    ("wrong", "status"),
    [
        ({"radius_m": 501}, 400),
        ({"radius_m": "nan"}, 400),
        ({"radius_m": -1}, 400),
        ({"x": "inf"}, 400),
        ({"without": "12"}, 400),
        ({"inner_radius_m": 20}, 400),
        ({"max_bytes": -1}, 400),
        ({"gpu_face_bytes": 5000}, 400),
    ],
)
def test_bad_questions_over_http(
    server: BackgroundServer, grid: GridScene, wrong: dict[str, Any], status: int
) -> None:
    folder = grid.manifest.files["segments.pack"].path.partition("/")[0]
    query = {"x": 0, "y": 0, "z": 0, "radius_m": 12.0} | wrong
    answer = httpx.get(f"{server.scene_url('grid')}/{folder}/plan", params=query)
    assert answer.status_code == status
    assert answer.json()["error"]["message"]


def test_a_plan_names_the_pack_where_others_serve_it(scenes_dir: Path, grid: GridScene) -> None:
    path = grid.manifest.files["segments.pack"].path
    query = {"x": CENTRE[0], "y": CENTRE[1], "z": CENTRE[2], "radius_m": 12.0}
    with BackgroundServer(scenes_dir, pull_base_url="https://cdn.example/scenes") as running:
        url = f"{running.scene_url('grid')}/{path.partition('/')[0]}/plan"
        plan = decode(httpx.get(url, params=query).content, Direction.SERVER_TO_CLIENT)
    assert isinstance(plan, Plan)
    assert plan.pack == f"https://cdn.example/scenes/grid/{path}"


def test_a_plan_of_an_unknown_version(server: BackgroundServer) -> None:
    url = f"{server.scene_url('grid')}/v-000000000000/plan?x=0&y=0&z=0&radius_m=1"
    assert httpx.get(url).status_code == 404


def test_a_plan_asks_for_the_token(scenes_dir: Path, token: str) -> None:
    with BackgroundServer(scenes_dir, token=token) as running:
        plan = f"{running.scene_url('grid')}/v-000000000000/plan?x=0&y=0&z=0&radius_m=1"
        assert httpx.get(plan).status_code == 401
