"""The image of a textured payload: its bytes as they are, and what its header says.

Nothing here decodes pixels. A header is read so that nobody hands an image library fifty bytes that
claim 65535 x 65535 pixels.

Formats: JPEG (ITU-T T.81, annex B), PNG (ISO 15948, 5.2 and 11.2.2), WebP (RFC 9649, 2.3 to 2.7),
KTX2 (Khronos KTX File Format 2.0, section 3).

PURE: no I/O, no clock.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.errors import PayloadError
from terraport_payload.types import UInt16, UInt64

__all__ = [
    "MAX_IMAGE_BYTES",
    "MAX_SIDE",
    "MEDIA_TYPES",
    "Texture",
    "gpu_texture_bytes",
    "read_image_header",
    "texel_bits",
]

MEDIA_TYPES: Final = ("image/jpeg", "image/ktx2", "image/png", "image/webp")
"""What a payload's image may be."""

MAX_SIDE: Final = 4096
"""Pixels; the base's image may have them, a segment's half as many (the store checks that)."""

MAX_IMAGE_BYTES: Final = 1 << 26
"""Bytes of one image file: what 4096 x 4096 pixels take uncompressed."""

_JPEG: Final = b"\xff\xd8\xff"
_PNG: Final = b"\x89PNG\r\n\x1a\n"
_KTX2: Final = b"\xabKTX 20\xbb\r\n\x1a\n"

_UNCOMPRESSED_BITS: Final = 32
"""Of a texel on a GPU that cannot read the image's form: RGBA."""

_BASIS_LZ: Final = 1
"""KTX2's supercompressionScheme of ETC1S."""

_STANDALONE: Final = frozenset({0x01, *range(0xD0, 0xD8)})
"""JPEG markers without a length: TEM and the restarts."""

_FRAMES: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""JPEG markers that start a frame; DHT, JPG and DAC lie between them."""


@dataclass(frozen=True, slots=True)
class Texture:
    r"""One image file, not decoded.

    Raises
    ------
    PayloadError
        When the bytes are not of the media type or of other sides, the sides are no powers of two
        or above 4096, or there are more than 2^26 bytes.

    Examples
    --------
    >>> head = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 8, 4)
    >>> Texture.of(head).width
    8
    """

    data: bytes
    """The file as it is."""
    media_type: str
    """One of :data:`MEDIA_TYPES`."""
    width: int
    """Pixels."""
    height: int
    """Pixels."""

    def __post_init__(self) -> None:
        if len(self.data) > MAX_IMAGE_BYTES:
            raise PayloadError(
                f"image of {len(self.data)} bytes, expected at most {MAX_IMAGE_BYTES}"
            )
        actual = read_image_header(self.data)
        stated = (self.media_type, self.width, self.height)
        if actual != stated:
            raise PayloadError(f"image is {_text(actual)} by its header, expected {_text(stated)}")
        for side in (self.width, self.height):
            if not 1 <= side <= MAX_SIDE or side & (side - 1):
                raise PayloadError(
                    f"image of {self.width} x {self.height} pixels, expected powers of two, at "
                    f"most {MAX_SIDE}"
                )

    @property
    def bits(self) -> int:
        """What a GPU keeps of a texel; see :func:`texel_bits`."""
        return texel_bits(self.data)

    def __repr__(self) -> str:
        """Say what it is, without the image's bytes."""
        size = f"{self.width} x {self.height} pixels, {len(self.data):,} bytes"
        return f"<Texture {self.media_type}, {size}>"

    @classmethod
    def of(cls, data: bytes) -> Texture:
        """Read type and sides from an image file's own header; raises as the class does."""
        return cls(data, *read_image_header(data))


def read_image_header(data: bytes | memoryview) -> tuple[str, int, int]:
    """Read what an image file says of itself, without decoding it; safe on hostile bytes.

    Parameters
    ----------
    data : bytes or memoryview
        The whole file.

    Returns
    -------
    media_type : str
        One of :data:`MEDIA_TYPES`.
    width, height : int
        Pixels; not checked against any limit.

    Raises
    ------
    PayloadError
        When the first bytes are of none of the four, or the header is cut short.
    """
    head = bytes(data[:32])
    try:
        if head.startswith(_JPEG):
            return "image/jpeg", *_jpeg_size(memoryview(data))
        if head.startswith(_PNG):
            if head[12:16] != b"IHDR":
                raise PayloadError(f"PNG starts with chunk {head[12:16]!r}, expected b'IHDR'")
            width, height = struct.unpack_from(">II", head, 16)
            return "image/png", width, height
        if head.startswith(_KTX2):
            width, height = struct.unpack_from("<II", head, 20)
            return "image/ktx2", width, height
        if head[:4] == b"RIFF" and head[8:12] == b"WEBP":
            return "image/webp", *_webp_size(head)
    except struct.error:
        raise PayloadError(f"image header cut short after {len(data)} bytes") from None
    raise PayloadError(f"image starts with {head[:8]!r}, expected one of {', '.join(MEDIA_TYPES)}")


def texel_bits(data: bytes | memoryview) -> int:
    """Tell what a GPU keeps of a texel: 4 (ETC1S), 8 (UASTC) or 32 (whatever GPUs cannot read).

    Parameters
    ----------
    data : bytes or memoryview
        An image file, at least 48 bytes of a KTX2.

    Raises
    ------
    PayloadError
        When a KTX2 file is cut short.
    """
    head = bytes(data[:48])
    if not head.startswith(_KTX2):
        return _UNCOMPRESSED_BITS
    if len(head) < 48:
        raise PayloadError(f"image header cut short after {len(head)} bytes")
    (scheme,) = struct.unpack_from("<I", head, 44)
    return 4 if scheme == _BASIS_LZ else 8


def gpu_texture_bytes(textures: UInt16) -> UInt64:
    """Reckon what textures take on a GPU, all levels down to 1 x 1 included.

    spec/protocol.md, section 4.

    Parameters
    ----------
    textures : ndarray of shape (S, 3), uint16
        Width, height and bits a texel of each; zeros without a texture.

    Returns
    -------
    ndarray of shape (S,), uint64
        Bytes. Compressed forms keep blocks of 4 x 4 texels, also of smaller levels.

    Examples
    --------
    >>> gpu_texture_bytes(np.array([[4, 4, 32], [4, 4, 8], [4, 4, 4], [0, 0, 0]], np.uint16))
    array([84, 48, 24,  0], dtype=uint64)
    """
    width, height, bits = textures.astype(np.int64).T
    total = np.zeros(len(textures), np.int64)
    open_ = bits > 0
    for level in range(MAX_SIDE.bit_length()):
        w, h = np.maximum(width >> level, 1), np.maximum(height >> level, 1)
        blocks = ((w + 3) // 4) * ((h + 3) // 4) * 2 * bits
        total += np.where(open_, np.where(bits == _UNCOMPRESSED_BITS, w * h * 4, blocks), 0)
        open_ &= (w > 1) | (h > 1)
    return total.astype(np.uint64)


def _jpeg_size(data: memoryview) -> tuple[int, int]:
    at = 2
    while at + 4 <= len(data):  # each round moves on by two bytes or more
        if data[at] != 0xFF:
            raise PayloadError(f"JPEG byte {data[at]:#04x} at {at}, expected a marker")
        marker = data[at + 1]
        if marker == 0xFF:  # fill byte
            at += 1
            continue
        if marker in _STANDALONE:
            at += 2
            continue
        if marker in (0xD9, 0xDA):
            raise PayloadError("JPEG without a frame header before its first scan")
        if marker in _FRAMES:
            height, width = struct.unpack_from(">HH", data, at + 5)
            return width, height
        (length,) = struct.unpack_from(">H", data, at + 2)
        at += 2 + max(int(length), 2)
    raise PayloadError(f"JPEG without a frame header in {len(data)} bytes")


def _webp_size(head: bytes) -> tuple[int, int]:
    kind = head[12:16]
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", head, 26)
        return width & 0x3FFF, height & 0x3FFF
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", head, 21)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8X":
        low, middle, high, low2, middle2, high2 = struct.unpack_from("<6B", head, 24)
        width = (low | middle << 8 | high << 16) + 1
        return width, (low2 | middle2 << 8 | high2 << 16) + 1
    raise PayloadError(f"WebP chunk {kind!r}, expected VP8, VP8L or VP8X")


def _text(header: tuple[str, int, int]) -> str:
    return f"{header[0]} of {header[1]} x {header[2]} pixels"
