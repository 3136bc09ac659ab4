"""Cubes of one lattice: cores fill space, data overlaps, samples find their tiles."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.tiles.tile_plan import (
    SCALE,
    Lattice,
    TilePlan,
    corner_points,
    count_tiles,
    plan_tiles,
    tile_shape,
)

LATTICE = Lattice((-50.0, 2.0, 7.0), 0.25)


def some_cells(count: int = 3000) -> np.ndarray:
    """Positions on a slope, in cells."""
    rng = np.random.default_rng(3)
    x, z = rng.uniform(0, 500, (2, count))
    return np.stack([x, 40 + 0.2 * x + rng.normal(0, 2, count), z], axis=1)


def plan_for(cells: np.ndarray, depth: int = 8, block: int = 8) -> TilePlan:
    blocks, counts = np.unique(np.floor(cells / block).astype(np.int64), axis=0, return_counts=True)
    return plan_tiles(LATTICE, tile_shape(depth), blocks, counts, block)


def test_cells_and_metres_are_inverse() -> None:
    metres = LATTICE.metres(np.array([[0.0, 4.0, 8.0]]))
    assert metres.tolist() == [[-50.0, 3.0, 9.0]]
    assert LATTICE.cells(metres).tolist() == [[0.0, 4.0, 8.0]]


@pytest.mark.parametrize("depth", [7, 8, 9, 10, 11])
def test_a_tile_is_made_of_whole_units(depth: int) -> None:
    shape = tile_shape(depth)
    assert shape.core % shape.unit == 0
    assert shape.pad % shape.unit == 0
    assert shape.core + 2 * shape.pad == shape.side
    assert shape.margin >= 40
    # The solver's cube is 1.1 times the data box, about the same middle.
    assert shape.core + 2 * shape.margin == pytest.approx(shape.side / SCALE)


def test_too_small_a_cube_is_refused() -> None:
    with pytest.raises(ValueError, match="a cube of 64 cells has no core with a margin of 40"):
        tile_shape(6)


def test_every_sample_lies_in_exactly_one_core_and_in_that_tile_s_data() -> None:
    cells = some_cells()
    plan = plan_for(cells)
    cores = np.zeros(len(cells), dtype=int)
    members = dict(plan.members(cells))
    for tile in range(plan.count):
        low, high = plan.core(tile)
        inside = np.flatnonzero(((cells >= low) & (cells < high)).all(axis=1))
        cores[inside] += 1
        assert np.isin(inside, members[tile]).all()
    assert (cores == 1).all()


def test_members_are_those_of_the_data_box() -> None:
    cells = some_cells()
    plan = plan_for(cells)
    for tile, rows in plan.members(cells):
        low, high = plan.data(tile)
        inside = ((cells >= low) & (cells <= high)).all(axis=1)
        assert rows.tolist() == np.flatnonzero(inside).tolist()


def test_neighbouring_cubes_differ_by_whole_units() -> None:
    plan = plan_for(some_cells())
    unit = plan.shape.unit
    lows = np.array([plan.cube(tile)[0] for tile in range(plan.count)])
    assert ((lows - lows[0]) % unit == 0).all()


def test_neighbours_share_a_wall() -> None:
    plan = plan_for(some_cells())
    pairs = plan.neighbours()
    assert pairs
    for low, high, axis in pairs:
        step = plan.indices[high] - plan.indices[low]
        assert step.tolist() == [int(a == axis) for a in range(3)]
        assert plan.core(low)[1][axis] == plan.core(high)[0][axis]


def test_loads_count_at_least_the_samples_of_the_data_box() -> None:
    cells = some_cells()
    plan = plan_for(cells)
    for tile, rows in plan.members(cells):
        assert plan.points[tile] >= len(rows)


def test_the_plan_does_not_depend_on_the_order_of_blocks() -> None:
    cells = some_cells()
    assert plan_for(cells).indices.tolist() == plan_for(cells[::-1]).indices.tolist()


def test_a_core_that_surface_only_reaches_into_gets_a_tile_too() -> None:
    shape = tile_shape(8)
    block = np.array([[shape.core // 8 - 1, 2, 2]])  # ends at the wall
    tiles, _ = count_tiles(shape, np.zeros(3, dtype=np.int64), block, np.array([9]), 8)
    assert {tuple(tile) for tile in tiles.tolist()} >= {(0, 0, 0), (1, 0, 0)}


def test_corner_points_span_the_data_box() -> None:
    plan = plan_for(some_cells())
    points, normals = corner_points(plan, 0)
    low, high = plan.data(0)
    assert points.tolist() == [low.tolist(), high.tolist()]
    assert np.linalg.norm(normals, axis=1).tolist() == [1.0, 1.0]
    middle = points.mean(axis=0) - (points[1] - points[0]) / 2 * SCALE
    assert middle == pytest.approx(plan.cube(0)[0].astype(float))
