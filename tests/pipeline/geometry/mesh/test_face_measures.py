"""Plain measures, on answers written out."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.face_measures import (
    automatic_extent,
    dense_labels,
    edge_steps,
    face_boxes,
    face_centres,
    first_faces,
    label_boxes,
    label_sums,
    main_labels,
    surface_area,
)

VERTICES = np.array([[0, 0, 0], [3, 0, 0], [0, 0, 4], [3, 6, 4]], np.float32)
FACES = np.array([[0, 1, 2], [2, 1, 3]], np.int32)


def test_centres_and_boxes():
    """Means of corners, corners' extremes, and the boxes of sets of faces."""
    np.testing.assert_allclose(face_centres(VERTICES, FACES), [[1, 0, 4 / 3], [2, 2, 8 / 3]])
    low, high = face_boxes(VERTICES, FACES)
    assert low.tolist() == [[0, 0, 0], [0, 0, 0]]
    assert high.tolist() == [[3, 0, 4], [3, 6, 4]]
    low, high = label_boxes(np.array([1, 0], np.int32), np.array([1, 1]), low, high)
    assert high.tolist() == [[3, 6, 4], [3, 0, 4]]


def test_labels():
    """First faces, and numbers without gaps in their own order."""
    labels = np.array([2, 0, 2, 0, 5], np.int32)
    assert first_faces(labels, 6).tolist() == [1, 0, 0, 0, 0, 4]
    assert dense_labels(labels).tolist() == [1, 0, 1, 0, 2]


def test_edge_steps_are_whole_and_proportional():
    """The longest edge has 2^20 steps; a collapsed edge still has one."""
    edges = np.array([[0, 1], [0, 2], [1, 2], [0, 0]], np.int32)
    steps = edge_steps(VERTICES, edges)
    assert steps.dtype == np.int64
    np.testing.assert_allclose(steps[:3] / 2**20, [0.6, 0.8, 1.0], atol=1e-6)
    assert steps[3] == 1
    assert edge_steps(VERTICES, edges[:0]).shape == (0,)


def test_automatic_extent():
    """1.2 sides of the square of all faces' area at mean size; the box where there is none."""
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1]], np.float32)
    assert automatic_extent(flat, FACES, 800) == 1.2 * np.sqrt(0.5 * 800)
    assert automatic_extent(flat, np.zeros((1, 3), int), 800) == 1.0


@pytest.mark.parametrize("seed", range(10))
def test_main_labels_are_the_most_common(seed):
    """Ties go to the lowest kind."""
    rng = np.random.default_rng(seed)
    labels = rng.integers(0, 6, 60).astype(np.int32)
    kinds = rng.integers(0, 4, 60).astype(np.int32)
    main, n_kinds = main_labels(labels, 7, kinds)
    for label in range(7):
        mine = kinds[labels == label].tolist()
        assert n_kinds[label] == len(set(mine))
        expected = min(set(mine), key=lambda k: (-mine.count(k), k)) if mine else -1
        assert main[label] == expected


def test_sums_and_area():
    """Faces and sums by label; the area of both faces."""
    size, total = label_sums(np.array([1, 0, 1], np.int32), 3, np.array([1, 2, 4], np.float32))
    assert (size.tolist(), total.tolist()) == ([1, 2, 0], [2.0, 5.0, 0.0])
    sides = np.cross(VERTICES[1] - VERTICES[2], VERTICES[3] - VERTICES[2])
    assert surface_area(VERTICES, FACES) == pytest.approx(6.0 + np.linalg.norm(sides) / 2)


def test_threads_change_no_byte(terrain):
    """Several pieces, float32 and float64."""
    mesh = terrain(2, cells=400)
    edges = mesh.faces[:, :2]
    for vertices in (mesh.vertices, mesh.vertices.astype(np.float64)):
        for work in (
            lambda n, v=vertices: face_centres(v, mesh.faces, threads=n),
            lambda n, v=vertices: np.stack(face_boxes(v, mesh.faces, threads=n)),
            lambda n, v=vertices: edge_steps(v, edges, threads=n),
            lambda n, v=vertices: np.array(surface_area(v, mesh.faces, threads=n)),
        ):
            assert work(1).tobytes() == work(2).tobytes()
