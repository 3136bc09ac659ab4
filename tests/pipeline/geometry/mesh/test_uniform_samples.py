from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.uniform_samples import sample_mesh


def test_samples_follow_area_and_lie_on_the_mesh() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [9, 0, 0], [18, 0, 0], [9, 1, 0.0]])
    faces = np.array([[0, 1, 2], [3, 4, 5]], np.int32)
    points, face = sample_mesh(vertices, faces, 5000, np.random.default_rng(0))
    assert (face == 1).mean() == pytest.approx(0.9, abs=0.001)
    assert points[:, 2].tolist() == [0.0] * 5000
    first = points[face == 0]
    assert first.mean(axis=0)[:2] == pytest.approx([1 / 3, 1 / 3], abs=0.02)
    assert (first.sum(axis=1) <= 1).all()


def test_equal_seeds_give_equal_bytes() -> None:
    vertices, faces = np.eye(3), np.array([[0, 1, 2]], np.int32)
    runs = [sample_mesh(vertices, faces, 9, np.random.default_rng(4))[0] for _ in range(2)]
    assert runs[0].tobytes() == runs[1].tobytes()


def test_a_mesh_without_area_is_refused() -> None:
    with pytest.raises(ValueError, match="1 faces without area"):
        sample_mesh(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32), 5, np.random.default_rng(0))
