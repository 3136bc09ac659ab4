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
    faces, order = cache_order(mesh)
    assert order[faces].tolist() in ([[5, 2, 0]], [[2, 0, 5]], [[0, 5, 2]])
    assert order[3:].tolist() == [1, 3, 4]


def test_unused_vertices_after_the_last_used_one() -> None:
    mesh = SegmentMesh(
        positions=np.zeros((5, 3), dtype=np.float32),
        faces=np.array([[2, 1, 0]], dtype=np.uint32),
        normals=np.zeros((5, 3), dtype=np.float32),
    )
    assert cache_order(mesh)[1][3:].tolist() == [3, 4]
