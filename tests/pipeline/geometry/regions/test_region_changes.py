"""Volumes of cut and fill by region."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.regions.region_changes import (
    ChangeMap,
    add_shares,
    region_volumes,
)


def change_map(dz_m: np.ndarray, moved: np.ndarray | None = None) -> ChangeMap:
    """Cells of 2 m from (-4, 10)."""
    steps = dz_m.astype(np.float32)
    mask = ~np.isnan(steps) if moved is None else moved
    return ChangeMap((-4.0, 10.0), 2.0, steps, np.full_like(steps, 0.1), mask, 0.05)


def sheet(x0: float, x1: float, z0: float, z1: float, cells: int = 8) -> tuple:
    """Sloping sheet, and its faces."""
    x, z = np.meshgrid(
        np.linspace(x0, x1, cells + 1), np.linspace(z0, z1, cells + 1), indexing="ij"
    )
    vertices = np.stack([x, 0.5 * x, z], -1).reshape(-1, 3).astype(np.float32)
    index = np.arange((cells + 1) ** 2, dtype=np.int32).reshape(cells + 1, cells + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = [np.stack(corners, -1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))]
    return vertices, np.concatenate(faces)


def test_volumes_of_regions_and_beyond_add_up_to_the_whole() -> None:
    steps = np.random.default_rng(1).normal(0, 1, (4, 6))
    steps[0, 0] = np.nan
    change = change_map(steps, moved=np.random.default_rng(2).random((4, 6)) > 0.3)
    # Two sheets, beside each other along a line inside a column of cells; the rest is bare.
    west, east = sheet(-4, -1, 10, 20), sheet(-1, 2, 10, 20)
    shares = [
        add_shares(*mesh, np.full(len(mesh[1]), region, np.int32), change)
        for region, mesh in ((7, west), (3, east))
    ]
    regions, beyond, whole = region_volumes(change, shares)
    assert list(regions) == [3, 7]
    for name in ("cut_m3", "fill_m3", "area_m2"):
        pieces = [getattr(volumes, name) for volumes in (*regions.values(), beyond)]
        assert sum(pieces) == pytest.approx(getattr(whole, name))
        assert min(pieces) >= 0
    counted = steps[change.counted]
    assert whole.cut_m3 == pytest.approx(-counted[counted < 0].sum() * 4)
    assert whole.area_m2 == len(counted) * 4
    # Errors that cells share add up, independent ones partly cancel out.
    parts = [volumes.uncertainty_m3 for volumes in (*regions.values(), beyond)]
    assert max(parts) < whole.uncertainty_m3 < sum(parts)
    assert beyond.area_m2 > 0


def test_a_cell_is_shared_by_area_from_above() -> None:
    """A quarter of the cell is region 0, three quarters region 1, whose faces are steep."""
    change = change_map(np.array([[-1.0]]))
    west, east = sheet(-4, -3.5, 10, 12), sheet(-3.5, -2, 10, 12)
    east[0][:, 1] *= 9
    shares = [
        add_shares(*mesh, np.full(len(mesh[1]), region, np.int32), change)
        for region, mesh in enumerate((west, east))
    ]
    regions, beyond, _ = region_volumes(change, shares)
    assert regions[0].cut_m3 == pytest.approx(1.0)
    assert regions[1].cut_m3 == pytest.approx(3.0)
    assert beyond.cut_m3 == beyond.area_m2 == 0.0


def test_a_wall_seen_edge_on_has_no_share() -> None:
    change = change_map(np.array([[2.0]]))
    vertices = np.array([[-3, 0, 11], [-3, 5, 11], [-3, 5, 11.5]], np.float32)
    faces = np.array([[0, 1, 2]], np.int32)
    regions, beyond, whole = region_volumes(
        change, [add_shares(vertices, faces, np.zeros(1, np.int32), change)]
    )
    assert regions == {}
    assert beyond.fill_m3 == whole.fill_m3 == 8.0


def test_nothing_changed() -> None:
    change = change_map(np.full((2, 2), np.nan))
    regions, _, whole = region_volumes(change, [])
    assert regions == {}
    assert whole.area_m2 == 0.0
    assert not change.touches(np.array([-100.0, 0, -100]), np.array([100.0, 0, 100]))


def test_boxes_that_lie_over_a_change() -> None:
    moved = np.zeros((4, 6), bool)
    moved[2, 1] = True  # 0 to 2 m along x, 12 to 14 m along z
    change = change_map(np.ones((4, 6)), moved)
    low = np.array([-9.0, 0.0, 0.0])
    assert change.touches(low, np.array([0.1, 1.0, 12.1]))
    assert not change.touches(low, np.array([-0.1, 1.0, 12.1]))
    assert not change.touches(low, np.array([0.1, 1.0, 11.9]))
    assert not change.touches(low, np.array([-8.0, 1.0, 3.0]))
    assert not change.touches(np.array([50.0, 0, 50]), np.array([60.0, 0, 60]))
