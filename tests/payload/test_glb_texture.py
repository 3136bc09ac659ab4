from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from glb_file import read_glb, split_glb
from payload.images import ktx2, pillow, png
from store.tiny_scene import SCALES, STEP_M, lattice_mesh, textured

from terraport_payload import (
    PayloadError,
    SegmentMesh,
    encode_glb,
    snap_uvs,
)
from terraport_payload.order import cache_order

MESH = textured(lattice_mesh(0, 0, 3), pillow("JPEG"))


def encoded(mesh: SegmentMesh = MESH, **options: Any) -> bytes:
    return encode_glb(mesh, step_m=STEP_M, attribute_scales=SCALES, **options)


GOOD = encoded()
DOCUMENT, BINARY = split_glb(GOOD)


@pytest.mark.parametrize(
    ("image", "extension"),
    [
        (pillow("JPEG"), None),
        (png(), None),
        (pillow("WEBP"), "EXT_texture_webp"),
        (ktx2(), "KHR_texture_basisu"),
    ],
)
def test_texture_comes_back_as_it_went(image: bytes, extension: str | None) -> None:
    mesh = textured(lattice_mesh(0, 0, 3), image)
    glb = encoded(mesh)
    decoded = read_glb(glb)
    assert decoded.texture == mesh.texture
    assert decoded.colours is None
    assert decoded.uvs is not None
    assert mesh.uvs is not None
    texture = mesh.texture
    assert texture is not None
    _, order = cache_order(mesh)
    error = 0.251 / min(texture.width, texture.height)
    np.testing.assert_allclose(decoded.uvs, mesh.uvs[order], atol=error)
    document, _ = split_glb(glb)
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
    again = read_glb(encoded(replace(MESH, uvs=snapped)))
    assert again.uvs is not None
    assert {tuple(row) for row in again.uvs.tolist()} == {tuple(row) for row in snapped.tolist()}


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
