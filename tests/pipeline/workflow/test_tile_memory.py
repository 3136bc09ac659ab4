"""What fits is decided before it starts, and told with numbers."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.tiles.tile_plan import Lattice, TilePlan, plan_tiles, tile_shape
from terraport_pipeline.workflow.tile_memory import choose_depth, forecast_tiles, plan_memory

GIB = 1 << 30


def test_five_million_points_fit_eight_gibibytes() -> None:
    plan = plan_memory(5_000_000, 8 * GIB, extent_m=360.0, area_m2=360.0 * 320.0)
    assert not plan.tiled
    # Measured whole build: 3.84 GiB at its peak.
    assert 3.84 * GIB < plan.whole_bytes < 5.5 * GIB


def test_one_million_points_are_forecast_within_a_fifth() -> None:
    plan = plan_memory(1_000_000, 8 * GIB, extent_m=360.0, area_m2=360.0 * 320.0)
    assert 1.71 * GIB < 1.05 * plan.whole_bytes < 1.25 * 1.71 * GIB  # 1.71 measured


def test_fifty_million_points_do_not() -> None:
    plan = plan_memory(50_000_000, 8 * GIB, extent_m=360.0, area_m2=360.0 * 320.0)
    assert plan.tiled
    assert plan.whole_bytes > 20 * GIB
    assert "50,000,000 points" in plan.why
    assert "allowed are 8.0 GiB: it goes in tiles" in plan.why


def test_a_lower_depth_makes_fewer_faces() -> None:
    size = {"extent_m": 360.0, "area_m2": 360.0 * 320.0}
    deep = plan_memory(50_000_000, 8 * GIB, **size)
    flat = plan_memory(50_000_000, 8 * GIB, detail_depth=10, **size)
    assert flat.whole_bytes < deep.whole_bytes


def test_tiles_can_be_asked_for() -> None:
    plan = plan_memory(1000, 8 * GIB, force=True)
    assert plan.tiled
    assert plan.why.startswith("tiles were asked for")


def plan_at(depth: int) -> TilePlan:
    """A flat survey of 4096 x 4096 cells with two samples per cell."""
    i, j = np.mgrid[0:64, 0:64]
    blocks = np.stack([i.ravel(), np.full(i.size, 1), j.ravel()], axis=1)
    counts = np.full(len(blocks), 2 * 64 * 64)
    return plan_tiles(Lattice((0.0, 0.0, 0.0), 0.1), tile_shape(depth), blocks, counts, 64)


POINTS, AREA = 2 * 4096 * 4096, (4096 * 0.1) ** 2


@pytest.mark.parametrize(("gib", "depth"), [(2, 9), (4, 10), (8, 10), (64, 11)])
def test_more_memory_means_larger_tiles(gib: int, depth: int) -> None:
    plan = choose_depth(plan_at, points=POINTS, area_m2=AREA, max_memory_bytes=gib * GIB)
    assert plan is not None
    assert plan.shape.depth == depth


def test_too_little_is_nothing() -> None:
    assert choose_depth(plan_at, points=POINTS, area_m2=AREA, max_memory_bytes=GIB // 2) is None


def test_what_is_asked_for_is_taken() -> None:
    plan = choose_depth(plan_at, points=POINTS, area_m2=AREA, max_memory_bytes=64 * GIB, asked=8)
    assert plan is not None
    assert plan.shape.depth == 8


def test_side_by_side_as_memory_and_threads_allow() -> None:
    plan = plan_at(10)
    two = forecast_tiles(plan, POINTS, AREA, 8 * GIB, 2)
    many = forecast_tiles(plan, POINTS, AREA, 8 * GIB, 64)
    assert two.workers == 2
    assert many.workers == (8 * GIB - 900 * 2**20) // many.tile_bytes
    assert many.tile_bytes == two.tile_bytes
    # Margins included: more faces than the survey's 2.8 per cell.
    assert 1.0 < many.faces / (2.8 * 4096**2) < 1.8
