from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.mesh_edges import edge_facts, open_loops
from terraport_pipeline.synth.bodies import BODIES, sphere


@pytest.mark.parametrize(("name", "euler"), [("sphere", 2), ("torus", 0), ("block", 0)])
def test_closed_bodies_have_no_open_edge(name: str, euler: int) -> None:
    facts = edge_facts(BODIES[name]()[1])
    assert len(facts.open_edges) == 0
    assert (facts.non_manifold, facts.against, facts.repeated_faces) == (0, 0, 0)
    assert facts.euler == euler


def test_two_cut_holes_are_two_loops_with_their_size() -> None:
    vertices, faces = sphere()
    middle = vertices[faces].mean(axis=1)
    cut = (middle[:, 1] > 0.48) | (middle[:, 0] > 0.45)
    facts = edge_facts(faces[~cut])
    loops = open_loops(vertices, facts.open_edges)
    assert len(loops.length_m) == 2
    # caps of radius sqrt(0.5^2 - 0.48^2) and sqrt(0.5^2 - 0.45^2), whose rims are jagged
    expected = np.pi * (0.25 - np.array([0.45, 0.48]) ** 2)
    assert sorted(loops.area_m2, reverse=True) == pytest.approx(expected, rel=0.15)
    assert max(loops.extent_m) == pytest.approx(2 * np.sqrt(0.25 - 0.45**2), rel=0.1)
    assert facts.euler == 0


def test_flaws_are_counted() -> None:
    faces = np.array(
        [[0, 1, 2], [0, 2, 3], [0, 2, 4], [5, 6, 7], [5, 6, 8], [0, 1, 2], [9, 9, 1]], np.int32
    )
    facts = edge_facts(faces)
    assert facts.non_manifold == 1  # 0-2, three faces
    assert facts.against == 1  # 5-6 run through twice in one direction
    assert facts.repeated_faces == 2


def test_nothing_is_nothing() -> None:
    facts = edge_facts(np.zeros((0, 3), np.int32))
    assert (facts.edges, len(facts.open_edges), facts.euler) == (0, 0, 0)
    assert len(open_loops(np.zeros((0, 3)), facts.open_edges).length_m) == 0
