"""A field of corrections that brings two photos together and fades, on a sheet of two halves."""

from __future__ import annotations

import numpy as np
import pytest
from photo_scene import ground

from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.photos.photo_samples import neutral_gains
from terraport_pipeline.geometry.photos.view_candidates import new_candidates
from terraport_pipeline.geometry.textures.seam_levels import (
    LevelGrid,
    field_of_piece,
    level_field,
    node_levels,
)
from terraport_pipeline.geometry.textures.seams import Nodes, Seams, find_seams, label_nodes

CELLS = 96
MIDDLE_M = 20.0


def sheet(step: int, *, at_m: float = 0.0) -> tuple[np.ndarray, Nodes, Seams]:
    """View 0 on the left, view 1, so much brighter, on the right of a flat sheet."""
    vertices, faces = ground(CELLS)
    view = (vertices[faces].mean(axis=1)[:, 0] > MIDDLE_M).astype(np.int32)
    candidates = new_candidates(len(faces))
    candidates.view[:, :2] = 0, 1
    candidates.colour[:, 0], candidates.colour[:, 1] = 100, 100 + step
    pairs, edges = face_pairs(faces, len(vertices))
    nodes = label_nodes(faces, view, len(vertices))
    own = np.full((len(faces), 3), 100, np.uint8)
    seams = find_seams(
        nodes, faces, view, candidates, own, neutral_gains(2), pairs, edges, vertices
    )
    return vertices + np.float32(at_m), nodes, seams


def levels_of(vertices: np.ndarray, nodes: Nodes, seams: Seams, threads: int = 1) -> np.ndarray:
    field, cell = level_field(vertices, nodes, seams)
    return node_levels(field, vertices, nodes, cell, threads=threads)


def test_without_a_step_nothing_is_corrected() -> None:
    assert (levels_of(*sheet(0)) == 0).all()


def test_both_sides_come_half_way_and_it_fades() -> None:
    vertices, nodes, seams = sheet(10)
    level = levels_of(vertices, nodes, seams)[:, 0]
    x = vertices[nodes.vertex][:, 0]
    left, right = nodes.view == 0, nodes.view == 1
    assert (level[left] >= 0).all()  # the darker side is raised
    assert (level[right] <= 0).all()
    near = np.abs(x - MIDDLE_M) < 0.7
    far = np.abs(x - MIDDLE_M) > 17.0  # 40 edges
    assert level[left & near].mean() == pytest.approx(-level[right & near].mean(), rel=0.05)
    assert 2.5 < level[left & near].mean() < 5.0
    # to 1 / e over 63 edges: cosh(4 / 63) / cosh(44 / 63) of it is left near the rim
    left_over = np.abs(level[far]).mean() / np.abs(level[near]).mean()
    assert left_over == pytest.approx(np.cosh(4 / 63) / np.cosh(44 / 63), abs=0.05)


def test_twice_the_step_is_twice_the_correction() -> None:
    # of one trust: what a seam is worth does not change with the step here
    vertices, nodes, seams = sheet(4)
    seams.trust[:] = 1.0
    level = levels_of(vertices, nodes, seams)
    seams.step[:] *= 2
    assert levels_of(vertices, nodes, seams) == pytest.approx(2 * level, abs=0.01)


def test_where_the_sheet_lies_does_not_matter_nor_do_threads() -> None:
    near_sheet, far_sheet = sheet(10), sheet(10, at_m=1024.0)
    level = levels_of(*near_sheet)
    assert levels_of(*far_sheet) == pytest.approx(level, abs=0.02)
    assert levels_of(*near_sheet, threads=2).tobytes() == level.tobytes()


def test_a_seam_of_no_trust_pulls_nothing() -> None:
    vertices, nodes, seams = sheet(10)
    seams.trust[:] = 0.0
    assert np.abs(levels_of(vertices, nodes, seams)).max() == 0


def test_a_piece_takes_its_part_of_the_whole_and_the_rest_is_not_corrected() -> None:
    vertices, nodes, _ = sheet(10)
    extent = float(np.ptp(vertices, axis=0).max())
    grid = LevelGrid.over(vertices.min(axis=0).astype(np.float64), extent, 1.0)
    none = np.zeros(0, np.int64)
    field, cell = field_of_piece(vertices, nodes, grid, none, np.zeros((0, 3)))
    assert (node_levels(field, vertices, nodes, cell) == 0).all()
    assert (field.near == -1).all()


def test_cells_hold_eight_edges_however_small_the_sheet() -> None:
    assert LevelGrid.over(np.zeros(3), 40.0, 1.0).size_m == 8.0
    assert LevelGrid.over(np.zeros(3), 0.0, 0.0).size_m > 0.0
    # never more cells along one side than a key can number
    wide = LevelGrid.over(np.zeros(3), 1e6, 1e-3)
    assert 1e6 / wide.size_m + 2 <= 2**14 + 1e-6
