"""The plain grid against a loop over faces."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.geometry.regions.grid_segmenter import GridSegmenter, grid_cells
from terraport_pipeline.geometry.regions.segmenter import SegmenterMesh


def test_cells_are_squares_in_plan(terrain):
    """Same cell exactly where both plan coordinates fall into the same square."""
    mesh = terrain(1, cells=9)
    cells = grid_cells(mesh.vertices, mesh.faces, 5.0)
    low = mesh.vertices.min(axis=0)
    number = {}
    for face, cell in zip(mesh.faces, cells, strict=True):
        middle = mesh.vertices[face].astype(float).mean(axis=0)
        square = (int((middle[0] - low[0]) // 5.0), int((middle[2] - low[2]) // 5.0))
        assert number.setdefault(square, cell) == cell
    assert len(set(number.values())) == len(number) == 49


def test_pieces_of_a_cell_that_do_not_touch_are_apart(terrain):
    """A region is a connected piece of one cell; all cells are covered."""
    mesh = terrain(2, cells=30, holes=0.3)
    subject = SegmenterMesh(mesh.vertices, mesh.faces)
    segmentation = GridSegmenter(region_cell_m=8.0, fine_cell_m=4.0).segment(subject)
    cells = grid_cells(mesh.vertices, mesh.faces, 8.0)
    pairs, _ = face_pairs(mesh.faces, len(mesh.vertices))
    pieces, count = components(len(mesh.faces), pairs, labels=cells)
    assert segmentation.regions.tolist() == pieces.tolist()
    assert segmentation.region_count == count > 16
    assert segmentation.fine_count >= 64
    assert (segmentation.similarity == 0.0).all()


def test_automatic_cells(terrain):
    """About twenty regions; fine pools of about 8,000 faces, here the whole mesh."""
    mesh = terrain(4, cells=40)
    segmentation = GridSegmenter().segment(SegmenterMesh(mesh.vertices, mesh.faces))
    assert 16 <= segmentation.region_count <= 30
    assert segmentation.fine_count == 1


def test_limits():
    """No faces are no cells; lengths and numbers that cannot be are refused."""
    empty = SegmenterMesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    assert GridSegmenter().segment(empty).region_count == 0
    for wrong in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match="region_cell_m"):
            GridSegmenter(region_cell_m=wrong)
    wide = np.array([[0, 0, 0], [1e6, 0, 0], [0, 0, 1e6]])
    with pytest.raises(ValueError, match="cells of"):
        grid_cells(np.concatenate([wide, wide + 1e6]), np.array([[0, 1, 2], [3, 4, 5]]), 1e-3)
