"""3D Tiles of a running service: every address that the tileset names, asked for."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import pytest
from glb_file import split_glb

from terraport_server import BackgroundServer
from terraport_server.scenes import tileset as tile_desk
from terraport_server.scenes.served_scene import ServedScene
from terraport_server.scenes.tileset import MAX_KEPT_BYTES, TilesetCache
from terraport_store import Scene

SAMPLE = Path(__file__).resolve().parents[2] / "data" / "sample_scene"


@pytest.fixture(scope="module")
def http() -> Iterator[httpx.Client]:
    with (
        BackgroundServer(SAMPLE) as running,
        httpx.Client(base_url=f"{running.url}/scenes/sample_scene/", timeout=60) as client,
    ):
        yield client


def uris(tile: dict[str, Any]) -> Iterator[str]:
    if "content" in tile:
        yield tile["content"]["uri"]
    for child in tile.get("children", ()):
        yield from uris(child)


def test_every_address_of_the_tileset_answers(http: httpx.Client) -> None:
    answer = http.get("tileset.json")
    document = answer.json()
    assert answer.headers["cache-control"] == "no-cache"
    assert len(document["root"]["transform"]) == 16
    named = list(uris(document["root"]))
    with Scene.open(SAMPLE) as scene:
        assert document["asset"]["tilesetVersion"] == scene.manifest.version
        seen = set()
        for uri in named:
            # Viewers carry the tileset's own query on.
            content = http.get(f"{uri}&radius_m=20")
            assert content.status_code == 200
            assert content.headers["content-type"] == "model/gltf-binary"
            assert "immutable" in content.headers["cache-control"]
            document, binary = split_glb(content.content)
            for material in document["materials"]:
                assert "KHR_materials_unlit" in material["extensions"], uri
            assert "KHR_materials_unlit" in document["extensionsUsed"]
            if found := re.match(r"tiles/segments/(\d+)\.glb", uri):
                seen.add(int(found[1]))
                assert binary == split_glb(scene.glb(int(found[1])))[1]
        assert seen == set(range(len(scene.index)))
    assert len(set(named)) == len(named)


def test_what_is_known_is_not_sent_again(http: httpx.Client) -> None:
    answer = http.get("tileset.json")
    again = http.get("tileset.json", headers={"If-None-Match": answer.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    for part in list(uris(answer.json()["root"]))[:2]:  # of the base, and a segment
        etag = http.get(part).headers["etag"]
        assert http.get(part, headers={"If-None-Match": etag}).status_code == 304


def test_a_radius_and_a_version(http: httpx.Client) -> None:
    plain = http.get("tileset.json")
    version = plain.json()["asset"]["tilesetVersion"]
    near = http.get("tileset.json", params={"radius_m": 20})
    assert b"viewerRequestVolume" in near.content
    assert b"viewerRequestVolume" not in plain.content
    assert http.get("tileset.json", params={"v": version}).content == plain.content
    assert http.get("tileset.json", params={"v": "0" * 32}).status_code == 404
    for radius in ("0", "-1", "nan", "1e9", "wide"):
        refused = http.get("tileset.json", params={"radius_m": radius})
        assert refused.status_code == 400
        assert "radius_m" in refused.json()["error"]["message"]


def test_a_part_that_is_none_is_refused(http: httpx.Client) -> None:
    answer = http.get("tiles/0123456789abcdef.glb")
    assert answer.status_code == 404
    assert answer.json()["error"]["code"] == "unknown_tile"
    for number, status, code in (("99999", 404, "unknown_segment"), ("x", 400, "invalid_field")):
        answer = http.get(f"tiles/segments/{number}.glb")
        assert (answer.status_code, answer.json()["error"]["code"]) == (status, code)


def test_a_token_is_asked_for() -> None:
    with BackgroundServer(SAMPLE, token="sixteen-characters") as running:
        path = f"{running.url}/scenes/sample_scene/tileset.json"
        assert httpx.get(path).status_code == 401
        headers = {"Authorization": "Bearer sixteen-characters"}
        answer = httpx.get(path, headers=headers)
        assert answer.status_code == 200
        part = next(uri for uri in uris(answer.json()["root"]) if uri.startswith("tiles/"))
        address = f"{running.url}/scenes/sample_scene/{part}"
        assert httpx.get(address).status_code == 401
        kept = httpx.get(address, headers=headers)
        assert kept.headers["cache-control"].startswith("private")


def test_without_a_library_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(_manifest: object) -> object:
        raise ModuleNotFoundError("No module named 'pyproj'", name="pyproj")

    monkeypatch.setattr("terraport_server.scenes.tileset.place_scene", missing)
    with BackgroundServer(SAMPLE) as running:
        answer = httpx.get(f"{running.url}/scenes/sample_scene/tileset.json")
    assert answer.status_code == 501
    assert "pip install 'terraport[tiles]'" in answer.json()["error"]["message"]


def test_parts_that_are_too_many_go(monkeypatch: pytest.MonkeyPatch) -> None:
    assert MAX_KEPT_BYTES >= 64 << 20
    monkeypatch.setattr("terraport_server.scenes.tileset.MAX_KEPT_BYTES", 1 << 20)

    async def work() -> None:
        desk = TilesetCache()
        with ThreadPoolExecutor(1) as pool:
            scenes = [ServedScene(name, SAMPLE, pool) for name in ("a", "b")]
            made = []
            for served in (*scenes, scenes[1]):
                made.append(b"".join((await desk.tiles(served)).tileset.pieces(None)))
                assert list(desk._kept) == [(served.id, served.version)]
            assert made[0] == made[1] == made[2]
            for served in scenes:
                served.retire()
                assert served.closed  # held only while it is worked on

    asyncio.run(work())


def test_a_tileset_is_written_once_for_all_radii(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else whoever asks for another each time has a second of work done for it, and 40 MB kept."""
    written: list[str] = []
    write = tile_desk._make

    def counted(served: ServedScene) -> tile_desk.ServedTiles:
        written.append(served.id)
        return write(served)

    monkeypatch.setattr(tile_desk, "_make", counted)
    with (
        BackgroundServer(SAMPLE) as running,
        httpx.Client(base_url=f"{running.url}/scenes/sample_scene/", timeout=60) as client,
    ):
        answers = [client.get(f"tileset.json?radius_m={radius}") for radius in range(10, 30)]
        assert len({answer.content for answer in answers}) == len(answers)
        assert len({answer.headers["etag"] for answer in answers}) == len(answers)
        again = {"If-None-Match": answers[3].headers["etag"]}
        assert client.get("tileset.json?radius_m=13", headers=again).status_code == 304
        assert client.get("tileset.json?radius_m=14", headers=again).status_code == 200
    assert written == ["sample_scene"]
