from __future__ import annotations

import numpy as np
import pytest
from photo_scene import ground

from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.photos.photo_samples import neutral_gains
from terraport_pipeline.geometry.photos.view_candidates import SLOTS, Candidates
from terraport_pipeline.geometry.textures.level_sums import joined_sums, shorter_sums, solve_levels
from terraport_pipeline.geometry.textures.seam_levels import (
    LevelGrid,
    field_of_piece,
    level_field,
    level_sums,
    node_levels,
)
from terraport_pipeline.geometry.textures.seams import Nodes, Seams, find_seams, label_nodes


def sheet() -> tuple[np.ndarray, np.ndarray, Nodes, Seams]:
    """Three views in stripes across a sheet; each ten levels brighter than the one before.

    Its faces are sorted along x, so that a slice of them is a piece of the sheet.
    """
    vertices, faces = ground(48)
    centres = vertices[faces].mean(axis=1)
    faces = faces[np.argsort(centres[:, 0], kind="stable")]
    view = np.clip((vertices[faces].mean(axis=1)[:, 2] / 14.0).astype(np.int32), 0, 2)
    views = np.full((len(faces), SLOTS), -1, np.int16)
    colour = np.zeros((len(faces), SLOTS, 3), np.uint8)
    views[:, :3] = 0, 1, 2
    for number in range(3):
        colour[:, number] = 100 + 10 * number
    pairs, edges = face_pairs(faces, len(vertices))
    nodes = label_nodes(faces, view, len(vertices))
    seams = find_seams(
        nodes, faces, view, Candidates(views, np.zeros((0, 0), np.uint16), colour),
        np.full((len(faces), 3), 100, np.uint8), neutral_gains(3), pairs, edges, vertices,
        unit_m=0.83,
    )  # fmt: skip
    return vertices, faces, nodes, seams


def pieces(vertices, faces, nodes, seams, grid):
    """Sums of two pieces of the sheet, each with all of it around."""
    piece_sums = []
    for own in (slice(0, len(faces) // 2), slice(len(faces) // 2, len(faces))):
        is_own = np.zeros(len(faces))
        is_own[own] = 1.0
        share = 0.5 * is_own[seams.face].sum(axis=1)
        sums, _ = level_sums(vertices, nodes, seams, grid, own=own, share=share)
        piece_sums.append(shorter_sums(sums))
    return piece_sums


def test_pieces_add_up_to_the_whole() -> None:
    vertices, faces, nodes, seams = sheet()
    grid = LevelGrid.over(vertices.min(axis=0).astype(np.float64), 40.0, 0.83)
    whole, cell = level_sums(vertices, nodes, seams, grid)
    joined = joined_sums(pieces(vertices, faces, nodes, seams, grid))
    assert (joined.keys == whole.keys).all()
    for name in ("link_weight", "seam_weight"):
        assert getattr(joined, name).sum() == pytest.approx(getattr(whole, name).sum())
    # vertices on the border between the pieces count in both
    assert 0 <= joined.nodes.sum() - whole.nodes.sum() < 60
    whole_level, _ = solve_levels(whole)
    joined_level, _ = solve_levels(joined)
    assert np.abs(whole_level).max() > 2.0
    assert np.abs(whole_level - joined_level).max() < 0.05
    assert len(cell) == len(nodes.vertex)


def test_a_piece_takes_its_part_of_the_field() -> None:
    vertices, faces, nodes, seams = sheet()
    grid = LevelGrid.over(vertices.min(axis=0).astype(np.float64), 40.0, 0.83)
    whole, cell = level_sums(vertices, nodes, seams, grid)
    level, _ = solve_levels(whole)
    everywhere, number = field_of_piece(vertices, nodes, grid, whole.keys, level)
    assert (number == cell).all()
    expected = node_levels(everywhere, vertices, nodes, number)
    # the nodes of some faces, as a piece that has nothing else would have them
    some = slice(0, len(faces) // 3)
    used = np.unique(nodes.corner[some])
    row = np.zeros(len(nodes.vertex), np.int32)
    row[used] = np.arange(len(used))
    piece_nodes = Nodes(row[nodes.corner[some]], nodes.vertex[used], nodes.view[used])
    field, piece_cell = field_of_piece(vertices, piece_nodes, grid, whole.keys, level)
    assert (node_levels(field, vertices, piece_nodes, piece_cell) == expected[used]).all()


def test_cells_that_were_not_solved_have_no_correction() -> None:
    vertices, _, nodes, _ = sheet()
    grid = LevelGrid.over(vertices.min(axis=0).astype(np.float64), 40.0, 0.83)
    field, cell = field_of_piece(vertices, nodes, grid, np.zeros(0, np.int64), np.zeros((0, 3)))
    assert not node_levels(field, vertices, nodes, cell).any()


def test_the_whole_is_one_piece() -> None:
    vertices, _, nodes, seams = sheet()
    field, cell = level_field(vertices, nodes, seams)
    sums, _ = level_sums(vertices, nodes, seams, field.grid)
    assert np.allclose(solve_levels(sums)[0], field.level)
    assert cell.max() + 1 == len(field.near)
