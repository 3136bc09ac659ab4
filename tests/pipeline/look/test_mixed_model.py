"""Tracing a mixed model through the full meshes agrees with building it."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.geometry.cover.handoff_rays import (
    aim_rays,
    hidden_base_faces,
    random_places,
    random_subsets,
)
from terraport_pipeline.published.mixed_model import (
    BuiltModel,
    MixedModel,
    Places,
    ShownFaces,
    face_normals,
)


@pytest.mark.parametrize("which", range(2, 9))
def test_traced_and_built_mixed_models_agree(model, which) -> None:
    rng = np.random.default_rng(11)
    loaded = random_subsets(rng.uniform(0, 100, (model.segment_count, 3)), 9, rng)[which]
    hidden = hidden_base_faces(model.cover_offsets, model.cover_segments, loaded)
    rays = aim_rays(
        random_places(model.detail_vertices, model.detail_faces, 5_000, rng)[0], 15.0, rng
    )
    traced = MixedModel(
        ShownFaces(
            RayScene(model.detail_vertices, model.detail_faces), loaded[model.segment_of_face]
        ),
        ShownFaces(RayScene(model.base_vertices, model.base_faces), ~hidden),
    ).closest(rays.origins, rays.directions)
    built = BuiltModel(model, loaded, hidden).closest(rays.origins, rays.directions)
    np.testing.assert_array_equal(np.isfinite(traced), np.isfinite(built))
    met = np.isfinite(built)
    np.testing.assert_allclose(traced[met], built[met], atol=2e-3)


def test_a_stack_of_hidden_sheets_is_passed_through() -> None:
    # 60 sheets 1 cm apart, only the lowest shown.
    square = np.array([[0, 0, 0], [0, 0, 4], [4, 0, 4], [4, 0, 0]], dtype=np.float32)
    sheets = np.concatenate([square + np.float32([0, 0.01 * i, 0]) for i in range(60)])
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * i for i in range(60)])
    shown = np.zeros(120, dtype=np.bool_)
    shown[:2] = True
    t = ShownFaces(RayScene(sheets, faces), shown).closest(
        np.float32([[1, 2, 3]]), np.float32([[0, -1, 0]])
    )
    np.testing.assert_allclose(t, [2.0], atol=1e-5)


def test_distance_is_the_least_of_ray_normal_and_vertical() -> None:
    # A floor at height 0; places at height 0.3 whose ray goes level and misses it.
    floor = RayScene([[-9, 0, -9], [-9, 0, 9], [9, 0, 9], [9, 0, -9]], [[0, 1, 2], [0, 2, 3]])
    shown = ShownFaces(floor, np.ones(2, dtype=np.bool_))
    slanted = np.float32([[0.6, 0.8, 0.0]])
    places = Places(np.float32([[-1, 0.3, 0]]), np.float32([[1, 0, 0]]), np.float32([1.0]), slanted)
    nothing = np.float32([np.inf])
    np.testing.assert_allclose(places.distance(shown, nothing, 1.0), [0.3], atol=1e-6)
    assert places.distance(shown, nothing, 0.2).tolist() == [np.inf]
    np.testing.assert_allclose(places.distance(shown, np.float32([1.1]), 1.0), [0.1], atol=1e-6)


def test_distance_looks_outwards_past_nothing() -> None:
    """A roof and a cellar within reach do not hide the floor between them."""
    square = np.float32([[-9, 0, -9], [-9, 0, 9], [9, 0, 9], [9, 0, -9]])
    sheets = np.concatenate([square + np.float32([0, height, 0]) for height in (3, 0.5, -2, 0)])
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * i for i in range(4)])
    up, nothing = np.float32([[0, 1, 0]]), np.float32([np.inf])
    shown = np.ones(8, dtype=np.bool_)
    places = Places(np.float32([[-1, 0, 0]]), np.float32([[1, 0, 0]]), np.float32([1.0]), up)
    scene = RayScene(sheets, faces)
    # the sheet that lies in the place itself is met too
    at_it = places.distance(ShownFaces(scene, shown), nothing, 4.0)
    np.testing.assert_allclose(at_it, [0.0], atol=1e-5)
    shown[6:] = False
    near = places.distance(ShownFaces(scene, shown), nothing, 4.0)
    np.testing.assert_allclose(near, [0.5], atol=1e-5)


def test_face_normals_are_unit_and_upright_for_slivers() -> None:
    vertices = np.float32([[0, 0, 0], [0, 0, 2], [2, 0, 0], [4, 0, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    normals = face_normals(vertices, faces, np.array([0, 1]))
    assert normals.tolist() == [[0, 1, 0], [0, 1, 0]]
