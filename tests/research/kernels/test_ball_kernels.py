"""Balls on three samples, and the samples around a place."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_research.kernels.ball_kernels import (
    agrees,
    grid_points,
    is_empty,
    points_around,
    rest_ball,
)

TRIANGLE = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [0.25, 0.5, 0.25]], np.float64)


@pytest.mark.parametrize("reach", [0.02, 0.1, 0.3])
def test_all_points_within_reach_and_no_others(reach: float) -> None:
    points = np.random.default_rng(0).random((800, 3))
    grid = grid_points(points, reach)
    out = np.empty(800, np.int64)
    for centre in np.random.default_rng(1).uniform(-0.2, 1.2, (40, 3)):
        count = points_around(*centre, reach, points, grid, out)
        away = ((points - centre) ** 2).sum(axis=1)
        assert sorted(out[:count].tolist()) == np.flatnonzero(away <= reach * reach).tolist()


def test_no_more_are_told_than_there_is_room_for() -> None:
    points = np.zeros((50, 3))
    out = np.empty(7, np.int64)
    assert points_around(0.0, 0.0, 0.0, 1.0, points, grid_points(points, 1.0), out) == 7


def test_a_ball_rests_on_the_side_that_sees_the_corners_anticlockwise() -> None:
    centre = np.empty(3)
    assert rest_ball(TRIANGLE, 0, 1, 2, 1.0, centre)
    assert np.linalg.norm(TRIANGLE[:3] - centre, axis=1) == pytest.approx([1, 1, 1])
    assert centre[1] > 0
    assert rest_ball(TRIANGLE, 0, 2, 1, 1.0, centre)
    assert centre[1] < 0


def test_a_ball_that_is_too_small_falls_through() -> None:
    radius = np.sqrt(0.5)  # of the circle through the corners
    assert rest_ball(TRIANGLE, 0, 1, 2, radius * 1.001, np.empty(3))
    assert not rest_ball(TRIANGLE, 0, 1, 2, radius * 0.999, np.empty(3))


def test_samples_in_a_line_hold_no_ball() -> None:
    line = np.array([[0, 0, 0], [1, 1, 1], [2, 2, 2.0]])
    assert not rest_ball(line, 0, 1, 2, 10.0, np.empty(3))


def test_a_face_agrees_with_all_three_normals_or_not_at_all() -> None:
    up = np.tile([0.0, 1.0, 0.0], (4, 1))
    assert agrees(TRIANGLE, up, 0, 1, 2)
    assert not agrees(TRIANGLE, up, 0, 2, 1)
    up[1] = 0, -1, 0
    assert not agrees(TRIANGLE, up, 0, 1, 2)


def test_what_lies_in_the_ball_is_seen_and_its_own_three_are_not() -> None:
    centre = np.empty(3)
    rest_ball(TRIANGLE, 0, 1, 2, 1.0, centre)
    near = np.arange(4)
    assert not is_empty(TRIANGLE, centre, 1.0, near, 4, 0, 1, 2)
    assert is_empty(TRIANGLE, centre, 1.0, near, 3, 0, 1, 2)
    away = TRIANGLE.copy()
    away[3] = 0.25, -0.5, 0.25
    assert is_empty(away, centre, 1.0, near, 4, 0, 1, 2)
