"""Covers, good and bad: what each step may be, and what a reader must refuse.

``NAME.cover`` and ``NAME.json``, in ``cover/``. The JSON has the faces of the base that the cover
is read for, the segments of the scene, and either ``offsets`` and ``segments`` or ``error``, a part
of the text of our own decoder's error. Of bad ones one byte or number is wrong, under a right
checksum where the checksum is not what is wrong.
"""

from __future__ import annotations

import json
import struct
from itertools import accumulate
from pathlib import Path
from typing import Final

import numpy as np
import xxhash

from terraport_payload import Cover
from terraport_payload.cover import COVER_MAGIC, MAX_COVER_ROWS, MAX_ROW_SEGMENTS

ROWS: Final[dict[str, list[list[int]]]] = {
    "no-face": [],
    "bare": [[]] * 40,
    "bare-between": [[], [], [3], [3], [], [5], []],
    "one-segment": [[0]] * 1000,
    "runs": [[1]] * 14 + [[1, 2]] * 15 + [[2]] * 16 + [[2, 3]] * 142 + [[3]] * 143 + [[3, 4]] * 300,
    "many": [list(range(face % 3, 40 - face % 5)) for face in range(12)],
    # Further back than a step remembers.
    "forgotten": [[face // 2 * (face % 2)] for face in range(60)],
    "far": [[0], [33_554_430], [1, 16_000_000], [64, 8191, 16_000_000], [128]],
}


def write_covers(folder: Path) -> None:
    """Write every pair."""
    folder.mkdir()
    for name, rows in ROWS.items():
        cover = cover_of(rows)
        put(folder, f"good-{name}", cover.to_bytes(), cover)
    cover = cover_of([[1], [1, 2], [2]])
    data = cover.to_bytes()
    # A header of a later minor version: longer, and with what is not known here.
    put(folder, "good-later", sealed(cover_head(3, 4, minor=7, start=40) + b"later..." + data[32:]))
    for name, (bad, error) in bad_covers(data).items():
        write_pair(
            folder, f"bad-{name}", bad, {"base_faces": 3, "segment_count": 8, "error": error}
        )
    beyond = MAX_COVER_ROWS + 1
    facts = {"base_faces": beyond, "segment_count": 8, "error": f"at most {MAX_COVER_ROWS}"}
    write_pair(folder, "bad-too-many-faces", sealed(cover_head(beyond, 1) + b"\x10"), facts)


def bad_covers(good: bytes) -> dict[str, tuple[bytes, str]]:
    """Return covers for a base of three faces, each with one fault, and the error.

    The good one has the rows {1}, {1, 2} and {2}: three steps, the first two of them two bytes.
    """
    steps = good[32:]
    wide = b"\x0f\x02" * MAX_ROW_SEGMENTS + b"\x1f\x02\x20"
    return {
        "empty": (b"", "0 bytes, expected 32"),
        "short": (good[:31], "31 bytes, expected 32"),
        "magic": (b"TPSEGIDX" + good[8:], "magic"),
        "major": (sealed(b"\2" + good[17:]), "format version 2"),
        "checksum": (good[:8] + bytes([good[8] ^ 1]) + good[9:], "checksum"),
        "flipped": (good[:-1] + bytes([good[-1] ^ 16]), "checksum"),
        "steps-in-header": (sealed(cover_head(3, 4, start=31) + steps), "steps at 31"),
        "steps-outside": (sealed(cover_head(3, 4, start=38) + steps), "steps at 38"),
        "other-base": (sealed(cover_head(4, 4) + steps), "cover of 4 base faces, expected 3"),
        "fewer-entries": (sealed(cover_head(3, 3) + steps), "expected 1 faces and 0 entries"),
        "more-entries": (sealed(cover_head(3, 5) + steps), "1 entries left over"),
        "entries-of-gigabytes": (sealed(cover_head(3, 2**32 - 1) + steps), "at most"),
        "cut": (sealed(cover_head(3, 4) + steps[:-1]), "steps end 1 base faces early"),
        "no-steps": (sealed(cover_head(3, 4)), "steps end 3 base faces early"),
        "cut-in-a-number": (sealed(cover_head(3, 4) + steps[:1]), "cut short"),
        "bytes-after": (sealed(cover_head(3, 4) + steps + b"\0"), "1 bytes and 0 entries left"),
        "long-run": (sealed(cover_head(3, 4) + b"\x40"), "4 base faces of 1 segments"),
        "run-of-billions": (
            sealed(cover_head(3, 4) + b"\xf0\xf0\xff\xff\xff\x0f"),
            "4294967295 base faces",
        ),
        "number-of-five-bytes": (sealed(cover_head(3, 4) + b"\x1f\x80\x80\x80\x80\x10"), "32 bits"),
        "number-without-end": (sealed(cover_head(3, 4) + b"\x1f" + b"\x80" * 9), "32 bits"),
        "wide-row": (sealed(cover_head(3, 2 * MAX_ROW_SEGMENTS) + wide), "more than 4096 segments"),
    }


def cover_of(rows: list[list[int]]) -> Cover:
    """Return the cover with these rows."""
    offsets = list(accumulate(map(len, rows), initial=0))
    segments = [segment for row in rows for segment in row]
    return Cover(np.array(offsets, dtype=np.uint32), np.array(segments, dtype=np.uint32))


def cover_head(base_faces: int, entries: int, *, minor: int = 0, start: int = 32) -> bytes:
    """Bytes 16 to 32 of a cover."""
    return struct.pack("<HHIII", 1, minor, start, base_faces, entries)


def sealed(tail: bytes) -> bytes:
    """Put magic and a right checksum before the rest of a cover."""
    return COVER_MAGIC + struct.pack("<Q", xxhash.xxh3_64_intdigest(tail)) + tail


def put(folder: Path, name: str, data: bytes, cover: Cover | None = None) -> None:
    """Write a good pair; without a cover, as our own decoder reads the bytes."""
    base_faces = struct.unpack_from("<I", data, 24)[0]
    cover = cover or Cover.from_bytes(data, base_faces)
    facts = {
        "base_faces": base_faces,
        "segment_count": int(cover.segments.max(initial=0)) + 1,
        "offsets": cover.offsets.tolist(),
        "segments": cover.segments.tolist(),
    }
    write_pair(folder, name, data, facts)


def write_pair(folder: Path, name: str, data: bytes, facts: dict[str, object]) -> None:
    """Write a cover, and what is expected of it."""
    (folder / f"{name}.cover").write_bytes(data)
    (folder / f"{name}.json").write_text(json.dumps(facts, separators=(",", ":")) + "\n")
