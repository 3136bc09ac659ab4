"""The HTTP endpoints of a running service."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote, urljoin
from urllib.request import urlopen

import httpx
import pytest
from glb_file import split_glb
from server.grid_scene import GridScene, write_grid_scene
from server.plain_client import PlainClient

from terraport_server import BackgroundServer
from terraport_store import Scene, change_labels
from terraport_store.labels import parse_labels
from terraport_store.layout import BASE

TOKEN = "sixteen-characters"


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> GridScene:
    return write_grid_scene(tmp_path_factory.mktemp("http") / "grid", name="<Pit> & co")


@pytest.fixture(scope="module")
def server(grid: GridScene) -> Iterator[BackgroundServer]:
    with BackgroundServer(grid.path.parent) as running:
        yield running


@pytest.fixture(scope="module")
def guarded(grid: GridScene) -> Iterator[BackgroundServer]:
    with BackgroundServer(grid.path.parent, token=TOKEN) as running:
        yield running


@pytest.fixture
def http(server: BackgroundServer) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=server.url) as client:
        yield client


def file_bytes(grid: GridScene, key: str) -> bytes:
    with Scene.open(grid.path) as scene:
        return scene.file_path(key).read_bytes()


def test_scenes(http: httpx.Client, grid: GridScene) -> None:
    (entry,) = http.get("/scenes").json()["scenes"]
    assert entry["id"] == "grid"
    assert entry["version"] == grid.manifest.version
    assert entry["segments"] == 36
    for name in ("self", "base", "regions", "labels"):
        assert http.get("/" + entry["links"][name]).status_code == 200


NAMES = ("Pit #1 (Süd)", "50% done?", "a&b;c=d +e", "坑", "über 2%20x", 'it\'s <b>"q"')
"""Folder names that mean something else in a URL, or cannot be in one."""


def test_links_can_be_resolved_whatever_a_scene_is_called(grid: GridScene, tmp_path: Path) -> None:
    for name in NAMES:
        shutil.copytree(grid.path, tmp_path / name)
        (tmp_path / name / "report.html").write_text(name)
    with BackgroundServer(tmp_path) as server:
        root = f"{server.url}/"

        def get(link: str) -> bytes:
            assert link.isascii()
            with urlopen(urljoin(root, link), timeout=10) as answer:
                return bytes(answer.read())

        listed = json.loads(get("scenes"))["scenes"]
        assert {line["id"] for line in listed} == set(NAMES)
        for line in listed:
            links = line["links"]
            scene = json.loads(get(links["self"]))
            assert scene["id"] == line["id"]
            assert scene["links"].items() >= links.items()
            assert get(links["report"]).decode() == line["id"]
            assert get(links["segment"].replace("{segment}", "3")) == grid.glb(3)
            tileset = json.loads(get(links["tileset"]))
            for uri in contents_of(tileset["root"]):
                get(urljoin(urljoin(root, links["tileset"]), uri).removeprefix(root))
            with PlainClient(urljoin(root, links["stream"]).removesuffix("/stream")) as client:
                assert client.hello().scene.id == line["id"]
        selves = {line["links"]["self"] for line in listed}
        assert selves == {f"scenes/{quote(name, safe='')}" for name in NAMES}


def contents_of(tile: dict[str, Any]) -> Iterator[str]:
    for content in (tile.get("content"), *tile.get("contents", ())):
        if content is not None:
            yield content["uri"]
    for child in tile.get("children", ()):
        yield from contents_of(child)


def test_what_is_beside_the_scenes_is_named_where_it_answers(
    http: httpx.Client, guarded: BackgroundServer
) -> None:
    links = http.get("/scenes").json()["links"]
    assert links == {"docs": "docs", "metrics": "metrics"}
    for path in links.values():
        assert http.get(f"/{path}").status_code == 200
    headers = {"Authorization": f"Bearer {TOKEN}"}
    assert httpx.get(f"{guarded.url}/scenes", headers=headers).json()["links"] == {}


def test_labels_are_asked_again_and_answered_shortly(tmp_path: Path) -> None:
    """They belong to no version, so nobody may keep them unasked."""
    write_grid_scene(tmp_path / "pit", cells=2, stable_ids=(4, 2, 9))
    change_labels(tmp_path / "pit", {9: "Süd 石"})
    with BackgroundServer(tmp_path) as running:
        url = f"{running.url}/scenes/pit/labels.json"
        whole = httpx.get(url)
        assert parse_labels(whole.content) == {9: "Süd 石"}
        assert whole.headers["content-type"] == "application/json"
        assert whole.headers["cache-control"] == "no-cache"
        again = httpx.get(url, headers={"If-None-Match": whole.headers["etag"]})
        assert (again.status_code, again.content) == (304, b"")


def test_a_report_that_comes_later_is_named(tmp_path: Path) -> None:
    """Links are kept as long as nothing in the scene's folder changed."""
    pit = write_grid_scene(tmp_path / "pit", cells=2).path
    past_s = time.time() - 60
    os.utime(pit, (past_s, past_s))
    with BackgroundServer(tmp_path) as running, httpx.Client(base_url=running.url) as http:

        def links() -> dict[str, str]:
            (listed,) = http.get("/scenes").json()["scenes"]
            assert http.get("/scenes/pit").json()["links"].items() >= listed["links"].items()
            return dict(listed["links"])

        assert "report" not in links()
        (pit / "report.html").write_text("<p>", encoding="utf-8")
        assert links()["report"] == "scenes/pit/report"
        (pit / "report.html").unlink()
        assert "report" not in links()


def test_many_scenes_are_listed_whole(tmp_path: Path) -> None:
    """In pieces: a token sees its scenes, each once, however many there are."""
    first = write_grid_scene(tmp_path / "scenes" / "s000", cells=2).path
    names = [f"s{number:03}" for number in range(200)]
    for name in names[1:]:
        shutil.copytree(first, first.with_name(name), copy_function=os.link)
    (tmp_path / "tokens").write_text(f"all {TOKEN}\none only-one-of-them-here s007\n")
    with BackgroundServer(tmp_path / "scenes", tokens_file=tmp_path / "tokens") as running:

        def listed(token: str) -> list[str]:
            headers = {"Authorization": f"Bearer {token}"}
            answer = httpx.get(f"{running.url}/scenes", headers=headers).json()
            return [scene["id"] for scene in answer["scenes"]]

        assert listed(TOKEN) == names
        assert listed("only-one-of-them-here") == ["s007"]


def test_one_scene_is_its_manifest_with_addresses(http: httpx.Client, grid: GridScene) -> None:
    document = http.get("/scenes/grid").json()
    manifest = grid.manifest.model_dump(mode="json")
    assert {key: document[key] for key in manifest} == manifest
    assert document["id"] == "grid"
    assert document["links"]["stream"] == "scenes/grid/stream"


@pytest.mark.parametrize(
    ("path", "media_type"),
    [
        ("base.tsg", "application/vnd.terraport.segment"),
        ("regions.json", "application/json"),
    ],
)
def test_files_are_the_published_bytes(
    http: httpx.Client, grid: GridScene, path: str, media_type: str
) -> None:
    expected = file_bytes(grid, path)
    whole = http.get(f"/scenes/grid/{path}")
    assert whole.content == expected
    assert whole.headers["content-type"] == media_type
    assert whole.headers["etag"] == f'"{grid.manifest.files[path].xxh3}"'
    assert whole.headers["cache-control"] == "no-cache"
    partial = http.get(f"/scenes/grid/{path}", headers={"Range": "bytes=5-9"})
    assert (partial.status_code, partial.content) == (206, expected[5:10])
    again = http.get(
        f"/scenes/grid/{path}", headers={"If-None-Match": f'"x", W/{whole.headers["etag"]}'}
    )
    assert (again.status_code, again.content) == (304, b"")
    other = http.get(f"/scenes/grid/{path}", headers={"If-None-Match": '"other"'})
    assert other.status_code == 200


def test_the_base_as_glb(http: httpx.Client, grid: GridScene) -> None:
    answer = http.get("/scenes/grid/base.glb", params={"v": grid.manifest.version})
    assert answer.headers["content-type"] == "model/gltf-binary"
    assert answer.headers["cache-control"] == "public, max-age=31536000, immutable"
    with Scene.open(grid.path) as scene:
        base = scene.file_mesh(BASE)
        assert answer.content == scene.file_glb(BASE)
    document, _ = split_glb(answer.content)
    count = document["accessors"][document["meshes"][0]["primitives"][0]["indices"]]["count"]
    assert count == 3 * len(base.faces)
    again = http.get("/scenes/grid/base.glb", headers={"If-None-Match": answer.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


def test_a_version_in_the_address_is_cached_for_ever(http: httpx.Client, grid: GridScene) -> None:
    answer = http.get("/scenes/grid/base.tsg", params={"v": grid.manifest.version})
    assert answer.headers["cache-control"] == "public, max-age=31536000, immutable"
    unknown = http.get("/scenes/grid/base.tsg", params={"v": "0" * 32})
    assert unknown.status_code == 404
    assert unknown.json()["error"]["code"] == "unknown_scene"


@pytest.mark.parametrize("number", ["36", "-1"])
def test_an_unknown_segment(http: httpx.Client, number: str) -> None:
    answer = http.get(f"/scenes/grid/segments/{number}.glb")
    assert answer.status_code == 404
    assert answer.json()["error"]["message"] == f"got segment {number}, expected 0 to 35"


def test_an_unknown_scene(http: httpx.Client) -> None:
    for path in ("/scenes/atlantis", "/scenes/atlantis/base.tsg", "/scenes/..%2F..%2Fetc"):
        answer = http.get(path)
        assert answer.status_code == 404
        assert "/work" not in answer.text


def test_a_small_base_has_no_overview(http: httpx.Client) -> None:
    assert http.get("/scenes/grid/overview.tsg").json()["error"]["code"] == "unknown_overview"
    assert "overview" not in http.get("/scenes/grid").json()["links"]


@pytest.mark.parametrize(
    ("link", "path", "file", "media_type"),
    [
        ("report", "report", "report.html", "text/html; charset=utf-8"),
        ("report_pdf", "report.pdf", "report.pdf", "application/pdf"),
        ("preview", "preview.jpg", "preview.jpg", "image/jpeg"),
    ],
)
def test_what_a_build_says_of_a_scene(
    http: httpx.Client, grid: GridScene, link: str, path: str, file: str, media_type: str
) -> None:
    def links() -> dict[str, str]:
        (line,) = http.get("/scenes").json()["scenes"]
        assert line["links"].items() <= http.get("/scenes/grid").json()["links"].items()
        return dict(line["links"])

    missing = http.get(f"/scenes/grid/{path}")
    assert (missing.status_code, missing.json()["error"]["code"]) == (404, "unknown_report")
    assert link not in links()
    (grid.path / file).write_bytes(b"\xff\xd8 written by a build")
    try:
        answer = http.get(f"/scenes/grid/{path}")
        assert links()[link] == f"scenes/grid/{path}"
    finally:
        (grid.path / file).unlink()
    assert answer.content == b"\xff\xd8 written by a build"
    assert answer.headers["content-type"] == media_type
    assert link not in links()


@pytest.mark.parametrize("way", ["the file", "its folder", "in a circle"])
def test_a_report_that_is_a_link_out_of_the_scene_is_not_served(
    http: httpx.Client, grid: GridScene, tmp_path: Path, way: str
) -> None:
    (tmp_path / "report.html").write_text("not of this scene")
    report, folder = grid.path / "report.html", grid.path / "elsewhere"
    if way == "the file":
        report.symlink_to(tmp_path / "report.html")
    elif way == "its folder":
        folder.symlink_to(tmp_path)
        report.symlink_to(folder / "report.html")
    else:
        report.symlink_to(report)
    try:
        answer = http.get("/scenes/grid/report")
        assert (answer.status_code, answer.json()["error"]["code"]) == (404, "unknown_report")
        assert "report" not in http.get("/scenes/grid").json()["links"]
    finally:
        report.unlink()
        folder.unlink(missing_ok=True)


@pytest.mark.parametrize("key", ["base.tsg", "regions.json"])
def test_a_file_that_became_a_link_out_of_the_scene_is_not_served(tmp_path: Path, key: str) -> None:
    grid = write_grid_scene(tmp_path / "scenes" / "grid", cells=2)
    with (
        BackgroundServer(grid.path.parent) as server,
        httpx.Client(base_url=server.url) as http,
    ):
        path = grid.path / grid.manifest.files[key].path
        path.rename(tmp_path / "elsewhere")
        path.symlink_to(tmp_path / "elsewhere")
        assert http.get(f"/scenes/grid/{key}").status_code == 404


def test_health_readiness_metrics_and_documentation(http: httpx.Client) -> None:
    assert http.get("/healthz").text == "ok\n"
    assert http.get("/readyz").text == "ok\n"
    metrics = http.get("/metrics")
    assert metrics.headers["content-type"].startswith("text/plain; version=0.0.4")
    assert "terraport_event_loop_lag_seconds_bucket" in metrics.text
    assert http.get("/docs").status_code == 200
    assert "/scenes/{scene_id}/base.tsg" in http.get("/openapi.json").json()["paths"]


def test_a_service_without_scenes_is_not_ready(tmp_path: Path) -> None:
    with BackgroundServer(tmp_path) as running:
        answer = httpx.get(f"{running.url}/readyz")
        assert (answer.status_code, answer.text) == (503, "no scene\n")
        assert httpx.get(f"{running.url}/scenes").json()["scenes"] == []


@pytest.mark.parametrize(
    "path",
    [
        "/scenes",
        "/scenes/grid",
        "/scenes/grid/base.tsg",
        "/scenes/grid/regions.json",
        "/scenes/grid/labels.json",
        "/scenes/grid/segments/0.glb",
        "/scenes/grid/report",
        "/scenes/atlantis",
    ],
)
def test_scenes_need_the_token(guarded: BackgroundServer, path: str) -> None:
    url = guarded.url + path
    for headers in ({}, {"Authorization": "Bearer wrong"}, {"Authorization": f"Basic {TOKEN}"}):
        answer = httpx.get(url, headers=headers)
        assert answer.status_code == 401
        assert answer.headers["www-authenticate"] == "Bearer"
        assert answer.json()["error"]["code"] == "unauthorised"
    right = httpx.get(url, headers={"Authorization": f"Bearer {TOKEN}"})
    assert right.status_code in {200, 404}
    if "cache-control" in right.headers:
        assert "public" not in right.headers["cache-control"]


def test_a_token_for_other_scenes(grid: GridScene, tmp_path: Path) -> None:
    tokens = tmp_path / "tokens"
    tokens.write_text(f"guest {TOKEN} elsewhere\n")
    headers = {"Authorization": f"Bearer {TOKEN}"}
    with BackgroundServer(grid.path.parent, tokens_file=tokens) as running:
        assert httpx.get(f"{running.url}/scenes", headers=headers).json()["scenes"] == []
        answer = httpx.get(f"{running.url}/scenes/grid", headers=headers)
    assert (answer.status_code, answer.json()["error"]["code"]) == (403, "forbidden")
