"""Segment format 2: one mesh as a short head, one gzip stream of planes, and its image.

Described in ``spec/segment-format.md``: segments, base and overview of a scene. Lossless on the
scene's grid and scales, but for normals, which are rounded to 1.1 degrees (4.5 where an image is
drawn without light).

PURE: no I/O, no clock.
"""

from __future__ import annotations

import gzip
import math
import struct
import zlib
from collections.abc import Mapping
from typing import Final

import numpy as np

from terraport_payload.errors import PayloadError
from terraport_payload.grid import (
    MAX_STEPS,
    AttributeScale,
    decode_attribute,
    encode_attribute,
    grid_codes,
)
from terraport_payload.mesh import SegmentMesh
from terraport_payload.meshcheck import check_mesh
from terraport_payload.texture import MAX_IMAGE_BYTES, Texture
from terraport_payload.types import (
    AnyInt,
    Bool,
    Float32,
    Float64,
    Int32,
    Int64,
    UInt8,
    UInt16,
    UInt32,
)
from terraport_payload.uv import decode_uvs, encode_uvs

__all__ = [
    "MAX_ATTRIBUTES",
    "MAX_STREAM_BYTES",
    "decode_segment",
    "encode_segment",
    "segment_bounds",
    "segment_texture",
]

MAX_ATTRIBUTES: Final = 32
"""Attributes of a scene: a segment has a bit for each."""

MAX_STREAM_BYTES: Final = 1 << 28
"""Of the planes, not compressed: 16 million vertices. Bounds what a few bytes can become."""

_OUTER: Final = struct.Struct("<4sII")
_MAGIC: Final = b"TSG2"
_HEAD: Final = struct.Struct("<IIiiibBBxHHHxxII")
_COLOURS, _UVS, _REGIONS, _WIDE = 1, 2, 4, 8
_IMAGES: Final = ("image/jpeg", "image/png", "image/webp", "image/ktx2")
_POLE: Final = 127
_TEXTURED_NORMAL_STEP: Final = 4
_MAX_STEP_EXPONENT: Final = 103
"""2^24 such steps are finite in float32."""
_NO_REGION: Final = 0xFFFF


def encode_segment(
    mesh: SegmentMesh,
    *,
    step_m: float,
    scales: Mapping[str, AttributeScale],
    may_be_wide: bool = False,
) -> bytes:
    """Encode one segment, or the base or overview of a scene.

    Faces keep their order; vertices get the order of their first use.

    Parameters
    ----------
    mesh : SegmentMesh
        Every vertex is used by a face.
    step_m : float
        Step of the scene's grid, metres; a power of two.
    scales : mapping of str to AttributeScale
        Every attribute of the scene, in the scene's order; the mesh may lack some.
    may_be_wide : bool, optional
        Whether the mesh may be wider than 65535 steps, as base and overview may; a segment may not.

    Returns
    -------
    bytes
        Fewest where each face shares an edge with the one before it.

    Raises
    ------
    PayloadError
        The mesh does not fit: a segment of more than 65535 steps along an axis, a vertex without
        a face, an attribute that the scene does not have.
    """
    check_mesh(mesh)
    names = list(scales)
    if len(names) > MAX_ATTRIBUTES or not set(mesh.attributes) <= set(names):
        raise PayloadError(
            f"attributes {sorted(mesh.attributes)}, expected some of the scene's {names}, of which "
            f"there may be {MAX_ATTRIBUTES}"
        )
    # (1) Faces as strips; vertices are numbered by their first use.
    corners, starts, lefts = _strips(mesh.faces.astype(np.int64))
    stream, order = _number_by_first_use(
        corners[np.array([[0, 0, 1], [1, 1, 1]], bool)[starts * 1]]
    )
    if len(order) != len(mesh.positions):
        raise PayloadError(
            f"{len(mesh.positions)} vertices of which faces use {len(order)}, expected all"
        )
    is_new = np.zeros(len(stream), bool)
    is_new[np.unique(stream, return_index=True)[1]] = True
    planes = [_bits(starts), _bits(lefts), _bits(is_new)]
    planes.append(_differences(stream[~is_new], 2 if len(order) <= 1 << 16 else 4))
    # (2) What vertices have.
    codes = grid_codes(mesh.positions, step_m)[order]
    origin = codes.min(axis=0)
    codes -= origin
    flags, region, mask = 0, _NO_REGION, 0
    if codes.max() > 0xFFFF:
        if not may_be_wide:
            raise PayloadError(f"{codes.max()} steps along an axis, expected at most 65535")
        flags |= _WIDE
    planes += [_differences(axis, 4 if flags & _WIDE else 2) for axis in codes.T]
    step = 1 if mesh.texture is None else _TEXTURED_NORMAL_STEP
    planes += [_differences(axis, 1) for axis in _fold(mesh.normals[order], step).T]
    if mesh.colours is not None:
        flags |= _COLOURS
        red, green, blue = mesh.colours[order].astype(np.int64).T
        planes += [_differences(plane, 1) for plane in (green, red - green, blue - green)]
    width = height = kind = 0
    image = b""
    if mesh.uvs is not None and mesh.texture is not None:
        flags |= _UVS
        image, width, height = mesh.texture.data, mesh.texture.width, mesh.texture.height
        kind = 1 + _IMAGES.index(mesh.texture.media_type)
        planes += [_differences(axis, 2) for axis in encode_uvs(mesh.uvs[order], width, height).T]
    if mesh.region_ids is not None:
        region = int(mesh.region_ids[0])
        if (mesh.region_ids != region).any():
            flags, region = flags | _REGIONS, _NO_REGION
            planes.append(_differences(mesh.region_ids[order], 2))
    for bit, (name, scale) in enumerate(scales.items()):
        if name in mesh.attributes:
            mask |= 1 << bit
            planes.append(_differences(encode_attribute(mesh.attributes[name][order], scale), 2))
    head = _HEAD.pack(
        len(order), len(mesh.faces), *origin.tolist(), round(math.log2(step_m)), flags, kind,
        region, width, height, mask, zlib.crc32(image),
    )  # fmt: skip
    packed = gzip.compress(head + b"".join(planes), 9, mtime=0)
    return _OUTER.pack(_MAGIC, len(packed), len(image)) + packed + image


def decode_segment(
    data: bytes | memoryview, *, scales: Mapping[str, AttributeScale] | None
) -> SegmentMesh:
    """Decode one segment.

    Parameters
    ----------
    data : bytes or memoryview
        The whole segment.
    scales : mapping of str to AttributeScale, or None
        As for :func:`encode_segment`; None leaves all attributes out.

    Returns
    -------
    SegmentMesh
        Scene frame, metres; arrays of its own.

    Raises
    ------
    PayloadError
        For anything that is not a whole segment: never another exception, whatever the bytes.
    """
    # (1) The two parts, and their checksums.
    planes, image, head = _opened(data)
    vertices, faces, x, y, z, exponent, flags, kind, region, width, height, mask = head
    # (2) Faces.
    starts, lefts = planes.bits(faces), planes.bits(faces)
    is_new = planes.bits(faces + 2 * int(starts.sum()))
    stream = np.cumsum(is_new, dtype=np.int32) - 1
    if not starts[0] or int(stream[-1]) != vertices - 1:
        raise PayloadError(f"{stream[-1] + 1} vertices in faces, expected {vertices}")
    old = planes.differences(int((~is_new).sum()), 2 if vertices <= 1 << 16 else 4)
    if (old > stream[~is_new]).any():
        raise PayloadError("a face with a vertex that is not there yet")
    stream[~is_new] = old  # at most what stood there: it fits
    # (3) Vertices.
    steps = planes.steps(vertices, flags, (x, y, z))
    # Not by absolute values: int32 has none of its least number, which a damaged origin may give.
    inside = int(steps.min()) > -MAX_STEPS and int(steps.max()) < MAX_STEPS
    if not inside:
        raise PayloadError("a position 2^24 steps or more from the origin, expected less")
    if exponent > _MAX_STEP_EXPONENT:
        raise PayloadError(f"steps of 2^{exponent} m, expected at most 2^{_MAX_STEP_EXPONENT}")
    normals = _unfold(planes.rows(vertices, 2, 1))
    colours = uvs = texture = regions = None
    if flags & _COLOURS:
        coded = planes.rows(vertices, 3, 1)
        colours = coded[:, [1, 0, 2]] + coded[:, [0, 0, 0]] * np.array([1, 0, 1], np.uint8)
    if flags & _UVS:
        texture = Texture(image, _IMAGES[kind - 1], width, height)
        uvs = decode_uvs(planes.rows(vertices, 2, 2), width, height)
    if flags & _REGIONS:
        regions = planes.differences(vertices, 2)
    elif region != _NO_REGION:
        regions = np.full(vertices, region, np.uint16)
    attributes = {}
    known = [] if scales is None else list(scales.items())
    if scales is not None and mask >> len(known):
        raise PayloadError(f"attributes {mask:#x}, expected some of the scene's {len(known)}")
    for bit in range(mask.bit_length()):
        if mask >> bit & 1:
            codes = planes.differences(vertices, 2)
            if scales is not None:
                name, scale = known[bit]
                attributes[name] = decode_attribute(codes, scale)
    if planes.left:
        raise PayloadError(f"{planes.left} bytes behind the last plane, expected none")
    mesh = SegmentMesh(
        (steps * 2.0**exponent).astype(np.float32), _faces(stream, starts, lefts), normals,
        colours, regions, attributes, uvs, texture,
    )  # fmt: skip
    check_mesh(mesh)
    return mesh


def segment_bounds(data: bytes | memoryview) -> Float64:
    """Check a segment's checksums and return the box around it, without decoding the rest.

    Parameters
    ----------
    data : bytes or memoryview
        The whole segment.

    Returns
    -------
    ndarray of shape (6,), float64
        Least x, y, z, then greatest, metres, scene frame: exactly those of the decoded positions.

    Raises
    ------
    PayloadError
        It is damaged, or not a whole segment.
    """
    planes, _, (vertices, faces, x, y, z, exponent, flags, _, _, _, _, _) = _opened(data)
    starts = planes.bits(faces)
    planes.take((faces + 7) // 8)
    is_new = planes.bits(faces + 2 * int(starts.sum()))
    planes.differences(int((~is_new).sum()), 2 if vertices <= 1 << 16 else 4)
    steps = planes.steps(vertices, flags, (x, y, z)).astype(np.int64)
    if not -1022 <= exponent <= _MAX_STEP_EXPONENT:
        raise PayloadError(f"step 2^{exponent}, expected 2^-1022 to 2^{_MAX_STEP_EXPONENT}")
    bounds: Float64 = np.concatenate([steps.min(axis=0), steps.max(axis=0)]) * 2.0**exponent
    return bounds


def segment_texture(data: bytes | memoryview) -> tuple[int, int, int]:
    """Read what the index says of a segment's texture, without decoding anything.

    Parameters
    ----------
    data : bytes or memoryview
        The whole segment.

    Returns
    -------
    (int, int, int)
        Width and height of the image, pixels, and what a GPU keeps of a texel, bits; zeros without
        a texture.

    Raises
    ------
    PayloadError
        When it is not a whole segment, or its image is not what a segment may have.
    """
    _, image = _parts(data)
    if not len(image):
        return 0, 0, 0
    texture = Texture.of(bytes(image))
    return texture.width, texture.height, texture.bits


def _parts(data: bytes | memoryview) -> tuple[memoryview, memoryview]:
    """Split a segment into gzip stream and image."""
    view = memoryview(data)
    if len(view) < _OUTER.size:
        raise PayloadError(f"{len(view)} bytes, expected at least {_OUTER.size}", offset=0)
    magic, packed_bytes, image_bytes = _OUTER.unpack_from(view)
    if magic != _MAGIC:
        raise PayloadError(f"magic {magic!r}, expected {_MAGIC!r}", offset=0)
    if _OUTER.size + packed_bytes + image_bytes != len(view) or image_bytes > MAX_IMAGE_BYTES:
        raise PayloadError(
            f"{len(view)} bytes, expected {_OUTER.size} + {packed_bytes} + {image_bytes}", offset=4
        )
    return view[_OUTER.size : _OUTER.size + packed_bytes], view[_OUTER.size + packed_bytes :]


def _opened(data: bytes | memoryview) -> tuple[_Planes, bytes, tuple[int, ...]]:
    """Check the checksums of a segment; return its planes behind the head, image and head."""
    packed, image_view = _parts(data)
    planes, image = _Planes(packed), bytes(image_view)
    *head, crc = _HEAD.unpack(planes.take(_HEAD.size))
    vertices, faces, flags, kind = head[0], head[1], head[6], head[7]
    if not vertices or not faces or flags & ~15 or kind > len(_IMAGES):
        raise PayloadError(
            f"{vertices} vertices, {faces} faces, flags {flags}, image {kind}, expected at least "
            f"one face, flags below 16, an image up to {len(_IMAGES)}"
        )
    if bool(kind) != bool(flags & _UVS) or bool(kind) != bool(image) or zlib.crc32(image) != crc:
        raise PayloadError("an image that is damaged, or texture coordinates without one")
    return planes, image, tuple(head)


class _Planes:
    """The planes of a segment, taken one after the other."""

    def __init__(self, packed: memoryview) -> None:
        decoder = zlib.decompressobj(wbits=31)
        try:
            self._data = memoryview(decoder.decompress(packed, MAX_STREAM_BYTES))
        except zlib.error as error:
            raise PayloadError(f"planes are damaged ({error})", offset=_OUTER.size) from None
        if not decoder.eof or decoder.unused_data:
            raise PayloadError("planes are cut off or too long", offset=_OUTER.size)

    @property
    def left(self) -> int:
        """Bytes that were not taken."""
        return len(self._data)

    def take(self, count: int) -> memoryview:
        if count > len(self._data):
            raise PayloadError(f"a plane of {count} bytes, expected at most {len(self._data)}")
        taken, self._data = self._data[:count], self._data[count:]
        return taken

    def bits(self, count: int) -> Bool:
        octets = np.frombuffer(self.take((count + 7) // 8), np.uint8)
        return np.unpackbits(octets, count=count, bitorder="little").view(bool)

    def differences(self, count: int, width: int) -> UInt16:
        """Take planes of zigzag differences, lowest byte first; values modulo 2^(8 width)."""
        octets = np.frombuffer(self.take(count * width), np.uint8).reshape(width, count)
        kind = np.dtype(f"<u{width}")
        zigzag = octets[0] if width == 1 else np.ascontiguousarray(octets.T).view(kind)[:, 0]
        signed = (zigzag >> 1) ^ (0 - (zigzag & 1)).astype(kind)
        return np.cumsum(signed, dtype=kind)

    def steps(self, count: int, flags: int, origin: tuple[int, int, int]) -> Int32 | Int64:
        """Take positions: whole steps of the grid, (count, 3)."""
        # Values of a damaged wide mesh may be near 2^32: 64 bits hold their sums with the origin.
        kind, width = (np.int64, 4) if flags & _WIDE else (np.int32, 2)
        steps: Int32 | Int64 = self.rows(count, 3, width).astype(kind) + np.array(origin, kind)
        return steps

    def rows(self, count: int, columns: int, width: int) -> UInt16:
        return np.stack([self.differences(count, width) for _ in range(columns)], axis=1)


def _differences(values: AnyInt, width: int) -> bytes:
    """Make planes of what :meth:`_Planes.differences` takes."""
    half = 1 << 8 * width - 1
    whole = values.astype(np.int64)
    difference = whole - np.concatenate([[0], whole[:-1]])
    signed = ((difference + half) & (2 * half - 1)) - half
    zigzag = ((signed << 1) ^ (signed >> 63)).astype(f"<u{width}")
    octets: UInt8 = zigzag.view(np.uint8).reshape(len(zigzag), width)
    return octets.T.tobytes()


def _bits(values: Bool) -> bytes:
    return np.packbits(values, bitorder="little").tobytes()


def _strips(faces: Int64) -> tuple[Int64, Bool, Bool]:
    """Rotate faces so that their last corner is the one that the face before does not have.

    Returns
    -------
    corners : ndarray of shape (F, 3), int64
        The edge (first, second corner) is the face before's edge from its third to its second
        corner, or, where *lefts*, from its first to its third.
    starts : ndarray of shape (F,), bool
        Whether the face does not go on from the one before.
    lefts : ndarray of shape (F,), bool
    """
    # Of each pair of neighbours in the order: which corners of one the other has.
    before, after = faces[:-1], faces[1:]
    equal = before[:, :, None] == after[:, None, :]
    in_after, in_before = equal.any(axis=2), equal.any(axis=1)
    pairs = np.arange(len(before))
    lost, new = np.argmin(in_after, axis=1), np.argmin(in_before, axis=1)
    goes_on = (in_after.sum(axis=1) == 2) & (in_before.sum(axis=1) == 2)
    # The common edge runs the other way in the other face.
    goes_on &= before[pairs, (lost + 1) % 3] == after[pairs, (new + 2) % 3]
    # A face that shares the edge by which the strip entered the last face begins a new strip.
    goes_on[1:] &= lost[1:] != np.where(goes_on[:-1], new[:-1], 3)
    starts = np.concatenate([[True], ~goes_on])
    # A start is turned so that its next face lies right.
    turn = np.concatenate([[0], (new + 1) % 3])
    ahead = np.concatenate([np.where(goes_on, lost, 0), [0]])
    turn = np.where(starts, ahead, turn)
    corners = np.take_along_axis(faces, (turn[:, None] + np.arange(3)) % 3, axis=1)
    lefts = np.zeros(len(faces), bool)
    lefts[1:] = goes_on & (before[pairs, lost] == corners[:-1, 1])
    return corners, starts, lefts


def _faces(stream: Int32, starts: Bool, lefts: Bool) -> UInt32:
    """Undo :func:`_strips`: first and second corner stay as they were last replaced."""
    last = np.cumsum(1 + 2 * starts, dtype=np.int32) - 1
    third = stream[last]
    place = np.arange(len(starts), dtype=np.int32)
    sides = []
    for offset, replaced in ((2, ~lefts), (1, lefts)):
        origin = np.maximum.accumulate(np.where(starts | replaced, place, 0))
        value = np.where(starts[origin], stream[last[origin] - offset], third[origin - 1])
        sides.append(value)
    return np.stack([*sides, third], axis=1).astype(np.uint32)


def _number_by_first_use(stream: Int64) -> tuple[Int64, Int64]:
    """Give vertices numbers in the order of their first use.

    Returns
    -------
    stream
        In new numbers.
    order
        The old number of each.
    """
    old, first = np.unique(stream, return_index=True)
    order = old[np.argsort(first)]
    number = np.empty(int(old[-1]) + 1, np.int64)
    number[order] = np.arange(len(order))
    return number[stream], order


def _fold(normals: Float32, step: int) -> Int64:
    """Put unit vectors on the octahedron's square, whose middle is up, in 255 x 255 places."""
    x, y, z = (normals / np.abs(normals).sum(axis=1, keepdims=True)).T
    fold_x, fold_z = (1 - np.abs(z)) * np.copysign(1, x), (1 - np.abs(x)) * np.copysign(1, z)
    square = np.stack([np.where(y < 0, fold_x, x), np.where(y < 0, fold_z, z)], axis=1)
    codes = np.rint(square * (_POLE / step)).astype(np.int64) * step
    return np.clip(codes, -_POLE, _POLE)


def _unfold(codes: UInt16) -> Float32:
    square = codes.astype(np.uint8).view(np.int8).astype(np.float32) / np.float32(_POLE)
    y = 1 - np.abs(square).sum(axis=1)
    below = np.maximum(-y, 0)[:, None]
    square -= np.copysign(np.minimum(below, np.abs(square)), square)
    vector = np.stack([square[:, 0], y, square[:, 1]], axis=1)
    unit: Float32 = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    return unit
