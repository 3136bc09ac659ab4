from __future__ import annotations

import numpy as np
from photo_scene import ground

from terraport_pipeline.geometry.mesh.mesh_blocks import mesh_blocks


def test_it_is_the_same_mesh_in_another_order() -> None:
    vertices, faces = ground(120)
    blocks = mesh_blocks(vertices, faces)
    assert (blocks.vertices == vertices[blocks.vertex_order]).all()
    assert (blocks.vertex_order[blocks.faces] == faces[blocks.face_order]).all()
    assert (np.sort(blocks.face_order) == np.arange(len(faces))).all()
    assert len(blocks.spheres) == len(blocks.face_starts) - 1 > 4


def test_spheres_hold_their_blocks() -> None:
    vertices, faces = ground(120)
    blocks = mesh_blocks(vertices, faces)
    for b, (x, y, z, radius) in enumerate(blocks.spheres):
        members = blocks.faces[blocks.face_starts[b] : blocks.face_starts[b + 1]]
        away = np.linalg.norm(blocks.vertices[members.ravel()] - (x, y, z), axis=1)
        assert (away <= radius * (1 + 1e-6)).all()
        # and are small, so that they exclude something
        assert radius < 15.0


def test_nothing() -> None:
    blocks = mesh_blocks(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    assert blocks.faces.shape == (0, 3)
    assert (blocks.spheres[:, 3] == -1).all()
