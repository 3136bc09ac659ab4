"""Write the scene corpus: ``python tests/conformance/scene/generate.py`` from the repository's
root.

The files are committed; once the format is released they are kept for ever, and a new version of it
adds files. Bytes depend on zlib, so a rerun may differ from what is committed and still be right.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import shutil
import struct
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

if __name__ == "__main__":  # run as a script: the packages imported below lie in tests/
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from conformance.scene.axes_scene import write_axes_scene
from conformance.scene.covers import write_covers
from payload.images import ktx2, pillow, png
from store.tiny_scene import SCALES, STEP_M, lattice_mesh, sunken, textured, write_tiny_scene

from terraport_payload import (
    SegmentMesh,
    Texture,
    decode_segment,
    encode_segment,
)
from terraport_payload.texture import gpu_texture_bytes
from terraport_pipeline.geometry.segments.strip_order import strip_order
from terraport_store.labels import encode_labels
from terraport_store.layout import LABELS

HERE = Path(__file__).resolve().parent


def main() -> None:
    """Write all of it anew."""
    for name in (
        "axes",
        "tiny",
        "tiny-textured",
        "tiny-base-image",
        "tiny-changed",
        "payload",
        "cover",
    ):
        shutil.rmtree(HERE / name, ignore_errors=True)
    write_axes_scene(HERE / "axes")
    write_tiny_scene(HERE / "tiny", stable_ids=(5, 2, 9))
    (HERE / "tiny" / LABELS).write_bytes(encode_labels({7: "Süd 石", 9: "haul road"}))
    write_tiny_scene(HERE / "tiny-textured", image=pillow("JPEG"))
    write_tiny_scene(HERE / "tiny-base-image", base_image=pillow("JPEG"))
    write_tiny_scene(HERE / "tiny-changed", changed=True)
    (HERE / "payload").mkdir()
    write_good_segments()
    write_bad_segments()
    write_covers(HERE / "cover")


def write_good_segments() -> None:
    """Segments in format 2: each optional part, a far and a coarse grid, faces without strips."""
    mesh = replace(lattice_mesh(4, 4, 2), attributes={})
    bare = replace(mesh, colours=None, region_ids=None)
    wide = lattice_mesh(0, 0, 6)
    changed = sunken(lattice_mesh(4, 4, 2))
    random = np.random.default_rng(2)
    meshes = {
        "plain": (bare, STEP_M),
        "colours": (replace(mesh, region_ids=None), STEP_M),
        "region": (replace(bare, region_ids=mesh.region_ids), STEP_M),
        "regions": (replace(mesh, region_ids=np.arange(9, dtype=np.uint16) // 4), STEP_M),
        "attribute": (lattice_mesh(4, 4, 2), STEP_M),
        "attributes": (changed, STEP_M),
        "second-attribute": (
            replace(bare, attributes={"height_change_m": changed.attributes["height_change_m"]}),
            STEP_M,
        ),
        "jpeg": (textured(changed, pillow("JPEG")), STEP_M),
        "png": (textured(mesh, png()), STEP_M),
        "webp": (textured(mesh, pillow("WEBP")), STEP_M),
        "ktx2": (textured(mesh, ktx2()), STEP_M),
        "far": (
            replace(mesh, positions=mesh.positions + np.float32((1 << 23) * STEP_M)),
            STEP_M,
        ),
        "coarse": (replace(mesh, positions=mesh.positions * np.float32(64)), 4.0),
        "strips": (replace(wide, faces=wide.faces[strip_order(wide.faces)]), STEP_M),
        "no-strips": (
            replace(
                mesh,
                faces=np.vstack([mesh.faces[::-1], random.integers(0, 9, (9, 3))]).astype(
                    np.uint32
                ),
            ),
            STEP_M,
        ),
        "wide": (replace(mesh, positions=mesh.positions * np.float32(64)), STEP_M),
    }
    for name, (source, step_m) in meshes.items():
        data = encode_segment(source, step_m=step_m, scales=SCALES, may_be_wide=name == "wide")
        put(f"good-{name}.tsg", data, described(decode_segment(data, scales=SCALES)))


def write_bad_segments() -> None:
    """One fault each in segments of format 2; the checksum is right where it is not the fault."""
    mesh = textured(lattice_mesh(4, 4, 2), pillow("JPEG"))
    good = encode_segment(mesh, step_m=STEP_M, scales=SCALES)
    length, image_bytes = struct.unpack_from("<II", good, 4)
    packed, image = good[12 : 12 + length], good[12 + length :]
    stream = gzip.decompress(packed)

    def joined(packed: bytes, image: bytes = image) -> bytes:
        return struct.pack("<4sII", b"TSG2", len(packed), len(image)) + packed + image

    def changed(offset: int, kind: str, value: int, image: bytes = image) -> bytes:
        raw = bytearray(stream)
        struct.pack_into(kind, raw, offset, value)
        return joined(gzip.compress(bytes(raw), mtime=0), image)

    # 8 faces: the planes of starts and lefts have a byte each; then bits of new vertices, then old
    # corners of two bytes, the lowest bytes first.
    new_bytes = (8 + 2 * stream[40].bit_count() + 7) // 8
    bad = {
        "empty": (b"", "expected at least 12"),
        "magic": (b"TSG3" + good[4:], "magic"),
        "truncated": (good[:-1], "bytes, expected"),
        "extra": (good + b"\0", "bytes, expected"),
        "lengths": (
            struct.pack("<4sII", b"TSG2", length - 1, image_bytes) + good[12:],
            "bytes, expected",
        ),
        "noise": (joined(packed[:10] + b"\x07" + packed[11:]), "planes are damaged"),
        "checksum": (joined(packed[:-8] + bytes([packed[-8] ^ 1]) + packed[-7:]), "damaged"),
        "cut-gzip": (joined(packed[:-9]), "planes are cut off"),
        "cut-stream": (joined(gzip.compress(stream[:-1], mtime=0)), "a plane of"),
        "cut-head": (joined(gzip.compress(stream[:39], mtime=0)), "a plane of"),
        "longer-stream": (joined(gzip.compress(stream + b"\0", mtime=0)), "behind the last plane"),
        "more-vertices": (changed(0, "<I", 10), "vertices in faces, expected 10"),
        "fewer-vertices": (changed(0, "<I", 8), "vertices in faces, expected 8"),
        "huge-vertices": (changed(0, "<I", (1 << 32) - 1), "vertices in faces"),
        "no-vertices": (changed(0, "<I", 0), "expected at least one face"),
        "no-faces": (changed(4, "<I", 0), "expected at least one face"),
        "huge-faces": (changed(4, "<I", (1 << 32) - 1), "a plane of"),
        "no-start": (changed(40, "<B", stream[40] & ~1), "faces"),
        "later-corner": (changed(42 + new_bytes, "<B", 30), "is not there yet"),
        "flag": (changed(21, "<B", stream[21] | 16), "flags below 16"),
        "image-unknown": (changed(22, "<B", 5), "an image up to 4"),
        "image-crc": (
            joined(packed, image[:-1] + bytes([image[-1] ^ 1])),
            "an image that is damaged",
        ),
        "image-missing": (joined(packed, b""), "an image that is damaged"),
        "image-type": (changed(22, "<B", 2), "expected image/png"),
        "image-size": (changed(26, "<H", 32), "expected image/jpeg of 32"),
        "image-without-uvs": (
            changed(21, "<B", stream[21] & ~2),
            "texture coordinates without one",
        ),
        "attribute": (changed(32, "<I", 1 << len(SCALES)), "attribute"),
        "far": (changed(8, "<i", (1 << 24) - 1), "2^24 steps"),
        "far-below": (changed(16, "<i", -(1 << 31)), "2^24 steps"),
    }
    for name, (data, error) in bad.items():
        put(f"bad-{name}.tsg", data, {"good": False, "error": error})


def _gpu_bytes(texture: Texture) -> int:
    kept = np.array([[texture.width, texture.height, texture.bits]], np.uint16)
    return int(gpu_texture_bytes(kept)[0])


def described(mesh: SegmentMesh) -> dict[str, Any]:
    """Everything that a decoder should find, NaN as null."""
    texture: dict[str, Any] = {}
    if mesh.uvs is not None and mesh.texture is not None:
        texture = {
            "uvs": np.round(mesh.uvs, 6).tolist(),
            "texture": {
                "media_type": mesh.texture.media_type,
                "width": mesh.texture.width,
                "height": mesh.texture.height,
                "sha256": hashlib.sha256(mesh.texture.data).hexdigest(),
                "gpu_bytes": _gpu_bytes(mesh.texture),
            },
        }
    return {
        "good": True,
        "positions": mesh.positions.tolist(),
        "faces": mesh.faces.tolist(),
        "normals": np.round(mesh.normals, 6).tolist(),
        "colours": None if mesh.colours is None else mesh.colours.tolist(),
        "region_ids": None if mesh.region_ids is None else mesh.region_ids.tolist(),
        **texture,
        "attributes": {
            name: [None if np.isnan(value) else float(value) for value in values]
            for name, values in mesh.attributes.items()
        },
    }


def put(name: str, data: bytes, expected: dict[str, Any]) -> None:
    """Write a payload and, beside it, the JSON of what a reader must make of it."""
    scales = [{"name": n, "offset": s.offset, "step": s.step} for n, s in SCALES.items()]
    expected = {**expected, "scales": scales}
    (HERE / "payload" / name).write_bytes(data)
    text = json.dumps(expected, separators=(",", ":")) + "\n"
    (HERE / "payload" / f"{name}.json").write_text(text)


if __name__ == "__main__":
    main()
