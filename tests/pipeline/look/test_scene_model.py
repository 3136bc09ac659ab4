"""A published scene comes back as the meshes that went in."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from terraport_pipeline import scene_model
from terraport_pipeline.errors import ResourceError
from terraport_pipeline.scene_model import load_scene_model
from terraport_store import DamagedSceneError, Scene


def test_every_face_comes_back_with_its_segment_region_and_attribute(scene_path, detail) -> None:
    with Scene.open(scene_path) as scene:
        model = load_scene_model(scene)
    assert len(model.detail.faces) == len(detail.faces)
    assert_array_equal(np.bincount(model.segment_of_face), np.full(64, len(detail.faces) / 64))
    centres = model.detail.vertices[model.detail.faces].mean(axis=1)
    original = detail.vertices[detail.faces].mean(axis=1)
    order, wanted = np.lexsort(centres.T.round(2)), np.lexsort(original.T.round(2))
    assert_allclose(np.sort(centres[order], 0), np.sort(original[wanted], 0), atol=2e-3)
    assert_array_equal(model.region_of_face, (model.segment_of_face // 8 >= 5).astype(np.int32))
    assert_allclose(model.detail.attributes["grade"], model.detail.vertices[:, 0] / 100, atol=2e-3)
    hand_off = model.hand_off_model()
    assert (hand_off.segment_count, hand_off.tolerance_m) == (64, 1.0)
    assert len(hand_off.cover_offsets) == len(model.base.faces) + 1


def test_a_flipped_byte_is_named(scene_path, tmp_path) -> None:
    copy = shutil.copytree(scene_path, tmp_path / "copy")
    pack = next(copy.glob("v-*/segments.pack"))
    data = bytearray(pack.read_bytes())
    data[5_000] ^= 1
    pack.write_bytes(data)
    with Scene.open(copy) as scene, pytest.raises(DamagedSceneError, match="segment 0 has hash"):
        load_scene_model(scene)


def test_a_scene_beyond_memory_is_refused_before_reading(scene_path, monkeypatch) -> None:
    monkeypatch.setattr(scene_model, "MAX_DETAIL_FACES", 1_000)
    with (
        Scene.open(scene_path) as scene,
        pytest.raises(ResourceError, match="80000 detail faces, expected at most 1000"),
    ):
        load_scene_model(scene)
