"""Rays: hits, misses, barycentrics, watertight edges, odd input."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.engines.rays import CHUNK_RAYS, RayScene

SQUARE = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]], dtype=np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
DOWN = np.array([[0, -1, 0]], dtype=np.float32)


def test_hits_and_misses_are_told_apart() -> None:
    scene = RayScene(SQUARE, FACES)
    t, face = scene.closest_hit([[0.2, 3, 0.7], [0.7, 2, 0.2], [5, 1, 5]], np.repeat(DOWN, 3, 0))
    np.testing.assert_allclose(t, [3, 2, np.inf], rtol=1e-6)
    assert face.tolist() == [0, 1, -1]
    assert (t.dtype, face.dtype) == (np.float32, np.int32)


def test_distance_counts_in_direction_lengths() -> None:
    t, _ = RayScene(SQUARE, FACES).closest_hit([[0.2, 3, 0.7]], [[0, -2, 0]])
    np.testing.assert_allclose(t, [1.5], rtol=1e-6)


def test_barycentric_weights_rebuild_the_hit_point() -> None:
    rng = np.random.default_rng(3)
    origins = np.stack([rng.uniform(0, 1, 50), np.full(50, 4.0), rng.uniform(0, 1, 50)], 1)
    hits = RayScene(SQUARE, FACES).intersect(origins, np.repeat(DOWN, 50, 0))
    corners = SQUARE[FACES[hits.face]]
    weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v], 1)
    points = (weights[:, :, None] * corners).sum(1)
    np.testing.assert_allclose(points[:, [0, 2]], origins[:, [0, 2]], atol=1e-6)


def test_both_sides_are_hit() -> None:
    t, face = RayScene(SQUARE, FACES).closest_hit([[0.2, -3, 0.7]], [[0, 1, 0]])
    np.testing.assert_allclose(t, [3.0], rtol=1e-6)
    assert face.tolist() == [0]


def test_no_ray_slips_through_shared_edges_and_vertices(detail) -> None:
    inner = detail.vertices[(np.abs(detail.vertices[:, [0, 2]] - 50) < 49).all(1)]
    origins = inner + np.float32([0, 50, 0])
    scene = RayScene(detail.vertices, detail.faces)
    t, face = scene.closest_hit(origins, np.broadcast_to(DOWN, origins.shape))
    assert (face >= 0).all()
    np.testing.assert_allclose(t, 50, atol=1e-4)


def test_chunks_and_threads_do_not_change_the_answer(detail) -> None:
    rng = np.random.default_rng(1)
    count = 2 * CHUNK_RAYS + 17
    origins = rng.uniform([-5, 20, -5], [105, 30, 105], (count, 3))
    headings = rng.normal(size=(count, 3))
    first = RayScene(detail.vertices, detail.faces, threads=1).closest_hit(origins, headings)
    second = RayScene(detail.vertices, detail.faces, threads=2).closest_hit(origins, headings)
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])
    assert 0 < (first[1] >= 0).mean() < 1


def test_empty_mesh_and_no_rays() -> None:
    t, face = RayScene(np.empty((0, 3)), np.empty((0, 3))).closest_hit([[0, 1, 0]], DOWN)
    assert (t.tolist(), face.tolist()) == ([np.inf], [-1])
    assert len(RayScene(SQUARE, FACES).closest_hit(np.empty((0, 3)), np.empty((0, 3)))[0]) == 0


def test_rays_that_are_not_finite_miss() -> None:
    t, face = RayScene(SQUARE, FACES).closest_hit([[np.nan, 3, 0.7]], DOWN)
    assert (t.tolist(), face.tolist()) == ([np.inf], [-1])


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        (np.zeros((3, 2)), [[0, 1, 2]], r"shape \(3, 2\), expected \(V, 3\)"),
        (SQUARE, [[0, 1]], r"shape \(1, 2\), expected \(F, 3\)"),
        (SQUARE, [[0, 1, 4]], r"indices 0\.\.4, expected 0\.\.3"),
        (SQUARE * [1, np.nan, 1], FACES, r"vertex 0 = .*expected finite"),
    ],
)
def test_bad_meshes_are_refused_by_name(vertices, faces, words) -> None:
    with pytest.raises(ValueError, match=words):
        RayScene(vertices, faces)


def test_unequal_ray_counts_are_refused() -> None:
    with pytest.raises(ValueError, match="2 ray origins and 1 directions"):
        RayScene(SQUARE, FACES).closest_hit(np.zeros((2, 3)), DOWN)
