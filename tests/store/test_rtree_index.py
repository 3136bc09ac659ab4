"""rtree in the service's main path: from any thread, and which tree a scene gets."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from terraport_payload import box_distances_m
from terraport_payload.types import Float64, Int64
from terraport_store import BruteForceIndex, PackedRTree, RTreeIndex, spatial_index_of
from terraport_store.rtree_index import MOST_RTREE_SEGMENTS


def boxes(count: int, edge_m: float = 500.0) -> np.ndarray:
    rng = np.random.default_rng(count)
    low = rng.uniform(-edge_m, edge_m, (count, 3)).astype(np.float32)
    return np.hstack([low, low + rng.uniform(0, 20, (count, 3)).astype(np.float32)])


@pytest.mark.parametrize(
    ("count", "kind"),
    [(0, RTreeIndex), (100_000, RTreeIndex), (100_001, PackedRTree)],
)
def test_scenes_up_to_a_hundred_thousand_segments_are_searched_by_rtree(
    count: int, kind: type[object]
) -> None:
    assert MOST_RTREE_SEGMENTS == 100_000
    assert type(spatial_index_of(boxes(count))) is kind


def test_both_trees_agree_on_either_side_of_the_bound() -> None:
    bounds = boxes(MOST_RTREE_SEGMENTS + 1)
    trees = [spatial_index_of(bounds), spatial_index_of(bounds[:-1])]
    for radius_m in (0.0, 5.0, 300.0, 2000.0):
        whole, less = (tree.within((10.0, 0.0, -40.0), radius_m) for tree in trees)
        assert np.array_equal(whole[whole < MOST_RTREE_SEGMENTS], less)


def test_threads_get_their_own_answers() -> None:
    """libspatialindex alone gives wrong answers, or crashes, when two threads ask it."""
    bounds = boxes(5000)
    tree, model = RTreeIndex(bounds), BruteForceIndex(bounds)
    rng = np.random.default_rng(3)
    asked = [(rng.uniform(-600, 600, 3), float(rng.choice([20, 200, 900]))) for _ in range(60)]
    expected = [model.within(centre, radius_m) for centre, radius_m in asked]
    with ThreadPoolExecutor(6) as pool:
        answers = list(pool.map(lambda query: tree.within(*query), asked * 5))
    for number, answer in enumerate(answers):
        assert np.array_equal(answer, expected[number % len(asked)])


def test_an_answer_stays_when_another_is_asked_for() -> None:
    tree = RTreeIndex(boxes(2000))
    for radius_m in (50.0, 5000.0):
        first = tree.within((0.0, 0.0, 0.0), radius_m)
        before = first.copy()
        tree.within((400.0, 0.0, 400.0), 5000.0)
        assert np.array_equal(first, before)


@pytest.mark.parametrize("height_m", [0.0, 2.0])
@pytest.mark.parametrize(("radius_m", "by_tree"), [(10.0, True), (60.0, False), (500.0, False)])
def test_who_asks_for_much_of_a_scene_has_every_box_measured(
    monkeypatch: pytest.MonkeyPatch, height_m: float, radius_m: float, by_tree: bool
) -> None:
    """The tree took 10 ms for 71,000 of 90,000, where all are measured in 2.7."""
    x, z = (axis.ravel() for axis in np.meshgrid(np.arange(0.0, 200, 10), np.arange(0.0, 200, 10)))
    flat = np.zeros(len(x))
    bounds = np.stack([x, flat, z, x + 10, flat + height_m, z + 10], axis=1).astype(np.float32)
    asked = []
    in_cube = RTreeIndex._in_cube

    def note(tree: RTreeIndex, low: Float64, high: Float64) -> Int64:
        asked.append(low)
        return in_cube(tree, low, high)

    monkeypatch.setattr(RTreeIndex, "_in_cube", note)
    ids = RTreeIndex(bounds).within((100.0, 1.0, 90.0), radius_m)
    expected = np.flatnonzero(box_distances_m(bounds, (100.0, 1.0, 90.0)) <= radius_m)
    assert ids.tolist() == expected.tolist()
    assert bool(asked) == by_tree
