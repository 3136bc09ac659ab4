"""GLB to mesh, for the profile of ``spec/scene-format.md``; safe on hostile bytes.

Every count, offset and length is checked against the bytes at hand before anything is allocated: a
codec cannot expand by more than 64 (vertices) or 12 (indices), so a payload of n bytes never makes
more than about 64 n.

Speed: NumPy's inner loop runs along the shortest stride, so an operation on (V, 3) is V loops of
three steps; here every column is worked on by itself. Labels of errors are put together only where
there is an error.

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
from terraport_payload.types import AnyArray, Float32, Int8

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
_MOST: Final = 16 << 27
"""134 M vertices of 16 bytes in one payload: far above any segment, a bound for arithmetic."""

_VERTEX_EXPANSION: Final = 64
"""Vertex codec 0 spends at least 4 bytes a channel per block of up to 256 rows."""

_ITEM: Final[dict[Any, np.dtype[Any]]] = {
    BYTE: np.dtype("<i1"),
    UNSIGNED_SHORT: np.dtype("<u2"),
    UNSIGNED_INT: np.dtype("<u4"),
    FLOAT: np.dtype("<f4"),
}
_WIDTH: Final = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_BYTE_ONE: Final = np.float32(127.0)
"""What stands for 1 in normalised signed bytes."""

_FILTERS: Final = {"NORMAL": ("NONE", "OCTAHEDRAL"), "POSITION": ("NONE", "EXPONENTIAL")}


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
    # Invariant: nothing of the document is used before its type and range are checked, and no array
    # is made that its bytes in the BIN chunk cannot fill.
    # (1) The one mesh, with nothing required that we do not know.
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

    # (2) Codes: positions, faces, and what the mesh may have besides.
    codes = reader.accessor(attributes.get("POSITION"), (UNSIGNED_SHORT, FLOAT), "VEC3", "POSITION")
    translation, scale = _transform(typed(only(document, "nodes"), dict, "node"))
    if codes.dtype.kind == "f" and (any(translation) or scale != [1.0, 1.0, 1.0]):
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
    # (3) The image, and coordinates only where there is one.
    texture = None
    image = find_image(document, primitive)
    if image is not None:
        texture = reader.image(*image)
        uv_codes = reader.accessor(
            attributes.get("TEXCOORD_0"), (UNSIGNED_SHORT,), "VEC2", "TEXCOORD_0"
        )
        uv_scale = find_uv_scale(document, primitive)
        if (uv_scale is None) != reader.normalised(attributes["TEXCOORD_0"]):
            raise PayloadError(
                "TEXCOORD_0 must be normalised without a transform, and not with one"
            )
        uvs = decode_uvs(uv_codes, uv_scale)
    # (4) Codes to values; only then do counts and indices have to agree with each other.
    result = SegmentMesh(
        positions=_scene_positions(codes, translation, scale),
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

    def accessor(
        self, number: object, component_types: tuple[int, ...], kind: str, label: str
    ) -> AnyArray:
        """Read one accessor as (n,) or (n, k).

        The array may be a view of the payload, or have gaps between rows.
        """
        accessor = typed(pick(self._accessors, number, "accessor of", label), dict, "accessor")
        component = accessor.get("componentType")
        if component not in component_types or accessor.get("type") != kind:
            raise PayloadError(
                f"{label} is {component!r} {accessor.get('type')!r}, expected {kind} of "
                + " or ".join(map(str, component_types))
            )
        if _whole(accessor.get("byteOffset", 0), "byteOffset of", label, 0) or "sparse" in accessor:
            raise PayloadError(
                f"{label} has an offset inside its bufferView or is sparse, expected neither"
            )
        count = _whole(accessor.get("count"), "count of", label, 1)
        view = typed(
            pick(self._views, accessor.get("bufferView"), "bufferView of", label),
            dict,
            "bufferView",
        )
        item = _ITEM[component]
        width = _WIDTH[kind]
        vertex = label != "indices"
        stride = width * item.itemsize
        if vertex:
            stride = _whole(view.get("byteStride"), "byteStride of", label, stride)
            if stride > 16 or stride % 4:
                raise PayloadError(f"byteStride of {label} is {stride}, expected 4, 8, 12 or 16")
        if _whole(view.get("byteLength"), "byteLength of", label, 1) != count * stride:
            raise PayloadError(
                f"bufferView of {label} has {view['byteLength']} bytes, "
                f"expected {count} rows of {stride}"
            )
        rows = self._rows(view, count, stride, vertex=vertex, label=label).view(item)
        if not vertex:
            return rows.reshape(-1)
        return rows[:, 0] if width == 1 else rows[:, :width]

    def normalised(self, number: int) -> bool:
        """Tell whether an accessor that was read states that its integers are fractions."""
        return self._accessors[number].get("normalized", False) is True

    def image(self, number: object, media_type: str) -> Texture:
        """Read a bufferView that holds an image file as it is."""
        label = "image"
        view = typed(pick(self._views, number, "bufferView of", label), dict, "bufferView")
        length = _whole(view.get("byteLength"), "byteLength of", label, 1)
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
    ) -> AnyArray:
        """Read the rows of a bufferView, (count, stride) bytes; indices may come as themselves."""
        extensions = typed(view.get("extensions", {}), dict, "extensions")
        if "EXT_meshopt_compression" not in extensions:
            raw = self._slice(view, count * stride, label)
            return np.frombuffer(raw, dtype=np.uint8).reshape(count, stride)
        packed = typed(extensions["EXT_meshopt_compression"], dict, "EXT_meshopt_compression")
        mode = "ATTRIBUTES" if vertex else "TRIANGLES"
        layout = packed.get("mode"), packed.get("count"), packed.get("byteStride")
        if layout != (mode, count, stride):
            raise PayloadError(
                f"{label} is compressed as {layout}, expected {(mode, count, stride)}"
            )
        length = _whole(packed.get("byteLength"), "compressed bytes of", label, 1)
        least = count * stride // _VERTEX_EXPANSION if vertex else count // 3
        if length < least:
            raise PayloadError(
                f"{length} compressed bytes for {count} rows of {label}, expected at least {least}",
                offset=self._at,
            )
        name = packed.get("filter", "NONE")
        allowed = _FILTERS.get(label, ("NONE",))
        if name not in allowed or (name == "OCTAHEDRAL" and stride != 4):
            raise PayloadError(f"filter {name!r} of {label}, expected one of {allowed}")
        raw = self._slice(packed, length, label)
        if raw[0] != (0xA0 if vertex else 0xE1):
            raise PayloadError(
                f"codec byte {raw[0]:#04x} of {label}, expected {'0xa0' if vertex else '0xe1'}",
                offset=self._at + int(packed["byteOffset"]),
            )
        try:
            decoded: AnyArray = meshopt.decode_gltf_buffer(raw, count, stride, mode, name)
        except (ValueError, RuntimeError, MemoryError) as error:
            raise PayloadError(
                f"{label} does not decompress: {error}", offset=self._at + int(packed["byteOffset"])
            ) from None
        return decoded

    def _slice(self, where: dict[str, Any], length: int, label: str) -> memoryview:
        if where.get("buffer") != 0:
            raise PayloadError(
                f"{label} is in buffer {where.get('buffer')!r}, expected 0 (the BIN chunk)"
            )
        offset = _whole(where.setdefault("byteOffset", 0), "byteOffset of", label, 0)
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


def _transform(node: dict[str, Any]) -> tuple[list[float], list[float]]:
    """Read a node's translation and scale, three finite numbers each."""
    if "matrix" in node or "rotation" in node:
        raise PayloadError("node has a matrix or rotation, expected translation and scale alone")
    translation = _triple(node.get("translation", [0, 0, 0]), "translation")
    scale = _triple(node.get("scale", [1, 1, 1]), "scale")
    if not min(scale) > 0:
        raise PayloadError(f"node scale {scale}, expected positive numbers")
    return translation, scale


def _scene_positions(codes: AnyArray, translation: list[float], scale: list[float]) -> Float32:
    """Bring position codes, (V, 3), to the scene frame: float64 throughout, rounded once."""
    positions = np.empty(codes.shape, dtype=np.float32)
    columns = codes.T.astype(np.float64, order="C")
    factors = np.array((scale, translation)).reshape(2, 3, 1)
    with np.errstate(over="ignore"):  # a hostile transform gives infinity, which check_mesh names
        columns *= factors[0]
        columns += factors[1]
        for axis in range(3):
            positions[:, axis] = columns[axis]
    return positions


def _unit(signed: Int8) -> Float32:
    """Bring normals of signed bytes, (V, 3), to length 1.

    The sum of squares goes x, y, z in float32, as ``np.linalg.norm`` has it: the same bits.
    """
    codes = signed.T.astype(np.int8, order="C")
    if b"\x80" in codes.tobytes():  # searching costs a fifth of np.maximum, and few have one
        np.maximum(codes, -127, out=codes)  # glTF: -128 stands for -1 too
    columns = codes.astype(np.float32)
    columns /= _BYTE_ONE
    squares = columns * columns
    length = squares[0]
    length += squares[1]
    length += squares[2]
    np.sqrt(length, out=length)
    shortest = int(length.argmin())
    if not length[shortest] > 0:
        raise PayloadError(f"normal {shortest} has length 0, expected 1")
    columns /= length
    unit = np.empty(signed.shape, dtype=np.float32)
    for axis in range(3):
        unit[:, axis] = columns[axis]
    return unit


def _whole(value: object, noun: str, label: str, least: int) -> int:
    """Return *value* if it is a whole number from *least* on; *noun* and *label* name it if not."""
    if type(value) is int and least <= value <= _MOST:  # not isinstance: a bool is an int
        return value
    raise PayloadError(
        f"{noun} {label} is {value!r}, expected a whole number from {least} to {_MOST}"
    )


def _number(value: object, label: str) -> float:
    if type(value) is float and -math.inf < value < math.inf:  # nearly always; the rest judges
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise PayloadError(f"{label} is {value!r}, expected a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise PayloadError(f"{label} is not finite, expected a finite number")
    return number


def _triple(value: object, label: str) -> list[float]:
    values = typed(value, list, label)
    if len(values) != 3:
        raise PayloadError(f"{label} has {len(values)} numbers, expected 3")
    return [_number(number, label) for number in values]
