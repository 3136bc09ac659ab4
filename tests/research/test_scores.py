from __future__ import annotations

import numpy as np
import pytest

from terraport_research.reconstructors import Surface
from terraport_research.scores import score
from terraport_research.subjects import Subject, body, mesh_subject


@pytest.fixture(scope="module")
def ball() -> Subject:
    return body("sphere", 2000)


def truth(subject: Subject, keep: np.ndarray | None = None, lift: float = 1.0) -> Surface:
    faces = subject.truth_faces if keep is None else subject.truth_faces[keep]
    return Surface((subject.truth_vertices * np.float32(lift)), faces, None)


def grey(surface: Surface, level: int = 128) -> np.ndarray:
    return np.full((len(surface.vertices), 3), level, np.uint8)


def test_the_truth_itself_is_without_fault(ball: Subject) -> None:
    surface = truth(ball)
    scores = score(surface, grey(surface), ball)
    assert scores.to_truth.most < 1e-3
    assert scores.from_truth.most < 1e-3
    assert (scores.holes, scores.non_manifold, scores.open_edges, scores.euler) == (0, 0, 0, 2)
    assert scores.samples_lost == scores.truth_lost == scores.outside == 0


def test_a_cut_hole_is_found_with_its_area(ball: Subject) -> None:
    middle = ball.truth_vertices[ball.truth_faces].mean(axis=1)
    surface = truth(ball, middle[:, 1] < 4.5)  # radius 5
    scores = score(surface, grey(surface), ball)
    assert scores.holes == 1
    share = np.pi * (25 - 4.5**2) / (4 * np.pi * 25)
    assert scores.hole_area == pytest.approx(share, rel=0.1)
    assert scores.from_truth.most * ball.samples.spacing_m > 1.0
    assert 0 < scores.truth_lost < 0.06
    assert scores.to_truth.most < 1e-3  # what is there is right
    assert scores.hausdorff == scores.from_truth.most


def test_a_surface_too_far_out_is_measured_in_spacings(ball: Subject) -> None:
    surface = truth(ball, lift=1.1)
    scores = score(surface, grey(surface), ball)
    assert scores.to_truth.p50 == pytest.approx(0.5 / ball.samples.spacing_m, rel=0.02)
    assert scores.from_truth.p50 == pytest.approx(0.5 / ball.samples.spacing_m, rel=0.02)


def test_colour_is_compared_at_the_samples(ball: Subject) -> None:
    samples = ball.samples
    surface = truth(ball)
    scores = score(surface, grey(surface, 0), ball)
    assert scores.colour_most == samples.colours.max()
    assert scores.colour_p50 == pytest.approx(np.median(samples.colours.max(axis=1)), abs=1)


def test_where_the_truth_ends_there_is_no_hole(ball: Subject) -> None:
    """The upper half of a ball, closed by the reconstruction: right above, beyond below."""
    middle = ball.truth_vertices[ball.truth_faces].mean(axis=1)
    half = mesh_subject(
        "half",
        "Half",
        ball.truth_vertices.astype(np.float64),
        ball.truth_faces[middle[:, 1] > 0],
        2000,
    )
    assert len(half.rim) > 100
    itself = truth(half)
    assert score(itself, grey(itself), half).holes == 0
    whole = Surface(
        ball.truth_vertices * np.float32(np.ptp(half.truth_vertices, axis=0).max() / 10.0)
        + half.truth_vertices.mean(axis=0) * 0
        + np.float32([0, half.truth_vertices[:, 1].max() - 5.0, 0]),
        ball.truth_faces,
        None,
    )
    scores = score(whole, grey(whole), half)
    assert scores.outside == pytest.approx(0.5, abs=0.05)
    assert scores.to_truth.p99 < 0.5
