"""Small parts of the photo choice, by hand."""

from __future__ import annotations

import numpy as np
import pytest
from photo_scene import look_at

from terraport_pipeline.geometry.photos.view_kernels import (
    QUALITY_STEPS,
    SLOTS,
    index_of_view,
    quality_level,
    rate,
    sort_slots,
)


def test_a_level_is_a_logarithm_in_steps() -> None:
    assert quality_level(4.0) - quality_level(2.0) == QUALITY_STEPS
    assert quality_level(2.0**-12) == quality_level(0.0) == 1  # 0 stands for an empty place
    assert quality_level(1e30) == 65535
    levels = [quality_level(value) for value in np.geomspace(1e-3, 1e5, 500)]
    assert (np.diff(levels) > 0).all()


@pytest.mark.parametrize(("view", "slot"), [(7, 0), (-1, 1), (3, 2), (9, 3), (5, 3)])
def test_a_view_is_found_among_those_seen(view: int, slot: int) -> None:
    seen = np.array([7, -1, 3, 5, 9], np.int64)
    assert index_of_view(seen, 3, view) == slot  # what lies behind the first three is left over


def test_places_are_sorted_with_what_belongs_to_them_and_empty_ones_last() -> None:
    rng = np.random.default_rng(0)
    views = np.full((50, SLOTS), -1, np.int16)
    for row in views:
        row[rng.permutation(SLOTS)[: rng.integers(0, SLOTS + 1)]] = 1
        row[row > 0] = rng.permutation(300)[: (row > 0).sum()]
    qualities = (views.astype(np.uint16) + 7).astype(np.uint16)
    colours = np.repeat((views % 251).astype(np.uint8)[..., None], 3, axis=2)
    before = views.copy()
    sort_slots(views, qualities, colours, 0, 40)
    expected = np.sort(before.view(np.uint16), axis=1).view(np.int16)
    assert (views[:40] == expected[:40]).all()
    assert (views[40:] == before[40:]).all()
    assert (qualities == (views.astype(np.uint16) + 7).astype(np.uint16)).all()
    assert (colours[..., 1] == (views % 251).astype(np.uint8)).all()


def test_a_face_without_area_is_not_rated() -> None:
    """Its corners lie in a line, which rounding of the pixels makes a triangle."""
    view = look_at("a.jpg", (0.0, 10.0, 0.0), (0.0, 0.0, 0.1))
    vertices = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 0, 1]], np.float32)
    faces = np.array([[0, 1, 2], [0, 3, 1]], np.int32)
    uv = np.array([[100, 100], [120, 100.01], [140, 100], [100, 120]], np.float32)
    areas = [
        0.5 * ((uv[k] - uv[i])[0] * (uv[j] - uv[i])[1] - (uv[j] - uv[i])[0] * (uv[k] - uv[i])[1])
        for i, j, k in faces
    ]
    assert min(areas) > 0.0
    face, quality, _ = rate(
        view.packed(), vertices, faces, uv, np.ones((1, 1), np.float32),
        np.zeros((2, SLOTS), np.uint16), 0.1, 0, 2,
    )  # fmt: skip
    assert face.tolist() == [1]
    assert np.isfinite(quality).all()


def test_a_camera_that_stands_on_a_face_does_not_see_it() -> None:
    view = look_at("a.jpg", (0.0, 0.0, 0.0), (0.0, -1.0, 0.1))
    vertices = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0]], np.float32)
    uv = np.array([[100, 100], [100, 120], [120, 100]], np.float32)
    face, _, _ = rate(
        view.packed(), vertices, np.array([[0, 1, 2]], np.int32), uv, np.ones((1, 1), np.float32),
        np.zeros((1, SLOTS), np.uint16), 0.1, 0, 1,
    )  # fmt: skip
    assert not len(face)
