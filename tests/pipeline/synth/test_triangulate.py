from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.synth.triangulate import grid_triangles, icosphere, refine


def directed_edges(faces: np.ndarray) -> np.ndarray:
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def check_conforming(faces: np.ndarray) -> int:
    """Every directed edge occurs once, so no T-junction and one winding; count the border."""
    edges = directed_edges(faces)
    unique, counts = np.unique(edges, axis=0, return_counts=True)
    assert counts.max() == 1
    forward = {tuple(edge) for edge in unique.tolist()}
    return sum((b, a) not in forward for a, b in forward)


def plan_areas(places: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Signed area of each face in the plane."""
    a, b, c = places[faces].transpose(1, 0, 2)
    ab, ac = b - a, c - a
    return 0.5 * (ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])


def test_grid_covers_the_rectangle_upwards() -> None:
    places, faces = grid_triangles(3.0, 2.0, 1.0)
    assert len(places) == 7 * 5
    assert check_conforming(faces) == 2 * (6 + 4)
    area = plan_areas(places, faces)
    assert (area > 0).all()
    assert area.sum() == pytest.approx(24.0)


def test_icosphere_is_closed_and_round() -> None:
    unit, faces = icosphere(2)
    assert (len(unit), len(faces)) == (162, 320)
    assert check_conforming(faces) == 0
    np.testing.assert_allclose(np.linalg.norm(unit, axis=1), 1.0)
    outward = np.cross(unit[faces[:, 1]] - unit[faces[:, 0]], unit[faces[:, 2]] - unit[faces[:, 0]])
    assert (np.einsum("ij,ij->i", outward, unit[faces].mean(axis=1)) > 0).all()


def test_refine_bounds_every_edge_on_a_steep_surface_without_a_crack() -> None:
    def position_of(parameters: np.ndarray) -> np.ndarray:
        u, v = parameters.T
        return np.stack([u, v, 6.0 * np.tanh(4.0 * u)], axis=1)

    places, faces = grid_triangles(3.0, 2.0, 1.0)
    before = places.copy()
    parameters, positions, refined = refine(places, faces, position_of, 0.5)
    np.testing.assert_array_equal(places, before)
    np.testing.assert_array_equal(parameters[: len(places)], places)
    np.testing.assert_array_equal(positions, position_of(parameters))
    edges = directed_edges(refined)
    length = np.linalg.norm(positions[edges[:, 0]] - positions[edges[:, 1]], axis=1)
    assert length.max() <= 0.5
    check_conforming(refined)
    area = plan_areas(parameters, refined)
    assert (area > 0).all()
    assert area.sum() == pytest.approx(24.0)  # the same rectangle, nothing twice, nothing missing
