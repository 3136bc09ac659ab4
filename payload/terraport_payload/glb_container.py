"""GLB's outer form: header, JSON chunk, BIN chunk (glTF 2.0 specification, section 4.4).

PURE: no I/O, no clock.
"""

from __future__ import annotations

import json
import struct
from typing import Any, Final

__all__ = ["join_glb"]

_HEADER: Final = struct.Struct("<4sII")
_CHUNK: Final = struct.Struct("<I4s")


def join_glb(document: dict[str, Any], binary: bytes) -> bytes:
    """Write a GLB.

    Parameters
    ----------
    document : dict
        The glTF document; keys are written in insertion order, so same input gives same bytes.
    binary : bytes
        Contents of the BIN chunk.

    Returns
    -------
    bytes
        Both chunks padded to 4 bytes, JSON by spaces and BIN by zeros, as glTF asks.
    """
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode("ascii")
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    total = _HEADER.size + 2 * _CHUNK.size + len(text) + len(binary)
    return b"".join(
        (
            _HEADER.pack(b"glTF", 2, total),
            _CHUNK.pack(len(text), b"JSON"),
            text,
            _CHUNK.pack(len(binary), b"BIN\0"),
            binary,
        )
    )
