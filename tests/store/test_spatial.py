from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from terraport_payload import box_distances_m
from terraport_store import BruteForceIndex, PackedRTree, RTreeIndex, SpatialIndex

BOXES = np.array(
    [
        [0, 0, 0, 1, 1, 1],
        [2, 0, 0, 3, 1, 1],
        [-5, -5, -5, -4, -4, -4],
        [1, 1, 1, 1, 1, 1],  # a single point
    ],
    dtype=np.float32,
)


@pytest.fixture(params=[BruteForceIndex, RTreeIndex, PackedRTree])
def kind(request: pytest.FixtureRequest) -> type[RTreeIndex]:
    return request.param


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
    kind: type[RTreeIndex], centre: tuple[float, float, float], radius: float, expected: list[int]
) -> None:
    index: SpatialIndex = kind(BOXES)
    found = index.within(centre, radius)
    assert found.tolist() == expected
    assert found.dtype == np.int64


def test_no_segment_at_all(kind: type[RTreeIndex]) -> None:
    assert kind(np.zeros((0, 6), dtype=np.float32)).within((0, 0, 0), 10).tolist() == []


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
def test_senseless_queries(
    kind: type[RTreeIndex], centre: tuple[float, ...], radius: float, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        kind(BOXES).within(centre, radius)


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
def test_rtree_equals_brute_force(
    boxes: np.ndarray, centre: tuple[float, float, float], radius: float
) -> None:
    expected = BruteForceIndex(boxes).within(centre, radius)
    assert RTreeIndex(boxes).within(centre, radius).tolist() == expected.tolist()
    for fanout in (2, 3, 8, 64):
        found = PackedRTree(boxes, fanout, most_roots=fanout).within(centre, radius)
        assert found.tolist() == expected.tolist()


@given(boxes_strategy(wide), st.tuples(wide, wide, wide), st.integers(0, 59))
@example(np.full((1, 6), 6.010004e-22, np.float32), (0.0, 0.0, -1.0), 0)  # point and radius cancel
@example(np.array([[0, 0, 0, 1, 1, 1]], np.float32), (-1e-170, 0.5, 0.5), 0)  # a square underflows
@settings(max_examples=200)
def test_rtree_equals_brute_force_at_the_very_distance(
    boxes: np.ndarray, centre: tuple[float, float, float], which: int
) -> None:
    """The radius is exactly some box's distance: inclusive in both, to the last bit."""
    radius = float(box_distances_m(boxes, centre)[which % len(boxes)])
    tree, packed = RTreeIndex(boxes), PackedRTree(boxes, 3, most_roots=3)
    for exact in (radius, math.nextafter(radius, 0), math.nextafter(radius, math.inf)):
        expected = BruteForceIndex(boxes).within(centre, exact)
        assert tree.within(centre, exact).tolist() == expected.tolist()
        assert packed.within(centre, exact).tolist() == expected.tolist()


def test_many_boxes_and_queries() -> None:
    rng = np.random.default_rng(5)
    low = rng.uniform(-500, 500, (5000, 3)).astype(np.float32)
    boxes = np.hstack([low, low + rng.uniform(0, 20, (5000, 3)).astype(np.float32)])
    tree, packed, model = RTreeIndex(boxes), PackedRTree(boxes), BruteForceIndex(boxes)
    for _ in range(50):
        centre, radius = rng.uniform(-600, 600, 3), float(rng.uniform(0, 200))
        expected = model.within(centre, radius)
        assert np.array_equal(tree.within(centre, radius), expected)
        assert np.array_equal(packed.within(centre, radius), expected)
