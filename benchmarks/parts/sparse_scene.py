"""A scene of any size that takes no disk: every payload is zeros, and the pack is a hole.

Everything else is real: index, offsets, hashes (of zeros), the pack's own hash, the manifest. A
service cannot tell it from a scene whose payloads were written.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np
import xxhash
from parts.random_scene import TILE_M, base_glb, scene_info

from terraport_payload import Cover, decode_glb
from terraport_store import Manifest, SegmentIndex
from terraport_store.assembly import MeshShape, assemble_manifest
from terraport_store.layout import PACK_HEADER_BYTES, pack_header
from terraport_store.manifest import FileInfo
from terraport_store.swap import swap_in

__all__ = ["write_sparse_scene"]

_ZEROS: Final = bytes(1 << 22)


def write_sparse_scene(path: Path, *, pack_bytes: int, segment_bytes: int) -> Manifest:
    """Publish a square grid of zeros.

    Parameters
    ----------
    path : Path
        The scene directory; must not exist.
    pack_bytes : int
        About the length of the pack; it takes a page of the disk.
    segment_bytes : int
        Length of each payload; a multiple of 64.
    """
    # Every payload is the same zeros, so one hash serves all.
    side = max(1, math.isqrt(pack_bytes // segment_bytes))
    count = side * side
    number = np.arange(count)
    corner = np.stack([number % side, np.zeros(count), number // side], axis=1) * TILE_M
    size = np.array([TILE_M, 1.0, TILE_M])
    payload_digest = xxhash.xxh3_64_intdigest(bytes(segment_bytes))
    index = SegmentIndex(
        bounds=np.concatenate([corner, corner + size], axis=1).astype("<f4"),
        vertex_count=np.full(count, 6000, dtype="<u4"),
        face_count=np.full(count, 10_000, dtype="<u4"),
        offset=(PACK_HEADER_BYTES + segment_bytes * number).astype("<u8"),
        length=np.full(count, segment_bytes, dtype="<u4"),
        xxh3=np.full(count, payload_digest, dtype="<u8"),
        region=np.zeros(count, dtype="<u4"),
        region_count=np.ones(count, dtype="<u2"),
        texture=np.zeros((count, 3), dtype="<u2"),
    )
    # The small files are written as they are.
    path.mkdir()
    staging = path / ".v-0000000000000000.tmp"
    staging.mkdir()
    base = base_glb()
    cover = Cover(np.array([0, 0], dtype=np.uint32), np.zeros(0, dtype=np.uint32))
    files = {
        "base.glb": base,
        "base.cover": cover.to_bytes(),
        "regions.json": b'{"regions":[]}',
        "segments.idx": index.to_bytes(),
    }
    infos = {}
    for name, data in files.items():
        (staging / name).write_bytes(data)
        digest = f"{xxhash.xxh3_64_intdigest(data):016x}"
        infos[name] = FileInfo(path=f"new/{name}", bytes=len(data), xxh3=digest)
    # The pack is a hole behind its header: as long as it says, and a page on the disk.
    header = pack_header("glb")
    with (staging / "segments.pack").open("xb") as pack:
        pack.write(header)
        pack.truncate(index.end)
    infos["segments.pack"] = FileInfo(
        path="new/segments.pack", bytes=index.end, xxh3=_digest(header, index.end - len(header))
    )
    shape = MeshShape.of(decode_glb(base))
    return swap_in(path, staging, assemble_manifest(scene_info("sparse"), index, shape, infos))


def _digest(header: bytes, zeros: int) -> str:
    """Hash of a header and so many zeros; 20 GB take two seconds."""
    digest = xxhash.xxh3_64(header)
    while zeros > 0:
        digest.update(memoryview(_ZEROS)[: min(zeros, len(_ZEROS))])
        zeros -= len(_ZEROS)
    return f"{digest.intdigest():016x}"
