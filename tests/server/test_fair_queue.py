"""Whose turn it is."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from terraport_server.stream.fair_queue import EARNED, FairQueue


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


def test_who_was_away_goes_next_a_few_times() -> None:
    """Ten keys always have another; one comes after some rounds, and waits only at its fifth."""
    queue, others = FairQueue[str](), "0123456789"
    for key in others:
        queue.add(key, key)

    def take() -> str:
        key = queue.take()
        if key in others:
            queue.add(key, key)
        return key

    for _ in range(10 * EARNED + 5):
        take()
    waits = []
    for _ in range(EARNED + 1):
        queue.add("away", "away")
        waits.append(0)
        while take() != "away":
            waits[-1] += 1
    assert waits[:EARNED] == [0] * EARNED
    assert waits[EARNED] > 0


def test_keys_that_are_away_are_forgotten() -> None:
    queue = FairQueue[int]()
    for number in range(10_000):
        queue.add(f"key {number}", number)
        queue.take()
        queue.add("often", number)
        queue.take()
    assert len(queue._rounds) < 3000
