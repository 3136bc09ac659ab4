"""Whose turn it is."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from terraport_server.fair_queue import FairQueue


@given(st.lists(st.sampled_from("abc")))
def test_nobody_waits_for_two_of_another(keys: list[str]) -> None:
    queue = FairQueue[tuple[str, int]]()
    for number, key in enumerate(keys):
        queue.add(key, (key, number))
    taken = [queue.take() for _ in range(len(queue))]
    assert sorted(number for _, number in taken) == list(range(len(keys)))
    for key in set(keys):
        assert [n for k, n in taken if k == key] == [n for n, k in enumerate(keys) if k == key]
    while taken:  # round after round: each key that is left once
        left = {key for key, _ in taken}
        round_, taken = taken[: len(left)], taken[len(left) :]
        assert {key for key, _ in round_} == left


def test_an_empty_queue() -> None:
    queue = FairQueue[int]()
    assert len(queue) == 0
    with pytest.raises(IndexError, match="empty"):
        queue.take()
