"""What fits is decided before it starts, and told with numbers."""

from __future__ import annotations

import re

import numpy as np
import pytest

from terraport_pipeline.errors import OptionError, ResourceError
from terraport_pipeline.geometry.tiles.tile_plan import Lattice, TilePlan, plan_tiles, tile_shape
from terraport_pipeline.options.regions import Options
from terraport_pipeline.workflow.tile_memory import (
    cell_bytes,
    check_cells,
    choose_plan,
    count_cells,
    forecast_tiles,
    forecast_whole,
)

GIB = 1 << 30


SIZE = {"extent_m": 360.0, "area_m2": 360.0 * 320.0}


def test_five_million_points_in_one_piece() -> None:
    # Measured build in one piece: 3.84 GiB at its peak.
    assert 3.84 * GIB < forecast_whole(5_000_000, **SIZE).memory_bytes < 5.5 * GIB


def test_one_million_points_are_forecast_within_a_fifth() -> None:
    whole = forecast_whole(1_000_000, **SIZE)
    assert 1.71 * GIB < 1.05 * whole.memory_bytes < 1.25 * 1.71 * GIB  # 1.71 measured


def test_the_forecast_says_its_numbers() -> None:
    whole = forecast_whole(50_000_000, **SIZE)
    assert whole.memory_bytes > 20 * GIB
    assert "50,000,000 points" in str(whole)


def test_a_lower_depth_makes_fewer_faces() -> None:
    deep = forecast_whole(50_000_000, **SIZE)
    flat = forecast_whole(50_000_000, detail_depth=10, **SIZE)
    assert flat.memory_bytes < deep.memory_bytes


def plan_at(depth: int) -> TilePlan:
    """A flat survey of 4096 x 4096 cells with two samples per cell."""
    i, j = np.mgrid[0:64, 0:64]
    blocks = np.stack([i.ravel(), np.full(i.size, 1), j.ravel()], axis=1)
    counts = np.full(len(blocks), 2 * 64 * 64)
    return plan_tiles(Lattice((0.0, 0.0, 0.0), 0.1), tile_shape(depth), blocks, counts, 64)


POINTS, AREA = 2 * 4096 * 4096, (4096 * 0.1) ** 2


@pytest.mark.parametrize(("gib", "depth"), [(2, 9), (4, 10), (8, 10), (64, 10)])
def test_the_plan_is_the_same_from_four_gibibytes_on(gib: int, depth: int) -> None:
    plan = choose_plan(plan_at, points=POINTS, area_m2=AREA, max_memory_bytes=gib * GIB)
    assert plan.shape.depth == depth


def small_at(depth: int, cells: int = 256) -> TilePlan:
    """A flat survey of a few hundred cells along a side."""
    i, j = np.mgrid[0 : cells // 16, 0 : cells // 16]
    blocks = np.stack([i.ravel(), np.full(i.size, 1), j.ravel()], axis=1)
    counts = np.full(len(blocks), 2 * 16 * 16)
    return plan_tiles(Lattice((0.0, 0.0, 0.0), 0.1), tile_shape(depth), blocks, counts, 16)


def test_a_small_survey_is_one_tile_and_a_larger_one_keeps_two_workers_busy() -> None:
    small = choose_plan(small_at, points=2 * 256**2, area_m2=25.6**2, max_memory_bytes=8 * GIB)
    assert small.count == 1
    larger = choose_plan(
        lambda depth: small_at(depth, 1024),
        points=2 * 1024**2, area_m2=102.4**2, max_memory_bytes=8 * GIB,
    )  # fmt: skip
    assert larger.count > 1


def test_what_needs_one_piece_gets_one_tile_or_is_refused() -> None:
    size = {"points": 2 * 1024**2, "area_m2": 102.4**2, "in_one_piece": "engine graph"}
    one = choose_plan(lambda depth: small_at(depth, 1024), max_memory_bytes=64 * GIB, **size)
    assert one.count == 1
    with pytest.raises(ResourceError, match=r"engine graph needs the surface in one piece, about"):
        choose_plan(lambda depth: small_at(depth, 1024), max_memory_bytes=2 * GIB, **size)
    with pytest.raises(OptionError, match=r"engine graph with [0-9]+ tiles of depth 8; expected"):
        choose_plan(lambda depth: small_at(depth, 1024), max_memory_bytes=64 * GIB, asked=8, **size)


def test_too_little_is_refused() -> None:
    with pytest.raises(ResourceError, match=r"0\.5 GiB are too little even for the smallest tile"):
        choose_plan(plan_at, points=POINTS, area_m2=AREA, max_memory_bytes=GIB // 2)


def test_what_is_asked_for_is_taken() -> None:
    plan = choose_plan(plan_at, points=POINTS, area_m2=AREA, max_memory_bytes=64 * GIB, asked=8)
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


def test_cells_of_regions_are_refused_before_any_tile_is_solved() -> None:
    """Measured: 1.8 M points over 1.8 km2 have 2.3 M cells and stand at 2,729 MiB."""
    borders = Options()
    cells = count_cells(borders, 1.8e6, 3.7e6)
    assert cells == pytest.approx(2.3e6, rel=0.1)
    assert cell_bytes(cells) == pytest.approx(2729 * 2**20, rel=0.05)
    check_cells(cells, borders, 3 * GIB)
    with pytest.raises(ResourceError, match=r"allowed are 2\.2 GiB: give") as refused:
        check_cells(cells, borders, int(2.2 * GIB))
    # What it advises fits.
    advised = re.search(r"--max-memory ([\d.]+)G, --region-size (\d+)m", str(refused.value))
    assert advised is not None
    check_cells(cells, borders, int(float(advised[1]) * GIB))
    larger = Options(borders_size_m=float(advised[2]))
    check_cells(count_cells(larger, 1.8e6, 3.7e6), larger, int(2.2 * GIB))


def test_cells_never_exceed_the_faces_and_other_engines_have_none() -> None:
    assert count_cells(Options(), 1e6, 1000.0) <= 1000
    assert count_cells(Options(engine="means"), 1e6, 1e6) == 0
    # All that 100 M points have: within the 6 GiB that such a build is shown with.
    widest = count_cells(Options(), 20e6, 200e6)
    assert cell_bytes(widest) < 6 * GIB


def test_a_small_survey_may_use_little_memory() -> None:
    check_cells(count_cells(Options(), 1600.0, 20_000.0), Options(), 2**28)
