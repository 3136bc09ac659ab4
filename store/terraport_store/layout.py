"""Names and constants of a scene directory. PURE: no I/O, no clock."""

from __future__ import annotations

import re
import struct
from typing import Final

from terraport_payload import PayloadError

__all__ = [
    "ALIGNMENT",
    "BASE",
    "COVER",
    "ENCODING",
    "FORMAT_VERSION",
    "INDEX",
    "LABELS",
    "MANIFEST_NAME",
    "MAX_INDEX_BYTES",
    "MAX_LABELS_BYTES",
    "MAX_LEVELS",
    "MAX_MANIFEST_BYTES",
    "MAX_PAYLOAD_BYTES",
    "MAX_REGIONS_BYTES",
    "MAX_SEGMENT_SIDE",
    "MAX_STROKES_BYTES",
    "MAX_TAUGHT_BYTES",
    "MEDIA_TYPE",
    "PACK",
    "PACK_HEADER_BYTES",
    "PAINTING",
    "PREVIEW",
    "REGIONS",
    "REPORT",
    "REPORT_PDF",
    "STAGING",
    "STROKES",
    "STROKES_LOCK",
    "TAUGHT",
    "VERSION_FOLDER",
    "check_pack_header",
    "pack_header",
]

MANIFEST_NAME: Final = "scene.json"
"""The manifest; replacing it is the one act that publishes."""

LABELS: Final = "labels.json"
"""What people call the regions; beside the manifest, part of no version."""

STROKES: Final = "strokes.geojson"
TAUGHT: Final = "taught.json"
"""What people painted on the ground, and what that has taught so far; there too."""

STROKES_LOCK: Final = ".strokes.lock"
"""Held by whoever writes one of the two."""

PAINTING: Final = re.compile(r"\.(strokes|taught)-[0-9a-f]{16}\.tmp")
"""What an unfinished write of the two leaves; deleted by the next one."""

REPORT: Final = "report.html"
REPORT_PDF: Final = "report.pdf"
"""What the build's report writes there too: the page, and the page to print."""

PREVIEW: Final = "preview.jpg"
"""A small picture of the scene, for lists; the report draws it, too."""

FORMAT_VERSION: Final = "1.0"
"""What is written; every 1.x is read."""

BASE: Final = "base.tsg"
OVERVIEW: Final = "overview.tsg"
COVER: Final = "base.cover"
REGIONS: Final = "regions.json"

MAX_LEVELS: Final = 2
"""Payloads of a segment: its detail, and one coarser level."""

ENCODING: Final = "segment-2"
"""Encoding of the payloads: segment format 2."""

MEDIA_TYPE: Final = "application/vnd.terraport.segment"
"""Media type of a payload."""

PACK: Final = "segments.pack"
INDEX: Final = "segments.idx"

VERSION_FOLDER: Final = re.compile(r"v-[0-9a-f]{12}(-[0-9]{1,6})?")
"""Folder of one published version."""

STAGING: Final = re.compile(r"\.v-[0-9a-f]{16}\.tmp|\.(scene|labels)-[0-9a-f]{16}\.json\.tmp")
"""What an unfinished publication leaves; deleted by the next one."""

ALIGNMENT: Final = 64
"""Payloads start at multiples of it: a cache line, and more than any element needs. Pages (4096)
would cost 2-3 % of the pack and gain nothing: readers ask for whole payloads."""

PACK_HEADER_BYTES: Final = 64

MAX_MANIFEST_BYTES: Final = 4 << 20
"""A manifest has 5-20 KiB; its size does not grow with the scene."""

MAX_INDEX_BYTES: Final = 1 << 30
"""Bounds what opening a scene reads into memory: 18 million segments."""

MAX_REGIONS_BYTES: Final = 1 << 28
"""Bounds regions.json."""

MAX_LABELS_BYTES: Final = 64 << 20
"""Bounds labels.json: 131,072 labels of 256 characters of four bytes do not fit, and need not."""

MAX_STROKES_BYTES: Final = 16 << 20
"""Bounds strokes.geojson, which is written whole for each stroke."""

MAX_TAUGHT_BYTES: Final = 8 << 20
"""Bounds taught.json: a million squares of two bytes, deflated, in base64."""

MAX_PAYLOAD_BYTES: Final = (1 << 32) - 1
"""Payload lengths are u32 in the index and on the wire."""

MAX_SEGMENT_SIDE: Final = 2048
"""Pixels of a segment's image; the base's may have twice as many."""

_PACK: Final = struct.Struct("<8sHHII16s28x")
_PACK_MAGIC: Final = b"TPSEGPK1"


def pack_header(encoding: str) -> bytes:
    """First 64 bytes of a pack.

    Examples
    --------
    >>> len(pack_header("segment-2"))
    64
    """
    return _PACK.pack(_PACK_MAGIC, 1, 0, PACK_HEADER_BYTES, ALIGNMENT, encoding.encode("ascii"))


def check_pack_header(data: bytes | memoryview, encoding: str) -> None:
    """Check the first 64 bytes of a pack.

    Parameters
    ----------
    data : bytes or memoryview
        At least the first 64 bytes.
    encoding : str
        What the pack should hold.

    Raises
    ------
    PayloadError
        With the offset: too short, wrong magic, unknown major version, another encoding.
    """
    if len(data) < PACK_HEADER_BYTES:
        raise PayloadError(f"{len(data)} bytes, expected a header of {PACK_HEADER_BYTES}", offset=0)
    magic, major, _minor, header_bytes, alignment, name = _PACK.unpack_from(data)
    if magic != _PACK_MAGIC:
        raise PayloadError(f"magic {magic!r}, expected {_PACK_MAGIC!r}", offset=0)
    if major != 1:
        raise PayloadError(f"format version {major}, expected 1", offset=8)
    if header_bytes < PACK_HEADER_BYTES or alignment != ALIGNMENT:
        raise PayloadError(
            f"header of {header_bytes} bytes, alignment {alignment}, "
            f"expected {PACK_HEADER_BYTES} and {ALIGNMENT}",
            offset=12,
        )
    if name.rstrip(b"\0") != encoding.encode("ascii"):
        raise PayloadError(f"encoding {name!r}, expected {encoding!r}", offset=20)
