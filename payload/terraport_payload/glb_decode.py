"""GLB to mesh, for the profile of ``spec/scene-format.md``; safe on hostile bytes.

Every count, offset and length is checked against the bytes at hand before anything is allocated: a
codec cannot expand by more than 64 (vertices) or 12 (indices), so a payload of n bytes never makes
more than about 64 n.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import math
from typing import Any, Final

import meshopt
import numpy as np

from terraport_payload.colour import linear16_to_srgb
from terraport_payload.errors import PayloadError
from terraport_payload.glb_container import split_glb
from terraport_payload.glb_encode import (
    BYTE,
    FLOAT,
    UNSIGNED_INT,
    UNSIGNED_SHORT,
)
from terraport_payload.glb_json import only, pick, typed
from terraport_payload.glb_texture import (
    IMAGE_EXTENSIONS,
    UV_TRANSFORM,
    decode_uvs,
    find_image,
    find_uv_scale,
)
from terraport_payload.grid import NULL_CODE, AttributeScale, decode_attribute
from terraport_payload.mesh import SegmentMesh
from terraport_payload.meshcheck import check_mesh
from terraport_payload.texture import MAX_IMAGE_BYTES, Texture
from terraport_payload.types import AnyArray, Float32, Float64, Int8, UInt8

__all__ = ["decode_glb"]

_KNOWN: Final = frozenset(
    {
        "KHR_mesh_quantization",
        "EXT_meshopt_compression",
        "EXT_mesh_features",
        UV_TRANSFORM,
        *IMAGE_EXTENSIONS.values(),
    }
)
_MAX_ROWS: Final = 1 << 27
"""134 M vertices or indices in one payload: far above any segment, a bound for arithmetic."""

_VERTEX_EXPANSION: Final = 64
"""Vertex codec 0 spends at least 4 bytes a channel per block of up to 256 rows."""

_ITEM: Final = {BYTE: "<i1", UNSIGNED_SHORT: "<u2", UNSIGNED_INT: "<u4", FLOAT: "<f4"}
_WIDTH: Final = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def decode_glb(data: bytes | memoryview) -> SegmentMesh:
    """Decode one GLB payload.

    Parameters
    ----------
    data : bytes or memoryview
        The whole GLB; compressed or not.

    Returns
    -------
    SegmentMesh
        Scene frame, metres; arrays of its own.

    Raises
    ------
    PayloadError
        For anything that is not a whole GLB of the profile: never another exception, whatever the
        bytes.
    """
    document, binary, at = split_glb(data)
    reader = _Reader(document, binary, at)
    required = document.get("extensionsRequired", [])
    for name in typed(required, list, "extensionsRequired"):
        if not isinstance(name, str) or name not in _KNOWN:
            raise PayloadError(f"required extension {name!r}, expected one of {sorted(_KNOWN)}")
    mesh = typed(only(document, "meshes"), dict, "mesh")
    primitive = typed(only(mesh, "primitives"), dict, "primitive")
    if primitive.get("mode", 4) != 4:
        raise PayloadError(f"primitive mode {primitive.get('mode')!r}, expected 4 (triangles)")
    attributes = typed(primitive.get("attributes"), dict, "attributes")

    positions, quantised = reader.positions(attributes.get("POSITION"))
    translation, scale = _transform(typed(only(document, "nodes"), dict, "node"))
    if not quantised and (translation.any() or (scale != 1.0).any()):
        raise PayloadError("float positions with a node transform, expected none")
    indices = reader.accessor(
        primitive.get("indices"), (UNSIGNED_SHORT, UNSIGNED_INT), "SCALAR", "indices"
    )
    if len(indices) % 3:
        raise PayloadError(f"{len(indices)} indices, expected a multiple of 3")
    colours = region_ids = uvs = None
    if "COLOR_0" in attributes:
        linear = reader.accessor(attributes["COLOR_0"], (UNSIGNED_SHORT,), "VEC4", "COLOR_0")
        colours = linear16_to_srgb(linear[:, :3])
    if "_FEATURE_ID_0" in attributes:
        region_ids = reader.accessor(
            attributes["_FEATURE_ID_0"], (UNSIGNED_SHORT,), "SCALAR", "_FEATURE_ID_0"
        ).copy()
    texture = None
    image = find_image(document, primitive)
    if image is not None:
        texture = reader.image(*image)
        codes = reader.accessor(
            attributes.get("TEXCOORD_0"), (UNSIGNED_SHORT,), "VEC2", "TEXCOORD_0"
        )
        uv_scale = find_uv_scale(document, primitive)
        if (uv_scale is None) != reader.normalised(attributes["TEXCOORD_0"]):
            raise PayloadError(
                "TEXCOORD_0 must be normalised without a transform, and not with one"
            )
        uvs = decode_uvs(codes, uv_scale)
    with np.errstate(over="ignore"):  # a hostile transform gives infinity, which check_mesh names
        placed = (translation + scale * positions.astype(np.float64)).astype(np.float32)
    result = SegmentMesh(
        positions=placed,
        faces=indices.reshape(-1, 3).astype(np.uint32),
        normals=_unit(reader.accessor(attributes.get("NORMAL"), (BYTE,), "VEC3", "NORMAL")),
        colours=colours,
        region_ids=region_ids,
        attributes={
            name: decode_attribute(
                reader.accessor(attributes.get(gltf_name), (UNSIGNED_SHORT,), "SCALAR", gltf_name),
                scale_of,
            )
            for name, gltf_name, scale_of in _attribute_table(mesh)
        },
        uvs=uvs,
        texture=texture,
    )
    check_mesh(result)
    return result


class _Reader:
    """Reads accessors out of the BIN chunk."""

    def __init__(self, document: dict[str, Any], binary: memoryview, at: int) -> None:
        self._views = typed(document.get("bufferViews"), list, "bufferViews")
        self._accessors = typed(document.get("accessors"), list, "accessors")
        self._binary = binary
        self._at = at

    def positions(self, number: object) -> tuple[AnyArray, bool]:
        values = self.accessor(number, (UNSIGNED_SHORT, FLOAT), "VEC3", "POSITION")
        return values, values.dtype == np.dtype("<u2")

    def accessor(
        self, number: object, component_types: tuple[int, ...], kind: str, label: str
    ) -> AnyArray:
        """Read one accessor as (n,) or (n, k)."""
        accessor = typed(pick(self._accessors, number, f"accessor of {label}"), dict, "accessor")
        component = accessor.get("componentType")
        if component not in component_types or accessor.get("type") != kind:
            raise PayloadError(
                f"{label} is {component!r} {accessor.get('type')!r}, expected {kind} of "
                + " or ".join(map(str, component_types))
            )
        if (
            _whole(accessor.get("byteOffset", 0), f"byteOffset of {label}", 0)
            or "sparse" in accessor
        ):
            raise PayloadError(
                f"{label} has an offset inside its bufferView or is sparse, expected neither"
            )
        count = _whole(accessor.get("count"), f"count of {label}", 1)
        view = typed(
            pick(self._views, accessor.get("bufferView"), f"bufferView of {label}"),
            dict,
            "bufferView",
        )
        item = np.dtype(_ITEM[component])
        width = _WIDTH[kind]
        vertex = label != "indices"
        stride = width * item.itemsize
        if vertex:
            stride = _whole(view.get("byteStride"), f"byteStride of {label}", stride)
            if stride > 16 or stride % 4:
                raise PayloadError(f"byteStride of {label} is {stride}, expected 4, 8, 12 or 16")
        if _whole(view.get("byteLength"), f"byteLength of {label}", 1) != count * stride:
            raise PayloadError(
                f"bufferView of {label} has {view['byteLength']} bytes, "
                f"expected {count} rows of {stride}"
            )
        raw = self._rows(view, count, stride, vertex=vertex, label=label)
        if not vertex:
            return np.frombuffer(raw, dtype=item)
        table = np.frombuffer(raw, dtype=item).reshape(count, stride // item.itemsize)
        return table[:, 0] if width == 1 else table[:, :width]

    def normalised(self, number: int) -> bool:
        """Tell whether an accessor that was read states that its integers are fractions."""
        return self._accessors[number].get("normalized", False) is True

    def image(self, number: object, media_type: str) -> Texture:
        """Read a bufferView that holds an image file as it is."""
        label = "image"
        view = typed(pick(self._views, number, f"bufferView of {label}"), dict, "bufferView")
        length = _whole(view.get("byteLength"), f"byteLength of {label}", 1)
        if length > MAX_IMAGE_BYTES:
            raise PayloadError(f"{label} of {length} bytes, expected at most {MAX_IMAGE_BYTES}")
        if "EXT_meshopt_compression" in typed(view.get("extensions", {}), dict, "extensions"):
            raise PayloadError(f"{label} is compressed as geometry, expected a file as it is")
        texture = Texture.of(bytes(self._slice(view, length, label)))
        if texture.media_type != media_type:
            raise PayloadError(f"image is {texture.media_type}, expected {media_type} by mimeType")
        return texture

    def _rows(
        self, view: dict[str, Any], count: int, stride: int, *, vertex: bool, label: str
    ) -> UInt8 | memoryview:
        extensions = typed(view.get("extensions", {}), dict, "extensions")
        if "EXT_meshopt_compression" not in extensions:
            return self._slice(view, count * stride, label)
        packed = typed(extensions["EXT_meshopt_compression"], dict, "EXT_meshopt_compression")
        mode = "ATTRIBUTES" if vertex else "TRIANGLES"
        found = packed.get("mode"), packed.get("count"), packed.get("byteStride")
        if found != (mode, count, stride):
            raise PayloadError(
                f"{label} is compressed as {found}, expected {(mode, count, stride)}"
            )
        length = _whole(packed.get("byteLength"), f"compressed bytes of {label}", 1)
        least = count * stride // _VERTEX_EXPANSION if vertex else count // 3
        if length < least:
            raise PayloadError(
                f"{length} compressed bytes for {count} rows of {label}, expected at least {least}",
                offset=self._at,
            )
        name = packed.get("filter", "NONE")
        allowed = {"NORMAL": ("NONE", "OCTAHEDRAL"), "POSITION": ("NONE", "EXPONENTIAL")}.get(
            label, ("NONE",)
        )
        if name not in allowed or (name == "OCTAHEDRAL" and stride != 4):
            raise PayloadError(f"filter {name!r} of {label}, expected one of {allowed}")
        raw = self._slice(packed, length, label)
        if raw[0] != (0xA0 if vertex else 0xE1):
            raise PayloadError(
                f"codec byte {raw[0]:#04x} of {label}, expected {'0xa0' if vertex else '0xe1'}",
                offset=self._at + int(packed["byteOffset"]),
            )
        try:
            decoded = meshopt.decode_gltf_buffer(raw, count, stride, mode, name)
        except (ValueError, RuntimeError, MemoryError) as error:
            raise PayloadError(
                f"{label} does not decompress: {error}", offset=self._at + int(packed["byteOffset"])
            ) from None
        return np.ascontiguousarray(decoded).view(np.uint8).reshape(-1)

    def _slice(self, where: dict[str, Any], length: int, label: str) -> memoryview:
        if where.get("buffer") != 0:
            raise PayloadError(
                f"{label} is in buffer {where.get('buffer')!r}, expected 0 (the BIN chunk)"
            )
        offset = _whole(where.setdefault("byteOffset", 0), f"byteOffset of {label}", 0)
        if offset > len(self._binary) or length > len(self._binary) - offset:
            raise PayloadError(
                f"{label} lies at {offset} with {length} bytes, "
                f"expected within {len(self._binary)}",
                offset=self._at,
            )
        return self._binary[offset : offset + length]


def _attribute_table(mesh: dict[str, Any]) -> list[tuple[str, str, AttributeScale]]:
    extras = typed(mesh.get("extras", {}), dict, "extras")
    ours = typed(extras.get("terraport", {}), dict, "extras.terraport")
    rows: list[tuple[str, str, AttributeScale]] = []
    for entry in typed(ours.get("attributes", []), list, "extras.terraport.attributes"):
        row = typed(entry, dict, "attribute")
        name, gltf_name = row.get("name"), row.get("gltf_name")
        if not (isinstance(name, str) and isinstance(gltf_name, str) and gltf_name.startswith("_")):
            raise PayloadError(f"attribute names {name!r}, {gltf_name!r}, expected text and _TEXT")
        if row.get("null", NULL_CODE) != NULL_CODE:
            raise PayloadError(f"null code {row['null']!r} of {name!r}, expected {NULL_CODE}")
        scale = AttributeScale(_number(row.get("offset"), name), _number(row.get("step"), name))
        rows.append((name, gltf_name, scale))
    return rows


def _transform(node: dict[str, Any]) -> tuple[Float64, Float64]:
    if "matrix" in node or "rotation" in node:
        raise PayloadError("node has a matrix or rotation, expected translation and scale alone")
    translation = _triple(node.get("translation", [0, 0, 0]), "translation")
    scale = _triple(node.get("scale", [1, 1, 1]), "scale")
    if not (scale > 0).all():
        raise PayloadError(f"node scale {scale.tolist()}, expected positive numbers")
    return translation, scale


def _unit(signed: Int8) -> Float32:
    values = np.maximum(signed.astype(np.float32) / np.float32(127.0), np.float32(-1.0))
    length = np.linalg.norm(values, axis=1, keepdims=True)
    if not bool((length > 0).all()):
        raise PayloadError(f"normal {int(np.argmin(length))} has length 0, expected 1")
    unit: Float32 = (values / length).astype(np.float32)
    return unit


def _whole(value: object, label: str, least: int) -> int:
    if (
        isinstance(value, bool)
        or not isinstance(value, int)
        or not least <= value <= _MAX_ROWS * 16
    ):
        raise PayloadError(
            f"{label} is {value!r}, expected a whole number from {least} to {_MAX_ROWS * 16}"
        )
    return value


def _number(value: object, label: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise PayloadError(f"{label} is {value!r}, expected a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise PayloadError(f"{label} is not finite, expected a finite number")
    return number


def _triple(value: object, label: str) -> Float64:
    values = typed(value, list, label)
    if len(values) != 3:
        raise PayloadError(f"{label} has {len(values)} numbers, expected 3")
    return np.array([_number(part, label) for part in values], dtype=np.float64)
