"""Scenes of segments that are two triangles each, with incompressible bytes up to a length."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from terraport_payload import Cover, SegmentMesh, Texture, encode_segment
from terraport_store import BuildInfo, HandOff, Manifest, SceneInfo, SceneWriter

__all__ = ["TILE_M", "base_payload", "scene_info", "write_random_scene"]

TILE_M = 10.0
"""Width of a segment."""

_JPEG_HEAD = bytes.fromhex(
    "ffd8 ffc0 0011 08 0010 0010 03 012200 021101 031101 ffda 0008 01 0100 003f00"
)
"""Head of a JPEG of 16 x 16 texels: nobody decodes what follows."""


def base_payload() -> bytes:
    """One triangle: trials of the stream do not look at the base."""
    triangle = SegmentMesh(
        positions=np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0]], dtype=np.float32),
        faces=np.array([[0, 1, 2]], dtype=np.uint32),
        normals=np.tile(np.array([0, 1, 0], dtype=np.float32), (3, 1)),
    )
    return encode_segment(triangle, step_m=2.0**-10, scales={})


def scene_info(name: str) -> SceneInfo:
    """Return what the files do not say."""
    return SceneInfo(
        name=name,
        origin=(0.0, 0.0, 0.0),
        step_m=2.0**-10,
        points=1,
        regions=1,
        hand_off=HandOff(deviation_m=0.0, tolerance_m=0.0),
        build=BuildInfo(terraport="benchmark"),
    )


def _payload(x_m: float, z_m: float, length: int, rng: np.random.Generator) -> bytes:
    """Return a segment of a length: a flat tile with an image whose pixels are random bytes."""
    corners = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 0, 1]], dtype=np.float32)
    positions = corners * np.float32(TILE_M) + np.array([x_m, 0.5, z_m], dtype=np.float32)
    pixels = rng.bytes(max(0, length - 400))
    while True:
        mesh = SegmentMesh(
            positions=positions,
            faces=np.array([[0, 1, 2], [2, 1, 3]], dtype=np.uint32),
            normals=np.tile(np.array([0, 1, 0], dtype=np.float32), (4, 1)),
            uvs=corners[:, [0, 2]],
            texture=Texture(_JPEG_HEAD + pixels + b"\xff\xd9", "image/jpeg", 16, 16),
        )
        payload = encode_segment(mesh, step_m=2.0**-10, scales={})
        # The image's checksum is compressed with the rest, so the length is found by trial.
        if len(payload) == length or not pixels:
            return payload
        pixels = rng.bytes(max(0, len(pixels) + length - len(payload)))


def write_random_scene(
    path: Path, *, side: int, segment_bytes: int, spread: float = 2.0, seed: int = 1
) -> Manifest:
    """Publish a grid of side x side segments; segment row * side + column lies at column, row.

    Parameters
    ----------
    path : Path
        The scene directory.
    side : int
        Segments along each edge, 10 m each.
    segment_bytes : int
        Median length of a payload.
    spread : float, optional
        Lengths vary by that factor either way; 1 = all are equal.
    seed : int, optional
        Another seed is another version.
    """
    rng = np.random.default_rng(seed)
    with SceneWriter(path) as writer:
        for number in range(side * side):
            x, z = TILE_M * (number % side), TILE_M * (number // side)
            length = round(segment_bytes * spread ** rng.uniform(-1.0, 1.0))
            writer.add_segment(
                _payload(x, z, length, rng),
                region=0,
                bounds=(x, 0.0, z, x + TILE_M, 1.0, z + TILE_M),
                vertices=6000,
                faces=int(rng.integers(5_000, 15_000)),
                texture=(0, 0, 0),
            )
        offsets = np.array([0, 0], dtype=np.uint32)
        writer.set_base(base_payload(), Cover(offsets, np.zeros(0, dtype=np.uint32)))
        return writer.publish(scene_info("trial"))
