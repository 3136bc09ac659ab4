"""A published scene comes back as the meshes that went in."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from terraport_pipeline.published.scene_model import load_scene_model
from terraport_store import DamagedSceneError, Scene


def test_every_face_comes_back_with_its_segment_region_and_attribute(scene_path, detail) -> None:
    with Scene.open(scene_path) as scene:
        model = load_scene_model(scene)
    assert len(model.detail.faces) == len(detail.faces)
    assert_array_equal(np.bincount(model.segment_of_face), np.full(64, len(detail.faces) / 64))
    centres = model.detail.vertices[model.detail.faces].mean(axis=1)
    original = detail.vertices[detail.faces].mean(axis=1)
    order, original_order = np.lexsort(centres.T.round(2)), np.lexsort(original.T.round(2))
    assert_allclose(np.sort(centres[order], 0), np.sort(original[original_order], 0), atol=2e-3)
    assert_array_equal(model.region_of_face, (model.segment_of_face // 8 >= 5).astype(np.int32))
    assert_allclose(model.detail.attributes["grade"], model.detail.vertices[:, 0] / 100, atol=2e-3)
    hand_off = model.hand_off_model()
    assert (hand_off.segment_count, hand_off.tolerance_m) == (64, 1.0)
    assert len(hand_off.cover_offsets) == len(model.base.faces) + 1


def test_a_flipped_byte_is_named(scene_path, tmp_path) -> None:
    copy = shutil.copytree(scene_path, tmp_path / "copy")
    pack = next(copy.glob("v-*/segments.pack"))
    data = bytearray(pack.read_bytes())
    data[1_000] ^= 1
    pack.write_bytes(data)
    with Scene.open(copy) as scene, pytest.raises(DamagedSceneError, match="segment 0 has hash"):
        load_scene_model(scene)


def test_some_segments_alone_keep_the_scenes_numbers(scene_path) -> None:
    some = np.array([3, 11, 12])
    with Scene.open(scene_path) as scene:
        model = load_scene_model(scene, segments=some)
    assert_array_equal(np.unique(model.segment_of_face), some)
    assert len(model.detail.faces) == 3 * 80_000 // 64
    window = model.hand_off_model(some)
    assert window.segment_count == 3
    assert_array_equal(np.unique(window.segment_of_face), [0, 1, 2])
    assert_array_equal(np.unique(window.cover_segments), [0, 1, 2])
    # Base faces that none of them lies over are not there.
    assert (np.diff(window.cover_offsets) > 0).all()
    assert len(window.base_faces) == len(window.cover_offsets) - 1 < len(model.base.faces) // 4


def test_a_thinned_scene_keeps_its_shape_and_what_is_asked_for(scene_path) -> None:
    whole = np.zeros(64, np.bool_)
    whole[9] = True
    with Scene.open(scene_path) as scene:
        full = load_scene_model(scene)
        thin = load_scene_model(scene, max_faces=30_000, whole=whole)
    assert 10_000 < len(thin.detail.faces) < 45_000
    assert (thin.segment_of_face == 9).sum() == 80_000 // 64
    assert_array_equal(np.unique(thin.segment_of_face), np.arange(64))
    assert_allclose(thin.detail.vertices.min(axis=0), full.detail.vertices.min(axis=0), atol=0.3)
    # No cracks: seen from above, the triangles fill the square.
    corner = thin.detail.vertices[thin.detail.faces][:, :, [0, 2]].astype(float)
    side, other = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = 0.5 * (side[:, 1] * other[:, 0] - side[:, 0] * other[:, 1])
    assert area.sum() == pytest.approx(100.0**2, rel=1e-3)


def test_a_small_scene_is_not_thinned(scene_path) -> None:
    with Scene.open(scene_path) as scene:
        assert len(load_scene_model(scene, max_faces=80_000).detail.faces) == 80_000
