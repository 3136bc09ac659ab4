"""The scene that a fuzzed service serves: small, and real meshes, so that picks work."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from parts.random_scene import TILE_M, base_payload, scene_info

from terraport_payload import Cover, SegmentMesh, encode_segment
from terraport_store import SceneWriter

__all__ = ["EDGE_M", "SEGMENTS", "SIDE", "write_small_scene"]

SIDE: Final = 6
SEGMENTS: Final = SIDE * SIDE
EDGE_M: Final = SIDE * TILE_M


def write_small_scene(path: Path) -> None:
    """Publish a plane of SIDE x SIDE segments of two triangles each."""
    square = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]], dtype=np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
    normals = np.tile(np.array([0, 1, 0], dtype=np.float32), (4, 1))
    with SceneWriter(path) as writer:
        for number in range(SEGMENTS):
            corner = np.array([number % SIDE, 0, number // SIDE], dtype=np.float32)
            mesh = SegmentMesh(
                positions=(square + corner) * np.float32(TILE_M), faces=faces, normals=normals
            )
            writer.add_segment(encode_segment(mesh, step_m=2.0**-10, scales={}), region=0)
        offsets = np.array([0, 0], dtype=np.uint32)
        writer.set_base(base_payload(), Cover(offsets, np.zeros(0, dtype=np.uint32)))
        writer.publish(scene_info("fuzz"))
