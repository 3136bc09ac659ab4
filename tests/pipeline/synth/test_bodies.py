from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.mesh_edges import edge_facts
from terraport_pipeline.synth.bodies import BODIES

VOLUME = {
    "block": 0.8**3 - np.pi * 0.2**2 * 0.8,
    "stairs": 6 / 3.2**2 * 0.8,
    "torus": 2 * np.pi**2 * 0.36 * 0.14**2,
    "sphere": 4 / 3 * np.pi * 0.125,
}


@pytest.mark.parametrize("name", BODIES)
def test_bodies_are_closed_turned_outwards_and_about_a_metre_wide(name: str) -> None:
    vertices, faces = BODIES[name]()
    facts = edge_facts(faces)
    assert len(facts.open_edges) == facts.non_manifold == facts.against == 0
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = (np.cross(a, b) * c).sum() / 6
    assert volume == pytest.approx(VOLUME.get(name, volume), rel=0.005)
    assert volume > 0
    assert 0.7 < np.ptp(vertices, axis=0).max() <= 1.0
