"""Distances of points to a mesh that passes by: exact, signed, in any order of the pieces."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.closest_point import TriangleTree
from terraport_pipeline.geometry.mesh.point_sweep import PointSweep


def rough_ground(side: int = 60) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(4)
    x, z = np.meshgrid(np.linspace(0, 30, side), np.linspace(0, 30, side), indexing="ij")
    y = 2 * np.sin(x / 4) + rng.normal(0, 0.1, x.shape)
    number = np.arange(side * side).reshape(side, side)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = [np.stack(corners, -1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))]
    return (
        np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32),
        np.concatenate(faces).astype(np.int32),
    )


@pytest.fixture(scope="module")
def ground() -> tuple[np.ndarray, np.ndarray]:
    return rough_ground()


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    """Near the ground, some far above it and beside it."""
    rng = np.random.default_rng(5)
    near = rng.uniform(-1, 31, (2000, 3))
    near[:, 1] = 2 * np.sin(near[:, 0] / 4) + rng.normal(0, 0.3, len(near))
    far = rng.uniform(-80, 110, (40, 3))
    return np.concatenate([near, far]).astype(np.float32)


def swept(points: np.ndarray, pieces: list, reach_m: float) -> np.ndarray:
    sweep = PointSweep(points, reach_m)
    for vertices, faces in pieces:
        sweep.pass_by(vertices, faces)
    while sweep.farther():
        for vertices, faces in pieces:
            sweep.pass_by(vertices, faces)
    return sweep.distance_m


@pytest.mark.parametrize("reach_m", [0.05, 0.7, 500.0])
def test_distances_are_those_of_a_tree_over_the_faces(ground, points, reach_m) -> None:
    vertices, faces = ground
    expected = TriangleTree(vertices, faces).nearest(points).distance_m
    actual = swept(points, [(vertices, faces)], reach_m)
    np.testing.assert_allclose(np.abs(actual), expected, rtol=1e-4, atol=2e-5)


def test_the_order_and_number_of_pieces_change_nothing(ground, points) -> None:
    vertices, faces = ground
    whole = swept(points, [(vertices, faces)], 0.7)
    pieces = [(vertices, part) for part in np.array_split(faces[::-1], 7)]
    np.testing.assert_allclose(swept(points, pieces, 0.7), whole, rtol=1e-6)


def test_the_sign_is_the_side_also_over_a_ridge_and_below_it() -> None:
    """Over a ridge the edge is nearest, and one face's plane runs over the point, too."""
    vertices = np.array([[-9, 0, -5], [-9, 0, 5], [0, 3, -5], [0, 3, 5], [1, -9, -5], [1, -9, 5]])
    faces = np.array([[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]])
    points = np.array([[0.0, 4.0, 0.0], [-0.5, 3.4, 1.0], [-0.3, 2.5, 0.0], [-3.0, -1.0, 0.0]])
    for order in (faces, faces[::-1]):
        signs = np.sign(swept(points, [(vertices.astype(np.float32), order)], 0.5))
        assert signs.tolist() == [1, 1, -1, -1]


def test_beyond_reach_is_infinite_until_it_grows(ground) -> None:
    sweep = PointSweep(np.array([[3.0, 50.0, 3.0]]), 1.0)
    sweep.pass_by(*ground)
    assert sweep.distance_m.tolist() == [np.inf]
    assert not sweep.measured.any()


def test_no_points_and_no_faces_are_no_fault(ground) -> None:
    empty = PointSweep(np.zeros((0, 3)), 1.0)
    empty.pass_by(*ground)
    assert empty.distance_m.shape == (0,)
    assert not empty.farther()
    alone = PointSweep(np.zeros((1, 3)), 1.0)
    alone.pass_by(ground[0], np.zeros((0, 3), np.int32))
    assert alone.farther()
