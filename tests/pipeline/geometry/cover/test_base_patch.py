from __future__ import annotations

import numpy as np

from terraport_payload.types import Float32, Int32
from terraport_pipeline.geometry.cover.base_patch import append_surface, base_patch
from terraport_pipeline.geometry.cover.uncovered import uncovered_faces
from terraport_pipeline.geometry.mesh.trim import compact

CELL_M = 0.25


def sheet(low_m: float, high_m: float) -> tuple[Float32, Int32]:
    """Hilly ground between two places along x, 0 to 4 m along z, in cells of 0.25 m."""
    x = np.arange(low_m, high_m + CELL_M / 2, CELL_M)
    z = np.arange(0, 4 + CELL_M / 2, CELL_M)
    points_x, points_z = np.meshgrid(x, z, indexing="ij")
    height = np.sin(points_x) + 0.2 * points_z
    at = np.arange(points_x.size).reshape(points_x.shape)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    faces = np.concatenate([np.stack([a, c, b], -1), np.stack([a, d, c], -1)]).reshape(-1, 3)
    vertices = np.stack([points_x, height, points_z], -1).reshape(-1, 3).astype(np.float32)
    return vertices, faces.astype(np.int32)


DETAIL, WIDE = sheet(0, 8), sheet(-0.5, 8.5)
BASE = (
    np.array([[-0.5, 0, -0.5], [8.5, 0, -0.5], [8.5, 0, 4.5], [-0.5, 0, 4.5]], np.float32),
    np.array([[0, 2, 1], [0, 3, 2]], np.int32),
)


def without(surface: tuple[Float32, Int32], low_m: float, high_m: float) -> tuple[Float32, Int32]:
    x = surface[0][surface[1]][:, :, 0]
    return compact(*surface, (x.max(axis=1) <= low_m) | (x.min(axis=1) >= high_m))


def test_where_all_detail_lies_over_the_base_there_is_nothing_to_patch() -> None:
    vertices, faces = base_patch(BASE, DETAIL, WIDE, margin_m=0.3)
    assert vertices.shape == (0, 3)
    assert faces.shape == (0, 3)


def test_what_the_base_lost_is_patched_with_the_surface_it_was_thinned_from() -> None:
    lost = without(sheet(-0.5, 8.5), 5.9, 7.1)
    patch = base_patch(lost, DETAIL, WIDE, margin_m=0.3)
    assert uncovered_faces(*DETAIL, *lost).sum() > 0
    assert not uncovered_faces(*DETAIL, *append_surface(lost, patch)).any()
    rows = {tuple(row) for row in WIDE[0].tolist()}
    assert all(tuple(row) in rows for row in patch[0].tolist())
    # It reaches beyond what was missing by the margin and the faces that this meets, not farther.
    assert patch[0][:, 0].min() >= 5.9 - 0.3 - 3 * CELL_M
    assert patch[0][:, 0].max() <= 7.1 + 0.3 + 3 * CELL_M


def test_the_detail_itself_stands_in_where_that_surface_has_nothing_either() -> None:
    lost, narrow = without(sheet(-0.5, 8.5), 5.9, 9), without(WIDE, 7.4, 9)
    patch = base_patch(lost, DETAIL, narrow, margin_m=0.3)
    assert not uncovered_faces(*DETAIL, *append_surface(lost, patch)).any()


def test_a_base_without_faces_is_replaced() -> None:
    none = (BASE[0][:0], BASE[1][:0])
    patch = base_patch(none, DETAIL, WIDE, margin_m=0.3)
    assert not uncovered_faces(*DETAIL, *patch).any()
