from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.mesh.vertex_normals import vertex_normals


def test_counter_clockwise_seen_from_above_points_up() -> None:
    vertices = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0]], dtype=np.float32)
    normals = vertex_normals(vertices, np.array([[0, 1, 2]], dtype=np.int32))
    assert normals.tolist() == [[0, 1, 0]] * 3


def test_weights_are_areas() -> None:
    """A floor of area 2 and a wall of area 1 lean the shared vertices to the floor."""
    vertices = np.array([[0, 0, 0], [0, 0, 2], [2, 0, 0], [0, 1, 0]], dtype=np.float32)
    faces = np.array([[0, 1, 2], [0, 3, 1]], dtype=np.int32)
    shared = vertex_normals(vertices, faces)[0]
    assert np.allclose(shared, np.array([1.0, 2.0, 0.0]) / np.sqrt(5.0), atol=1e-6)


def test_unused_and_degenerate_vertices_point_up() -> None:
    vertices = np.zeros((4, 3), dtype=np.float32)
    normals = vertex_normals(vertices, np.array([[0, 1, 2]], dtype=np.int32))
    assert (normals == (0, 1, 0)).all()


def test_a_sphere_points_outwards() -> None:
    rng = np.random.default_rng(1)
    from scipy.spatial import ConvexHull

    points = rng.normal(size=(400, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    hull = ConvexHull(points)
    faces = hull.simplices.copy()
    inward = (
        np.cross(
            points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
        )
        * points[faces[:, 0]]
    ).sum(axis=1) < 0
    faces[inward] = faces[inward][:, ::-1]
    normals = vertex_normals(points.astype(np.float32), faces.astype(np.int32))
    assert ((normals * points).sum(axis=1) > 0.95).all()
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)
