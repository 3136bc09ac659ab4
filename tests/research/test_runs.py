from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from terraport_research.runs import run
from terraport_research.subjects import Subject, body


@pytest.fixture(scope="module")
def ball() -> Subject:
    return body("sphere", 1000)


def test_samples_keep_their_colour_and_costs_are_measured(ball: Subject, tmp_path: Path) -> None:
    outcome = run("ball-pivoting", ball.samples, tmp_path)
    assert outcome.error == ""
    assert outcome.surface is not None
    assert np.array_equal(outcome.colours, ball.samples.colours)
    assert 0 < outcome.cpu_s < 10
    assert outcome.added_bytes < 2**30
    assert not list(tmp_path.iterdir())


def test_new_vertices_get_carried_colours(ball: Subject, tmp_path: Path) -> None:
    outcome = run("poisson", ball.samples, tmp_path, depth=5)
    assert outcome.surface is not None
    assert outcome.surface.note == "octree depth 5"
    assert outcome.colours is not None
    assert outcome.colours.shape == outcome.surface.vertices.shape
    low, high = ball.samples.colours.min(axis=0), ball.samples.colours.max(axis=0)
    assert (outcome.colours >= low).all()
    assert (outcome.colours <= high).all()


def test_a_failure_is_a_result_with_its_reason(ball: Subject, tmp_path: Path) -> None:
    from dataclasses import replace

    flat = replace(ball.samples, points=np.zeros_like(ball.samples.points))
    outcome = run("delaunay", flat, tmp_path)
    assert outcome.surface is None
    assert "no Delaunay triangulation in plan" in outcome.error


def test_the_time_limit_ends_it(ball: Subject, tmp_path: Path) -> None:
    outcome = run("poisson", ball.samples, tmp_path, time_limit_s=0.01)
    assert outcome.error == "not done after 0.01 s: stopped"
