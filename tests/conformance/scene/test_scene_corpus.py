"""The committed scene and payloads, good and bad; other languages run the same files."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conformance.scene.axes_scene import NAMES, board_picture

from terraport_payload import AttributeScale, Cover, PayloadError, decode_segment
from terraport_payload.texture import gpu_texture_bytes
from terraport_store import DamagedSceneError, Scene, read_names, validate_scene
from terraport_store.layout import BASE

HERE = Path(__file__).resolve().parent
SCENES = ("tiny", "tiny-textured", "tiny-base-image", "tiny-changed", "axes")
"""One with names, one with textures, one whose base alone has one, one of which a segment alone has
an attribute, and one to see axes by."""
DAMAGED = json.loads((HERE / "damaged.json").read_text())
COVERS = sorted((HERE / "cover").glob("*.cover"))
PAYLOADS = sorted(p for p in (HERE / "payload").iterdir() if p.suffix != ".json")


def decode(path: Path) -> Any:
    data = path.read_bytes()
    scales = expected_of(path)["scales"]
    return decode_segment(
        data, scales={scale.pop("name"): AttributeScale(**scale) for scale in scales}
    )


def expected_of(path: Path) -> Any:
    return json.loads(path.with_name(path.name + ".json").read_text())


def test_corpus_is_small() -> None:
    files = [path for path in HERE.rglob("*") if path.is_file() and path.suffix != ".pyc"]
    assert sum(path.stat().st_size for path in files) < 400_000
    for name in SCENES:
        assert sum(p.stat().st_size for p in (HERE / name).rglob("*") if p.is_file()) < 60_000


@pytest.mark.parametrize("name", SCENES)
def test_good_scene_is_whole(name: str) -> None:
    assert validate_scene(HERE / name) == []


def test_good_scene_says_what_it_said_when_it_was_written() -> None:
    """Old files stay readable: these numbers never change."""
    with Scene.open(HERE / "tiny") as scene:
        assert scene.manifest.name == "tiny 0"
        assert scene.manifest.origin == (500000.0, 8000000.0, 100.0)
        assert scene.manifest.step_m == 2.0**-12
        assert scene.manifest.counts.detail_faces == 288
        assert scene.index.face_count.tolist() == [72] * 4
        assert scene.index.region.tolist() == [0, 1, 1, 2]
        assert scene.cover.over(0).tolist() == [0]
        assert scene.cover.over(31).tolist() == [3]
        assert scene.within((0.0, 1.0, 0.0), 1.0).tolist() == [0]
        assert scene.manifest.format_version == "1.0"


def test_names_without_stable_ids() -> None:
    names, _ = read_names(HERE / "tiny-textured")
    assert [names.stable_id(region) for region in range(3)] == [None] * 3
    assert [names.label(region) for region in range(3)] == [None, "bench", None]


def test_names_with_labels() -> None:
    names, _ = read_names(HERE / "tiny")
    assert [names.stable_id(region) for region in range(3)] == [5, 2, 9]
    assert [names.label(region) for region in range(3)] == [None, "bench", "haul road"]
    assert names.without_region() == {7: "Süd 石"}
    assert names.next_stable_id == 10


def test_textures() -> None:
    with Scene.open(HERE / "tiny-textured") as scene:
        stated = scene.manifest.textures
        assert stated is not None
        assert (stated.segments, stated.max_side, stated.media_types) == (2, 16, ("image/jpeg",))
        assert scene.manifest.has_colour is False
        meshes = [scene.mesh(segment) for segment in range(4)]
    assert [mesh.texture is not None for mesh in meshes] == [True, False, True, False]
    assert [mesh.colours is None for mesh in meshes] == [True, False, True, False]


def test_a_texture_of_the_base_alone() -> None:
    with Scene.open(HERE / "tiny-base-image") as scene:
        stated = scene.manifest.textures
        assert stated is not None
        assert (stated.source, stated.segments, stated.base_side) == ("vertex", 0, 16)
        assert scene.manifest.has_colour is True
        base = scene.file_mesh(BASE)
        meshes = [scene.mesh(segment) for segment in range(4)]
    assert base.texture is not None
    assert base.colours is None
    assert all(mesh.texture is None and mesh.colours is not None for mesh in meshes)


def test_an_attribute_of_one_segment_alone() -> None:
    with Scene.open(HERE / "tiny-changed") as scene:
        names = [info.name for info in scene.manifest.attributes]
        meshes = [scene.mesh(segment) for segment in range(4)]
    assert names == ["grade", "height_change_m"]
    assert [list(mesh.attributes) for mesh in meshes] == [["grade"]] * 3 + [names]
    steps = meshes[3].attributes["height_change_m"]
    assert (np.nanmin(steps), np.nanmax(steps)) == (-1.5, 0.5)
    assert np.isnan(steps).sum() == 16


def test_the_axes_scene_is_what_it_is_said_to_be() -> None:
    with Scene.open(HERE / "axes") as scene:
        meshes = [scene.mesh(segment) for segment in range(len(NAMES))]
        boxes = dict(zip(NAMES, scene.index.bounds.tolist(), strict=True))
        assert all(scene.cover.over(face).tolist() == [5] for face in range(scene.cover.base_faces))
    # The arrows: 4 m to +x, 6 m to -z (north), 3 m to +y, all from one place.
    assert boxes["east"][0] == 1.5
    assert boxes["east"][3] == 5.5
    assert boxes["north"][2] == -6.0
    assert boxes["north"][5] == 0.0
    assert boxes["up"][1] == 0.5
    assert boxes["up"][4] == 3.5
    board = meshes[NAMES.index("board")]
    assert board.uvs is not None
    assert board.texture is not None
    assert board.texture.data == board_picture()
    upper_left = board.positions[(board.uvs == [0.0, 0.0]).all(axis=1)]
    assert upper_left.tolist() == [[-5.0, 4.5, -8.0]]  # west and high: it is read from the south
    for mesh in meshes:
        corners = mesh.positions[mesh.faces]
        outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (np.einsum("ij,ij->i", outwards, mesh.normals[mesh.faces[:, 0]]) > 0).all()


@pytest.mark.parametrize("case", DAMAGED, ids=[case["name"] for case in DAMAGED])
def test_damaged_scene(case: dict[str, Any], tmp_path: Path) -> None:
    scene = tmp_path / "tiny"
    shutil.copytree(HERE / case.get("scene", "tiny"), scene)
    files = json.loads((scene / "scene.json").read_text())["files"]
    name = case["file"]
    apply(case["edit"], scene / (files[name]["path"] if name in files else name))
    findings = validate_scene(scene)
    assert {finding.code for finding in findings} == set(case["findings"])
    if case["open"]:
        Scene.open(scene).close()
    else:
        with pytest.raises(DamagedSceneError):
            Scene.open(scene)


def apply(edit: dict[str, Any], path: Path) -> None:
    """Damage one file as a case describes."""
    ((kind, value),) = edit.items()
    data = bytearray(path.read_bytes())
    if kind == "flip":
        data[value] ^= 0x01
    elif kind == "truncate":
        del data[value:]
    elif kind == "write":
        offset, text = value
        raw = bytes.fromhex(text)
        data[offset : offset + len(raw)] = raw
    elif kind == "set":
        (*keys, last), new = value
        document = json.loads(data)
        node = document
        for key in keys:
            node = node[key]
        node[last] = new
        data = bytearray(json.dumps(document).encode())
    else:
        assert kind == "delete"
        path.unlink()
        return
    path.write_bytes(bytes(data))


@pytest.mark.parametrize("path", PAYLOADS, ids=[p.name for p in PAYLOADS])
def test_payload(path: Path) -> None:
    expected = expected_of(path)
    if not expected["good"]:
        with pytest.raises(PayloadError) as caught:
            decode(path)
        assert expected["error"] in str(caught.value)
        return
    mesh = decode(path)
    assert mesh.positions.tolist() == expected["positions"]
    assert mesh.faces.tolist() == expected["faces"]
    assert np.allclose(mesh.normals, expected["normals"], atol=2e-6)
    for name in ("colours", "region_ids"):
        values = getattr(mesh, name)
        assert (None if values is None else values.tolist()) == expected[name]
    assert (mesh.uvs is None) == ("uvs" not in expected)
    if mesh.uvs is not None:
        assert np.allclose(mesh.uvs, expected["uvs"], atol=2e-6)
        texture = expected["texture"]
        sides = (texture["media_type"], texture["width"], texture["height"])
        assert (mesh.texture.media_type, mesh.texture.width, mesh.texture.height) == sides
        assert hashlib.sha256(mesh.texture.data).hexdigest() == texture["sha256"]
        kept = np.array([[mesh.texture.width, mesh.texture.height, mesh.texture.bits]], np.uint16)
        assert int(gpu_texture_bytes(kept)[0]) == texture["gpu_bytes"]
    assert set(mesh.attributes) == set(expected["attributes"])
    for name, values in expected["attributes"].items():
        decoded = [None if np.isnan(value) else float(value) for value in mesh.attributes[name]]
        assert decoded == values


@pytest.mark.parametrize("path", COVERS, ids=[p.name for p in COVERS])
def test_cover(path: Path) -> None:
    expected = json.loads(path.with_suffix(".json").read_text())
    if "error" in expected:
        with pytest.raises(PayloadError, match=re.escape(expected["error"])):
            Cover.from_bytes(path.read_bytes(), expected["base_faces"])
        return
    cover = Cover.from_bytes(path.read_bytes(), expected["base_faces"])
    assert cover.offsets.tolist() == expected["offsets"]
    assert cover.segments.tolist() == expected["segments"]
    assert int(cover.segments.max(initial=0)) < expected["segment_count"]


def test_every_payload_has_its_pair() -> None:
    texts = {p.name.removesuffix(".json") for p in (HERE / "payload").glob("*.json")}
    assert texts == {p.name for p in PAYLOADS}
    assert sum(expected_of(path)["good"] for path in PAYLOADS) >= 6
