"""Cuts of the merge tree: by hand on a small tree, and as properties of random ones."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terraport_pipeline.geometry.graph.merge_tree import MergeTree, merge_tree


def small_tree() -> MergeTree:
    """Faces 0..4; 5 = 0+1 at 1, 6 = 3+4 at 4, 7 = 5+2 at 0.5 (an inversion), 8 = 7+6 at 3."""
    children = np.array([[0, 1], [3, 4], [5, 2], [7, 6]], np.int32)
    return merge_tree(5, children, np.array([1.0, 4.0, 0.5, 3.0]), np.arange(1, 6))


def random_tree(seed: int) -> MergeTree:
    """Random merges of random forests with many equal costs."""
    rng = np.random.default_rng(seed)
    leaves = int(rng.integers(1, 40))
    merges = int(rng.integers(0, leaves))
    free, children = list(range(leaves)), []
    for m in range(merges):
        a, b = (free.pop(int(rng.integers(len(free)))) for _ in range(2))
        children.append((min(a, b), max(a, b)))
        free.append(leaves + m)
    cost = rng.integers(-5, 5, merges).astype(np.float64)
    area = rng.integers(1, 9, leaves)
    return merge_tree(leaves, np.array(children, np.int32).reshape(-1, 2), cost, area)


TREES = st.integers(0, 10_000).map(random_tree)


def finer(fine: np.ndarray, coarse: np.ndarray) -> bool:
    """Whether every part of the first lies within one of the second."""
    return len(set(zip(fine.tolist(), coarse.tolist(), strict=True))) == len(set(fine.tolist()))


def test_what_a_tree_knows_of_its_nodes():
    tree = small_tree()
    assert tree.parents.tolist() == [5, 5, 7, 6, 6, 7, 8, 8, -1]
    assert tree.faces.tolist() == [1, 1, 1, 1, 1, 2, 2, 3, 5]
    assert tree.area.tolist() == [1, 2, 3, 4, 5, 3, 9, 6, 15]
    assert tree.height.tolist() == [1.0, 4.0, 1.0, 4.0], "never below a child's"
    assert tree.root_count == 1


@pytest.mark.parametrize(
    ("most", "labels"),
    [
        (0.9, [0, 1, 2, 3, 4]),  # merge 7 cost 0.5, but what is under it cost 1
        (1.0, [0, 0, 0, 1, 2]),
        (3.9, [0, 0, 0, 1, 2]),
        (4.0, [0, 0, 0, 0, 0]),
    ],
)
def test_cut_by_cost(most, labels):
    assert small_tree().cut_by_cost(most)[0].tolist() == labels


@pytest.mark.parametrize(
    ("count", "labels"),
    [
        (1, [0, 0, 0, 0, 0]),
        (2, [0, 0, 0, 1, 1]),
        (3, [0, 0, 0, 1, 2]),
        (4, [0, 0, 1, 2, 3]),
        (5, [0, 1, 2, 3, 4]),
        (9, [0, 1, 2, 3, 4]),
    ],
)
def test_cut_by_count(count, labels):
    assert small_tree().cut_by_count(count)[0].tolist() == labels


def test_cut_by_size():
    tree = small_tree()
    assert tree.cut_by_size(2)[0].tolist() == [0, 0, 1, 2, 2]
    assert tree.cut_by_size(2, most=1.0)[0].tolist() == [0, 0, 1, 2, 3]


@given(TREES, st.floats(-6, 6), st.floats(-6, 6))
def test_cuts_by_cost_are_nested(tree, first, second):
    low, high = sorted((first, second))
    assert finer(tree.cut_by_cost(low)[0], tree.cut_by_cost(high)[0])


@given(TREES)
def test_cuts_by_count_are_nested_and_have_that_many(tree):
    before = None
    for count in range(tree.leaf_count, 0, -1):
        labels, region_count = tree.cut_by_count(count)
        assert region_count == len(set(labels.tolist())) == max(count, tree.root_count)
        if before is not None:
            assert finer(before, labels)
        before = labels


@given(TREES, st.integers(1, 12), st.floats(-6, 6))
def test_cuts_by_size_keep_both_bounds(tree, size, most):
    labels, _ = tree.cut_by_size(size, most)
    assert np.bincount(labels).max() <= size
    assert finer(labels, tree.cut_by_cost(most)[0])


@given(TREES)
def test_heights_never_fall_from_child_to_parent(tree):
    for merge, pair in enumerate(tree.children.tolist()):
        for child in pair:
            if child >= tree.leaf_count:
                assert tree.height[child - tree.leaf_count] <= tree.height[merge]


@given(TREES, st.floats(-6, 6))
def test_labels_are_numbered_by_first_face(tree, most):
    labels, count = tree.cut_by_cost(most)
    first = np.unique(labels, return_index=True)[1]
    assert labels[np.sort(first)].tolist() == list(range(count))


def test_wrong_arguments_are_refused():
    with pytest.raises(ValueError, match="count is 0, expected 1 or more"):
        small_tree().cut_by_count(0)
    with pytest.raises(ValueError, match="received 3 choices, expected one per merge"):
        small_tree().cut(np.ones(3, np.bool_))


def test_no_faces():
    tree = merge_tree(0, np.zeros((0, 2), np.int32), np.zeros(0), np.zeros(0, np.int64))
    assert tree.cut_by_cost(0.0)[1] == tree.cut_by_count(1)[1] == 0
