"""Points counted in photos, against a plain loop."""

from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.photos.lens import Lens, View
from terraport_pipeline.geometry.photos.view_cover import cover_points

LENS = Lens(200, 100, 100.0, 100.0, 100.0, 50.0)
DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def views():
    """Two cameras 10 and 40 m above, looking down."""
    return [
        View("low", LENS, DOWN, np.array([0.0, 10.0, 0.0])),
        View("high", LENS, DOWN, np.array([5.0, 40.0, 0.0])),
    ]


def test_counts_and_finest_pixels():
    points = np.array(
        [[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [11.0, 0.0, 0.0], [60.0, 0, 0], [0, 50, 0]]
    )
    photos, finest_m, points_in_view = cover_points(views(), points)
    assert photos.tolist() == [2, 2, 1, 0, 0]
    assert finest_m.tolist() == [0.1, 0.1, 0.4, np.inf, np.inf]
    assert points_in_view.tolist() == [2, 3]


def test_coarse_pixels_do_not_count():
    photos, _, points_in_view = cover_points(views(), np.zeros((1, 3)), coarsest_m=0.2)
    assert photos.tolist() == [1]
    assert points_in_view.tolist() == [1, 0]


def test_agrees_with_projecting_by_numpy():
    points = np.random.default_rng(3).uniform(-30, 30, (500, 3))
    photos, _, _ = cover_points(views(), points)
    expected = np.zeros(500, int)
    for view in views():
        pixels, _ = view.project(points)
        expected += ((pixels >= 0) & (pixels < (200, 100))).all(axis=1)
    assert (photos == expected).all()
