from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.closest_point import TriangleTree
from terraport_research.reconstructors import RECONSTRUCTORS, Samples, Work
from terraport_research.subjects import Subject, body


@pytest.fixture(scope="module")
def ball() -> Subject:
    return body("sphere", 2000)


@pytest.mark.parametrize("key", RECONSTRUCTORS)
def test_each_algorithm_on_a_sphere(key: str, ball: Subject, tmp_path: Path) -> None:
    algorithm = RECONSTRUCTORS[key]
    samples = ball.samples
    surface = algorithm.run(samples, Work(tmp_path))
    assert len(surface.faces) > 1000
    assert surface.vertices.dtype == np.float32
    assert surface.faces.dtype == np.int32
    assert surface.faces.max() < len(surface.vertices)
    if surface.sample is not None:
        assert surface.vertices.tobytes() == samples.points[surface.sample].tobytes()
    gap = TriangleTree(surface.vertices, surface.faces).nearest(ball.seen).distance_m
    limit = 2.0 if key == "delaunay" else 0.5
    assert np.percentile(gap, 95) < limit * samples.spacing_m
    if key != "delaunay":
        a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
        outward = (np.cross(b - a, c - a) * (a + b + c)).sum(axis=1) > 0
        assert outward.mean() > 0.99


def test_delaunay_makes_ground_that_looks_up(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 10, (500, 3)).astype(np.float32) * np.float32([1, 0.1, 1])
    up = np.tile(np.array([0, 1, 0], np.float32), (500, 1))
    samples = Samples(points, up, np.zeros((500, 3), np.uint8), np.ones(500, np.float32), 0.45)
    faces = RECONSTRUCTORS["delaunay"].run(samples, Work(tmp_path)).faces
    a, b, c = (points[faces[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 1] > 0).all()
