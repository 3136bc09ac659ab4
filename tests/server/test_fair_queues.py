"""Fairness between clients: plans and picks by CPU time, payload by turns, sessions by address."""

from __future__ import annotations

import asyncio
import threading
import time
from collections import Counter
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from terraport_server.fair_queue import Account, FairQueue, PickQueue, PlanQueue
from terraport_server.stream.limits import RESERVED_SHARE, SessionCounts
from terraport_server.stream.scheduler import STEP_BYTES, TURN_BYTES, Rank, SendScheduler


def busy(seconds: float) -> Callable[[], None]:
    """Return a job that takes so much CPU time."""

    def work() -> None:
        until_s = time.thread_time() + seconds
        while time.thread_time() < until_s:
            pass

    return work


@given(st.lists(st.integers(1, 50), min_size=2, max_size=6))
def test_clients_that_always_ask_get_equal_cpu_time(costs_ms: list[int]) -> None:
    """Whatever their jobs cost, usage differs by two jobs at most."""
    queue = FairQueue[int]()
    used_ms: Counter[int] = Counter()
    for number in range(len(costs_ms)):
        queue.add(str(number), number)
    for _ in range(400):
        account, number = queue.take()
        account.charge(costs_ms[number] / 1000.0, now_s=0.0)
        used_ms[number] += costs_ms[number]
        queue.add(str(number), number)
    used = [used_ms[number] for number in range(len(costs_ms))]
    assert max(used) - min(used) <= 2 * max(costs_ms)


def test_newcomers_do_not_overtake_a_client_that_has_used_little_for_long() -> None:
    queue = FairQueue[str]()
    for number in range(2000):  # one that works for long, one that asks now and then
        queue.add("wide", "w")
        if number % 50 == 0:
            queue.add("narrow", "n")
        for _ in range(len(queue)):
            account, job = queue.take()
            account.charge(0.005 if job == "w" else 0.001, now_s=0.0)
    for number in range(10):
        queue.add(f"new {number}", f"new {number}")
        queue.add(f"new {number}", "again")
    queue.add("narrow", "n")
    order = []
    while queue:
        account, job = queue.take()
        account.charge(0.005, now_s=0.0)
        order.append(job)
    assert order.index("n") <= 10


def test_a_client_that_reconnects_continues_with_its_usage() -> None:
    queue = FairQueue[str]()
    queue.account("192.0.2.1 anna").charge(1.0, now_s=5.0)
    queue.add("192.0.2.1 anna", "anna")
    queue.add("192.0.2.1 ben", "ben")
    assert queue.take()[1] == "ben"


def test_what_is_used_slowly_is_free() -> None:
    account = Account()
    account.charge(1.0, now_s=0.0)
    assert account.is_heavy(10.0)
    assert not account.is_heavy(21.0)


def test_a_plan_of_a_light_client_goes_before_those_of_heavy_ones() -> None:
    async def story() -> list[str]:
        plans, order = PlanQueue(), list[str]()
        done = asyncio.get_running_loop().create_future()
        for number in range(40):
            plans.ask(f"heavy {number % 10}", busy(0.004), lambda: order.append("heavy"))

        def light() -> None:
            order.append("light")
            done.set_result(None)

        await asyncio.sleep(0.05)
        plans.ask("light", lambda: None, light)
        await asyncio.wait_for(done, 10)
        return order

    order = asyncio.run(story())
    assert order.index("light") < 39


def test_a_plan_runs_at_once_where_nobody_waits() -> None:
    async def story() -> None:
        plans, order = PlanQueue(), list[int]()
        plans.ask("anna", lambda: order.append(1), lambda: order.append(2))
        assert order == [1, 2]
        plans.ask("anna", lambda: order.append(3), lambda: None)
        assert order == [1, 2], "one in an iteration of the loop"
        await asyncio.sleep(0.01)
        assert order == [1, 2, 3]

    asyncio.run(story())


def test_a_pick_of_a_light_client_goes_before_a_flood() -> None:
    async def story() -> list[str]:
        queue, gate, order = PickQueue[None](1), threading.Event(), list[str]()

        def work(name: str) -> None:
            gate.wait(10)
            order.append(name)

        picks = [
            asyncio.create_task(queue.run("heavy", lambda: work("heavy"), lambda: None))
            for _ in range(5)
        ]
        await asyncio.sleep(0.01)
        picks.append(asyncio.create_task(queue.run("light", lambda: work("light"), lambda: None)))
        cancelled = asyncio.create_task(queue.run("light", lambda: work("never"), lambda: None))
        await asyncio.sleep(0.01)
        cancelled.cancel()
        gate.set()
        await asyncio.gather(*picks)
        queue.shutdown(wait=True)
        return order

    order = asyncio.run(story())
    assert order.index("light") == 1, "behind the one that ran already"
    assert "never" not in order


def test_a_failed_pick_is_raised_to_its_client_alone() -> None:
    async def story() -> None:
        queue, ended = PickQueue[int](1), list[int]()
        failing = queue.run("anna", lambda: 1 // 0, lambda: ended.append(1))
        with pytest.raises(ZeroDivisionError):
            await failing
        assert await queue.run("anna", lambda: 7, lambda: ended.append(2)) == 7
        assert ended == [1, 2]
        queue.shutdown(wait=True)

    asyncio.run(story())


def send_all(asked: list[tuple[str, Rank, int]]) -> list[str]:
    """Let clients send so many turns each; return whose turn it was, in order."""

    async def story() -> list[str]:
        scheduler, order = SendScheduler(), list[str]()

        def burst(name: str, rank: Rank, turns: int) -> Callable[[], tuple[int, Rank | None]]:
            left = turns

            def send() -> tuple[int, Rank | None]:
                nonlocal left
                left -= 1
                order.append(name)
                return TURN_BYTES, rank if left else None

            return send

        # A full step before: nobody else is served at once.
        for _ in range(STEP_BYTES // TURN_BYTES):
            scheduler.ask(Rank.PREFETCH, burst("first", Rank.PREFETCH, 1))
        for name, rank, turns in asked:
            scheduler.ask(rank, burst(name, rank, turns))
        for _ in range(sum(turns for _, _, turns in asked)):
            await asyncio.sleep(0)
        return order[STEP_BYTES // TURN_BYTES :]

    return asyncio.run(story())


def test_new_landings_go_first_and_aims_last() -> None:
    order = send_all(
        [("aim", Rank.PREFETCH, 2), ("old", Rank.LANDING, 2), ("new", Rank.NEW_LANDING, 2)]
    )
    assert order == ["new", "new", "old", "old", "aim", "aim"]


def test_equal_clients_alternate() -> None:
    order = send_all([("a", Rank.LANDING, 3), ("b", Rank.LANDING, 3)])
    assert order == ["a", "b"] * 3


def test_repeated_new_landings_starve_nobody() -> None:
    order = send_all([("new", Rank.NEW_LANDING, 100), ("old", Rank.LANDING, 5)])
    assert order.index("old") <= 8


def test_the_loop_runs_between_steps() -> None:
    """A new landing waits for one step of others' payload at most."""

    async def story() -> list[str]:
        scheduler, order, left = SendScheduler(), list[str](), 50

        def endless() -> tuple[int, Rank | None]:
            nonlocal left
            left -= 1
            order.append("old")
            return TURN_BYTES, Rank.LANDING if left else None

        def once() -> tuple[int, Rank | None]:
            order.append("new")
            return 1000, None

        scheduler.ask(Rank.LANDING, endless)
        await asyncio.sleep(0)
        scheduler.ask(Rank.NEW_LANDING, once)
        await asyncio.sleep(0.05)
        return order

    assert asyncio.run(story()).index("new") <= 2 * STEP_BYTES // TURN_BYTES


def test_the_last_sessions_are_for_addresses_that_hold_few() -> None:
    counts = SessionCounts(32, 16)
    for address in ("127.0.0.2", "127.0.0.3", "127.0.0.4"):
        while counts.add(address) is None:
            pass
    assert len(counts) > 32 - 32 // RESERVED_SHARE - 3
    assert counts.refusal("127.0.0.4") is not None
    assert counts.add("127.0.0.5") is None
    counts.remove("127.0.0.5")
    everything = SessionCounts(32, 32)
    while everything.add("127.0.0.2") is None:
        pass
    assert len(everything) == 32
