from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.mesh_edges import edge_facts
from terraport_pipeline.geometry.mesh.uniform_samples import sample_mesh
from terraport_pipeline.synth.bodies import sphere
from terraport_research.kernels.signed_distance import march_samples


def test_a_sphere_comes_back_closed_and_close() -> None:
    points, _ = sample_mesh(*sphere(), 2000, np.random.default_rng(0))
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    spacing = np.sqrt(np.pi / 2000)
    arguments = points.astype(np.float32), normals.astype(np.float32)
    vertices, faces = march_samples(*arguments, cell_m=spacing, reach_m=3 * spacing)
    assert np.linalg.norm(vertices, axis=1) == pytest.approx(0.5, abs=0.2 * spacing)
    facts = edge_facts(faces)
    assert (len(facts.open_edges), facts.euler, facts.against) == (0, 2, 0)
    again = march_samples(*arguments, cell_m=spacing, reach_m=3 * spacing, workers=2)
    assert again[0].tobytes() == vertices.tobytes()


def test_a_sheet_ends_within_its_reach() -> None:
    x, z = np.meshgrid(np.arange(20.0), np.arange(20.0))
    points = np.stack([x.ravel(), np.zeros(400), z.ravel()], axis=1).astype(np.float32)
    normals = np.tile(np.array([0, 1, 0], np.float32), (400, 1))
    vertices, faces = march_samples(points, normals, cell_m=0.9, reach_m=2.0)
    assert np.abs(vertices[:, 1]).max() < 1e-3  # the field is 0 at nodes
    assert vertices[:, [0, 2]].min() >= -2.0
    assert vertices[:, [0, 2]].max() <= 21.0
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 1] > 0).all()
