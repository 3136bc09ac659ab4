from __future__ import annotations

import itertools

import numpy as np
from photo_scene import ground

from terraport_pipeline.geometry.cover.face_cells import face_cells


def test_every_face_is_in_one_cell_and_cells_are_small() -> None:
    vertices, faces = ground(40)
    order, starts = face_cells(vertices, faces, 4.0)
    assert (np.sort(order) == np.arange(len(faces))).all()
    assert starts[0] == 0
    assert starts[-1] == len(faces)
    assert (np.diff(starts) > 0).all()
    first = vertices[faces[order, 0]]
    for begin, end in itertools.pairwise(starts):
        assert (np.diff(order[begin:end]) > 0).all()
        assert np.ptp(first[begin:end], axis=0).max() <= 4.0 * 1.5


def test_no_faces() -> None:
    order, starts = face_cells(np.zeros((3, 3), np.float32), np.zeros((0, 3), np.int32), 4.0)
    assert order.shape == (0,)
    assert starts.tolist() == [0]
