"""Small images of every kind, made by hand where that is easy and by Pillow where it is not."""

from __future__ import annotations

import io
import struct
import zlib

import numpy as np
import PIL.Image


def png(width: int = 16, height: int = 8) -> bytes:
    """A grey PNG."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    rows = b"".join(b"\0" + bytes(range(width)) for _ in range(height))
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )


def pillow(kind: str, width: int = 16, height: int = 8, **options: object) -> bytes:
    """An image with a gradient."""
    x, y = np.meshgrid(np.arange(width) * 8 % 256, np.arange(height) * 16 % 256)
    out = io.BytesIO()
    pixels = np.stack([x, y, x ^ y], axis=2).astype(np.uint8)
    PIL.Image.fromarray(pixels).save(out, kind, **options)
    return out.getvalue()


def ktx2(width: int = 16, height: int = 8, *, scheme: int = 1) -> bytes:
    """The header of a KTX2 file, and nothing after it; scheme 1 is that of ETC1S."""
    fields = struct.pack("<9I", 0, 1, width, height, 0, 0, 1, 1, scheme)
    return b"\xabKTX 20\xbb\r\n\x1a\n" + fields
