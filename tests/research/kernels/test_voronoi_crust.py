from __future__ import annotations

import numpy as np

from terraport_pipeline.geometry.mesh.mesh_edges import edge_facts
from terraport_pipeline.geometry.mesh.uniform_samples import sample_mesh
from terraport_pipeline.synth.bodies import sphere, torus
from terraport_research.kernels.voronoi_crust import crust


def test_the_crust_of_a_sphere_is_its_surface() -> None:
    points, _ = sample_mesh(*sphere(), 2000, np.random.default_rng(0))
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    faces = crust(points.astype(np.float32), normals.astype(np.float32))
    # a closed surface has 2 V - 4; where four samples are nearly level both diagonals stay
    assert 2 * 2000 - 4 <= len(faces) < 2.1 * 2000
    assert len(np.unique(faces)) == 2000
    assert len(edge_facts(faces).open_edges) < 20
    a, b, c = (points[faces[:, k]] for k in range(3))
    assert ((np.cross(b - a, c - a) * (a + b + c)).sum(axis=1) > 0).all()


def test_no_triangle_spans_the_hole_of_a_torus() -> None:
    points, _ = sample_mesh(*torus(), 3000, np.random.default_rng(0))
    faces = crust(points.astype(np.float32), np.zeros((3000, 3), np.float32))
    corners = points[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    assert longest < 0.15  # the hole is 0.44 wide, the spacing 0.026
