"""Distances of the survey's points to the mesh, against an independent reckoning."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from terraport_payload import SegmentMesh
from terraport_pipeline.model import Mesh
from terraport_pipeline.report.accuracy import Accuracy, AccuracyMeter, draw_distances
from terraport_pipeline.report.plan_view import PAPER, Plan

CORNER_M = 20.0


@pytest.fixture(scope="module")
def survey(make_terrain) -> tuple[Mesh, np.ndarray]:
    """A mesh, and points of a corner of it that scatter 10 cm about finer ground, with outliers."""
    mesh = make_terrain(120)
    rng = np.random.default_rng(11)
    fine = make_terrain(400).vertices
    fine = fine[(fine[:, [0, 2]] < CORNER_M).all(axis=1)]
    points = fine[rng.integers(0, len(fine), 20_000)].astype(np.float64)
    points += rng.normal(0, 0.1, points.shape)
    points[:20, 1] += rng.uniform(2, 15, 20)
    normals = np.zeros_like(mesh.vertices)
    return Mesh(mesh.vertices, mesh.faces, normals, mesh.colours, {}), points.astype(np.float32)


@pytest.fixture(scope="module")
def accuracy(survey) -> Accuracy:
    mesh, points = survey
    measured = AccuracyMeter(points, 0.3, len(points)).finish(mesh)
    assert measured is not None
    return measured


def test_within_5_percent_of_nearest_neighbours_in_a_dense_sampling(survey, accuracy) -> None:
    """Samples every 2 cm or so on the mesh: they lengthen distances of some 7 cm by 1 %."""
    mesh, points = survey
    near = (mesh.vertices[mesh.faces].mean(axis=1)[:, [0, 2]] < CORNER_M + 3).all(axis=1)
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces[near], process=False)
    samples, _ = trimesh.sample.sample_surface(surface, 1_500_000, seed=1)
    nearest, _ = cKDTree(samples).query(points)
    for percent in (50, 90, 95, 99):
        expected = float(np.percentile(nearest, percent))
        assert accuracy.percentile_m(percent) == pytest.approx(expected, rel=0.05), percent


def test_point_by_point_as_trimesh_has_it(survey, accuracy) -> None:
    mesh, points = survey
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    _, expected, _ = trimesh.proximity.closest_point(surface, points[:1500])
    np.testing.assert_allclose(accuracy.distance_m[:1500], expected, atol=1e-5)


def test_the_bias_is_the_mesh_above_the_points(survey) -> None:
    mesh, points = survey
    lower = points - np.float32([0, 0.5, 0])
    measured = AccuracyMeter(lower, 0.3, len(lower)).finish(mesh)
    assert measured is not None
    assert measured.bias_m > 0.3
    assert measured.rms_m >= measured.bias_m


def test_segments_one_by_one_give_the_same(survey, accuracy) -> None:
    mesh, points = survey
    meter = AccuracyMeter(points, 0.3, len(points))
    for faces in np.array_split(mesh.faces, 5):
        meter.add(SegmentMesh(mesh.vertices, faces.astype(np.uint32), mesh.normals))
    measured = meter.finish(mesh)
    assert measured is not None
    np.testing.assert_allclose(measured.signed_m, accuracy.signed_m, rtol=1e-6, atol=1e-9)


def test_more_points_than_are_measured_are_thinned_evenly(survey, monkeypatch) -> None:
    mesh, points = survey
    monkeypatch.setattr("terraport_pipeline.report.accuracy.MAX_SAMPLES", 1000)
    measured = AccuracyMeter(points, 0.3, 7_000_000).finish(mesh)
    assert measured is not None
    assert (len(measured.points), measured.total) == (1000, 7_000_000)
    assert measured.points[[0, -1]].tolist() == points[[0, -1]].tolist()


def test_without_points_or_a_mesh_nothing_is_known(survey) -> None:
    mesh, points = survey
    none = Mesh(mesh.vertices[:0], mesh.faces[:0], mesh.normals[:0], mesh.colours[:0], {})
    assert AccuracyMeter(points, 0.3, 1).finish(none) is None
    assert AccuracyMeter(np.full((9, 3), np.nan, np.float32), 0.3, 9).finish(mesh) is None


def test_the_map_is_bright_where_the_mesh_is_off() -> None:
    plan = Plan(
        np.full((60, 60, 3), 120, np.uint8), np.zeros((120, 120), np.float32),
        np.zeros((120, 120), np.int32), 0.5, 0.0, 0.0,
    )  # fmt: skip
    plan.image[:10] = PAPER
    rng = np.random.default_rng(2)
    points = rng.uniform(0, 60, (20_000, 3)).astype(np.float32)
    off = np.where(points[:, 0] > 30, 1.0, 0.01)
    image, top_m = draw_distances(Accuracy(points, off, len(points)), plan)
    assert top_m == pytest.approx(1.0, rel=0.05)
    assert image.shape == plan.image.shape
    assert (image[:10] == PAPER).all()
    west, east = image[15:, :25].astype(int), image[15:, 35:].astype(int)
    assert east.mean() > west.mean() + 60
