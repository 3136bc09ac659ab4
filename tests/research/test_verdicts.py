from __future__ import annotations

from dataclasses import replace

import pytest

from terraport_research.reconstructors import RECONSTRUCTORS
from terraport_research.scores import Distances, Scores
from terraport_research.verdicts import (
    THESIS_COLOUR,
    judge_colour,
    judge_shape,
)

NEAR = Distances(0.1, 0.1, 0.3, 0.5, 0.9)
FAR = Distances(1.0, 0.8, 2.0, 3.0, 9.0)
GOOD = Scores(
    faces=10, vertices=7, colour_p50=1, colour_p95=8, colour_most=70, samples_lost=0.0,
    to_truth=NEAR, from_truth=NEAR, hausdorff=0.9, outside=0.0, holes=0, hole_area=0.0,
    truth_lost=0.0, open_edges=0, non_manifold=0, turned=0, euler=2,
)  # fmt: skip


@pytest.mark.parametrize(
    ("p95", "lost", "kept"), [(8, 0.0, True), (20, 0.01, True), (21, 0, False), (8, 0.02, False)]
)
def test_colour_is_kept_up_to_what_neighbours_differ(p95, lost, kept) -> None:
    row = judge_colour("poisson", replace(GOOD, colour_p95=p95, samples_lost=lost), 20.0)
    assert row.kept is kept
    assert row.thesis_kept is True


def test_the_worst_model_decides() -> None:
    row = judge_shape("ball-pivoting", [GOOD, replace(GOOD, holes=3), GOOD])
    assert (row.holes, row.has_holes, row.similar, row.proceed) == (3, True, True, False)
    assert row.thesis == (True, True)
    row = judge_shape("delaunay", [GOOD, replace(GOOD, to_truth=FAR)])
    assert (row.has_holes, row.similar, row.proceed) == (False, False, False)
    row = judge_shape("poisson", [GOOD])
    assert row.proceed
    assert judge_shape("marching-cubes", [GOOD]).thesis is None


def test_the_thesis_spoke_about_every_algorithm() -> None:
    assert set(THESIS_COLOUR) == set(RECONSTRUCTORS)
