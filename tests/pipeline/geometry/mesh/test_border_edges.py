from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.clouds.border import area_outside_m2, border_edges, measure_border
from terraport_pipeline.geometry.clouds.footprint import Footprint


def strip(length: int) -> tuple[np.ndarray, np.ndarray]:
    """Cells of one metre in a row along x, two faces each, looking up."""
    x = np.repeat(np.arange(length + 1), 2)
    z = np.tile([0, 1], length + 1)
    vertices = np.stack([x, 0 * x, z], axis=1).astype(np.float32)
    cell = 2 * np.arange(length)
    faces = np.concatenate(
        [np.stack([cell, cell + 1, cell + 2], axis=1), np.stack([cell + 2, cell + 1, cell + 3], 1)]
    )
    return vertices, faces.astype(np.int32)


# Inside where x < 2.5: half a metre per cell.
LEFT = Footprint((0.0, -5.0), 0.5, np.tile(2.5 - 0.5 * np.arange(40.0)[:, None], (1, 30)))


def test_border_edges_are_those_of_one_face_in_its_direction() -> None:
    vertices, faces = strip(3)
    border = border_edges(faces, len(vertices))
    directed = {(a, b) for f in faces.tolist() for a, b in zip(f, [*f[1:], f[0]], strict=True)}
    expected = sorted((a, b) for a, b in directed if (b, a) not in directed)
    assert border.tolist() == [list(edge) for edge in expected]
    assert len(border) == 8


def test_a_closed_surface_has_no_border() -> None:
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], np.int32)
    assert border_edges(faces, 4).shape == (0, 2)
    vertices = np.eye(4, 3, dtype=np.float32)
    facts = measure_border(vertices, faces, LEFT, lambda p: np.zeros(len(p), np.float32), 1.0)
    assert facts.length_m == facts.teeth_p95 == 0.0


def test_border_facts_of_a_strip() -> None:
    vertices, faces = strip(8)
    facts = measure_border(vertices, faces, LEFT, lambda p: p[:, 0].astype(np.float32), 2.0)
    assert facts.length_m == pytest.approx(18.0)
    assert facts.reach_p50 == pytest.approx(4.0)
    assert facts.teeth_p50 == 0.0  # straight but for the four corners
    assert facts.teeth_p95 > 0.0
    assert facts.outside_m2 == area_outside_m2(vertices, faces, LEFT) == pytest.approx(5.5, abs=0.6)


def test_two_fans_whose_numbers_balance_have_a_border_each() -> None:
    """Vertex 0 joins faces (0, 1, 2) and (0, 4, 3): 1 - 2 + 4 - 3 is 0, and yet it is border."""
    edges = border_edges(np.array([[0, 1, 2], [0, 4, 3]], np.int32), 5)
    assert edges.tolist() == [[0, 1], [0, 4], [1, 2], [2, 0], [3, 0], [4, 3]]
