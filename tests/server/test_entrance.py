"""Turns and bounds of those who are not let in."""

from __future__ import annotations

import asyncio

import pytest

from terraport_server.entrance import Entrance

MAX_BYTES = 32 << 20


class Peer:
    def __init__(self) -> None:
        self.gave_way: str | None = None

    def give_way(self, text: str) -> None:
        self.gave_way = text


def test_one_step_of_all_strangers_in_a_step_of_the_loop() -> None:
    """Beside a thousand steps of one address, those of another are the second and the fourth."""
    done: list[str] = []

    async def work() -> list[int]:
        entrance = Entrance("", MAX_BYTES)
        for number in range(1000):
            entrance.wait("192.0.2.1", lambda n=number: done.append(f"a{n}"))
        for number in range(2):
            entrance.wait("192.0.2.2", lambda n=number: done.append(f"b{n}"))
        lengths = []
        for _ in range(6):
            await asyncio.sleep(0)
            lengths.append(len(done))
        return lengths

    assert asyncio.run(work()) == [1, 2, 3, 4, 5, 6]
    assert done[:6] == ["a0", "b0", "a1", "b1", "a2", "a3"]


def test_whoever_asks_where_nobody_does_has_his_step_at_once() -> None:
    """And all others in later steps of the loop, one in each, their addresses in turn."""
    done: list[str] = []

    async def work() -> None:
        entrance = Entrance("", MAX_BYTES)

        async def turn(name: str) -> None:
            await entrance.turn(name[0])
            done.append(name)

        entrance.ask("a", lambda: done.append("a0"))
        assert done == ["a0"]
        turns = [asyncio.create_task(turn(name)) for name in ("a1", "a2", "a3", "b1")]
        given_up = asyncio.create_task(entrance.turn("c"))
        await asyncio.sleep(0)
        given_up.cancel()
        await asyncio.gather(*turns)
        for _ in range(2):
            await asyncio.sleep(0)
        entrance.ask("a", lambda: done.append("a4"))

    asyncio.run(work())
    assert done == ["a0", "a1", "a2", "b1", "a3", "a4"]


def test_a_step_that_fails_stops_nobody() -> None:
    done: list[int] = []

    async def work() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda *_: done.append(0))
        entrance = Entrance("", MAX_BYTES)
        entrance.wait("192.0.2.1", lambda: 1 // 0)  # type: ignore[arg-type, return-value]
        entrance.wait("192.0.2.1", lambda: done.append(1))
        for _ in range(3):
            await asyncio.sleep(0)

    asyncio.run(work())
    assert done == [0, 1]


def test_room_is_made_by_whom_most_came_with() -> None:
    entrance, peers = Entrance("", MAX_BYTES), [Peer() for _ in range(3)]
    assert not entrance.make_room()
    for peer, address in zip(peers, "abb", strict=True):
        entrance.strangers.enter(peer, address)
    assert entrance.make_room()
    assert [peer.gave_way is None for peer in peers] == [True, False, True]
    assert len(entrance.strangers) == 2


@pytest.mark.parametrize("many", [True, False])
def test_unfinished_messages_are_bounded_together(many: bool) -> None:
    entrance, honest = Entrance("", MAX_BYTES), Peer()
    entrance.strangers.enter(honest, "b")
    entrance.weigh(honest, 400_000)
    peers = [Peer() for _ in range(200 if many else 1)]
    for peer in peers:
        entrance.strangers.enter(peer, "a")
    for _ in range(2):
        for peer in peers:
            entrance.weigh(peer, MAX_BYTES // len(peers))
    assert entrance.strangers.total_bytes <= MAX_BYTES
    assert honest.gave_way is None
    assert sum(peer.gave_way is not None for peer in peers) >= len(peers) // 2
