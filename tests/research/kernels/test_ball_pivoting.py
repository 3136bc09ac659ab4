from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.mesh_edges import edge_facts
from terraport_pipeline.geometry.mesh.uniform_samples import sample_mesh
from terraport_pipeline.synth.bodies import sphere
from terraport_research.kernels.ball_pivoting import pivot_balls

SPACING = np.sqrt(np.pi / 2000)


def ball(count: int = 2000) -> tuple[np.ndarray, np.ndarray]:
    points, _ = sample_mesh(*sphere(), count, np.random.default_rng(0))
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    return points.astype(np.float32), normals.astype(np.float32)


def test_two_balls_close_a_sphere() -> None:
    points, normals = ball()
    faces = pivot_balls(points, normals, [SPACING, 2 * SPACING])
    facts = edge_facts(faces)
    assert (len(facts.open_edges), facts.non_manifold, facts.against) == (0, 0, 0)
    assert facts.euler == 2
    assert len(faces) == 2 * len(points) - 4  # every sample is a vertex
    a, b, c = (points[faces[:, k]] for k in range(3))
    assert ((np.cross(b - a, c - a) * (a + b + c)).sum(axis=1) > 0).all()


def test_the_ball_lies_on_three_samples_and_holds_none() -> None:
    points, normals = ball(300)
    radius = 2.0 * np.sqrt(np.pi / 300)
    faces = pivot_balls(points, normals, [radius])
    places = points.astype(np.float64)
    a, b, c = (places[faces[:, k]] for k in range(3))
    u, v = b - a, c - a
    normal = np.cross(u, v)
    squared = (normal**2).sum(axis=1, keepdims=True)
    middle = (
        (u**2).sum(axis=1, keepdims=True) * np.cross(v, normal)
        + (v**2).sum(axis=1, keepdims=True) * np.cross(normal, u)
    ) / (2 * squared)
    rise = np.sqrt((radius**2 - (middle**2).sum(axis=1, keepdims=True)) / squared)
    centres = a + middle + rise * normal
    away = np.linalg.norm(centres[:, None] - places[None], axis=2)
    assert away.min() >= radius * (1 - 1e-5)
    assert np.take_along_axis(away, faces.astype(np.int64), axis=1) == pytest.approx(radius)


def test_a_small_ball_leaves_holes_and_a_larger_one_closes_them() -> None:
    points, normals = ball()
    small = edge_facts(pivot_balls(points, normals, [SPACING]))
    assert len(small.open_edges) > 100
    assert len(pivot_balls(points, normals, [SPACING / 100])) == 0


def test_equal_input_gives_equal_bytes() -> None:
    points, normals = ball(500)
    runs = [pivot_balls(points, normals, [0.1, 0.2]).tobytes() for _ in range(2)]
    assert runs[0] == runs[1]


def test_a_gap_wider_than_the_ball_stays() -> None:
    points, normals = ball()
    away = points[:, 1] < 0.4
    faces = pivot_balls(points[away], normals[away], [SPACING, 2 * SPACING])
    facts = edge_facts(faces)
    assert facts.euler == 1  # a disk
    assert len(facts.open_edges) > 20


def test_a_radius_must_be_positive() -> None:
    with pytest.raises(ValueError, match=r"\[1.0, 0.0\]"):
        pivot_balls(*ball(50), [1.0, 0.0])
