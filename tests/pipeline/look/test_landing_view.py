"""A landing to look at: on the ground, its segments, and the base pushed back behind the detail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from terraport_pipeline.engines.cameras import Camera, eye_level, top_down
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.geometry.cover.handoff_rays import hidden_base_faces
from terraport_pipeline.published.landing_view import (
    choose_landing,
    mixed_mesh,
    view_from_above,
    view_from_eye,
)
from terraport_pipeline.published.scene_model import SceneModel, load_scene_model
from terraport_store import Scene


@pytest.fixture(scope="module")
def loaded_scene(scene_path) -> SceneModel:
    with Scene.open(scene_path) as scene:
        return load_scene_model(scene)


@pytest.fixture(scope="module")
def rays(loaded_scene) -> RayScene:
    return RayScene(loaded_scene.detail.vertices, loaded_scene.detail.faces)


def test_landing_stands_on_the_ground_in_the_middle(loaded_scene, rays) -> None:
    landing = choose_landing(loaded_scene, rays)
    x, y, z = landing.position
    assert 25 <= min(x, z) <= max(x, z) <= 75
    t, _ = rays.closest_hit([[x, y + 9, z]], [[0, -1, 0]])
    assert_allclose(t, [9], atol=1e-3)
    assert landing.radius_m == pytest.approx(20)
    low, high = loaded_scene.segment_bounds[:, :3], loaded_scene.segment_bounds[:, 3:]
    gap = np.maximum(np.maximum(low - landing.position, landing.position - high), 0)
    assert_array_equal(landing.loaded, np.linalg.norm(gap, axis=1) <= 20)
    assert 4 < landing.loaded.sum() < 40


def test_without_level_ground_the_nearest_vertex_serves(loaded_scene) -> None:
    # A wall: rays from above meet its edge at most.
    wall = np.float32([[0, 0, 50], [0, 90, 50], [90, 0, 50]])
    mesh = replace(loaded_scene.detail, vertices=wall, faces=np.int32([[0, 1, 2]]))
    model = replace(loaded_scene, detail=mesh)
    landing = choose_landing(model, RayScene(wall, [[0, 1, 2]]))
    assert list(landing.position) in wall.tolist()


def test_mixed_mesh_is_loaded_detail_and_shown_base(loaded_scene) -> None:
    loaded = np.zeros(64, dtype=np.bool_)
    camera = top_down(loaded_scene.detail.vertices, aspect=1.0)
    nothing = mixed_mesh(loaded_scene, loaded, camera, 1.0)
    assert nothing.base_from == 0
    assert len(nothing.faces) == len(loaded_scene.base.faces)
    everything = mixed_mesh(loaded_scene, ~loaded, camera, 1.0)
    assert everything.base_from == len(everything.faces) == len(loaded_scene.detail.faces)
    loaded[:8] = True
    some = mixed_mesh(loaded_scene, loaded, camera, 1.0)
    assert some.base_from == (loaded_scene.segment_of_face < 8).sum()
    assert len(some.faces) > some.base_from


@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
def test_base_is_pushed_back_along_the_line_of_sight_only(loaded_scene, kind) -> None:
    camera = (
        eye_level((50, 30, 50), azimuth_deg=10)
        if kind == "perspective"
        else top_down(loaded_scene.detail.vertices, aspect=1.0)
    )
    mixed = mixed_mesh(loaded_scene, np.zeros(64, dtype=np.bool_), camera, 640 / 360)
    moved = mixed.vertices[len(loaded_scene.detail.vertices) :].astype(np.float64)
    base = loaded_scene.base.vertices.astype(np.float64)
    assert_allclose(np.linalg.norm(moved - base, axis=1), 0.3, atol=1e-4)
    before, after = (camera.project(places, 640, 360) for places in (base, moved))
    ahead = before[2] > 1.0
    assert_allclose(after[0][ahead], before[0][ahead], atol=0.02)
    assert_allclose(after[1][ahead], before[1][ahead], atol=0.02)
    assert (after[2][ahead] > before[2][ahead]).all()


def test_faces_beside_the_picture_are_left_out_and_nothing_else(loaded_scene) -> None:
    camera, size = eye_level((50, 30, 50), azimuth_deg=10), (64, 36)
    loaded = np.arange(64) < 32
    mixed = mixed_mesh(loaded_scene, loaded, camera, size[0] / size[1])
    hidden = hidden_base_faces(loaded_scene.cover.offsets, loaded_scene.cover.segments, loaded)
    detail_faces = loaded_scene.detail.faces[loaded[loaded_scene.segment_of_face]]
    base_faces = loaded_scene.base.faces[~hidden] + len(loaded_scene.detail.vertices)
    everything = np.concatenate([detail_faces, base_faces])
    assert 0 < len(mixed.faces) < 0.7 * len(everything)
    rays = camera.rays(*size)
    cut = RayScene(mixed.vertices, mixed.faces).closest_hit(*rays)[0]
    assert np.isfinite(cut).any()
    assert_allclose(cut, RayScene(mixed.vertices, everything).closest_hit(*rays)[0], rtol=1e-5)


def test_views_look_at_ground(loaded_scene, rays) -> None:
    landing = choose_landing(loaded_scene, rays)

    def ground(camera: Camera) -> float:
        return float((rays.closest_hit(*camera.rays(64, 36))[1] >= 0).mean())

    assert ground(view_from_above(landing, 16 / 9)) > 0.7
    eye = view_from_eye(landing, rays)
    assert ground(eye) > 0.4
    assert eye.eye[1] == pytest.approx(landing.position[1] + 1.7)
    # A wall right in front of the eye is not the direction that is chosen.
    x, y, z = landing.position
    side = np.float32([[x + 1, y - 5, z - 4], [x + 1, y - 5, z + 4], [x + 1, y + 9, z]])
    walled = RayScene(
        np.concatenate([loaded_scene.detail.vertices, side]),
        np.concatenate(
            [loaded_scene.detail.faces, np.arange(3)[None] + len(loaded_scene.detail.vertices)]
        ),
    )
    assert view_from_eye(replace(landing), walled).forward[0] < 0.7
