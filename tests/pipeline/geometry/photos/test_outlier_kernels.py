"""Distances of views from the rest of a cell, by hand; and who pays for a neighbour."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.photos.outlier_kernels import MAX_VIEWS, drop, rate
from terraport_pipeline.geometry.photos.view_kernels import QUALITY_STEPS, SLOTS

FACES = 10


def cells(*levels: list[int] | int, own: int | None = 100, count: int = 1):
    """Cells of ten faces each, all with the same views: one grey level each, or one for a face."""
    faces = FACES * count
    views = np.full((faces, SLOTS), -1, np.int16)
    colours = np.zeros((faces, SLOTS, 3), np.uint8)
    for number, level in enumerate(levels):
        views[:, number] = number
        colours[:, number] = np.broadcast_to(np.tile(level, faces)[:faces, None], (faces, 3))
    grey = np.full((0 if own is None else faces, 3), own or 0, np.uint8)
    return views, colours, grey


def distances(*levels: list[int] | int, own: int | None = 100) -> list[float]:
    views, colours, grey = cells(*levels, own=own)
    seen = np.full((1, MAX_VIEWS), -1, np.int16)
    far = np.zeros((1, MAX_VIEWS), np.float32)
    rate(
        views,
        colours,
        grey,
        np.arange(FACES, dtype=np.int32),
        np.array([0, FACES]),
        seen,
        far,
        0,
        1,
    )
    assert seen[0].tolist() == [*range(len(levels)), *[-1] * (MAX_VIEWS - len(levels))]
    return far[0, : len(levels)].tolist()


def test_a_distance_is_a_share_of_what_is_allowed() -> None:
    assert distances(100, 100, 160) == pytest.approx([0.0, 0.0, 2.0], abs=1e-3)
    assert distances(145) == pytest.approx([0.75], abs=1e-3)  # alone: twice as much is allowed


def test_two_views_without_a_cloud_are_not_judged() -> None:
    assert distances(30, 200, own=None) == [0.0, 0.0]


def test_grain_counts_beyond_the_usual_and_beyond_the_smoothest_view() -> None:
    rough = [80, 120] * 5  # grain 20, usual 6
    assert distances(100, rough) == pytest.approx([0.0, np.sqrt(2 * 14.0**2) / 30], abs=1e-3)
    assert distances(rough, rough) == pytest.approx([0.0, 0.0], abs=1e-3)
    assert distances(100, rough, 100, own=None) == pytest.approx([0.0, 0.0, 0.0], abs=1e-3)


@pytest.mark.parametrize(("near", "kept"), [(0.3, True), (0.5, False)])
def test_a_neighbour_that_is_dropped_lowers_the_threshold(near: float, kept: bool) -> None:
    views, colours, _ = cells(100, count=2)
    qualities = np.where(views >= 0, 20_000, 0).astype(np.uint16)
    seen = np.full((2, MAX_VIEWS), -1, np.int16)
    seen[:, 0] = 0
    far = np.zeros((2, MAX_VIEWS), np.float32)
    far[:, 0] = 1.5, near
    around = np.full((2, 27), -1, np.int32)
    around[:, 13] = 0, 1
    around[0, 22], around[1, 4] = 1, 0
    order, starts = np.arange(2 * FACES, dtype=np.int32), np.array([0, FACES, 2 * FACES])
    dropped = drop(views, qualities, colours, order, starts, around, seen, far, 0, 2)
    assert dropped == FACES * (1 if kept else 2)
    assert (views[:FACES, 0] == -1).all()
    assert ((views[FACES:, 0] == 0) == kept).all()
    if kept:
        assert (qualities[FACES:, 0] == 20_000 - int(QUALITY_STEPS * np.float32(0.6) ** 2)).all()
