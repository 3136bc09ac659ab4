"""File name extensions of the mesh files that are read, and of written segments."""

from __future__ import annotations

from typing import Final

__all__ = ["GLTF_ENDINGS", "MESH_ENDINGS", "SEGMENT_ENDINGS"]

GLTF_ENDINGS: Final = (".glb", ".gltf")

MESH_ENDINGS: Final = (".off", ".ply", ".obj", ".stl", *GLTF_ENDINGS)

SEGMENT_ENDINGS: Final = (".seg", ".npy", ".ply", ".glb")
