"""How much contrast counts: by its size, and by how smooth the ground is for it."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from terraport_pipeline.geometry.borders.cells import LENGTH_STEPS, CellGraph
from terraport_pipeline.geometry.borders.evidence import contrast, roughness

SIDE = 40
EAST, SOUTH = (axis.ravel() for axis in np.meshgrid(np.arange(SIDE), np.arange(SIDE)))
MIDDLES = np.stack([EAST, 0 * EAST, SOUTH], axis=1).astype(np.float64)
KEYS = (EAST * 1000 + SOUTH).astype(np.int64)
AREA = np.ones(SIDE * SIDE)


def around(step: float, steepness: float, keys=KEYS):
    """Two materials, ``step`` apart, one cell of each beside the other."""
    features = step * ((EAST + SOUTH) % 2)[:, None].astype(np.float64)
    rough = np.full(len(KEYS), np.sqrt(steepness))
    return contrast(features, rough, AREA, MIDDLES, keys, 8.0)


def test_usual_contrast_on_usual_ground_is_the_deviation():
    found = around(14.0, 7.0 / 6.0)
    assert found.shape == (SIDE * SIDE,)
    assert_allclose(found, 7.0, rtol=0.02)


def test_much_contrast_counts_for_more_than_in_proportion_and_smooth_ground_too():
    usual, more = around(14.0, 7.0 / 6.0), around(18.0, 9.0 / 6.0)
    assert_allclose(more / usual, (9.0 / 7.0) ** 1.5, rtol=0.02)
    smooth = around(14.0, 7.0 / 6.0 / 1.5)
    assert_allclose(smooth / usual, 1.5**0.75, rtol=0.02)


def test_beyond_what_surveys_have_it_counts_in_proportion():
    """Ground without noise, of plain colours, is no reason to see no borders at all."""
    assert_allclose(around(14.0, 0.0), around(14.0, 1e-6), rtol=1e-12)
    assert_allclose(around(200.0, 1.0) / around(100.0, 0.5), 2.0, rtol=1e-9)


def test_roughness_is_the_mean_root_over_a_cells_border():
    """Three cells in a row, the middle one with a long calm border and a short steep one."""
    border = (np.array([3.0, 1.0]) * LENGTH_STEPS).astype(np.int64)
    graph = CellGraph(
        np.zeros(0, np.int32), np.arange(4, dtype=np.int64), np.ones((4, 8), np.int64),
        np.array([[0, 1], [1, 2]], np.int32), border,
    )  # fmt: skip
    assert_allclose(roughness(graph, np.array([0.04, 9.0])), [0.2, (3 * 0.2 + 3.0) / 4, 3.0, 0.0])
