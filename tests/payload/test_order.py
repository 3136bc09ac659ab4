from __future__ import annotations

import numpy as np

from terraport_payload import SegmentMesh
from terraport_payload.order import cache_order


def test_unused_vertices_come_last_in_their_order() -> None:
    mesh = SegmentMesh(
        positions=np.zeros((6, 3), dtype=np.float32),
        faces=np.array([[5, 2, 0]], dtype=np.uint32),
        normals=np.zeros((6, 3), dtype=np.float32),
    )
    faces, order = cache_order(mesh, keep_face_order=True)
    assert faces.tolist() == [[0, 1, 2]]
    assert order.tolist() == [5, 2, 0, 1, 3, 4]


def test_unused_vertices_after_the_last_used_one() -> None:
    mesh = SegmentMesh(
        positions=np.zeros((5, 3), dtype=np.float32),
        faces=np.array([[2, 1, 0]], dtype=np.uint32),
        normals=np.zeros((5, 3), dtype=np.float32),
    )
    assert cache_order(mesh, keep_face_order=True)[1].tolist() == [2, 1, 0, 3, 4]
