from __future__ import annotations

import numpy as np
from photo_scene import ground

from terraport_pipeline.geometry.photos.view_candidates import SLOTS, Candidates
from terraport_pipeline.geometry.photos.view_outliers import drop_outliers


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


def leaves(size: int, *, deep: int, seed: int = 0) -> np.ndarray:
    """Grey levels about 100: of so many faces every other one is leaf or gap."""
    return (100 + deep * np.where(np.random.default_rng(seed).random(size) < 0.5, 1, -1)).astype(
        np.uint8
    )


def two_views(second: np.ndarray, first: int = 100, own: int = 100):
    """A sheet in two views, the second with a level for each face: faces that keep it."""
    vertices, faces = ground(24)
    views = np.full((len(faces), SLOTS), -1, np.int16)
    views[:, 0], views[:, 1] = 0, 1
    colour = np.zeros((len(faces), SLOTS, 3), np.uint8)
    colour[:, 0] = first
    colour[:, 1] = second[:, None]
    candidates = Candidates(views, np.where(views >= 0, 20_000, 0).astype(np.uint16), colour)
    drop_outliers(candidates, vertices, faces, np.full((len(faces), 3), own, np.uint8))
    assert (candidates.view[:, 0] == 0).all()
    return (candidates.view == 1).any(axis=1), vertices[faces].mean(axis=1)


def test_leaves_have_the_mean_of_grass_but_not_its_grain() -> None:
    faces = len(ground(24)[1])
    assert not two_views(leaves(faces, deep=40))[0].any()
    assert two_views(leaves(faces, deep=5))[0].all()


def test_what_is_rough_in_all_views_is_rough() -> None:
    vertices, faces = ground(24)
    views = np.full((len(faces), SLOTS), -1, np.int16)
    views[:, 0], views[:, 1] = 0, 1
    colour = np.zeros((len(faces), SLOTS, 3), np.uint8)
    colour[:, 0] = leaves(len(faces), deep=40)[:, None]
    colour[:, 1] = leaves(len(faces), deep=40, seed=1)[:, None]
    candidates = Candidates(views, np.full_like(views, 20_000).astype(np.uint16), colour)
    own = np.full((len(faces), 3), 100, np.uint8)
    assert drop_outliers(candidates, vertices, faces, own) < 0.02 * 2 * len(faces)


def test_the_rim_of_what_is_dropped_goes_too() -> None:
    vertices, faces = ground(24)
    across = vertices[faces].mean(axis=1)[:, 0]
    inside = across < 20.0
    # half of it far from the rest, and a strip beside it only somewhat
    kept, places = two_views(np.where(inside, 180, np.where(across < 24.0, 116, 100)))
    assert not kept[places[:, 0] < 20.0].any()
    assert not kept[(places[:, 0] > 20.5) & (places[:, 0] < 23.0)].any()
    assert kept[places[:, 0] > 36.0].all()
    # by itself the strip stays
    kept, places = two_views(np.where((across > 20.0) & (across < 24.0), 116, 100))
    assert kept.all()


def test_threads_change_nothing() -> None:
    vertices, faces = ground(40)
    rng = np.random.default_rng(3)
    views = np.full((len(faces), SLOTS), -1, np.int16)
    views[:, :4] = np.arange(4)
    colour = rng.integers(60, 160, (len(faces), SLOTS, 3)).astype(np.uint8)
    colour[: len(faces) // 3, 1] = 220
    results = []
    for threads in (1, 2):
        candidates_copy = Candidates(
            views.copy(), np.where(views >= 0, 20_000, 0).astype(np.uint16), colour.copy()
        )
        drop_outliers(candidates_copy, vertices, faces, None, threads=threads)
        results.append(candidates_copy)
    np.testing.assert_array_equal(results[0].view, results[1].view)
    np.testing.assert_array_equal(results[0].quality, results[1].quality)


def test_nothing() -> None:
    vertices, _ = ground(2)
    none = Candidates(
        np.zeros((0, SLOTS), np.int16),
        np.zeros((0, SLOTS), np.uint16),
        np.zeros((0, SLOTS, 3), np.uint8),
    )
    assert drop_outliers(none, vertices, np.zeros((0, 3), np.int32), None) == 0
