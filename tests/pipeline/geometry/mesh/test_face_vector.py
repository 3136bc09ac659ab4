from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.face_vector import face_vector


def test_twice_the_area_along_the_normal() -> None:
    vertices = np.array([[1, 1, 1], [1, 1, 3], [4, 1, 1]], np.float32)
    face = np.array([[0, 1, 2], [0, 2, 1], [0, 0, 1]], np.int32)
    assert face_vector(vertices, face, 0) == (0.0, 6.0, 0.0)
    assert face_vector(vertices, face, 1) == (0.0, -6.0, 0.0)
    assert face_vector(vertices, face, 2) == (0.0, 0.0, 0.0)


def test_far_from_the_origin_it_loses_no_more_than_the_vertices_did() -> None:
    far = np.array([[8192, 512, -8192]] * 3, np.float32) + 2.0**-10 * np.array(
        [[0, 0, 0], [0, 0, 1], [1, 0, 0]], np.float32
    )
    assert face_vector(far, np.array([[0, 1, 2]], np.int32), 0)[1] == pytest.approx(2.0**-20)
