"""A set of ids against Python's own, and what it costs."""

from __future__ import annotations

import sys

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_server.session.id_set import IdSet

some_ids = st.lists(st.sampled_from([0, 1, 2, 3, 5, 8, 13, 4000, 2**32 - 1]), max_size=8)
changes = st.lists(
    st.tuples(st.sampled_from(["add", "discard", "update", "difference_update"]), some_ids),
    max_size=12,
)


@settings(max_examples=300)
@given(first=some_ids, script=changes, queried=some_ids)
def test_any_history_is_that_of_a_set(
    first: list[int], script: list[tuple[str, list[int]]], queried: list[int]
) -> None:
    ours, model = IdSet(first), set(first)
    for name, ids in script:
        if name in {"add", "discard"}:
            for segment in ids:
                getattr(ours, name)(segment)
                getattr(model, name)(segment)
        else:
            getattr(ours, name)(np.array(ids, dtype=np.uint32))
            getattr(model, name)(ids)
        assert len(ours) == len(model)
    assert [segment in ours for segment in queried] == [segment in model for segment in queried]
    assert ours.contains(np.array(queried, dtype=np.int64)).tolist() == [
        s in model for s in queried
    ]
    assert ours.array().tolist() == sorted(model)


def test_single_ids_do_not_pile_up_as_python_objects() -> None:
    id_set = IdSet()
    for segment in range(50_000):
        id_set.add(segment)
    assert len(id_set) == 50_000
    assert sys.getsizeof(id_set._added) < 100_000
    assert id_set.array().nbytes == 200_000


def test_an_empty_set_costs_next_to_nothing() -> None:
    id_set = IdSet()
    assert (
        sys.getsizeof(id_set) + sys.getsizeof(id_set._added) + sys.getsizeof(id_set._sorted) < 600
    )
