"""What each fuzz target of the C++ core begins with: the conformance corpus, in its own form.

Each target says in its first lines what its bytes are: some put a byte that chooses how a message
is read before it, and ``meshopt`` takes compressed streams without the GLB around them.
"""

from __future__ import annotations

import gzip
import json
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from engines.cores import UNREAL

CORPUS = Path(__file__).resolve().parents[1] / "conformance"
GLB_HEAD_BYTES = 20
CHUNK_HEAD_BYTES = 8
MOST_MESHOPT_ELEMENTS = 2048


def seeds_of(target: str) -> Iterator[bytes]:
    """Yield the seeds of a target; none for one that makes its own sense of any bytes."""
    match target:
        case "glb":
            for path in _glbs():
                yield path.read_bytes()
                if _is_good(path):
                    text, binary = _chunks(path.read_bytes())
                    yield struct.pack("<H", len(text)) + text + binary
        case "segment":
            for path in sorted(CORPUS.glob("scene/payload/*.tsg")):
                data = path.read_bytes()
                yield data
                if _is_good(path):
                    (packed,) = struct.unpack_from("<I", data, 4)
                    planes, image = gzip.decompress(data[12 : 12 + packed]), data[12 + packed :]
                    yield struct.pack("<H", len(image)) + planes + image
        case "meshopt":
            for path in filter(_is_good, _glbs()):
                yield from _streams(path.read_bytes())
        case "cover":
            yield from _files("scene/*/v-*/base.cover", "scene/cover/*.cover")
        case "manifest":
            yield from _files(
                "scene/*/scene.json", "scene/*/v-*/regions.json", "scene/*/labels.json"
            )
        case "json":
            for seed in _files("scene/*/scene.json", "wire/*/*.json"):
                yield b"\x00" + seed
        case "ktx2":
            text = (UNREAL / "tests" / "ktx2_file.h").read_text(encoding="utf-8")
            yield bytes.fromhex("".join(re.findall(r'^ *"([0-9a-f]+)"', text, re.MULTILINE)))
        case "frame":
            yield from _files("wire/*/frame-*.bin")
        case "wire_message":
            for path in sorted(CORPUS.glob("wire/*/*.json")):
                case = json.loads(path.read_bytes())
                if case["kind"] != "frame":
                    choice = case["direction"] == "client_to_server"
                    yield bytes([choice]) + path.with_suffix(".bin").read_bytes()


def _files(*patterns: str) -> Iterator[bytes]:
    for pattern in patterns:
        for path in sorted(CORPUS.glob(pattern)):
            yield path.read_bytes()


def _glbs() -> list[Path]:
    globs = CORPUS.glob("scene/payload/*.glb"), CORPUS.glob("scene/*/v-*/base.glb")
    return sorted(path for paths in globs for path in paths)


def _is_good(path: Path) -> bool:
    return not path.name.startswith("bad")


def _chunks(glb: bytes) -> tuple[bytes, bytes]:
    """Return the JSON and the BIN chunk."""
    (length,) = struct.unpack_from("<I", glb, 12)
    end = GLB_HEAD_BYTES + length
    return glb[GLB_HEAD_BYTES:end], glb[end + CHUNK_HEAD_BYTES :]


def _streams(glb: bytes) -> Iterator[bytes]:
    """Yield each compressed buffer as the target ``meshopt`` takes it."""
    text, binary = _chunks(glb)
    views: list[dict[str, Any]] = json.loads(text)["bufferViews"]
    for view in views:
        packed = view.get("extensions", {}).get("EXT_meshopt_compression")
        if packed is None:
            continue
        is_vertices = packed["mode"] == "ATTRIBUTES"
        kind = packed["byteStride"] // 4 - 1 if is_vertices else 4
        count = packed["count"] if is_vertices else packed["count"] // 3
        start = packed.get("byteOffset", 0)
        if count <= MOST_MESHOPT_ELEMENTS:
            yield struct.pack("<BH", kind, count - 1) + binary[start : start + packed["byteLength"]]
