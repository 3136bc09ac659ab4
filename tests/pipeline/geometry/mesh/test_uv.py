from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_pipeline.geometry.mesh.uv import split_wedges


def test_without_seams_nothing_is_split() -> None:
    faces = np.array([[2, 1, 0], [2, 0, 3]])
    uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float64)
    split = split_wedges(faces, uvs[faces], 5)
    assert split.vertex.tolist() == [2, 1, 0, 3]  # by first use; vertex 4 is used by nobody
    assert split.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert split.uvs.tolist() == uvs[[2, 1, 0, 3]].tolist()


def test_labels_split_too() -> None:
    faces = np.array([[0, 1, 2], [2, 1, 3], [3, 1, 4]])
    split = split_wedges(faces, np.zeros((3, 3, 2)), 5, labels=np.array([7, 7, 9]))
    assert split.vertex.tolist() == [0, 1, 2, 3, 3, 1, 4]
    assert split.labels.tolist() == [7, 7, 7, 7, 9, 9, 9]


def test_signed_zero_and_nan() -> None:
    faces = np.array([[0, 1, 2], [0, 1, 2]])
    wedges = np.zeros((2, 3, 2))
    wedges[1] = -0.0
    wedges[:, 1] = np.nan
    assert len(split_wedges(faces, wedges, 3).vertex) == 3


@pytest.mark.parametrize(
    ("faces", "wedges", "labels", "message"),
    [
        (np.zeros((2, 4), int), np.zeros((2, 3, 2)), None, r"faces have shape \(2, 4\)"),
        (np.zeros((2, 3), int), np.zeros((2, 3)), None, r"expected \(2, 3, 2\)"),
        (np.zeros((2, 3), int), np.zeros((2, 3, 2)), np.zeros(3, int), "labels have shape"),
        (np.full((1, 3), 4), np.zeros((1, 3, 2)), None, "expected 0 to 3"),
        (np.full((1, 3), -1), np.zeros((1, 3, 2)), None, "expected 0 to 3"),
    ],
)
def test_wrong_input(faces: object, wedges: object, labels: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        split_wedges(faces, wedges, 4, labels=labels)  # type: ignore[arg-type]


def test_no_face() -> None:
    split = split_wedges(np.zeros((0, 3), int), np.zeros((0, 3, 2)), 4)
    assert (len(split.vertex), split.faces.shape, split.uvs.shape) == (0, (0, 3), (0, 2))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_every_corner_keeps_vertex_uv_and_label(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n_vertices, n_faces = int(rng.integers(1, 12)), int(rng.integers(1, 40))
    faces = rng.integers(0, n_vertices, (n_faces, 3))
    wedges = rng.integers(0, 3, (n_faces, 3, 2)).astype(np.float32)
    labels = rng.integers(0, 3, n_faces)
    split = split_wedges(faces, wedges, n_vertices, labels=labels)
    assert np.array_equal(split.vertex[split.faces], faces)
    assert np.array_equal(split.uvs[split.faces], wedges)
    assert np.array_equal(split.labels[split.faces], np.repeat(labels[:, None], 3, axis=1))
    rows = np.column_stack([split.vertex, split.uvs, split.labels])
    assert len(np.unique(rows, axis=0)) == len(rows)  # as few as can be
