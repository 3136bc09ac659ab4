"""A mesh thinned by cells."""

from __future__ import annotations

import numpy as np
from coloured_ground import cut_mesh, ground
from numpy.testing import assert_array_equal

from terraport_pipeline.geometry.mesh.thin_cells import thin_by_cells


def test_thinned_pieces_still_meet() -> None:
    pieces = [piece for piece, _ in cut_mesh(ground(40), 2)]
    area = 0.0
    for piece in pieces:
        kept, faces, origin = thin_by_cells(piece.vertices, piece.faces, 8.0)
        assert len(faces) == len(origin) < 0.5 * len(piece.faces)
        assert faces.max() < len(kept)
        corner = piece.vertices[kept][faces][:, :, [0, 2]].astype(float)
        side, other = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
        area += float((0.5 * (side[:, 1] * other[:, 0] - side[:, 0] * other[:, 1])).sum())
    assert abs(area - 3600.0) < 1e-2  # seen from above, no gap and no overlap


def test_fine_cells_change_nothing() -> None:
    mesh = ground(6)
    kept, faces, origin = thin_by_cells(mesh.vertices, mesh.faces, 1e-3)
    assert_array_equal(kept[faces], mesh.faces)
    assert_array_equal(origin, np.arange(len(mesh.faces)))


def test_no_faces() -> None:
    kept, faces, origin = thin_by_cells(np.zeros((0, 3)), np.zeros((0, 3), int), 1.0)
    assert len(kept) == len(faces) == len(origin) == 0
