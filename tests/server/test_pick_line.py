"""Picks wait in line for a thread."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable

import pytest

from terraport_server.errors import PickTimeoutError
from terraport_server.scenes.pick_queue import PickLine
from terraport_server.stream.priced_queue import Account


def test_a_newcomers_pick_goes_before_the_rest_of_a_flood() -> None:
    async def story() -> list[str]:
        line, order, over = PickLine[None](1), list[str](), list[str]()
        gate = threading.Semaphore(0)

        def work(name: str) -> Callable[[], None]:
            def do() -> None:
                gate.acquire(timeout=10)
                order.append(name)

            return do

        async def ask(account: Account, name: str) -> None:
            await line.run(account, work(name), lambda: over.append(name))

        flood = Account()
        tasks = [asyncio.create_task(ask(flood, f"flood {number}")) for number in range(8)]
        await asyncio.sleep(0)
        gate.release()
        await tasks[0]  # so that the flood has used something
        tasks.append(asyncio.create_task(ask(Account(), "newcomer")))
        await asyncio.sleep(0)
        gate.release(8)
        await asyncio.gather(*tasks)
        assert sorted(order) == sorted(over)
        await asyncio.to_thread(line.shutdown, wait=True)
        return order

    assert "newcomer" in asyncio.run(story())[:3], "one is under way"


def test_a_pick_that_nobody_waits_for_is_not_begun() -> None:
    async def story() -> None:
        line, order, over = PickLine[None](1), list[str](), list[str]()
        gate, account = threading.Event(), Account()
        first = asyncio.create_task(
            line.run(account, lambda: order.append("first") or _wait(gate), lambda: None)
        )
        gone = asyncio.create_task(
            line.run(account, lambda: order.append("gone"), lambda: over.append("gone"))
        )
        await asyncio.sleep(0)
        gone.cancel()
        await asyncio.sleep(0)
        gate.set()
        await first
        last = line.run(account, lambda: order.append("last"), lambda: over.append("last"))
        await last
        assert order == ["first", "last"]
        assert over == ["gone", "last"]
        line.shutdown(wait=False)

    asyncio.run(story())


def test_who_goes_away_during_a_pick_that_fails_leaves_no_complaint(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Each was a traceback in the log: "Future exception was never retrieved"."""

    def fail() -> None:
        gate.wait(10)
        raise PickTimeoutError(0)

    async def story() -> None:
        line, over = PickLine[None](1), asyncio.Event()
        gone = asyncio.create_task(line.run(Account(), fail, over.set))
        await asyncio.sleep(0)
        gone.cancel()
        await asyncio.sleep(0)
        gate.set()
        await over.wait()
        line.shutdown(wait=False)

    gate = threading.Event()
    asyncio.run(story())
    assert caplog.records == []


def test_a_failure_is_the_askers() -> None:
    def fail() -> None:
        raise PickTimeoutError(3)

    async def story() -> None:
        line = PickLine[None](1)
        with pytest.raises(PickTimeoutError):
            await line.run(Account(), fail, lambda: None)
        await line.run(Account(), lambda: None, lambda: None)
        line.shutdown(wait=False)

    asyncio.run(story())


def _wait(gate: threading.Event) -> None:
    gate.wait(10)
