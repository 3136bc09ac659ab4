from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from terraport_payload import box_distances_m
from terraport_store import PackedRTree

BOXES = np.array(
    [
        [0, 0, 0, 1, 1, 1],
        [2, 0, 0, 3, 1, 1],
        [-5, -5, -5, -4, -4, -4],
        [1, 1, 1, 1, 1, 1],  # a single point
    ],
    dtype=np.float32,
)


def measured(boxes: np.ndarray, centre: Any, radius_m: float) -> np.ndarray:
    """What the tree must answer: every box measured."""
    return np.flatnonzero(box_distances_m(boxes, centre) <= radius_m)


@pytest.mark.parametrize(
    ("centre", "radius", "expected"),
    [
        ((0.5, 0.5, 0.5), 0.0, [0]),
        ((1.0, 1.0, 1.0), 0.0, [0, 3]),  # touching counts
        ((1.5, 0.5, 0.5), 0.5, [0, 1]),  # at exactly the radius
        ((1.5, 0.5, 0.5), math.nextafter(0.5, 0), []),
        ((-1.0, -1.0, -1.0), math.sqrt(27), [0, 1, 2, 3]),
        ((-1.0, -1.0, -1.0), math.nextafter(math.sqrt(27), 0), [0, 1, 3]),
        ((0, 0, 0), 100, [0, 1, 2, 3]),
        ((50, 50, 50), 1, []),
    ],
)
def test_answers_written_out(
    centre: tuple[float, float, float], radius: float, expected: list[int]
) -> None:
    segments = PackedRTree(BOXES).within(centre, radius)
    assert segments.tolist() == expected
    assert segments.dtype == np.int64


def test_no_segment_at_all() -> None:
    assert PackedRTree(np.zeros((0, 6), dtype=np.float32)).within((0, 0, 0), 10).tolist() == []


@pytest.mark.parametrize(
    ("centre", "radius", "message"),
    [
        ((0, 0, 0), -1, "radius_m is -1, expected a finite number >= 0"),
        ((0, 0, 0), math.nan, "radius_m is nan"),
        ((0, 0, 0), math.inf, "radius_m is inf"),
        ((0, math.nan, 0), 1, "expected three finite numbers"),
        ((0, 0), 1, "expected three finite numbers"),
    ],
)
def test_senseless_queries(centre: tuple[float, ...], radius: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PackedRTree(BOXES).within(centre, radius)


def boxes_strategy(elements: st.SearchStrategy[float]) -> st.SearchStrategy[np.ndarray]:
    corner = hnp.arrays(np.float32, st.tuples(st.integers(1, 60), st.just(6)), elements=elements)
    return corner.map(
        lambda c: np.hstack([np.minimum(c[:, :3], c[:, 3:]), np.maximum(c[:, :3], c[:, 3:])])
    )


whole = st.integers(-8, 8).map(float)  # many exact ties
wide = st.floats(-3000, 3000, width=32)


@given(
    boxes_strategy(whole) | boxes_strategy(wide),
    st.tuples(whole | wide, whole | wide, whole | wide),
    st.floats(0, 5000) | st.integers(0, 12).map(float),
)
@settings(max_examples=300)
def test_equals_every_box_measured(
    boxes: np.ndarray, centre: tuple[float, float, float], radius: float
) -> None:
    expected = measured(boxes, centre, radius)
    for fanout in (2, 3, 8, 64):
        segments = PackedRTree(boxes, fanout, most_roots=fanout).within(centre, radius)
        assert segments.tolist() == expected.tolist()


@given(boxes_strategy(wide), st.tuples(wide, wide, wide), st.integers(0, 59))
@example(np.full((1, 6), 6.010004e-22, np.float32), (0.0, 0.0, -1.0), 0)  # point and radius cancel
@example(np.array([[0, 0, 0, 1, 1, 1]], np.float32), (-1e-170, 0.5, 0.5), 0)  # a square underflows
@settings(max_examples=200)
def test_equals_every_box_measured_at_the_very_distance(
    boxes: np.ndarray, centre: tuple[float, float, float], which: int
) -> None:
    """The radius is exactly some box's distance: inclusive in both, to the last bit."""
    radius = float(box_distances_m(boxes, centre)[which % len(boxes)])
    tree = PackedRTree(boxes, 3, most_roots=3)
    for exact in (radius, math.nextafter(radius, 0), math.nextafter(radius, math.inf)):
        assert tree.within(centre, exact).tolist() == measured(boxes, centre, exact).tolist()


def test_many_boxes_and_queries() -> None:
    rng = np.random.default_rng(5)
    low = rng.uniform(-500, 500, (5000, 3)).astype(np.float32)
    boxes = np.hstack([low, low + rng.uniform(0, 20, (5000, 3)).astype(np.float32)])
    tree = PackedRTree(boxes)
    for _ in range(50):
        centre, radius = rng.uniform(-600, 600, 3), float(rng.uniform(0, 200))
        assert np.array_equal(tree.within(centre, radius), measured(boxes, centre, radius))
