from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.closest_point import TriangleTree
from terraport_pipeline.geometry.mesh.deviation import point_triangle_distances


def soup(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of all lengths that cross each other."""
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(300, 3)) * rng.choice([0.05, 1.0, 20.0], (300, 1))
    faces = np.stack([rng.permutation(300) for _ in range(3)], axis=1).astype(np.int32)
    a, b, c = faces.T
    return vertices, faces[(a != b) & (b != c) & (c != a)]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_equals_looking_at_every_triangle(seed: int) -> None:
    vertices, faces = soup(seed)
    points = np.random.default_rng(seed + 10).normal(size=(200, 3)) * 3
    every = point_triangle_distances(
        np.repeat(points, len(faces), axis=0), np.tile(vertices[faces], (len(points), 1, 1))
    ).reshape(len(points), -1)
    nearest = TriangleTree(vertices, faces).nearest(points)
    assert nearest.distance_m == pytest.approx(every.min(axis=1), abs=1e-5)
    assert (nearest.weights >= -1e-6).all()
    assert nearest.weights.sum(axis=1) == pytest.approx(1, abs=1e-6)
    feet = nearest.interpolate(faces, vertices)
    assert np.linalg.norm(feet - points, axis=1) == pytest.approx(nearest.distance_m, abs=1e-4)


def test_colours_are_interpolated_where_the_place_is() -> None:
    vertices = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0]], np.float32)
    faces = np.array([[0, 1, 2]], np.int32)
    colours = np.array([[0, 0, 0], [200, 0, 0], [0, 100, 0]], np.uint8)
    nearest = TriangleTree(vertices, faces).nearest(np.array([[1.0, 1.0, 5.0]]))
    assert nearest.interpolate(faces, colours).tolist() == [[50.0, 25.0, 0.0]]


def test_triangles_without_area_are_lines_and_points() -> None:
    vertices = np.array([[0, 0, 0], [2, 0, 0], [4, 0, 0], [9, 9, 9]], np.float32)
    faces = np.array([[0, 1, 2], [3, 3, 3]], np.int32)
    nearest = TriangleTree(vertices, faces).nearest(np.array([[3.0, 2.0, 0.0], [9.0, 9.0, 10.0]]))
    assert nearest.distance_m.tolist() == [2.0, 1.0]
    assert nearest.face.tolist() == [0, 1]


def test_a_mesh_without_faces_is_refused() -> None:
    with pytest.raises(ValueError, match="without faces"):
        TriangleTree(np.zeros((3, 3)), np.zeros((0, 3), np.int32))
