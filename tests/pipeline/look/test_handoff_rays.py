"""The proof's pure part: subsets, the cover rule, places, rays, strict misses."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from terraport_pipeline.geometry.cover.handoff_rays import (
    RayKind,
    aim_rays,
    cumulative_face_area,
    grazing_rays,
    hidden_base_faces,
    random_places,
    random_subsets,
    rim_base_faces,
)


def test_subsets_begin_with_none_and_all_and_are_of_every_size() -> None:
    centres = np.random.default_rng(0).uniform(0, 100, (50, 3))
    loaded = random_subsets(centres, 100, np.random.default_rng(1))
    assert loaded.shape == (100, 50)
    assert not loaded[0].any()
    assert loaded[1].all()
    sizes = loaded.sum(axis=1)
    assert (sizes == 1).sum() >= 15
    assert ((sizes >= 45) & (sizes < 50)).sum() >= 15
    assert ((sizes > 1) & (sizes < 45)).sum() >= 40
    again = random_subsets(centres, 100, np.random.default_rng(1))
    np.testing.assert_array_equal(loaded, again)


def test_a_landing_is_the_nearest_segments() -> None:
    centres = np.stack([np.arange(40.0), np.zeros(40), np.zeros(40)], axis=1)
    landing = np.flatnonzero(random_subsets(centres, 3, np.random.default_rng(2))[2])
    assert (np.diff(landing) == 1).all()


@given(st.integers(0, 2**32 - 1))
def test_cover_rule_agrees_with_its_words(seed) -> None:
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 4, 12)
    offsets = np.concatenate([[0], np.cumsum(counts)])
    segments = rng.integers(0, 6, offsets[-1]).astype(np.uint32)
    loaded = rng.random(6) < 0.6
    hidden = hidden_base_faces(offsets.astype(np.uint32), segments, loaded)
    rim = rim_base_faces(offsets.astype(np.uint32), segments, loaded)
    for face in range(12):
        over = segments[offsets[face] : offsets[face + 1]]
        assert hidden[face] == (len(over) > 0 and all(loaded[s] for s in over))
        partly = any(loaded[s] for s in over) and not all(loaded[s] for s in over)
        assert (face in rim) == partly


def test_places_are_spread_by_area() -> None:
    # Two right triangles, the second four times as large.
    vertices = np.float32([[0, 0, 0], [0, 0, 1], [1, 0, 0], [5, 0, 0], [5, 0, 2], [7, 0, 0]])
    faces = np.array([[0, 1, 2], [3, 4, 5]], dtype=np.int32)
    np.testing.assert_allclose(cumulative_face_area(vertices, faces), [0.5, 2.5])
    places, face = random_places(vertices, faces, 20_000, np.random.default_rng(0))
    np.testing.assert_allclose((places[:, 0] > 4).mean(), 0.8, atol=0.02)
    np.testing.assert_array_equal(face, places[:, 0] > 4)
    np.testing.assert_array_equal(places[:, 1], 0)
    first = places[places[:, 0] < 4]
    assert (first[:, 0] + first[:, 2] <= 1 + 1e-9).all()
    np.testing.assert_allclose(first[:, [0, 2]].mean(axis=0), [1 / 3, 1 / 3], atol=0.02)


def test_places_on_a_mesh_without_area_still_come() -> None:
    vertices = np.zeros((3, 3), np.float32)
    faces = np.array([[0, 1, 2]], dtype=np.int32)
    places, _ = random_places(vertices, faces, 4, np.random.default_rng(0))
    assert places.tolist() == [[0, 0, 0]] * 4


def test_every_ray_passes_through_its_place_from_the_right_side() -> None:
    rng = np.random.default_rng(4)
    places = rng.uniform([0, 0, 0], [100, 20, 100], (3_000, 3))
    rays = aim_rays(places, 20.0, rng)
    ahead = places - rays.origins
    length = np.linalg.norm(ahead, axis=1)
    np.testing.assert_allclose(np.linalg.norm(rays.directions, axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(rays.directions * length[:, None], ahead, atol=2e-3)
    down, above, eye = (rays.kind == kind for kind in (RayKind.DOWN, RayKind.ABOVE, RayKind.EYE))
    assert down.sum() == above.sum() == eye.sum() == 1_000
    assert (rays.directions[down] == [0, -1, 0]).all()
    np.testing.assert_allclose(rays.origins[above, 1], 25.0, atol=1e-4)
    np.testing.assert_allclose(rays.origins[eye, 1] - places[eye, 1], 1.7, atol=1e-4)
    assert length[eye].max() < 82


def test_grazing_rays_see_their_places_from_the_front() -> None:
    rng = np.random.default_rng(6)
    places = rng.uniform(0, 100, (2_000, 3)).astype(np.float32)
    normals = np.tile(np.float32([1, 0, 0]), (2_000, 1))
    free = np.where(np.arange(2_000) % 2, 2.0, np.inf).astype(np.float32)
    rays = grazing_rays(places, normals, lambda _points, _directions: free, rng)
    assert (rays.kind == RayKind.GRAZING).all()
    ahead = places - rays.origins
    length = np.linalg.norm(ahead, axis=1)
    np.testing.assert_allclose(rays.directions * length[:, None], ahead, atol=1e-3)
    angle = np.degrees(np.arcsin(-(rays.directions * normals).sum(axis=1)))
    assert 0.9 < angle.min() < angle.max() < 60.1
    assert np.median(angle) < 15
    assert length[1::2].max() < 2.0  # from before what is in the way
    assert length.max() > 50.0
