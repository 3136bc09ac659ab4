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
from pipeline.engines.mesh_files.gltf_writer import pbr, picture, strips, write_gltf

from terraport_pipeline.engines.mesh_files.gltf_files import gltf_companions
from terraport_pipeline.engines.mesh_files.read_mesh import FileMesh, read_mesh
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


def halves(mesh: FileMesh) -> tuple[list[int], list[int]]:
    """Colour of the west and of the east, away from where they meet."""
    assert mesh.colours is not None
    middle = np.median(mesh.vertices[:, 0])
    west, east = mesh.vertices[:, 0] < middle, mesh.vertices[:, 0] > middle
    return tuple(
        np.median(mesh.colours[side], axis=0).astype(int).tolist() for side in (west, east)
    )  # type: ignore[return-value]


RED, GREEN = (0.6, 0.01, 0.01), (0.0, 0.2, 0.0)
RED_SRGB, GREEN_SRGB = [203, 25, 25], [0, 124, 0]
"""Of linear .6 and .01, and of .2 (IEC 61966-2-1)."""
SPECULAR = "KHR_materials_pbrSpecularGlossiness"


def by_column(west: object, east: object, kind: str) -> np.ndarray:
    places, *_ = strips()
    return np.where(places[:, :1] < 6.0, west, east).astype(kind)


@pytest.mark.parametrize(
    ("materials", "images", "colours", "west", "east", "origin"),
    [
        ([pbr(RED), pbr(GREEN)], [], None, RED_SRGB, GREEN_SRGB, "material"),
        (
            [{"extensions": {SPECULAR: {"diffuseFactor": [*RED, 1]}}}, pbr(GREEN)],
            [], None, RED_SRGB, GREEN_SRGB, "material",
        ),
        ([pbr(RED)], [], None, RED_SRGB, RED_SRGB, "material"),
        (
            [pbr(textured=True), pbr(GREEN)], [picture((200, 100, 50))], None,
            [200, 100, 50], GREEN_SRGB, "material and texture",
        ),
        (
            [pbr((0.5, 0.5, 0.5), textured=True)], [picture((200, 100, 50))], None,
            [146, 71, 34], [146, 71, 34], "texture",
        ),
        (
            [{"extensions": {SPECULAR: {"diffuseTexture": {"index": 0}}}}],
            [picture((200, 100, 50))], None, [200, 100, 50], [200, 100, 50], "texture",
        ),
        (
            [pbr((0.25, 0.25, 0.25))], [], by_column([255, 0, 0], [0, 0, 255], "u1"),
            [137, 0, 0], [0, 0, 137], "vertices",
        ),
        ([], [], by_column([255, 0, 9], [0, 70, 255], "u1"), [255, 0, 9], [0, 70, 255], "vertices"),
        (
            [], [], by_column([0.5, 0, 0, 1], [0, 0, 0.5, 1], "f4"),
            [188, 0, 0], [0, 0, 188], "vertices",
        ),
        (
            [], [], by_column([32768, 0, 0, 65535], [0, 0, 32768, 65535], "u2"),
            [188, 0, 0], [0, 0, 188], "vertices",
        ),
        ([pbr(textured=True)], [picture(40_000, "I;16")], None, [156] * 3, [156] * 3, "texture"),
        ([pbr(textured=True)], [picture((90, 255), "LA")], None, [90] * 3, [90] * 3, "texture"),
    ],
)  # fmt: skip
def test_base_colours_are_srgb(
    tmp_path: Path,
    materials: list[dict[str, Any]],
    images: list[bytes],
    colours: np.ndarray | None,
    west: list[int],
    east: list[int],
    origin: str,
) -> None:
    """Factor, texture and vertex colours, each alone and times one another; 8-bit vertex colours
    are taken for sRGB."""
    path = write_gltf(tmp_path / "a.glb", materials, images, colours=colours)
    mesh = read_mesh(path)
    np.testing.assert_allclose(halves(mesh), (west, east), atol=1)
    assert mesh.origin_of_colours == origin
    assert mesh.warnings == ()


@pytest.mark.parametrize(
    "materials", [[], [pbr((0.8, 0.8, 0.8))], [pbr((1, 1, 1)), pbr((1, 1, 1))]]
)
def test_one_grey_says_nothing(tmp_path: Path, materials: list[dict[str, Any]]) -> None:
    mesh = read_mesh(write_gltf(tmp_path / "a.glb", materials))
    assert (mesh.colours, mesh.origin_of_colours) == (None, "none")


def with_extension(name: str, place: Callable[[dict[str, Any]], dict[str, Any]]) -> Any:
    """Use an extension somewhere, without requiring it."""

    def change(tree: dict[str, Any]) -> None:
        tree["extensionsUsed"] = [name]
        place(tree).setdefault("extensions", {})[name] = {"center": [1, 2, 3]}

    return change


def as_ktx2(tree: dict[str, Any]) -> None:
    tree["extensionsUsed"] = ["KHR_texture_basisu"]
    tree["textures"] = [{"extensions": {"KHR_texture_basisu": {"source": 0}}}]


def draco_without_data(tree: dict[str, Any]) -> None:
    with_extension("KHR_draco_mesh_compression", lambda t: t["meshes"][0]["primitives"][0])(tree)
    tree["accessors"][0].pop("bufferView")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (with_extension("CESIUM_RTC", lambda tree: tree), r"centre \[1, 2, 3\] \(CESIUM_RTC\)"),
        (
            with_extension("EXT_mesh_gpu_instancing", lambda tree: tree["nodes"][0]),
            "EXT_mesh_gpu_instancing",
        ),
        (
            with_extension("EXT_meshopt_compression", lambda tree: tree["bufferViews"][0]),
            "EXT_meshopt_compression",
        ),
        (draco_without_data, "KHR_draco_mesh_compression"),
        (lambda tree: tree["accessors"][0].pop("bufferView"), "POSITION has no data"),
        (as_ktx2, "texture 0 .*KHR_texture_basisu.* is not read"),
        (lambda tree: tree["images"].__setitem__(0, {"uri": "b.png"}), "texture 0 .*b.png"),
        (
            lambda tree: tree["images"].__setitem__(0, {"uri": "../b.png"}),
            "texture 0 .*is not read",
        ),
        (lambda tree: tree["meshes"][0]["primitives"][0].update(mode=9), None),
        (
            lambda tree: [one.update(mode=6) for one in tree["meshes"][0]["primitives"]],
            "2 of 2 primitives .*fans",
        ),
    ],
)
def test_what_is_used_but_not_required_is_refused_by_name_too(
    tmp_path: Path, change: Any, message: str | None
) -> None:
    path = write_gltf(tmp_path / "a.glb", [pbr(textured=True)], [picture((9, 9, 9))], change=change)
    if message is None:
        assert "1 of 2 primitives" in read_mesh(path).warnings[0]
        return
    with pytest.raises(ReadError, match=message):
        read_mesh(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (with_extension("ACME_displacement", lambda tree: tree), "a.glb uses ACME_displacement"),
        (lambda tree: tree["materials"][0].update(alphaMode="MASK", name="leaf"), "material leaf"),
        (lambda tree: tree["nodes"][0].update(skin=0), "skeleton"),
        (
            lambda tree: tree["materials"].__setitem__(0, {"emissiveTexture": {"index": 0}}),
            "emissiveTexture",
        ),
        (with_extension("KHR_materials_sheen", lambda tree: tree["materials"][0]), None),
    ],
)
def test_what_is_left_out_is_told(tmp_path: Path, change: Any, words: str | None) -> None:
    images = [picture((9, 99, 9, 0), "RGBA")]
    path = write_gltf(tmp_path / "a.glb", [pbr(textured=True)], images, change=change)
    found = read_mesh(path).warnings
    assert [words in text for text in found] == [True] if words else not found  # type: ignore[operator]


def test_vertex_colours_on_top_of_a_texture_are_told(tmp_path: Path) -> None:
    path = write_gltf(
        tmp_path / "a.glb", [pbr(textured=True)], [picture((90, 90, 90))],
        colours=by_column([255, 0, 0], [0, 0, 255], "u1"),
    )  # fmt: skip
    mesh = read_mesh(path)
    assert halves(mesh) == ([90, 90, 90], [90, 90, 90])
    assert "COLOR_0" in mesh.warnings[0]


def test_webp_beside_a_fallback_and_a_fallback_beside_ktx2(tmp_path: Path) -> None:
    for name, want in (("EXT_texture_webp", 180), ("KHR_texture_basisu", 20)):

        def change(tree: dict[str, Any], name: str = name) -> None:
            tree["extensionsUsed"] = [name]
            tree["textures"] = [{"source": 0, "extensions": {name: {"source": 1}}}]

        other = picture((180, 180, 180), form="WEBP") if want == 180 else b"\xabKTX 20\xbb"
        images = [picture((20, 20, 20)), other]
        mesh = read_mesh(
            write_gltf(tmp_path / "a.glb", [pbr(textured=True)], images, change=change)
        )
        np.testing.assert_allclose(halves(mesh)[0], [want] * 3, atol=2)


def test_gltf_with_buffers_and_images_beside_it(tmp_path: Path) -> None:
    """Names as URIs have them (percent-encoded), in another case than on the disk."""
    (tmp_path / "west half.PNG").write_bytes(picture((10, 200, 30)))
    path = write_gltf(
        tmp_path / "a.gltf", [pbr(textured=True)], [{"uri": "West%20half.png"}],
        change=lambda tree: tree["buffers"][0].update(uri="a%20data.bin"),
    )  # fmt: skip
    assert halves(read_mesh(path)) == ([10, 200, 30], [10, 200, 30])
    companions = gltf_companions(path)
    assert [file.name for file in companions] == ["a data.bin", "west half.PNG"]
    (tmp_path / "a data.bin").unlink()
    with pytest.raises(ReadError, match=r"a%20data\.bin is missing"):
        read_mesh(path)
    whole = write_gltf(tmp_path / "b.gltf", [pbr(RED), pbr(GREEN)])
    assert halves(read_mesh(whole)) == (RED_SRGB, GREEN_SRGB)


@pytest.mark.parametrize("where", ["vertices", "node", "turned"])
def test_large_coordinates_in_32_bits_are_told(tmp_path: Path, where: str) -> None:
    """A node adds its place in 64 bits: nothing is lost. Turned upright it is lost all the same."""
    corners = CORNERS + np.array([500_000.3, 4_500_000.7, 300.0]) * (where != "node")
    matrix = np.eye(4)
    if where == "node":
        matrix[:3, 3] = [500_000.3, 4_500_000.7, 300.0]
    elif where == "turned":
        matrix = trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0])
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.Trimesh(corners, [[0, 1, 2]], process=False), transform=matrix)
    scene.export(tmp_path / "a.glb")
    found = read_mesh(tmp_path / "a.glb").warnings
    assert ["they move in steps of 0.5 m" in text for text in found] == [True] * (where != "node")


def test_texture_coordinates_beyond_the_edge_of_a_clamped_image(tmp_path: Path) -> None:
    def change(tree: dict[str, Any]) -> None:
        tree["samplers"] = [{"wrapS": 33071, "wrapT": 33071}]
        tree["textures"][0]["sampler"] = 0

    images = [picture((9, 9, 9))]
    path = write_gltf(tmp_path / "a.glb", [pbr(textured=True)], images, change=change)
    assert read_mesh(path).texture is not None
    data = path.read_bytes()
    uvs = strips()[1]
    path.write_bytes(data.replace(uvs.tobytes(), (uvs * np.float32(1.5)).tobytes()))
    with pytest.raises(ReadError, match="clamped or mirrored"):
        read_mesh(path)


def places_in(tree: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Keys that lead to every value within."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    found = []
    for key, value in items:
        found.append((*at, key))
        found += places_in(value, (*at, key)) if isinstance(value, dict | list) else []
    return found


def test_a_damaged_description_is_an_error_of_the_file(tmp_path: Path) -> None:
    """Any value in any place: read, or refused; nothing else breaks out."""
    path = write_gltf(
        tmp_path / "a.gltf", [pbr((0.5, 0.5, 0.5), textured=True)], [picture((9, 9, 9))]
    )
    whole = json.loads(path.read_text())
    rng = np.random.default_rng(4)
    places, values = places_in(whole), [None, -1, 99_999, "x", [], {}, 3.5, [[]]]
    refused = 0
    for number in rng.permutation(len(places) * len(values))[:150]:
        *way, last = places[number // len(values)]
        tree = json.loads(json.dumps(whole))
        held = tree
        for key in way:
            held = held[key]
        held[last] = values[number % len(values)]
        path.write_text(json.dumps(tree))
        try:
            gltf_companions(path)
            read_mesh(path)
        except ReadError:
            refused += 1
    assert refused > 30
