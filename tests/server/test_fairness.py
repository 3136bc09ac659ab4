"""Whose plan, pick and payload is next: fair queues by used CPU time, and the order of sending."""

from __future__ import annotations

import asyncio
import random
import threading
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from terraport_server.fair_queue import HALF_LIFE_S, Account, Accounts, FairQueue, PickQueue
from terraport_server.stream.scheduler import STEP_BYTES, TURN_BYTES, Rank, SendScheduler


@given(costs=st.lists(st.floats(0.0001, 0.05), min_size=2, max_size=6))
def test_clients_that_always_ask_get_equal_cpu_time(costs: list[float]) -> None:
    queue, accounts = FairQueue[int](), [Account() for _ in costs]
    used_s = [0.0] * len(costs)
    for number, account in enumerate(accounts):
        queue.add(account, number)
    for _ in range(400):
        account, number = queue.take()
        account.charge(costs[number], now_s=0.0)
        used_s[number] += costs[number]
        queue.add(account, number)
        if min(used_s):
            assert max(used_s) - min(used_s) <= 2 * max(costs)


def test_usage_fades_stays_with_a_client_and_several_jobs_gain_nothing() -> None:
    accounts = Accounts()
    accounts.of("a").charge(1.0, now_s=0.0)
    assert accounts.of("a").used_s(2 * HALF_LIFE_S) == pytest.approx(0.25), "after a reconnect, too"
    queue, one, many = FairQueue[str](), Account(), Account()
    for _ in range(50):
        queue.add(many, "many")
    queue.add(one, "one")
    turns = Counter[str]()
    while queue and turns["one"] < 10:
        account, name = queue.take()
        turns[name] += 1
        account.charge(0.01, now_s=0.0)
        if name == "one":
            queue.add(one, "one")
    assert turns["many"] <= 12


def test_a_pick_that_was_cancelled_is_not_started_and_a_failure_is_its_askers() -> None:
    async def story() -> None:
        picks, gate, ran = PickQueue[int](1), threading.Event(), list[str]()

        def work(name: str, answer: int) -> int:
            gate.wait(10)
            ran.append(name)
            return 1 // answer

        def ask(name: str, answer: int) -> asyncio.Task[int]:
            run = picks.run(Account(), lambda: work(name, answer), lambda: None)
            return asyncio.create_task(run)

        first, gone, bad, last = ask("first", 1), ask("gone", 1), ask("bad", 0), ask("last", 1)
        await asyncio.sleep(0.01)
        gone.cancel()
        gate.set()
        assert await first == await last == 1
        with pytest.raises(ZeroDivisionError):
            await bad
        assert ran == ["first", "bad", "last"]
        picks.shutdown(wait=True)

    asyncio.run(story())


def test_new_landings_are_sent_first_and_nobody_starves() -> None:
    async def story() -> None:
        scheduler, order = SendScheduler(), list[Rank]()

        def client(rank: Rank, bursts: int) -> None:
            left = [bursts]

            def burst() -> tuple[int, Rank | None]:
                order.append(rank)
                left[0] -= 1
                return TURN_BYTES, rank if left[0] else None

            scheduler.ask(rank, burst)

        client(Rank.AIM, 1)  # fills the step together with the next
        client(Rank.AIM, 1)
        asked = [Rank.NEW_LANDING] * 30 + [Rank.LANDING] * 10 + [Rank.AIM] * 5
        random.Random(1).shuffle(asked)
        for rank in asked:
            client(rank, 1)
        assert len(order) == STEP_BYTES // TURN_BYTES
        for _ in range(100):
            await asyncio.sleep(0)
        sent = order[2:]
        assert sent[:8] == [Rank.NEW_LANDING] * 8
        assert max(i for i, rank in enumerate(sent) if rank is Rank.LANDING) < 40
        assert sent[-5:] == [Rank.AIM] * 5, "what no landing can use"
        assert sent.index(Rank.LANDING) == 8, "each ninth turn, however many land anew"

    asyncio.run(story())
