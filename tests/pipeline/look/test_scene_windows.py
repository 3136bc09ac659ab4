"""A scene looked at in windows shows what it shows whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from terraport_pipeline.published.scene_model import load_scene_model
from terraport_pipeline.validate import scene_windows
from terraport_pipeline.validate.handoff import check_hand_off_in_windows
from terraport_pipeline.validate.handoff_report import HandOffOptions
from terraport_pipeline.validate.scene_windows import prove_in_windows, segments_around, windows_of
from terraport_store import Scene

FEW = HandOffOptions(rays=12_000, subsets=24, seed=3)


@pytest.fixture
def boxes():
    """An 8 x 8 grid of squares that touch."""
    i, j = np.divmod(np.arange(64), 8)
    low = np.stack([i, np.zeros(64), j], axis=1).astype(float)
    return np.concatenate([low, low + 1.0], axis=1)


def test_windows_hold_every_segment_and_overlap_by_those_that_touch(boxes) -> None:
    windows = windows_of(boxes, np.full(64, 10), 160)
    assert len(windows) == 4
    assert_array_equal(np.unique(np.concatenate(windows)), np.arange(64))
    for window in windows:  # 4 x 4 and one row more on two sides
        assert len(window) == 25
        assert (np.diff(window) > 0).all()


def test_what_fits_is_one_window(boxes) -> None:
    (only,) = windows_of(boxes, np.full(64, 10), 640)
    assert_array_equal(only, np.arange(64))


def test_a_segment_is_never_cut(boxes) -> None:
    assert len(windows_of(boxes[:1], np.array([10**9]), 5)) == 1


def test_no_hole_whole_is_no_hole_in_windows(scene_path, monkeypatch) -> None:
    monkeypatch.setattr(scene_windows.scene_windows, "__defaults__", (25_000,))
    with Scene.open(scene_path) as scene:
        report = prove_in_windows(scene, FEW)
    assert report.windows == 4
    assert report.holes == 0
    assert report.hits > 10_000
    assert report.worst is not None
    assert max(report.worst.loaded, default=0) < 64


def test_a_hole_is_found_in_its_window_and_named_by_the_scenes_numbers(scene_path) -> None:
    with Scene.open(scene_path) as scene:
        windows = windows_of(
            scene.index.bounds.astype(float), scene.index.face_count.astype(np.int64), 25_000
        )

        def wrong(segments):
            model = load_scene_model(scene, segments=segments).hand_off_model(segments)
            # Only the first segment of each base face is kept: faces hide too early.
            return replace(
                model,
                cover_offsets=np.arange(len(model.base_faces) + 1),
                cover_segments=model.cover_segments[model.cover_offsets[:-1]],
            )

        report = check_hand_off_in_windows(windows, wrong, [len(w) for w in windows], FEW)
    assert report.holes_hidden > 10
    assert report.worst is not None
    assert report.worst.hole
    tile = np.clip(np.array(report.worst.target)[[0, 2]] // 12.5, 0, 7).astype(int)
    assert tile[0] * 8 + tile[1] not in report.worst.loaded


def test_segments_around_a_place_are_the_nearest(scene_path) -> None:
    with Scene.open(scene_path) as scene:
        assert segments_around(scene, (1.0, 0.0, 1.0), 1).tolist() == [0]
        assert segments_around(scene, (1.0, 0.0, 1.0), 80_000).tolist() == list(range(64))
