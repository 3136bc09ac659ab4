"""Distances to triangles, and the base faces that stand in for far detail."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.cover import far_detail as module
from terraport_pipeline.geometry.cover.columns import fit_grid
from terraport_pipeline.geometry.cover.far_detail import far_detail, median_edge
from terraport_pipeline.geometry.mesh.adjacency import as_kernel_input


@pytest.mark.parametrize("seed", range(30))
def test_distance_to_a_triangle(seed):
    """Against a dense sampling of the triangle, collapsed triangles included."""
    rng = np.random.default_rng(seed)
    a, b, c, p = rng.normal(0, 2, (4, 3))
    if seed % 5 == 0:
        c = a + 0.3 * (b - a)
    if seed % 11 == 0:
        b = a.copy()
    u, v = np.meshgrid(np.linspace(0, 1, 201), np.linspace(0, 1, 201))
    inside = u + v <= 1 + 1e-12
    points = a + u[inside][:, None] * (b - a) + v[inside][:, None] * (c - a)
    sampled = np.sqrt(((points - p) ** 2).sum(axis=1).min())
    exact = np.sqrt(module._distance_squared(p, a, b, c))
    assert exact <= sampled + 1e-12
    assert exact == pytest.approx(sampled, abs=0.05)


def test_far_faces_are_counted_and_listed_nearby():
    """A detail face 1 m above the base is far at a tolerance of 0.2 m; one 0.3 m above is not."""
    base_v = np.array([[x, 0, z] for x in (0.0, 2, 4) for z in (0.0, 2, 4)])
    base_f = np.array(
        [[0, 1, 3], [3, 1, 4], [1, 2, 4], [4, 2, 5], [3, 4, 6], [6, 4, 7], [4, 5, 7], [7, 5, 8]],
        np.int32,
    )
    corners = np.array([[0.5, 0, 0.5], [0.9, 0, 0.5], [0.5, 0, 0.9]])
    detail_v = np.concatenate([np.add(corners, [0, 0.3, 0]), np.add(corners, [0, 1.0, 0])])
    detail_f = np.arange(6, dtype=np.int32).reshape(2, 3)
    base = as_kernel_input(base_v, np.float64), as_kernel_input(base_f, np.int32)
    detail = as_kernel_input(detail_v, np.float64), as_kernel_input(detail_f, np.int32)
    grid = fit_grid([base, detail], 0.5, 0.5)
    segment = np.array([7, 9], np.int32)
    far = far_detail(base, detail, segment, grid, reach_m=0.5, tolerance_m=0.2)
    assert (far.far_faces, far.baseless_faces) == (1, 0)
    assert set(far.segment.tolist()) == {9}
    # the four nearest vertices are 0, 1, 3 and 4: every face but the last has one of them
    assert np.diff(far.offsets).tolist() == [1, 1, 1, 1, 1, 1, 1, 0]


def test_detail_without_base_is_counted():
    """Nothing in the column: far, baseless, and beyond all reach unlisted."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 1]])
    face = as_kernel_input(np.array([[0, 1, 2]]), np.int32)
    base = as_kernel_input(corners, np.float64), face
    detail = as_kernel_input(np.add(corners, [50.0, 0, 50.0]), np.float64), face
    grid = fit_grid([base, detail], 1.0, 1.0)
    far = far_detail(base, detail, np.array([0], np.int32), grid, reach_m=1.0, tolerance_m=0.1)
    assert (far.far_faces, far.baseless_faces, far.offsets.tolist()) == (1, 1, [0, 0])


def test_median_edge():
    """Of the first edges."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 5]])
    assert median_edge(vertices, np.array([[0, 1, 2], [1, 0, 2], [2, 0, 1]], np.int32)) == 1.0
