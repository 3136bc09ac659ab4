from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from terraport_pipeline.engines.mesh_files.read_mesh import read_mesh
from terraport_pipeline.errors import ReadError

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0]], float)


def write_glb(path: Path, change: Callable[[dict[str, Any]], object] | None = None) -> None:
    """A textured triangle, and what *change* makes of its description."""
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.new("RGB", (4, 4)))
    visual = trimesh.visual.TextureVisuals(uv=CORNERS[:, :2], material=material)
    mesh = trimesh.Trimesh(CORNERS, [[0, 1, 2]], visual=visual, process=False)
    data = bytes(mesh.export(file_type="glb"))
    if change is not None:
        (length,) = struct.unpack_from("<I", data, 12)
        tree = json.loads(data[20 : 20 + length])
        change(tree)
        text = json.dumps(tree).encode()
        text += b" " * (-len(text) % 4)
        rest = data[20 + length :]
        size = 20 + len(text) + len(rest)
        data = struct.pack("<4sIII4s", b"glTF", 2, size, len(text), b"JSON") + text + rest
    path.write_bytes(data)


def accessor(tree: dict[str, Any], name: str) -> dict[str, Any]:
    number = tree["meshes"][0]["primitives"][0]["attributes"][name]
    return tree["accessors"][number]  # type: ignore[no-any-return]


def texture(tree: dict[str, Any]) -> dict[str, Any]:
    return tree["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]  # type: ignore[no-any-return]


def transform(tree: dict[str, Any], **values: object) -> None:
    texture(tree)["extensions"] = {"KHR_texture_transform": values}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda tree: tree.update(extensionsRequired=["EXT_meshopt_compression"]),
            "requires EXT_meshopt_compression, which is not read",
        ),
        (
            lambda tree: tree.update(extensionsRequired=["KHR_draco_mesh_compression"]),
            r"compressed \(KHR_draco_mesh_compression\)",
        ),
        (
            lambda tree: accessor(tree, "TEXCOORD_0").update(componentType=5123, normalized=True),
            "TEXCOORD_0 holds integers",
        ),
        (
            lambda tree: accessor(tree, "POSITION").update(componentType=5122, normalized=True),
            "POSITION holds integers",
        ),
        (lambda tree: accessor(tree, "POSITION").update(sparse={}), "sparse accessor"),
        (lambda tree: transform(tree, scale=[0.5, 0.5]), "KHR_texture_transform"),
        (lambda tree: texture(tree).update(texCoord=1), "a second set"),
        (lambda tree: tree.update(accessors=3), "cannot be read"),
    ],
)
def test_what_would_be_read_as_something_else_is_refused(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], message: str
) -> None:
    path = tmp_path / "a.glb"
    write_glb(path, change)
    with pytest.raises(ReadError, match=message):
        read_mesh(path)


@pytest.mark.parametrize(
    "change",
    [
        None,
        lambda tree: tree.update(extensionsRequired=["KHR_materials_unlit"]),
        lambda tree: transform(tree, scale=[1, 1], offset=[0, 0]),
    ],
)
def test_what_says_nothing_else_is_read(
    tmp_path: Path, change: Callable[[dict[str, Any]], object] | None
) -> None:
    path = tmp_path / "a.glb"
    write_glb(path, change)
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces[0]], CORNERS)
    assert mesh.texture is not None


@pytest.mark.parametrize("data", [b"glTF", b"glTF" + bytes(16), b"<html>" + bytes(20)])
def test_what_is_no_glb(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "a.glb").write_bytes(data)
    with pytest.raises(ReadError, match=r"expected 2|begin as a GLB"):
        read_mesh(tmp_path / "a.glb")


def test_a_mirrored_node_shows_its_front_where_its_mesh_does(tmp_path: Path) -> None:
    """The sign of the determinant turns the winding (glTF 2.0, 3.7.4)."""
    scene = trimesh.Scene()
    scene.add_geometry(
        trimesh.Trimesh(CORNERS, [[0, 1, 2]], process=False), transform=np.diag([-1.0, 1, 1, 1])
    )
    scene.export(tmp_path / "a.glb")
    mesh = read_mesh(tmp_path / "a.glb")
    a, b, c = mesh.vertices[mesh.faces[0]]
    np.testing.assert_allclose(np.cross(b - a, c - a), [0, 0, 1])
