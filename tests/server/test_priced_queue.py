"""Whose turn is next; with a loop: test_client_turns."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from terraport_server.stream.priced_queue import Account, PricedQueue


def test_who_has_used_least_goes_first_and_then_who_asked_first() -> None:
    queue, one, other, new = PricedQueue[str](), Account(), Account(), Account()
    queue.skip(one)
    one.pay(10)
    for account, item in ((one, "one"), (other, "other"), (new, "new")):
        queue.add(account, item)
    assert [queue.take()[1] for _ in range(3)] == ["other", "new", "one"]


def test_idle_time_earns_nothing() -> None:
    queue, busy, idle = PricedQueue[str](), Account(), Account()
    for _ in range(100):
        queue.add(busy, "busy")
        queue.take()[0].pay(1)
    for _ in range(3):
        queue.add(idle, "idle")
        queue.take()[0].pay(1)
    assert idle.finish > busy.finish


def test_who_asked_for_little_has_some_turns_at_once_and_no_more() -> None:
    queue, busy, idle = PricedQueue[str](lead=3.0), Account(), Account()
    for _ in range(100):
        queue.add(busy, "busy")
        queue.take()[0].pay(1)
    order = []
    queue.add(idle, "idle")
    queue.add(busy, "busy")
    for _ in range(12):
        account, item = queue.take()
        order.append(item)
        account.pay(1)
        queue.add(account, item)
    assert order[:3] == ["idle"] * 3
    assert order.count("idle") <= 3 + 5, "then they take turns"


@given(costs=st.lists(st.integers(1, 50), min_size=1, max_size=40))
def test_who_waits_with_several_gets_no_more_by_it(costs: list[int]) -> None:
    """Beside one that asks for one at a time, and always again."""
    queue, many, single = PricedQueue[int](), Account(), Account()
    for cost in costs:
        queue.add(many, cost)
    queue.add(single, 1)
    while queue:
        account, cost = queue.take()
        account.pay(cost)
        if account is single and single.finish <= sum(costs):
            queue.add(single, 1)
    assert many.finish == sum(costs)
    assert single.finish >= many.finish - 50
