from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from terraport_pipeline.errors import OptionError, SurveyError
from terraport_pipeline.geometry.mesh.closest_point import TriangleTree
from terraport_research.subjects import body, quarry, stanford


def test_a_body_is_sampled_as_a_scanner_would() -> None:
    subject = body("block", 2000)
    samples = subject.samples
    assert samples.points.shape == (2000, 3)
    area = 6 * 100 - 2 * np.pi * 2.5**2 + 2 * np.pi * 2.5 * 10  # a cube of 10 m with a hole
    assert samples.spacing_m == pytest.approx(np.sqrt(area / 2000), rel=0.1)
    nearest = TriangleTree(subject.truth_vertices, subject.truth_faces).nearest(samples.points)
    assert 0 < np.median(nearest.distance_m) < 0.1 * samples.spacing_m
    a, b, c = (subject.truth_vertices[subject.truth_faces[nearest.face, k]] for k in range(3))
    assert (np.cross(b - a, c - a) * samples.normals).sum(axis=1).min() >= -0.5
    assert len(subject.rim) == 0
    assert subject.neighbour_colour_p95 > 0
    again = body("block", 2000)
    assert again.samples.points.tobytes() == samples.points.tobytes()


def test_the_quarry_knows_its_truth(tmp_path: Path) -> None:
    subject = quarry(3000, tmp_path)
    tree = TriangleTree(subject.truth_vertices, subject.truth_faces)
    gap = tree.nearest(subject.samples.points).distance_m
    assert np.percentile(gap, 90) < 0.25 * subject.samples.spacing_m
    assert (
        np.percentile(tree.nearest(subject.seen).distance_m, 90) < 0.2 * subject.samples.spacing_m
    )
    # the rim is the rectangle's border
    low, high = subject.truth_vertices.min(axis=0), subject.truth_vertices.max(axis=0)
    border = np.minimum(subject.rim - low, high - subject.rim)[:, [0, 2]].min(axis=1)
    assert border.max() < 1e-2
    assert np.ptp(subject.rim[:, 0]) == pytest.approx(360, abs=1)


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(SurveyError, match="--data"):
        stanford("bunny", None, 1000)
    with pytest.raises(SurveyError, match="Stanford 3D Scanning Repository"):
        stanford("armadillo", tmp_path, 1000)
    with pytest.raises(OptionError, match="expected one of block"):
        body("teapot", 1000)


@pytest.mark.shared_data
def test_the_bunny_is_turned_the_right_way_round(shared_data: Path) -> None:
    if not (shared_data / "stanford/bunny.ply").is_file():
        pytest.skip("no stanford/bunny.ply")
    subject = stanford("bunny", shared_data, 1000)
    outward = (
        (subject.samples.points - subject.samples.points.mean(axis=0)) * subject.samples.normals
    ).sum(axis=1)
    assert (outward > 0).mean() > 0.8
    assert len(subject.rim) > 0  # it has holes below
