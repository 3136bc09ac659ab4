"""Read the GLBs that we write: for tests of what other programs are given.

Nothing is checked: the files are our own. ``tests/payload/test_khronos.py`` has them judged, and
read by another decoder.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import meshopt
import numpy as np

from terraport_payload import AttributeScale, SegmentMesh, Texture
from terraport_payload.colour import linear16_to_srgb
from terraport_payload.grid import decode_attribute

_KINDS = {5120: "<i1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def split_glb(data: bytes) -> tuple[dict[str, Any], bytes]:
    """The document and the BIN chunk of a GLB."""
    assert data[:4] == b"glTF"
    assert struct.unpack_from("<II", data, 4) == (2, len(data))
    (length,) = struct.unpack_from("<I", data, 12)
    (binary_length,) = struct.unpack_from("<I", data, 20 + length)
    assert (data[16:20], data[24 + length : 28 + length]) == (b"JSON", b"BIN\0")
    assert 28 + length + binary_length == len(data)
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def read_glb(data: bytes) -> SegmentMesh:
    """The mesh of a GLB with one mesh."""
    document, binary = split_glb(data)
    mesh = document["meshes"][0]
    primitive, node = mesh["primitives"][0], document["nodes"][0]
    attributes = primitive["attributes"]

    def read(number: int) -> Any:
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor["bufferView"]]
        packed = view["extensions"]["EXT_meshopt_compression"]
        start = packed["byteOffset"]
        rows = meshopt.decode_gltf_buffer(
            binary[start : start + packed["byteLength"]],
            packed["count"],
            packed["byteStride"],
            packed["mode"],
            packed.get("filter", "NONE"),
        )
        values = rows.reshape(-1).view(_KINDS[accessor["componentType"]])
        return values.reshape(accessor["count"], -1)[:, : _WIDTHS[accessor["type"]]]

    steps = read(attributes["POSITION"]).astype(np.float64)
    positions = steps * node.get("scale", [1, 1, 1]) + node.get("translation", [0, 0, 0])
    normals = read(attributes["NORMAL"]).astype(np.float32)
    colours = regions = uvs = texture = None
    if "COLOR_0" in attributes:
        colours = linear16_to_srgb(read(attributes["COLOR_0"])[:, :3])
    if "_FEATURE_ID_0" in attributes:
        regions = read(attributes["_FEATURE_ID_0"])[:, 0].copy()
    if "images" in document:
        view = document["bufferViews"][document["images"][0]["bufferView"]]
        start = view["byteOffset"]
        texture = Texture.of(binary[start : start + view["byteLength"]])
        used = document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
        scale = used["extensions"]["KHR_texture_transform"]["scale"]
        uvs = read(attributes["TEXCOORD_0"]).astype(np.float32) * np.float32(scale)
    rows = mesh.get("extras", {}).get("terraport", {}).get("attributes", [])
    return SegmentMesh(
        positions.astype(np.float32),
        read(primitive["indices"]).reshape(-1, 3).astype(np.uint32),
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
        colours,
        regions,
        {
            row["name"]: decode_attribute(
                read(attributes[row["gltf_name"]])[:, 0].copy(),
                AttributeScale(row["offset"], row["step"]),
            )
            for row in rows
        },
        uvs,
        texture,
    )
