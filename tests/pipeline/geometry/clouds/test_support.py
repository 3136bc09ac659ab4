from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from terraport_pipeline.geometry.clouds.support import (
    BINS,
    LEAST_THRESHOLD,
    support_histogram,
    support_ratio,
    support_threshold,
)


def test_the_ratio_is_the_distance_in_local_spacings_within_bounds() -> None:
    samples = np.array([[0, 0, 0], [100, 0, 0], [200, 0, 0]], np.float32)
    local = np.array([0.1, 2.0, 50.0], np.float32)  # counts as 1, 2 and 3
    places = np.array([[0, 2, 0], [100, 2, 0], [200, 6, 0]], np.float32)
    ratio = support_ratio(places, cKDTree(samples), local, 1.0)
    assert ratio.tolist() == [2.0, 1.0, 2.0]


def test_the_histogram_holds_all_area_and_adds_up_over_pieces() -> None:
    rng = np.random.default_rng(1)
    vertices = rng.normal(size=(300, 3)).astype(np.float32)
    faces = rng.integers(0, 300, (500, 3)).astype(np.int32)
    ratio = rng.uniform(0, 14, 300).astype(np.float32)
    whole = support_histogram(vertices, faces, ratio)
    corners = vertices[faces].astype(np.float64)
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    assert whole.shape == (BINS,)
    assert whole.sum() == pytest.approx(0.5 * areas.sum())
    histograms = [support_histogram(vertices, piece, ratio) for piece in np.split(faces, [123])]
    assert np.allclose(histograms[0] + histograms[1], whole)


def test_the_threshold_lies_where_the_flank_meets_the_plateau() -> None:
    middle = (np.arange(BINS) + 0.5) * 0.1
    mode = 1e5 * np.exp(-(((middle - 0.5) / 0.6) ** 2))
    histogram = mode + 10.0
    histogram[-1] = 1e6  # everything farther out
    threshold = support_threshold(histogram)
    assert 2.0 <= threshold <= 2.5
    assert mode[round(threshold * 10) + 1] < 10.0


@pytest.mark.parametrize(
    ("histogram", "expected"),
    [
        (np.zeros(BINS), 4.0),
        (np.r_[np.full(5, 10.0), np.zeros(BINS - 5)], LEAST_THRESHOLD),  # closed body: no plateau
        (np.full(BINS, 10.0), LEAST_THRESHOLD),
        (np.geomspace(1e9, 1.0, BINS), 4.0),
    ],
)
def test_the_threshold_stays_within_its_bounds(histogram: np.ndarray, expected: float) -> None:
    assert support_threshold(histogram) == expected
