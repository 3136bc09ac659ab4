"""glTF files of two strips of ground, west and east, in any form that the format allows."""

from __future__ import annotations

import base64
import io
import json
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

SIDE_M = 12.0
CELLS = 6

Tree = dict[str, Any]


def strips() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Places (x east, y up, z south), texture coordinates, and faces of the west and the east."""
    line = np.linspace(0.0, SIDE_M, CELLS + 1)
    x, north = (grid.ravel() for grid in np.meshgrid(line, line))
    places = np.stack([x, 0.3 * np.sin(x), -north], axis=1).astype(np.float32)
    uvs = np.stack([x, SIDE_M - north], axis=1).astype(np.float32) / np.float32(SIDE_M)
    at = np.arange((CELLS + 1) ** 2).reshape(CELLS + 1, -1)
    a, b, c, d = (part.ravel() for part in (at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]))
    faces = np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])
    west = places[faces].mean(axis=1)[:, 0] < SIDE_M / 2
    return places, uvs, faces[west], faces[~west]


def picture(colour: object, mode: str = "RGB", form: str = "PNG") -> bytes:
    """An image of one colour."""
    data = io.BytesIO()
    Image.new(mode, (8, 8), colour).save(data, form)  # type: ignore[arg-type]
    return data.getvalue()


def pbr(factor: Sequence[float] | None = None, *, textured: bool = False) -> Tree:
    """A material by its base colour factor and the first texture."""
    base: Tree = {} if factor is None else {"baseColorFactor": [*factor, 1.0]}
    return {"pbrMetallicRoughness": base | ({"baseColorTexture": {"index": 0}} if textured else {})}


def write_gltf(
    path: Path,
    materials: Sequence[Tree],
    images: Sequence[bytes | Tree] = (),
    *,
    colours: np.ndarray | None = None,
    change: Callable[[Tree], object] = lambda _: None,
) -> Path:
    """Write a mesh whose two primitives share one list of vertices, and have a material each."""
    places, uvs, *faces = strips()
    chunks: list[bytes] = []
    tree: Tree = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}], "bufferViews": [], "accessors": [],
    }  # fmt: skip

    def view(data: bytes) -> int:
        start = sum(map(len, chunks))
        chunks.append(data + bytes(-len(data) % 4))
        tree["bufferViews"].append({"buffer": 0, "byteOffset": start, "byteLength": len(data)})
        return len(tree["bufferViews"]) - 1

    def accessor(values: np.ndarray, component: int, kind: str) -> int:
        tree["accessors"].append(
            {
                "bufferView": view(values.tobytes()), "componentType": component, "type": kind,
                "count": len(values), "normalized": values.dtype.kind == "u" and kind != "SCALAR",
            }
        )  # fmt: skip
        return len(tree["accessors"]) - 1

    attributes = {
        "POSITION": accessor(places, 5126, "VEC3"),
        "TEXCOORD_0": accessor(uvs, 5126, "VEC2"),
    }
    if colours is not None:
        component = {"f4": 5126, "u1": 5121, "u2": 5123}[colours.dtype.str[1:]]
        attributes["COLOR_0"] = accessor(colours, component, f"VEC{colours.shape[1]}")
    primitives: list[Tree] = []
    for number, some in enumerate(faces):
        indices = accessor(some.astype(np.uint32).ravel(), 5125, "SCALAR")
        primitives.append({"attributes": dict(attributes), "indices": indices})
        if materials:
            primitives[-1]["material"] = min(number, len(materials) - 1)
    tree["meshes"] = [{"primitives": primitives}]
    if materials:
        tree["materials"] = list(materials)
    if images:
        tree["images"] = [
            one if isinstance(one, dict) else {"bufferView": view(one), "mimeType": "image/png"}
            for one in images
        ]
        tree["textures"] = [{"source": number} for number in range(len(images))]
    data = b"".join(chunks)
    tree["buffers"] = [{"byteLength": len(data)}]
    change(tree)
    if path.suffix == ".gltf":
        uri = tree["buffers"][0].get("uri")
        if uri is None:
            encoded = base64.b64encode(data).decode()
            tree["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{encoded}"
        else:
            (path.parent / uri.replace("%20", " ")).write_bytes(data)
        path.write_text(json.dumps(tree))
        return path
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data))
    chunk = struct.pack("<II", len(data), 0x004E4942)
    path.write_bytes(head + struct.pack("<I4s", len(text), b"JSON") + text + chunk + data)
    return path
