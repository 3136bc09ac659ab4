from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from terraport_pipeline.geometry.clouds.normals import estimate_normals, orient_normals
from terraport_pipeline.geometry.clouds.signs import sky_signs
from terraport_pipeline.geometry.clouds.spacing import estimate_spacing, nearest_neighbours
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.surface import Surface


def normals_of(points: np.ndarray, k: int = 16) -> tuple[np.ndarray, Any, float]:
    points = np.asarray(points, dtype=np.float32)
    neighbours = nearest_neighbours(points, k)
    normals, _ = estimate_normals(points, neighbours, k=k)
    return normals, neighbours, estimate_spacing(neighbours).areal_m


def test_normals_equal_the_smallest_eigenvector() -> None:
    points = np.random.default_rng(1).normal(size=(300, 3)).astype(np.float32)
    neighbours = nearest_neighbours(points, 12)
    normals, curvature = estimate_normals(points, neighbours, k=12)
    for i in range(0, 300, 17):
        near = points[np.append(neighbours.indices[i], i)].astype(np.float64)
        values, vectors = np.linalg.eigh(np.cov(near.T))
        assert abs(normals[i] @ vectors[:, 0]) == pytest.approx(1.0, abs=1e-4)
        assert curvature[i] == pytest.approx(values[0] / values.sum(), abs=1e-5)


def test_normals_far_from_the_origin_lose_nothing() -> None:
    """The covariance is taken about the point, not about zero."""
    rng = np.random.default_rng(2)
    flat = np.column_stack([rng.uniform(0, 8, (2, 400)).T, np.zeros(400)])[:, [0, 2, 1]]
    normals, _, _ = normals_of(flat + np.array([4000.0, 1000.0, -4000.0]))
    assert np.abs(normals[:, 1]).min() > 0.999


def test_points_at_one_place_get_some_unit_normal() -> None:
    normals, _, _ = normals_of(np.zeros((40, 3)))
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)


def test_terrain_faces_up_wherever_it_is_steep() -> None:
    rng = np.random.default_rng(3)
    x, z = rng.uniform(-20, 20, (2, 6000))
    points = np.column_stack([x, 8 * np.tanh(x / 0.8), z]).astype(np.float32)
    normals, neighbours, spacing_m = normals_of(points)
    oriented, _, guessed = orient_normals(points, normals, neighbours, spacing_m=spacing_m)
    slope = 10 / np.cosh(x / 0.8) ** 2
    true = np.column_stack([-slope, np.ones_like(x), np.zeros_like(x)])
    assert ((oriented * true).sum(axis=1) < 0).mean() < 0.001
    assert guessed == 0


def test_an_overhang_is_oriented_out_of_the_rock(overhang: Any) -> None:
    normals, neighbours, spacing_m = normals_of(overhang.points)
    oriented, spread, _ = orient_normals(overhang.points, normals, neighbours, spacing_m=spacing_m)
    wrong = (oriented * overhang.normals).sum(axis=1) < 0
    for edge in range(5):
        assert wrong[overhang.edge == edge].mean() < 0.005, f"edge {edge}"
    assert spread > 0
    assert (oriented[overhang.edge == 2, 1] < 0).mean() > 0.95


def test_under_a_roof_nothing_is_certain(overhang: Any) -> None:
    normals, _, spacing_m = normals_of(overhang.points)
    upward = np.where((normals[:, 1] < 0)[:, None], -normals, normals)
    sky = sky_signs(overhang.points, upward, spacing_m=spacing_m)
    certain = sky.certain
    assert not certain[overhang.edge == 2].any()
    assert certain[overhang.edge == 4].mean() > 0.95
    below = (overhang.edge == 0) & (overhang.points[:, 0] > 1.5) & (overhang.points[:, 0] < 2.5)
    assert not certain[below].any()


def test_a_part_under_a_brow_needs_to_know_of_it(overhang: Any) -> None:
    """What lies in the tile above: without it the underside is the highest ground there is."""
    lower = overhang.points[:, 1] < 5.0
    points, true = overhang.points[lower], overhang.normals[lower]
    underside = overhang.edge[lower] == 2
    normals, neighbours, spacing_m = normals_of(points)

    def wrong(above: np.ndarray | None) -> float:
        oriented, _, _ = orient_normals(
            points, normals, neighbours, spacing_m=spacing_m, above=above
        )
        return float(((oriented * true).sum(axis=1) < 0)[underside].mean())

    assert wrong(None) > 0.5
    assert wrong(overhang.points[overhang.edge == 4]) < 0.01


def test_the_sign_that_comes_in_does_not_matter(overhang: Any) -> None:
    normals, neighbours, spacing_m = normals_of(overhang.points)
    flips = np.where(np.random.default_rng(4).random(len(normals)) < 0.5, -1, 1)
    turned = (normals * flips[:, None]).astype(np.float32)
    first = orient_normals(overhang.points, normals, neighbours, spacing_m=spacing_m)[0]
    second = orient_normals(overhang.points, turned, neighbours, spacing_m=spacing_m)[0]
    # Levels of exactly zero have no sign to agree on.
    assert ((first * second).sum(axis=1) > 0).mean() > 0.9999


def test_inputs_are_not_modified(overhang: Any) -> None:
    normals, neighbours, spacing_m = normals_of(overhang.points)
    before = normals.copy()
    orient_normals(overhang.points, normals, neighbours, spacing_m=spacing_m)
    assert (normals == before).all()


def test_what_nothing_reaches_faces_up() -> None:
    """A lone vertical sheet has no certain point."""
    rng = np.random.default_rng(5)
    sheet = np.column_stack([0.02 * rng.normal(size=500), rng.uniform(0, 9, (2, 500)).T])
    points = sheet.astype(np.float32)
    normals, neighbours, spacing_m = normals_of(points)
    oriented, spread, guessed = orient_normals(points, normals, neighbours, spacing_m=spacing_m)
    upward = np.where((normals[:, 1] < 0)[:, None], -normals, normals)
    certain = sky_signs(points, upward, spacing_m=spacing_m).certain
    assert guessed + spread + certain.sum() == 500
    assert (oriented[:, 1] >= 0).all() or spread > 0


def test_a_highwall_with_notches_is_not_turned_inside_out() -> None:
    """Of 60,000 samples the cheapest link turned 809; a notch's back wall was one wrong step."""
    options = QuarryOptions(points=60_000, size_m=3600.0)
    surface, rng = Surface(options), np.random.default_rng(1)
    middles = surface.triangle_middles * options.scale
    near = np.flatnonzero((np.abs(middles[:, :2] - [-190.0, 980.0]) < 60.0).all(axis=1))
    share = surface.triangle_areas[near] / surface.triangle_areas[near].sum()
    triangle = near[rng.choice(len(near), 60_000, p=share)]
    drawn = surface.evaluate(triangle, rng.uniform(size=(len(triangle), 2)))
    seen = ~drawn.hidden
    x, y, z = (drawn.positions[seen] * options.scale - middles[near].mean(axis=0)).T
    true_x, true_y, true_z = drawn.normals[seen].T
    points = np.stack([x, z, -y], axis=1) + rng.normal(0.0, 0.015, (len(x), 3))
    true = np.stack([true_x, true_z, -true_y], axis=1)
    normals, neighbours, spacing_m = normals_of(points)
    oriented, _, _ = orient_normals(
        points.astype(np.float32), normals, neighbours, spacing_m=spacing_m
    )
    assert (true[:, 1] < -0.3).mean() > 0.1  # undersides
    assert ((oriented * true).sum(axis=1) < 0).mean() < 0.002
