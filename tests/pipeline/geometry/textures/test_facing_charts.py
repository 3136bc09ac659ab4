from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.textures.facing_charts import axis_of, facing_labels

UP = -3
"""The label of +y."""


def strip(*normals: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Faces in a row, each with an edge in common with the next; their normals as given."""
    faces = np.array([[i, i + 1, i + 2] for i in range(len(normals))])
    return np.array(normals, float), face_pairs(faces, len(normals) + 2)[0]


def test_faces_go_with_the_nearest_axis() -> None:
    directions = [(3, 1, 0), (-3, 1, 0), (0, 2, 1), (1, -2, 0), (0, 1, 4), (1, 0, -2)]
    labels = facing_labels(np.array(directions, float), np.zeros((0, 2), np.int32))
    assert labels.tolist() == [-1, -2, -3, -4, -5, -6]
    axes = axis_of(labels)
    assert (np.einsum("fk,fk->f", axes, directions) > 0).all()
    assert axes[2].tolist() == [0.0, 1.0, 0.0]


def test_a_steep_face_in_level_ground_joins_it() -> None:
    normals, pairs = strip((0, 1, 0), (0, 1, 0), (2, 1, 0), (0, 1, 0), (0, 1, 0))
    assert facing_labels(normals, pairs).tolist() == [UP] * 5


def test_a_wall_and_an_underside_do_not() -> None:
    for other, label in (((5, 0.1, 0), -1), ((0, -1, 0), -4)):
        normals, pairs = strip((0, 1, 0), (0, 1, 0), other, (0, 1, 0), (0, 1, 0))
        assert facing_labels(normals, pairs).tolist() == [UP, UP, label, UP, UP]


def test_a_large_slope_stays_a_chart() -> None:
    normals, pairs = strip(*[(0, 1, 0)] * 100, *[(2, 1, 0)] * 70)
    assert facing_labels(normals, pairs).tolist() == [UP] * 100 + [-1] * 70
    normals, pairs = strip(*[(0, 1, 0)] * 100, *[(2, 1, 0)] * 60)
    assert facing_labels(normals, pairs).tolist() == [UP] * 160


def test_two_of_one_size_do_not_change_places() -> None:
    normals, pairs = strip((2, 1.9, 0), (1.9, 2, 0))
    assert len(set(facing_labels(normals, pairs).tolist())) == 1


def test_faces_without_area_are_no_obstacle() -> None:
    normals, pairs = strip((0, 1, 0), (0, 0, 0), (0, 1, 0))
    assert facing_labels(normals, pairs)[[0, 2]].tolist() == [UP, UP]
