from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.mesh_edges import edge_facts
from terraport_research.kernels.marching_cubes import case_table, march


def grid(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    shape = values.shape
    cells = np.stack(np.meshgrid(*(np.arange(n - 1) for n in shape), indexing="ij"), axis=-1)
    return march(cells.reshape(-1, 3), values.ravel(), np.arange(values.size), shape)


def test_the_table_covers_every_case() -> None:
    table, counts = case_table()
    assert table.shape == (256, 5, 3)
    assert counts[0] == counts[255] == 0
    assert (counts[1:255] > 0).all()
    assert counts.max() == 5
    # a case and its reverse cross the same edges
    for case in range(256):
        edges = set(table[case, : counts[case]].ravel())
        assert edges == set(table[255 - case, : counts[255 - case]].ravel())


@pytest.mark.parametrize("seed", range(5))
def test_random_fields_give_closed_surfaces(seed: int) -> None:
    """Every ambiguous face occurs; the outermost nodes are outside, so nothing is cut open."""
    values = np.random.default_rng(seed).normal(size=(9, 8, 7))
    values[[0, -1]] = values[:, [0, -1]] = values[:, :, [0, -1]] = 1.0
    facts = edge_facts(grid(values)[1])
    assert len(facts.open_edges) == 0
    assert facts.against == 0
    assert facts.repeated_faces == 0


def test_a_ball_is_round_and_faces_outwards() -> None:
    x = np.stack(np.meshgrid(*(np.arange(24.0),) * 3, indexing="ij"), axis=-1) - 11.3
    vertices, faces = grid(np.linalg.norm(x, axis=-1) - 8.0)
    vertices = vertices - 11.3
    assert np.linalg.norm(vertices, axis=1) == pytest.approx(8.0, abs=0.03)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    assert ((np.cross(b - a, c - a) * (a + b + c)).sum(axis=1) > 0).all()
    assert edge_facts(faces).euler == 2


def test_unknown_nodes_open_the_surface() -> None:
    values = np.broadcast_to(np.array([-1.0, 1.0]), (6, 6, 2)).copy()
    values[0, 0, 0] = np.nan
    vertices, faces = grid(values)
    assert len(faces) == 2 * (25 - 1)
    assert vertices[:, 2] == pytest.approx(0.5)
