from __future__ import annotations

import json
from typing import Any

import pytest
from store.tiny_scene import TinyScene

from terraport_store import DamagedSceneError, Manifest, manifest_digest


@pytest.fixture
def document(tiny: TinyScene) -> dict[str, Any]:
    """A good scene.json, parsed."""
    return json.loads((tiny.path / "scene.json").read_bytes())


def read(document: Any) -> Manifest:
    return Manifest.from_bytes(json.dumps(document).encode())


def test_round_trip(tiny: TinyScene) -> None:
    data = (tiny.path / "scene.json").read_bytes()
    assert Manifest.from_bytes(data) == tiny.manifest
    assert tiny.manifest.to_bytes() == data


def test_version_is_the_digest_of_the_contents(document: dict[str, Any]) -> None:
    assert document["version"] == manifest_digest(document) == read(document).digest()
    document["name"] = "other"
    assert document["version"] != manifest_digest(document)


def test_version_does_not_depend_on_the_folder(document: dict[str, Any]) -> None:
    for file in document["files"].values():
        file["path"] = "elsewhere/" + file["path"].partition("/")[2]
    assert manifest_digest(document) == document["version"]


def test_unknown_keys_are_skipped_but_digested(document: dict[str, Any]) -> None:
    document["format_version"] = "1.9"
    document["novelty"] = {"a": 1}
    document["counts"]["novelty"] = 2
    assert read(document).name == "tiny 0"
    assert manifest_digest(document) != document["version"]


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (["format"], "zip", "format 'zip', expected 'terraport-scene'"),
        (["format_version"], "2.0", r"format_version '2.0', expected 1\.x"),
        (["format_version"], 1, "format_version 1, expected"),
        (["version"], "xyz", "field 'version'"),
        (["step_m"], 0, "field 'step_m'"),
        (["origin"], [1, 2], r"field 'origin\.2'"),
        (["origin"], [1, 2, 1e999], r"field 'origin\.2'"),
        (["counts", "segments"], -1, r"field 'counts\.segments'"),
        (["counts"], None, "field 'counts'"),
        (["encodings"], {"glb": {}}, "segments are stored as glb, expected segment-2; build the"),
        (
            ["files"],
            {"base.glb": {}},
            "stored as base.glb, expected base.tsg; build the scene again",
        ),
        (["encodings", "segment-2", "pack"], "other.pack", "no file 'other.pack' in files"),
        (["files", "base.tsg", "path"], "../../etc/passwd", r"field 'files\.base\.tsg\.path'"),
        (["files", "base.tsg", "path"], "/etc/passwd", r"field 'files\.base\.tsg\.path'"),
        (["files", "base.tsg", "path"], "v-1/..", r"field 'files\.base\.tsg\.path'"),
        (["files", "base.tsg", "path"], "base.tsg", r"field 'files\.base\.tsg\.path'"),
        (["files", "base.tsg", "xxh3"], "00", r"field 'files\.base\.tsg\.xxh3'"),
        (["files", "base.tsg", "bytes"], 1.5, r"field 'files\.base\.tsg\.bytes'"),
    ],
)
def test_names_the_wrong_field(
    document: dict[str, Any], path: list[str], value: object, message: str
) -> None:
    node = document
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value
    with pytest.raises(DamagedSceneError, match=message) as caught:
        read(document)
    assert caught.value.file == "scene.json"


@pytest.mark.parametrize("key", ["base.tsg", "base.cover", "regions.json", "segments.idx"])
def test_needed_files(document: dict[str, Any], key: str) -> None:
    del document["files"][key]
    with pytest.raises(DamagedSceneError, match=f"no file '{key}' in files"):
        read(document)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "does not parse as JSON"),
        (b"[]", "format 'list'"),
        (b"\xff", "does not parse as JSON"),
        (b"[" * 200_000, "does not parse as JSON"),
        (b" " * (4 * 2**20 + 1), "4194305 bytes, expected at most 4194304"),
    ],
)
def test_hostile_bytes(data: bytes, message: str) -> None:
    with pytest.raises(DamagedSceneError, match=message):
        Manifest.from_bytes(data)


def test_nothing_of_clock_or_machine(tiny: TinyScene) -> None:
    """Same input, same bytes: see test_writer for two builds; here, no such key."""
    text = (tiny.path / "scene.json").read_text()
    assert not any(word in text for word in ("time", "date", "seconds", "host", str(tiny.path)))
