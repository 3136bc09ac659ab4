from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.clouds import footprint as module
from terraport_pipeline.geometry.clouds.footprint import (
    make_footprint,
    plan_occupancy,
)


def square(side_m: float, spacing_m: float, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    count = int((side_m / spacing_m) ** 2)
    points = rng.uniform(0, side_m, (count, 3))
    points[:, 1] = rng.uniform(0, 50, count)  # heights do not count
    return points.astype(np.float32)


def footprint_of(
    points: np.ndarray, local_spacing_m: np.ndarray, spacing_m: float
) -> module.Footprint:
    """The outline of a whole cloud, counted at once."""
    occupancy = plan_occupancy(points.min(axis=0), points.max(axis=0), spacing_m)
    occupancy.add(points, local_spacing_m)
    return make_footprint(occupancy)


def at(outline: module.Footprint, x: float, z: float) -> float:
    return float(outline.margin_m(np.array([[x, 0.0, z]]))[0])


def test_the_outline_runs_through_the_outermost_samples() -> None:
    points = square(60.0, 1.0)
    outline = footprint_of(points, np.ones(len(points), np.float32), 1.0)
    assert outline.area_m2 == pytest.approx(61.0**2, rel=0.05)
    for depth in (-8.0, -3.0, 0.0, 3.0):
        assert at(outline, 60.0 - depth, 30.0) == pytest.approx(depth, abs=1.5)
    assert (outline.margin_m(points) > -1.0).mean() > 0.999


@pytest.mark.parametrize("sides_m", [(90.0, 30.0), (30.0, 90.0)])
def test_an_oblong_is_outlined_to_its_far_end(sides_m: tuple[float, float]) -> None:
    points = square(90.0, 1.0)
    inside = (points[:, 0] < sides_m[0]) & (points[:, 2] < sides_m[1])
    points = points[inside]
    outline = footprint_of(points, np.ones(len(points), np.float32), 1.0)
    assert outline.area_m2 == pytest.approx(91.0 * 31.0, rel=0.05)
    assert at(outline, sides_m[0] - 5, sides_m[1] - 5) == pytest.approx(5.0, abs=1.5)


def test_wide_holes_stay_open_and_narrow_ones_close() -> None:
    points = square(60.0, 1.0)
    wide = np.hypot(points[:, 0] - 20, points[:, 2] - 20) < 8.0
    narrow = np.hypot(points[:, 0] - 45, points[:, 2] - 45) < 2.5
    points = points[~wide & ~narrow]
    outline = footprint_of(points, np.ones(len(points), np.float32), 1.0)
    assert at(outline, 20, 20) < -3.0
    assert at(outline, 45, 45) > 0.0


def test_thin_ground_reaches_farther() -> None:
    x, z = np.meshgrid(np.arange(0.0, 60, 3.0), np.arange(0.0, 60, 3.0))
    points = np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], axis=1).astype(np.float32)
    gap = np.abs(points[:, 0] - 30) < 9  # a strip of 18 m without samples
    thin = footprint_of(points[~gap], np.full((~gap).sum(), 3.0, np.float32), 1.0)
    dense = footprint_of(points[~gap], np.full((~gap).sum(), 1.0, np.float32), 1.0)
    assert at(thin, 30, 30) > 0 > at(dense, 30, 30)


def test_counting_in_parts_and_in_any_order_is_the_same() -> None:
    points = square(30.0, 1.0)
    local = np.random.default_rng(2).uniform(0.5, 5, len(points)).astype(np.float32)
    whole = plan_occupancy(points.min(axis=0), points.max(axis=0), 1.0)
    whole.add(points, local)
    accumulated = plan_occupancy(points.min(axis=0), points.max(axis=0), 1.0)
    for some in (slice(400, None), slice(0, 400)):
        accumulated.add(points[some], local[some])
    assert accumulated.spacing_m.tobytes() == whole.spacing_m.tobytes()
    assert make_footprint(accumulated).field_m.tobytes() == make_footprint(whole).field_m.tobytes()


def test_the_raster_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_CELLS", 10_000)
    raster = plan_occupancy(np.zeros(3), np.array([1000.0, 0, 1000.0]), 0.1)
    assert raster.spacing_m.size < 11_000
    raster.add(np.array([[1e9, 0, 0]]), np.ones(1, np.float32))  # outside: left out
    assert not raster.spacing_m.any()
