from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from payload.images import ktx2, pillow, png
from store.tiny_scene import SCALES, STEP_M, lattice_mesh, textured

from terraport_payload import (
    PayloadError,
    SegmentMesh,
    decode_glb,
    encode_glb,
    snap_uvs,
)
from terraport_payload.glb_container import join_glb, split_glb

MESH = textured(lattice_mesh(0, 0, 3), pillow("JPEG"))


def encoded(mesh: SegmentMesh = MESH, **options: Any) -> bytes:
    return encode_glb(mesh, step_m=STEP_M, attribute_scales=SCALES, **options)


GOOD = encoded()
DOCUMENT, BINARY, _ = split_glb(GOOD)


@pytest.mark.parametrize("compress", [True, False])
@pytest.mark.parametrize(
    ("image", "extension"),
    [
        (pillow("JPEG"), None),
        (png(), None),
        (pillow("WEBP"), "EXT_texture_webp"),
        (ktx2(), "KHR_texture_basisu"),
    ],
)
def test_texture_comes_back_as_it_went(image: bytes, extension: str | None, compress: bool) -> None:
    mesh = textured(lattice_mesh(0, 0, 3), image)
    glb = encoded(mesh, compress=compress, keep_face_order=True)
    decoded = decode_glb(glb)
    assert decoded.texture == mesh.texture
    assert decoded.colours is None
    assert decoded.uvs is not None
    assert mesh.uvs is not None
    # Faces keep their order, corners may be rotated: compare corner sets by sorting.
    before = np.sort(mesh.uvs[mesh.faces].reshape(-1, 6), axis=1)
    after = np.sort(decoded.uvs[decoded.faces].reshape(-1, 6), axis=1)
    texture = mesh.texture
    assert texture is not None
    np.testing.assert_allclose(after, before, atol=0.251 / min(texture.width, texture.height))
    document, _, _ = split_glb(glb)
    assert ("COLOR_0" in json.dumps(document)) is False
    required = set(document["extensionsRequired"]) & {"EXT_texture_webp", "KHR_texture_basisu"}
    assert required == ({extension} if extension else set())


def test_texture_coordinates_are_half_texels() -> None:
    texture = MESH.texture
    assert texture is not None
    assert MESH.uvs is not None
    snapped = snap_uvs(MESH.uvs, texture.width, texture.height)
    texels = snapped * (texture.width, texture.height)
    assert (texels * 2 == np.rint(texels * 2)).all()
    again = decode_glb(encoded(replace(MESH, uvs=snapped), keep_face_order=True))
    assert again.uvs is not None
    assert {tuple(row) for row in again.uvs.tolist()} == {tuple(row) for row in snapped.tolist()}


def test_normalised_coordinates_of_other_writers_are_read() -> None:
    document, binary, _ = split_glb(encoded(compress=False))
    document = json.loads(json.dumps(document))
    texture_info = document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    (across, down) = texture_info.pop("extensions")["KHR_texture_transform"]["scale"]
    for key in ("extensionsUsed", "extensionsRequired"):
        document[key].remove("KHR_texture_transform")
    number = document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"]
    document["accessors"][number]["normalized"] = True
    decoded = decode_glb(join_glb(document, bytes(binary)))
    expected = decode_glb(encoded(compress=False))
    assert decoded.uvs is not None
    assert expected.uvs is not None
    codes = np.rint(expected.uvs / (across, down))
    np.testing.assert_allclose(decoded.uvs, codes / 65535, rtol=1e-6)


def test_image_lies_at_a_multiple_of_four_as_it_is() -> None:
    view = DOCUMENT["bufferViews"][DOCUMENT["images"][0]["bufferView"]]
    assert view["byteOffset"] % 4 == 0
    assert set(view) == {"buffer", "byteOffset", "byteLength"}
    start = view["byteOffset"]
    assert bytes(BINARY[start : start + view["byteLength"]]) == pillow("JPEG")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"texture": None}, "uvs and without texture"),
        ({"uvs": None}, "texture and without uvs"),
        ({"colours": np.zeros((16, 3), np.uint8)}, "glTF multiplies"),
        ({"uvs": np.zeros((16, 3), np.float32)}, "uvs is float32"),
        ({"uvs": np.full((16, 2), 1.01, np.float32)}, "expected 0 to 1"),
        ({"uvs": np.full((16, 2), np.nan, np.float32)}, "expected 0 to 1"),
    ],
)
def test_meshes_that_no_payload_carries(change: dict[str, Any], message: str) -> None:
    with pytest.raises(PayloadError, match=message):
        encoded(replace(MESH, **change))


def set_at(*path: Any) -> Callable[[dict[str, Any]], None]:
    *keys, last, value = path

    def change(document: dict[str, Any]) -> None:
        owner: Any = document
        for key in keys:
            owner = owner[key]
        owner[last] = value

    return change


VIEW = DOCUMENT["images"][0]["bufferView"]
SURFACE = ("materials", 0, "pbrMetallicRoughness")
TRANSFORM = (*SURFACE, "baseColorTexture", "extensions", "KHR_texture_transform")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (set_at("images", 0, "mimeType", "image/png"), "expected image/png by mimeType"),
        (set_at("images", 0, "mimeType", "image/webp"), "expected image/jpeg or image/png"),
        (set_at("images", 0, "mimeType", []), "image of type"),
        (set_at("images", 0, "bufferView", 99), "bufferView of image is 99"),
        (set_at("images", 0, "bufferView", True), "bufferView of image is True"),
        (set_at("images", 0, {"uri": "http://x/y.jpg"}), "image of type None"),
        (set_at("images", {}), "images is dict"),
        (set_at("textures", 0, {"source": 7}), "image is 7"),
        (set_at("textures", 0, {"extensions": {"EXT_texture_webp": 3}}), "is int, expected dict"),
        (set_at("textures", []), "texture is 0"),
        (set_at(*SURFACE, "baseColorTexture", {"index": 0, "texCoord": 1}), "another set"),
        (set_at(*SURFACE, "baseColorTexture", 5), "baseColorTexture is int"),
        (set_at(*SURFACE, "baseColorTexture", {"index": 0}), "TEXCOORD_0 must be normalised"),
        (set_at(*SURFACE, "baseColorTexture", "extensions", []), "expected dict"),
        (set_at(*SURFACE, "baseColorTexture", "extensions", {"A": 1}), "KHR_texture_transform is"),
        (set_at(*TRANSFORM, {"scale": [0.5, 0.5], "rotation": 1}), "expected a scale"),
        (set_at(*TRANSFORM, {"offset": [0, 0]}), "scale of KHR_texture_transform is NoneType"),
        (set_at(*TRANSFORM, "scale", [0.5]), "two numbers alone"),
        (set_at(*TRANSFORM, "scale", [0.5, "a"]), "two numbers alone"),
        (set_at(*TRANSFORM, "scale", [0.5, 0.3]), "powers of two up to 1"),
        (set_at(*TRANSFORM, "scale", [0.5, 2]), "powers of two up to 1"),
        (set_at(*TRANSFORM, "scale", [0.5, 1e-320]), "powers of two up to 1"),
        (set_at(*TRANSFORM, "scale", [0.5, 0.5]), "expected 0 to 1"),
        (set_at("materials", 0, "pbrMetallicRoughness", []), "is list, expected dict"),
        (set_at("bufferViews", VIEW, "byteLength", 1 << 27), "expected at most"),
        (set_at("bufferViews", VIEW, "byteLength", 1 << 25), "expected within"),
        (set_at("bufferViews", VIEW, "byteOffset", 3), "image starts with"),
        (set_at("bufferViews", VIEW, "buffer", 1), "expected 0"),
        (
            set_at("bufferViews", VIEW, "extensions", {"EXT_meshopt_compression": {}}),
            "compressed as geometry",
        ),
        (set_at("meshes", 0, "primitives", 0, "attributes", "TEXCOORD_0", 0), "TEXCOORD_0 is 5123"),
        (set_at("meshes", 0, "primitives", 0, "attributes", "TEXCOORD_0", None), "accessor of TEX"),
    ],
)
def test_broken_chains(change: Callable[[dict[str, Any]], None], message: str) -> None:
    document = json.loads(json.dumps(DOCUMENT))
    change(document)
    with pytest.raises(PayloadError, match=message):
        decode_glb(join_glb(document, bytes(BINARY)))


def test_colour_beside_a_texture_is_refused() -> None:
    coloured, binary, _ = split_glb(encoded(lattice_mesh(0, 0, 3), compress=False))
    document = json.loads(json.dumps(coloured))
    view = len(document["bufferViews"])
    data = pillow("JPEG")
    document["bufferViews"].append(
        {"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)}
    )
    document["images"] = [{"bufferView": view, "mimeType": "image/jpeg"}]
    document["textures"] = [{"source": 0}]
    document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    document["accessors"].append(dict(document["accessors"][attributes["_FEATURE_ID_0"]]))
    attributes["TEXCOORD_0"] = len(document["accessors"]) - 1
    document["accessors"][-1] |= {"type": "VEC2", "normalized": True}
    with pytest.raises(PayloadError, match="glTF multiplies"):
        decode_glb(join_glb(document, bytes(binary) + data))


@given(st.data())
@settings(max_examples=60)
def test_noise_gives_our_error_or_a_mesh(data: st.DataObject) -> None:
    raw = bytearray(GOOD)
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    with contextlib.suppress(PayloadError):
        decode_glb(bytes(raw))
