"""The order of points does not depend on theirs in files, nor does the choice among them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terraport_pipeline.engines.readers import point_order
from terraport_pipeline.engines.readers.point_order import (
    HashThinning,
    curve_keys,
    order_rows,
    point_hashes,
    thinning_rows,
)

rng = np.random.default_rng(8)


def test_the_curve_visits_each_octant_whole() -> None:
    points = rng.random((4096, 3))
    keys = curve_keys(points, np.zeros(3), np.ones(3))
    octant = (points > 0.5) @ [1, 2, 4]
    assert np.flatnonzero(np.diff(octant[np.argsort(keys)])).size == 7


def test_keys_of_what_lies_outside_the_box_are_on_its_side() -> None:
    box = np.zeros(3), np.array([1.0, 1.0, 0.5])
    keys = curve_keys(np.array([[-5.0, -5, -5], [0, 0, 0], [9, 9, 9], [1, 1, 1]]), *box)
    assert keys[0] == keys[1]
    assert keys[2] == keys[3] == (1 << 63) - 1


def test_a_box_without_extent_has_one_key() -> None:
    keys = curve_keys(np.full((3, 3), 7.0), np.full(3, 7.0), np.full(3, 7.0))
    assert keys.tolist() == [0, 0, 0]


def test_any_order_becomes_the_same_and_repeats_are_those_of_later_files() -> None:
    points = rng.integers(0, 3, (400, 3)).astype(float)
    grade = np.where(rng.random(400) < 0.2, np.nan, rng.integers(0, 2, 400))
    outcomes = []
    for _ in range(3):
        mix = rng.permutation(400)
        columns = [*points[mix].T, grade[mix]]
        file = rng.integers(0, 4, 400)
        keys = curve_keys(points[mix], np.zeros(3), np.full(3, 2.0))
        order, repeats = order_rows(keys, columns, file)
        kept = np.stack([column[order[~repeats]] for column in columns], axis=1)
        outcomes.append(kept)
        # The first of equal points stays: of the first file that has it.
        for row, again in zip(order[1:], repeats[1:], strict=True):
            if again:
                before = order[np.flatnonzero(order == row)[0] - 1]
                assert file[before] <= file[row]
    np.testing.assert_array_equal(outcomes[0], outcomes[1])
    np.testing.assert_array_equal(outcomes[0], outcomes[2])
    whole = np.column_stack([points, np.nan_to_num(grade, nan=-1)])
    assert len(outcomes[0]) == len(np.unique(whole, axis=0))


def test_minus_zero_is_zero() -> None:
    columns = [np.array([0.0, -0.0])]
    _, repeats = order_rows(np.zeros(2, np.uint64), columns, np.zeros(2, np.uint16))
    assert repeats.tolist() == [False, True]
    assert len(set(point_hashes(np.array([[0.0, 1, 2], [-0.0, 1, 2]])).tolist())) == 1


def test_hashes_are_spread_over_all_bits() -> None:
    steps = np.stack(np.meshgrid(*[np.arange(32.0)] * 3), axis=-1).reshape(-1, 3) / 1000 + 641_000
    hashes = point_hashes(steps)
    assert len(np.unique(hashes)) == len(steps)
    for shift in (0, 28, 56):
        share = np.bincount((hashes >> np.uint64(shift)).astype(np.int64) & 255, minlength=256)
        assert share.max() < 2 * share.mean()


def test_the_choice_depends_on_the_points_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(point_order, "_SKETCH_SIZE", 256)
    points = rng.random((20_000, 3))
    chosen = []
    for copies, pieces in ((1, 1), (3, 7)):
        thinning = HashThinning(1000)
        limits = [thinning.limit]
        for piece in np.array_split(rng.permutation(np.repeat(points, copies, axis=0)), pieces):
            thinning.look(point_hashes(piece))
            limits.append(thinning.limit)
        assert limits == sorted(limits, reverse=True)
        chosen.append(np.flatnonzero(point_hashes(points) <= np.uint64(thinning.limit)))
    np.testing.assert_array_equal(chosen[0], chosen[1])
    assert len(chosen[0]) == pytest.approx(1000, rel=0.25)


def test_few_points_are_all_kept() -> None:
    thinning = HashThinning(10)
    hashes = point_hashes(rng.random((5000, 3)))
    thinning.look(hashes)
    assert (hashes <= np.uint64(thinning.limit)).all()


@given(st.integers(1, 5000), st.integers(1, 5000))
def test_thinning_keeps_exactly_the_bound_once_each_and_spread(count: int, bound: int) -> None:
    rows = thinning_rows(count, bound)
    if count <= bound:
        assert rows is None
        return
    assert rows is not None
    assert len(rows) == bound
    assert (np.diff(rows) > 0).all()
    assert rows[0] >= 0
    assert rows[-1] < count
    # One row in each run: no gap is longer than two runs.
    assert np.diff(rows).max(initial=0) < 2 * (count / bound + 1)


def test_thinning_is_the_same_each_time_and_off_without_a_bound() -> None:
    np.testing.assert_array_equal(thinning_rows(1000, 100), thinning_rows(1000, 100))
    assert thinning_rows(1000, None) is None
