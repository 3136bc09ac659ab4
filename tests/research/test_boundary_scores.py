"""Borders of partitions against their definitions."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_research.boundary_scores import border_edges, boundary_score


def grid(cells):
    """Square of unit cells; x runs along the slow axis."""
    axis = np.arange(cells + 1.0)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    i, j = np.divmod(np.arange(cells * cells), cells)
    a = i * (cells + 1) + j
    b = a + cells + 1
    faces = np.stack([a, b, a + 1, a + 1, b, b + 1], axis=1).reshape(-1, 3)
    return vertices, faces, vertices[faces].mean(axis=1)


def test_borders_on_a_grid():
    """Two half planes; the found border is one cell off, or has a spur of three cells too much."""
    vertices, faces, middle = grid(8)
    pairs, edges = face_pairs(faces, len(vertices))
    true = (middle[:, 0] > 4).astype(int)
    assert border_edges(true, pairs, edges).tolist() == [
        [36 + i, 36 + i + 1] for i in range(8)
    ]  # vertices 36..44 are x = 4
    same = boundary_score(vertices, pairs, edges, true, 1 - true, 0.1)
    assert (same.recall, same.precision) == (1.0, 1.0)
    assert (same.true_length, same.predicted_length) == pytest.approx((8.0, 8.0))
    shifted = (middle[:, 0] > 5).astype(int)
    assert boundary_score(vertices, pairs, edges, true, shifted, 0.9).recall == 0.0
    assert boundary_score(vertices, pairs, edges, true, shifted, 1.1).recall == 1.0
    cut = true + 2 * ((middle[:, 0] < 3) & (middle[:, 1] > 4))  # 3 + 4 more border, 4 - 1 away
    score = boundary_score(vertices, pairs, edges, true, cut, 0.5)
    assert score.recall == 1.0
    assert score.precision == pytest.approx(8 / 15)


def test_no_border_at_all():
    """Nothing to find is found; nothing found of something is 0."""
    vertices, faces, middle = grid(4)
    pairs, edges = face_pairs(faces, len(vertices))
    one_region, two_regions = np.zeros(len(faces), int), (middle[:, 0] > 2).astype(int)
    nothing = boundary_score(vertices, pairs, edges, one_region, one_region, 1.0)
    assert (nothing.recall, nothing.precision) == (1.0, 1.0)
    missed = boundary_score(vertices, pairs, edges, two_regions, one_region, 1.0)
    assert (missed.recall, missed.precision) == (0.0, 1.0)
    assert boundary_score(vertices, pairs, edges, one_region, two_regions, 1.0).precision == 0.0


def test_faces_without_truth_do_not_count():
    """Borders of the unknown part are neither asked for nor held against the found ones."""
    vertices, faces, middle = grid(8)
    pairs, edges = face_pairs(faces, len(vertices))
    scored = middle[:, 1] < 4
    true = np.where(scored, (middle[:, 0] > 4).astype(int), 9)
    labels = (middle[:, 0] > 4) + 2 * (~scored & (middle[:, 0] > 6))
    score = boundary_score(vertices, pairs, edges, true, labels, 0.1, scored=scored)
    assert (score.recall, score.precision) == (1.0, 1.0)
    assert score.true_length == pytest.approx(4.0)


def segment_distance(point, start, end):
    """Distance from a point to a stretch."""
    along = end - start
    t = np.clip(np.dot(point - start, along) / max(np.dot(along, along), 1e-30), 0.0, 1.0)
    return np.linalg.norm(point - start - t * along)


@pytest.mark.parametrize("seed", range(6))
def test_recall_lies_between_exact_bounds(seed, terrain):
    """Against distances to whole edges, at the distance and a sixteenth below it."""
    mesh = terrain(seed, cells=8, holes=0.1)
    pairs, edges = face_pairs(mesh.faces, len(mesh.vertices))
    rng = np.random.default_rng(seed)
    true = mesh.colours[mesh.faces[:, 0], 0].astype(int) // 40
    labels = rng.integers(0, 2, len(mesh.faces)) * (rng.random(len(mesh.faces)) < 0.1)
    distance = 3.0
    score = boundary_score(mesh.vertices, pairs, edges, true, labels, distance)
    spots = mesh.vertices.astype(float)
    other = [spots[edge] for edge in border_edges(labels, pairs, edges)]
    near = {distance: 0.0, distance * 15 / 16: 0.0}
    total = 0.0
    for edge in border_edges(true, pairs, edges):
        start, end = spots[edge]
        length = np.linalg.norm(end - start)
        pieces = max(int(np.ceil(length / (distance / 8))), 1)
        total += length
        for piece in range(pieces):
            at = start + (end - start) * (piece + 0.5) / pieces
            gap = min(segment_distance(at, *stretch) for stretch in other)
            for limit in near:
                near[limit] += length / pieces * (gap <= limit)
    assert score.true_length == pytest.approx(total)
    assert near[distance * 15 / 16] - 1e-9 <= score.recall * total <= near[distance] + 1e-9


@pytest.mark.parametrize("distance", [0.0, -1.0, np.inf, np.nan])
def test_a_distance_that_is_none_is_refused(distance):
    """Said before any work."""
    vertices, faces, _ = grid(2)
    pairs, edges = face_pairs(faces, len(vertices))
    with pytest.raises(ValueError, match="distance"):
        boundary_score(vertices, pairs, edges, np.zeros(8, int), np.zeros(8, int), distance)
