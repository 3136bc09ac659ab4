"""What asyncio's own do, in less memory."""

from __future__ import annotations

import asyncio

import pytest

from terraport_server.stream.signals import Inbox, Signal


def test_everybody_goes_on_and_who_was_cancelled_takes_nobody_along() -> None:
    async def story() -> None:
        signal = Signal()
        tasks = [asyncio.create_task(signal.wait()) for _ in range(3)]
        await asyncio.sleep(0)
        tasks[1].cancel()
        await asyncio.sleep(0)
        signal.set()
        signal.clear()  # who waited goes on all the same
        results = await asyncio.gather(*tasks, return_exceptions=True)
        assert results[0] is None
        assert isinstance(results[1], asyncio.CancelledError)
        assert results[2] is None
        assert not signal.is_set()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.01):
                await signal.wait()
        signal.set()
        await signal.wait()

    asyncio.run(story())


def test_items_come_in_order_and_a_cancelled_reader_loses_none() -> None:
    async def story() -> None:
        inbox = Inbox[int]()
        reader = asyncio.create_task(inbox.get())
        await asyncio.sleep(0)
        inbox.put_nowait(1)
        reader.cancel()
        await asyncio.gather(reader, return_exceptions=True)
        inbox.put_nowait(2)
        assert not inbox.empty()
        assert [await inbox.get(), await inbox.get()] == [1, 2]
        assert inbox.empty()

    asyncio.run(story())
