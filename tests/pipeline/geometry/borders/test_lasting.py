"""Which nodes of a tree are regions: those that last, by area; small trees with the answer."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from terraport_pipeline.geometry.borders.consensus import AgreedTree
from terraport_pipeline.geometry.borders.lasting import lasting_regions


def tree(areas, merges, small=()):
    """Leaves of these areas; merges of (one, other, level); nodes that are no regions."""
    children = np.array([merge[:2] for merge in merges], np.int32).reshape(-1, 2)
    area = list(areas)
    for one, other, _ in merges:
        area.append(area[one] + area[other])
    is_region = np.ones(len(area), np.bool_)
    is_region[list(small)] = False
    level = np.array([merge[2] for merge in merges], np.float64)
    return AgreedTree(children, level, np.array(area, np.float64), is_region)


def regions(*arguments, **options):
    return sorted(lasting_regions(tree(*arguments, **options)).tolist())


@pytest.mark.parametrize(("level", "expected"), [(0.5, [2]), (1.4, [0, 1])])
def test_what_unites_early_is_one_and_late_two(level, expected):
    assert regions([100, 100], [(0, 1, level)]) == expected


def test_two_that_last_longer_apart_than_together_stay_two():
    # Apart from .55 to 1.0, together from there to 1.2.
    assert regions([100, 100], [(0, 1, 1.0)]) == [0, 1]
    assert regions([100, 100], [(0, 1, 0.8)]) == [2]


def test_the_level_is_each_regions_own():
    """On the left patches that unite at .8 and stand long; on the right .8 is the border."""
    merges = [(0, 1, 0.8), (2, 3, 0.8), (6, 4, 0.85), (5, 7, 1.5)]
    assert regions([50, 50, 60, 60, 60], merges) == [5, 7]
    merges = [(0, 1, 0.6), (2, 3, 0.95), (6, 4, 1.0), (5, 7, 1.5)]
    assert regions([50, 50, 60, 60, 60], merges) == [2, 3, 4, 5]


def test_area_decides():
    """Alone the first lasts .01 longer than all together; the others last .02 shorter."""
    merges = [(1, 2, 0.85), (3, 0, 0.88)]
    assert regions([1000, 100, 100], merges) == [0, 1, 2]  # 330 + 60 against 384
    assert regions([100, 100, 100], merges) == [4]  # 33 + 60 against 96


def test_what_is_too_small_is_part_of_what_it_is_united_with():
    assert regions([100, 2], [(0, 1, 1.1)], small=[1]) == [2]


def test_what_is_small_and_joined_what_was_cut_is_left_to_join_a_neighbour():
    merges = [(0, 1, 1.1), (3, 2, 1.15)]
    assert regions([100, 100, 2], merges, small=[2]) == [0, 1, 2]


def test_pieces_that_touch_nothing_are_regions_of_their_own():
    assert regions([100, 100, 3], [(0, 1, 0.6)], small=[2]) == [2, 3]


def test_every_leaf_is_in_one_region():
    rng = np.random.default_rng(8)
    count = 200
    open_, merges, level = list(range(count)), [], 0.3
    while len(open_) > 3:
        level += 0.008
        one, other = (open_.pop(int(rng.integers(len(open_)))) for _ in range(2))
        open_.append(count + len(merges))
        merges.append((one, other, level))
    whole = tree(rng.uniform(1, 50, count), merges)
    is_region = whole.area_m2 > 20
    made = AgreedTree(whole.children, whole.level, whole.area_m2, is_region)
    seen = np.zeros(count, np.int64)
    for node in lasting_regions(made).tolist():
        stack = [node]
        while stack:
            top = stack.pop()
            if top < count:
                seen[top] += 1
            else:
                stack += made.children[top - count].tolist()
    assert_array_equal(seen, 1)
