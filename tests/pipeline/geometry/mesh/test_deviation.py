from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.deviation import distances_to_mesh, point_triangle_distances


def test_distance_equals_a_dense_sampling_of_the_triangle() -> None:
    rng = np.random.default_rng(1)
    triangles = rng.normal(size=(40, 3, 3))
    points = 2 * rng.normal(size=(40, 3))
    u, v = np.meshgrid(np.linspace(0, 1, 150), np.linspace(0, 1, 150))
    inside = u + v <= 1
    u, v = u[inside], v[inside]
    for point, (a, b, c), distance in zip(
        points, triangles, point_triangle_distances(points, triangles), strict=True
    ):
        surface = a + u[:, None] * (b - a) + v[:, None] * (c - a)
        expected = np.linalg.norm(surface - point, axis=1).min()
        assert distance <= expected + 1e-9
        assert distance == pytest.approx(expected, abs=0.03)


def test_triangles_without_area_count_as_edges_and_points() -> None:
    triangles = np.array([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], [[1.0, 1, 1]] * 3])
    distances = point_triangle_distances(np.array([[1.5, 2.0, 0], [1, 1, 4]]), triangles)
    assert distances.tolist() == [2.0, 3.0]


def test_distance_to_a_mesh_takes_the_nearest_face() -> None:
    vertices = np.array([[0, 0, 0], [4, 0, 0], [0, 0, 4], [0, 9, 0], [4, 9, 0], [0, 9, 4]])
    faces = np.array([[0, 1, 2], [3, 4, 5]], dtype=np.int32)
    points = np.array([[1, 2, 1], [1, 8, 1], [-3, 0, 0]], dtype=np.float32)
    assert distances_to_mesh(points, vertices.astype(np.float32), faces).tolist() == [2, 1, 3]
