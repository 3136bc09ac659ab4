"""Mesh to GLB.

Follows glTF 2.0 (Khronos, 2021) with ``KHR_mesh_quantization``, ``EXT_meshopt_compression`` (vertex
codec 0, index codec 1) and ``EXT_mesh_features``. Vertices and faces are put in the order that GPU
caches and the codec like (meshoptimizer's vertex cache and vertex fetch orders); the mesh stays the
same set of faces.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

import meshopt
import numpy as np

from terraport_payload.colour import srgb_to_linear16
from terraport_payload.errors import PayloadError
from terraport_payload.glb_container import join_glb
from terraport_payload.glb_texture import add_texture
from terraport_payload.grid import (
    MAX_CODE,
    NULL_CODE,
    AttributeScale,
    encode_attribute,
    grid_codes,
)
from terraport_payload.mesh import SegmentMesh
from terraport_payload.meshcheck import check_mesh
from terraport_payload.order import cache_order
from terraport_payload.types import AnyArray, Float32, UInt8, UInt16
from terraport_payload.uv import encode_uvs

__all__ = ["encode_glb", "glb_parts", "gltf_attribute_name"]

_BYTE: Final = 5120
_UNSIGNED_SHORT: Final = 5123
_UNSIGNED_INT: Final = 5125
_FLOAT: Final = 5126
"""glTF component types (section 3.6.2.2)."""

_SHORT_INDEX_VERTICES: Final = 65535
"""Most vertices with 16-bit indices: glTF reserves index 65535 for primitive restart."""

_NORMAL_BITS: Final = 8
"""Bits per octahedral coordinate: within 2 degrees once decoded to signed bytes."""

_ZERO_LENGTH: Final = 1e-6


class _Views:
    """Collects bufferViews and accessors, and the bytes they stand for."""

    def __init__(self) -> None:
        self.binary = bytearray()
        self.unpacked_bytes = 0
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(
        self,
        rows: AnyArray,
        accessor: dict[str, Any],
        *,
        mode: str = "ATTRIBUTES",
        filtered: tuple[str, UInt8] | None = None,
    ) -> int:
        """Append one array as its own bufferView and accessor; return the accessor's number.

        *rows* is (n, ...) with a multiple of 4 bytes a row for vertices, (n,) for indices;
        *filtered* is the codec filter's name and what it made of the rows.
        """
        stride = rows.nbytes // len(rows)
        raw: bytes = meshopt.encode_gltf_buffer(rows if filtered is None else filtered[1], mode, 0)
        packed: dict[str, Any] = {
            "buffer": 0,
            "byteOffset": len(self.binary),
            "byteLength": len(raw),
            "byteStride": stride,
            "mode": mode,
            "count": len(rows),
        }
        if filtered is not None:
            packed["filter"] = filtered[0]
        view: dict[str, Any] = {
            "buffer": 1,
            "byteOffset": self.unpacked_bytes,
            "byteLength": rows.nbytes,
            "extensions": {"EXT_meshopt_compression": packed},
        }
        if mode == "ATTRIBUTES":
            view["byteStride"] = stride
        self.binary += raw + bytes(-len(raw) % 4)
        self.unpacked_bytes += rows.nbytes + -rows.nbytes % 4
        self.accessors.append({"bufferView": len(self.views), "count": len(rows), **accessor})
        self.views.append(view)
        return len(self.accessors) - 1

    def add_bytes(self, data: bytes) -> int:
        """Append a file as it is; return its bufferView's number."""
        self.views.append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)})
        self.binary += data + bytes(-len(data) % 4)
        return len(self.views) - 1


def encode_glb(
    mesh: SegmentMesh,
    *,
    step_m: float,
    attribute_scales: Mapping[str, AttributeScale],
    unlit: bool = False,
) -> bytes:
    """Encode a mesh as GLB.

    Parameters
    ----------
    mesh : SegmentMesh
        Scene frame, metres. Never modified. Zero-length normals are written as up (0, 1, 0).
    step_m : float
        The scene's grid step, a power of two, metres. Positions are rounded to it, so the same
        vertex in two segments decodes to the same bits. A mesh wider than 65535 steps (a base mesh)
        keeps float32 positions, still rounded.
    attribute_scales : mapping of str to AttributeScale
        The scene's scale of every attribute of the mesh, by the survey's name; more are ignored.
    unlit : bool, optional
        Have the colours shown as they are, without any light.

    Returns
    -------
    bytes
        One GLB. Same input, same bytes.

    Raises
    ------
    PayloadError
        When arrays do not belong together, a scale is missing or too narrow, two attribute names
        become the same glTF name, step_m is not a power of two, or a position lies outside the
        grid.
    """
    document, binary = glb_parts(
        mesh,
        step_m=step_m,
        attribute_scales=attribute_scales,
        unlit=unlit,
    )
    return join_glb(document, binary)


def glb_parts(
    mesh: SegmentMesh,
    *,
    step_m: float,
    attribute_scales: Mapping[str, AttributeScale],
    unlit: bool = False,
) -> tuple[dict[str, Any], bytes]:
    """Make the glTF document and the BIN chunk of a mesh; arguments and errors as encode_glb's."""
    # Invariant: every array goes through `order`, so that row i of all of them is the same vertex.
    # (1) The scene's grid, and the order that caches and the codec like.
    check_mesh(mesh)
    codes = grid_codes(mesh.positions, step_m)
    faces, order = cache_order(mesh)
    codes = codes[order]
    low = codes.min(axis=0)
    out = _Views()
    node: dict[str, Any] = {"mesh": 0}
    attributes: dict[str, int] = {}

    # (2) Positions: 16 bits about the segment's corner, which the node moves back into the scene.
    if int((codes.max(axis=0) - low).max()) <= MAX_CODE:
        local = np.zeros((len(codes), 4), dtype="<u2")
        local[:, :3] = codes - low
        node["translation"] = (low * step_m).tolist()
        node["scale"] = [step_m] * 3
        attributes["POSITION"] = out.add(
            local,
            {
                "componentType": _UNSIGNED_SHORT,
                "type": "VEC3",
                "min": local[:, :3].min(axis=0).tolist(),
                "max": local[:, :3].max(axis=0).tolist(),
            },
        )
    else:
        # Whole steps below 2^24 are exact in float32, so nothing but size is lost against 16 bits.
        wide = (codes * step_m).astype("<f4")
        attributes["POSITION"] = out.add(
            wide,
            {
                "componentType": _FLOAT,
                "type": "VEC3",
                "min": wide.min(axis=0).tolist(),
                "max": wide.max(axis=0).tolist(),
            },
            filtered=_exponential(wide),
        )

    # (3) Normals, and colour as vertex colours or texture coordinates.
    normals = np.zeros((len(codes), 4), dtype=np.float32)
    normals[:, :3] = _unit(mesh.normals[order])
    attributes["NORMAL"] = out.add(
        np.zeros((len(codes), 4), dtype=np.int8),
        {"componentType": _BYTE, "normalized": True, "type": "VEC3"},
        filtered=("OCTAHEDRAL", meshopt.encode_filter_oct(normals, 4, _NORMAL_BITS)),
    )
    if mesh.colours is not None:
        linear = np.full((len(order), 4), 65535, dtype="<u2")
        linear[:, :3] = srgb_to_linear16(mesh.colours[order])
        attributes["COLOR_0"] = out.add(
            linear,
            {"componentType": _UNSIGNED_SHORT, "normalized": True, "type": "VEC4"},
        )
    if mesh.uvs is not None and mesh.texture is not None:
        attributes["TEXCOORD_0"] = out.add(
            encode_uvs(mesh.uvs[order], mesh.texture.width, mesh.texture.height),
            {"componentType": _UNSIGNED_SHORT, "type": "VEC2"},
        )
    # (4) Region ids and the survey's attributes, each two bytes in a row of four.
    scalar = {"componentType": _UNSIGNED_SHORT, "type": "SCALAR"}
    primitive: dict[str, Any] = {"attributes": attributes, "indices": 0, "material": 0}
    if mesh.region_ids is not None:
        attributes["_FEATURE_ID_0"] = out.add(_padded(mesh.region_ids[order]), dict(scalar))
        primitive["extensions"] = {
            "EXT_mesh_features": {
                "featureIds": [
                    {
                        "featureCount": len(np.unique(mesh.region_ids)),
                        "attribute": 0,
                        "label": "region",
                    }
                ]
            }
        }
    table: list[dict[str, Any]] = []
    for name, values in mesh.attributes.items():
        scale = attribute_scales.get(name)
        if scale is None:
            raise PayloadError(
                f"no scale for attribute {name!r}, expected one of {sorted(attribute_scales)}"
            )
        gltf_name = gltf_attribute_name(name)
        if gltf_name in attributes or gltf_name.startswith("_FEATURE_ID_"):
            raise PayloadError(
                f"attribute {name!r} becomes {gltf_name!r}, which is taken; rename it"
            )
        attributes[gltf_name] = out.add(
            _padded(encode_attribute(values[order], scale)), dict(scalar)
        )
        table.append(
            {
                "name": name,
                "gltf_name": gltf_name,
                "offset": scale.offset,
                "step": scale.step,
                "null": NULL_CODE,
            }
        )
    # (5) Indices, the image, and the document that names them all.
    short = len(order) <= _SHORT_INDEX_VERTICES
    primitive["indices"] = out.add(
        np.ascontiguousarray(faces.reshape(-1), dtype="<u2" if short else "<u4"),
        {"componentType": _UNSIGNED_SHORT if short else _UNSIGNED_INT, "type": "SCALAR"},
        mode="TRIANGLES",
    )
    # The image comes last: a reader that streams has the geometry first.
    image = None if mesh.texture is None else out.add_bytes(mesh.texture.data)
    document = _document(node, primitive, table, step_m, out, unlit=unlit)
    if mesh.texture is not None and image is not None:
        add_texture(document, mesh.texture, image)
    return document, bytes(out.binary)


def gltf_attribute_name(name: str) -> str:
    """Name of a survey's attribute inside a GLB.

    glTF asks application-specific attributes for a leading underscore and capitals.

    Parameters
    ----------
    name : str
        The survey's name.

    Returns
    -------
    str
        "_" and the upper-cased name, every character but A-Z, 0-9 and "_" replaced by "_".

    Examples
    --------
    >>> gltf_attribute_name("ore grade %")
    '_ORE_GRADE__'
    """
    return "_" + re.sub(r"[^A-Z0-9_]", "_", name.upper())


def _unit(normals: Float32) -> Float32:
    """Make normals unit length; zero ones become up."""
    length = np.linalg.norm(normals.astype(np.float64), axis=1)
    unit = np.zeros((len(normals), 3), dtype=np.float32)
    good = length > _ZERO_LENGTH
    unit[good] = normals[good] / length[good, None]
    unit[~good, 1] = 1.0
    return unit


def _padded(codes: UInt16) -> UInt16:
    """16-bit scalars in rows of four bytes: glTF aligns vertex attributes to four."""
    rows = np.zeros((len(codes), 2), dtype="<u2")
    rows[:, 0] = codes
    return rows


def _exponential(positions: Float32) -> tuple[str, UInt8] | None:
    """Put float32 positions in fixed point, half the bytes; None where that is not exact."""
    packed = meshopt.encode_filter_exp(positions, 24, "SharedComponent")
    mantissa = packed.view("<i4") << 8 >> 8
    exponent = packed.view("<i4") >> 24
    exact = np.ldexp(mantissa.astype(np.float32), exponent)
    return ("EXPONENTIAL", packed) if bool((exact == positions).all()) else None


def _document(
    node: dict[str, Any],
    primitive: dict[str, Any],
    table: list[dict[str, Any]],
    step_m: float,
    out: _Views,
    *,
    unlit: bool,
) -> dict[str, Any]:
    required = ["KHR_mesh_quantization", "EXT_meshopt_compression"]
    used = list(required)
    # Roughness is 1 by default. Double-sided: a reconstructed survey is an open sheet. Culled back
    # faces would make its rims and the inside of overhangs vanish when seen from behind, which in
    # VR reads as a hole in the world.
    material: dict[str, Any] = {"pbrMetallicRoughness": {"metallicFactor": 0}, "doubleSided": True}
    if unlit:
        material["extensions"] = {"KHR_materials_unlit": {}}
        used.append("KHR_materials_unlit")
    if "extensions" in primitive:
        used.append("EXT_mesh_features")
    ours: dict[str, Any] = {"step_m": step_m}
    if table:
        ours["attributes"] = table
    return {
        "asset": {"version": "2.0", "generator": "terraport"},
        "extensionsUsed": used,
        "extensionsRequired": required,
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node],
        "meshes": [{"primitives": [primitive], "extras": {"terraport": ours}}],
        "materials": [material],
        "accessors": out.accessors,
        "bufferViews": out.views,
        "buffers": [
            {"byteLength": len(out.binary)},
            {
                "byteLength": out.unpacked_bytes,
                "extensions": {"EXT_meshopt_compression": {"fallback": True}},
            },
        ],
    }
