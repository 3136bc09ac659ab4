"""Medians over windows stand for medians over the whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from terraport_pipeline.geometry.clouds.outliers import mean_distances, usual_distance
from terraport_pipeline.geometry.clouds.spacing import estimate_spacing, nearest_neighbours
from terraport_pipeline.model import Cloud, to_scene
from terraport_pipeline.stages import measure_survey
from terraport_pipeline.stages.contract import Context

ORIGIN = np.array([641_000.0, 8_594_000.0, 1_200.0])


def test_windows_tell_what_the_whole_tells(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(measure_survey, "_BLOCK_ROWS", 7_000)
    rng = np.random.default_rng(1)
    # Twice as dense on one side.
    east = np.concatenate([rng.uniform(0, 50, 20_000), rng.uniform(50, 100, 10_000)])
    points = np.column_stack([east, rng.uniform(0, 60, 30_000), rng.normal(0, 0.02, 30_000)])
    points = (points + ORIGIN)[rng.permutation(30_000)]
    np.save(tmp_path / "points.npy", points)
    thin = to_scene(points[::10], ORIGIN)
    spacing = estimate_spacing(nearest_neighbours(thin, 16, workers=1)).areal_m
    cloud = Cloud(
        thin, np.zeros_like(thin), np.zeros((len(thin), 3), np.uint8), {}, ORIGIN, spacing
    )
    measured = measure_survey.run(tmp_path / "points.npy", cloud, 16, Context(tmp_path)).values
    neighbours = nearest_neighbours(points - ORIGIN, 16, workers=1)
    middle, deviation = usual_distance(mean_distances(neighbours))
    assert measured["spacing_m"] == pytest.approx(estimate_spacing(neighbours).areal_m, rel=0.06)
    assert measured["usual_log_m"] == pytest.approx(middle, abs=0.06)
    assert measured["usual_deviation"] == pytest.approx(deviation, rel=0.25)
    assert measured["points"] == 30_000
    assert measured["noise_m"] < 0.05
    assert measured["surface_spacing_m"] == pytest.approx((100 * 60 / 30_000) ** 0.5, rel=0.1)
    assert measured["extent_m"] == pytest.approx(100, abs=1)


@pytest.mark.parametrize("copies", [0, 2_000])
def test_noise_and_spacing_along_the_surface_are_told_apart(tmp_path: Path, copies: int) -> None:
    """A hill with noise of two spacings; copies of samples, at no distance, do not count."""
    rng = np.random.default_rng(2)
    east, north = rng.uniform(0, 80, (2, 10_000))
    points = np.column_stack([east, north, 6 * np.sin(east / 20) * np.cos(north / 15)])
    points += rng.normal(0, 1.6, points.shape)
    points = np.concatenate([points, points[:copies]])[rng.permutation(10_000 + copies)] + ORIGIN
    np.save(tmp_path / "points.npy", points)
    thin = to_scene(points, ORIGIN)
    cloud = Cloud(thin, np.zeros_like(thin), np.zeros((len(thin), 3), np.uint8), {}, ORIGIN, 0.8)
    measured = measure_survey.run(tmp_path / "points.npy", cloud, 16, Context(tmp_path)).values
    assert measured["noise_m"] == pytest.approx(1.6, rel=0.25)
    assert measured["surface_spacing_m"] == pytest.approx(0.8, rel=0.15)
