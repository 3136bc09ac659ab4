"""Whose turn it is among clients."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_server.stream.client_turns import LEAST_COST, ClientTurns
from terraport_server.stream.priced_queue import Account


def plan(order: list[str], name: str, cost: int) -> Callable[[], int]:
    """A plan that notes its name and looks at so many segments."""

    def make() -> int:
        order.append(name)
        return cost

    return make


async def land_often(
    turns: ClientTurns, order: list[str], name: str, cost: int, times: int
) -> Account:
    account = Account()
    for _ in range(times):
        await turns.take(account, plan(order, name, cost))
    return account


def test_who_lands_widely_waits_behind_who_does_not() -> None:
    async def story() -> list[str]:
        turns, order = ClientTurns(), list[str]()
        await asyncio.gather(
            land_often(turns, order, "wide", 9 * LEAST_COST, 5),
            land_often(turns, order, "narrow", 0, 20),
        )
        assert len(turns) == 0
        return order

    order = asyncio.run(story())
    turns_of_wide = [index for index, name in enumerate(order) if name == "wide"]
    assert turns_of_wide[:3] == [0, 11, 22], "ten narrow ones cost as much as a wide one"


def test_a_newcomer_goes_next() -> None:
    async def story() -> list[str]:
        turns, order = ClientTurns(), list[str]()
        others = [
            asyncio.create_task(land_often(turns, order, "wide", 10_000, 4)) for _ in range(8)
        ]
        for _ in range(20):
            await asyncio.sleep(0)
        came_at = len(order)
        await turns.take(Account(), plan(order, "newcomer", 10_000))
        assert order.index("newcomer") <= came_at + 1, "one turn may be under way"
        await asyncio.gather(*others)
        return order

    assert len(asyncio.run(story())) == 33


def test_a_landing_does_not_wait_for_all_others_at_each_of_its_turns() -> None:
    """Its message, its plan and its credit: each had waited until eighty had had a turn."""

    async def story() -> int:
        turns, order = ClientTurns(), list[str]()
        floods = [asyncio.create_task(land_often(turns, order, "flood", 0, 20)) for _ in range(80)]
        for _ in range(400):
            await asyncio.sleep(0)
        account, came_at = Account(), len(order)
        for _ in range(4):
            await turns.take(account, plan(order, "lands", 0))
        waited = len(order) - came_at
        await asyncio.gather(*floods)
        return waited

    assert asyncio.run(story()) <= 12


@pytest.mark.parametrize(("address", "least"), [("127.0.0.2", 60), (None, 20)])
def test_eight_of_one_address_have_together_what_one_has(address: str | None, least: int) -> None:
    async def flood(turns: ClientTurns, order: list[str], name: str, address: str | None) -> None:
        account = Account()
        account.address = address
        for _ in range(200):
            await turns.take(account, plan(order, name, 0))

    async def story() -> int:
        turns, order = ClientTurns(), list[str]()
        tasks = [asyncio.create_task(flood(turns, order, "one of many", address)) for _ in range(8)]
        tasks += [asyncio.create_task(flood(turns, order, "single", "127.0.0.3"))]
        for _ in range(400):
            await asyncio.sleep(0)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        return order[:200].count("single")

    got = asyncio.run(story())
    assert least <= got <= 120 if address else got <= 50


def test_who_comes_anew_for_each_landing_goes_on_with_what_was_used() -> None:
    """A new account each time had what newcomers have free: a wide plan each, ahead of others."""

    async def story() -> list[str]:
        turns, order, all_left_once = ClientTurns(), list[str](), asyncio.Event()

        async def come_and_go() -> None:
            for _ in range(6):
                account = Account()
                account.address = "127.0.0.2"
                turns.come(account)
                await turns.take(account, plan(order, "wide", 40 * LEAST_COST))
                turns.leave(account)
                if len(order) == 8:
                    all_left_once.set()

        async def land() -> None:
            account = Account()
            account.address = "127.0.0.3"
            await all_left_once.wait()
            for _ in range(4):
                await turns.take(account, plan(order, "narrow", 0))

        await asyncio.gather(*(come_and_go() for _ in range(8)), land())
        return order

    order = asyncio.run(story())
    last = max(at for at, name in enumerate(order) if name == "narrow")
    assert order.count("wide") == 48
    assert order[8 : last + 1].count("wide") <= 4, order


def test_idle_time_earns_nothing() -> None:
    """Who was away for long gets the next turn, and not all of the following ones."""

    async def story() -> list[str]:
        turns, order = ClientTurns(), list[str]()
        idle = Account()
        await land_often(turns, order, "busy", 1000, 50)
        order.clear()

        async def back() -> None:
            for _ in range(4):
                await turns.take(idle, plan(order, "back", 1000))

        await asyncio.gather(land_often(turns, order, "busy", 1000, 4), back())
        return order

    order = asyncio.run(story())
    for count in range(1, 9):
        assert abs(order[:count].count("busy") - order[:count].count("back")) <= 1


def test_who_goes_away_gives_the_place_up() -> None:
    async def story() -> list[str]:
        turns, order = ClientTurns(), list[str]()
        await turns.take(Account(), plan(order, "first", 0))
        gone = asyncio.create_task(turns.take(Account(), plan(order, "gone", 0)))
        stays = asyncio.create_task(turns.take(Account(), plan(order, "stays", 0)))
        await asyncio.sleep(0)
        gone.cancel()
        await asyncio.gather(gone, stays, return_exceptions=True)
        return order

    assert asyncio.run(story())[-1] == "stays"


def test_beside_who_takes_much_others_have_half_of_the_loop() -> None:
    """Two that take 4 ms a turn rest as long; who took little is served within the rests."""

    async def story() -> tuple[int, int]:
        turns, heavy = ClientTurns(), list[str]()

        def long_turn() -> int:
            until_s = time.perf_counter() + 0.004
            while time.perf_counter() < until_s:
                pass
            heavy.append("heavy")
            return 26_000

        async def takes_much() -> None:
            account = Account()
            while True:
                await turns.take(account, long_turn)
                await asyncio.sleep(0)

        others = [asyncio.create_task(takes_much()) for _ in range(2)]
        await asyncio.sleep(0.2)  # by then both have taken what is free
        account, order = Account(), list[str]()
        began_s, began, steps = time.perf_counter(), len(heavy), 0
        while time.perf_counter() - began_s < 0.2:
            await turns.take(account, plan(order, "light", 0))
            await asyncio.sleep(0)
            steps += 1
        for other in others:
            other.cancel()
        await asyncio.gather(*others, return_exceptions=True)
        return len(heavy) - began, steps

    # A machine that is busy with others lets the rests pass while nobody here is at work; without
    # rests, turns alternate however often it is tried.
    counts = []
    for _ in range(5):
        heavy, light = asyncio.run(story())
        counts.append((heavy, light))
        if 1 <= heavy <= 30 and light > 3 * heavy:
            return
    raise AssertionError(f"got {counts}, expected few turns of 4 ms and many of others between")


def test_who_comes_alone_does_not_wait() -> None:
    async def story() -> None:
        turns, order = ClientTurns(), list[str]()
        taking = turns.take(Account(), plan(order, "alone", 1))
        with pytest.raises(StopIteration):
            taking.send(None)
        assert order == ["alone"]

    asyncio.run(story())


def test_a_failure_is_the_asker_s_and_nobody_else_s() -> None:
    def fail() -> int:
        raise ValueError("broken")

    async def story() -> list[str]:
        turns, order = ClientTurns(), list[str]()
        results = await asyncio.gather(
            turns.take(Account(), plan(order, "first", 0)),
            turns.take(Account(), fail),
            turns.take(Account(), plan(order, "last", 0)),
            return_exceptions=True,
        )
        assert [type(result) for result in results] == [type(None), ValueError, type(None)]
        return order

    assert asyncio.run(story()) == ["first", "last"]


@settings(max_examples=60)
@given(costs=st.lists(st.integers(0, 20_000), min_size=2, max_size=6), turns_each=st.just(12))
def test_shares_are_equal_while_all_ask(costs: list[int], turns_each: int) -> None:
    """Between any two that ask all the time, what was used differs by two plans at most."""

    async def story() -> None:
        turns, order = ClientTurns(), list[str]()
        used = [0.0] * len(costs)
        worst = 2 * (max(costs) + LEAST_COST)
        everybody_asks = True

        async def client(number: int) -> None:
            nonlocal everybody_asks
            account = Account()

            def make() -> int:
                used[number] += costs[number] + LEAST_COST
                order.append(str(number))
                if everybody_asks and len(order) > len(costs):
                    assert max(used) - min(used) <= worst
                return costs[number]

            for _ in range(turns_each):
                await turns.take(account, make)
            everybody_asks = False

        await asyncio.gather(*(client(number) for number in range(len(costs))))

    asyncio.run(story())
