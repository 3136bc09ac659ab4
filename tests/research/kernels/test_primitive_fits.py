"""Errors of primitives from moments, against fits to points; and unions by them."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.optimize import least_squares

from terraport_research.kernels.face_clusters import unite_by_fit
from terraport_research.kernels.primitive_fits import fit_error, part_sums

TURN = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [0.3, 0.1, 0.2])


def sums_of(mesh: trimesh.Trimesh) -> np.ndarray:
    return part_sums(np.asarray(mesh.triangles), mesh.area_faces, np.asarray(mesh.face_normals))


def tube(sections: int = 64) -> trimesh.Trimesh:
    mesh = trimesh.creation.cylinder(1.0, 3.0, sections=sections)
    mesh.update_faces(np.abs(mesh.face_normals[:, 2]) < 0.5)
    return mesh


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.icosphere(3, radius=2.0),
        tube(),
        trimesh.Trimesh([[0, 0, 0], [3, 0, 0], [0, 2, 0], [3, 2, 0]], [[0, 1, 2], [2, 1, 3]]),
    ],
    ids=["sphere", "cylinder", "plane"],
)
def test_a_primitive_fits_itself_wherever_it_lies(mesh: trimesh.Trimesh) -> None:
    for moved in (mesh, mesh.copy().apply_transform(TURN).apply_translation((4, -2, 1))):
        # Middles of a chord lie inside: that is all that is left.
        assert 0.0 <= fit_error(sums_of(moved).sum(axis=0)) / moved.area < 2e-5


def test_a_sphere_through_a_box() -> None:
    """Of a unit cube, by hand; no plane or cylinder is nearer.

    In the middles of the edges of 12 triangles, x^2 is 1/2 (edges of the cube) or 1/4 (diagonals):
    mean 5/12. The sphere has r^2 = 5/12, and the mean of (x^2 - r^2)^2 over 4 r^2 is
    ((1/12)^2 2/3 + (1/6)^2 1/3) / (5/3).
    """
    box = trimesh.creation.box()
    expected = ((1 / 12) ** 2 * 2 / 3 + (1 / 6) ** 2 / 3) / (5 / 3)
    assert fit_error(sums_of(box).sum(axis=0)) / box.area == pytest.approx(expected)


def test_the_cylinder_is_that_of_an_algebraic_fit() -> None:
    """Half a tube, dented: against scipy's least squares with the axis given."""
    half = tube()
    half.update_faces(half.triangles_center[:, 0] > 0.0)
    vertices = np.array(half.vertices)
    vertices[:, 1] *= 0.9
    half = trimesh.Trimesh(vertices, half.faces, process=False)
    middles = (half.triangles + np.roll(half.triangles, 1, axis=1)) / 2
    places = middles.reshape(-1, 3)[:, :2]
    weight = np.sqrt(np.repeat(half.area_faces / 3, 3))

    def residuals(x: np.ndarray) -> np.ndarray:
        return weight * ((places**2).sum(axis=1) - 2 * places @ x[:2] - x[2])

    fit = least_squares(residuals, np.zeros(3))
    radius2 = fit.x[2] + (fit.x[:2] ** 2).sum()
    expected = 2 * fit.cost / (4 * radius2)
    assert fit_error(sums_of(half).sum(axis=0)) == pytest.approx(expected, rel=1e-6)


def test_unions_stay_within_primitives_while_they_can() -> None:
    """Two spheres that touch in one shared pair of faces: the last union is across."""
    ball = trimesh.creation.icosphere(2)
    n = len(ball.faces)
    sums = np.concatenate([sums_of(ball), sums_of(ball.copy().apply_translation((2, 0, 0)))])
    pairs = np.concatenate([ball.face_adjacency, ball.face_adjacency + n, [[0, n]]]).astype(
        np.int32
    )
    unions = unite_by_fit(pairs, sums / sums[:, 0].sum())
    assert len(unions) == 2 * n - 1
    assert (unions[:, 0] < unions[:, 1]).all()
    part = np.arange(2 * n)
    for keep, gone in unions[:-1]:
        part[part == gone] = keep
    assert (len(set(part[:n])), len(set(part[n:])), len(set(part))) == (1, 1, 2)
