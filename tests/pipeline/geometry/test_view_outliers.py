from __future__ import annotations

import numpy as np
from photo_scene import ground

from terraport_pipeline.geometry.view_candidates import SLOTS, Candidates
from terraport_pipeline.geometry.view_outliers import drop_outliers


def seen(*levels: int, own: int | None = 100):
    """A sheet in so many views, each of one grey level."""
    vertices, faces = ground(12)
    views = np.full((len(faces), SLOTS), -1, np.int16)
    colour = np.zeros((len(faces), SLOTS, 3), np.uint8)
    for number, level in enumerate(levels):
        views[:, number] = number
        colour[:, number] = level
    quality = np.where(views >= 0, 20_000, 0).astype(np.uint16)
    candidates = Candidates(views, quality, colour)
    grey = None if own is None else np.full((len(faces), 3), own, np.uint8)
    dropped = drop_outliers(candidates, vertices, faces, grey)
    return [view for view in candidates.view[0].tolist() if view >= 0], dropped // len(faces)


def test_the_one_that_differs_goes() -> None:
    assert seen(100, 103, 180, 98) == ([0, 1, 3], 1)
    assert seen(100, 103, 180, 98, own=None) == ([0, 1, 3], 1)


def test_between_two_views_the_cloud_decides() -> None:
    assert seen(30, 104, own=100) == ([1], 1)
    assert seen(30, 104, own=33) == ([0], 1)


def test_nobody_decides_between_two_views_without_a_cloud() -> None:
    assert seen(90, 100, own=None) == ([0, 1], 0)
    assert seen(30, 104, own=None) == ([0, 1], 0)


def test_many_that_agree_outvote_the_cloud() -> None:
    assert seen(100, 101, 102, own=200) == ([0, 1, 2], 0)


def test_views_that_agree_with_nobody_lose_to_the_cloud() -> None:
    assert seen(20, 160, 220, own=90) == ([], 3)


def test_a_single_view_needs_a_large_difference() -> None:
    assert seen(145, own=100) == ([0], 0)
    assert seen(170, own=100) == ([], 1)
    assert seen(170, own=None) == ([0], 0)


def test_what_stays_counts_less_the_more_it_differs() -> None:
    vertices, faces = ground(12)
    views = np.full((len(faces), SLOTS), -1, np.int16)
    views[:, :3] = 0, 1, 2
    colour = np.zeros((len(faces), SLOTS, 3), np.uint8)
    colour[:, 0], colour[:, 1], colour[:, 2] = 100, 100, 115
    quality = np.where(views >= 0, 20_000, 0).astype(np.uint16)
    candidates = Candidates(views, quality, colour)
    assert drop_outliers(candidates, vertices, faces, None) == 0
    assert (candidates.quality[:, 2] < candidates.quality[:, 0] - 1000).all()


def test_nothing() -> None:
    vertices, _ = ground(2)
    none = Candidates(
        np.zeros((0, SLOTS), np.int16),
        np.zeros((0, SLOTS), np.uint16),
        np.zeros((0, SLOTS, 3), np.uint8),
    )
    assert drop_outliers(none, vertices, np.zeros((0, 3), np.int32), None) == 0
