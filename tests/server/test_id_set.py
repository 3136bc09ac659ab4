"""A set of ids against Python's own, and what it costs."""

from __future__ import annotations

import sys

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_server.id_set import IdSet

some_ids = st.lists(st.sampled_from([0, 1, 2, 3, 5, 8, 13, 4000, 2**32 - 1]), max_size=8)
changes = st.lists(
    st.tuples(st.sampled_from(["add", "discard", "update", "difference_update"]), some_ids),
    max_size=12,
)


@settings(max_examples=300)
@given(first=some_ids, script=changes, asked=some_ids)
def test_any_history_is_that_of_a_set(
    first: list[int], script: list[tuple[str, list[int]]], asked: list[int]
) -> None:
    ours, model = IdSet(first), set(first)
    for name, ids in script:
        if name in {"add", "discard"}:
            for one in ids:
                getattr(ours, name)(one)
                getattr(model, name)(one)
        else:
            getattr(ours, name)(np.array(ids, dtype=np.uint32))
            getattr(model, name)(ids)
        assert len(ours) == len(model)
    assert [one in ours for one in asked] == [one in model for one in asked]
    assert ours.contains(np.array(asked, dtype=np.int64)).tolist() == [s in model for s in asked]
    assert ours.array().tolist() == sorted(model)


def test_single_ids_do_not_pile_up_as_python_objects() -> None:
    held = IdSet()
    for segment in range(50_000):
        held.add(segment)
    assert len(held) == 50_000
    assert sys.getsizeof(held._added) < 100_000
    assert held.array().nbytes == 200_000


def test_an_empty_set_costs_next_to_nothing() -> None:
    held = IdSet()
    assert sys.getsizeof(held) + sys.getsizeof(held._added) + sys.getsizeof(held._sorted) < 600
