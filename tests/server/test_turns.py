"""Whose payload goes next."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from terraport_server.stream.scheduler import Pause, Rank, Turns, rank_of

Burst = Callable[[], Rank | Pause | None]


def bursts(order: list[str], name: str, *ranks: Rank | Pause | None) -> Burst:
    """A burst that notes its name, and says one rank after the other; ``None`` at the end."""
    left = [*ranks, None]

    def burst() -> Rank | Pause | None:
        order.append(name)
        return left.pop(0)

    return burst


def test_new_landings_go_before_landings_and_landings_before_aims() -> None:
    async def story() -> list[str]:
        turns, order = Turns(), list[str]()
        await asyncio.gather(
            turns.take(Rank.AIM, bursts(order, "first")),
            turns.take(Rank.AIM, bursts(order, "aim", Rank.AIM)),
            turns.take(Rank.LANDING, bursts(order, "old", Rank.LANDING)),
            turns.take(Rank.NEW_LANDING, bursts(order, "new", Rank.NEW_LANDING, Rank.LANDING)),
        )
        assert len(turns) == 0
        return order

    assert asyncio.run(story()) == ["first", "new", "new", "old", "new", "old", "aim", "aim"]


def test_landing_anew_all_the_time_starves_nobody() -> None:
    async def story() -> list[str]:
        turns, order = Turns(), list[str]()
        await asyncio.gather(
            turns.take(Rank.AIM, bursts(order, "first")),
            turns.take(Rank.LANDING, bursts(order, "old", Rank.LANDING)),
            turns.take(Rank.NEW_LANDING, bursts(order, "new", *[Rank.NEW_LANDING] * 20)),
        )
        return order

    order = asyncio.run(story())
    assert [index for index, name in enumerate(order) if name == "old"] == [9, 18]


def test_equals_go_round() -> None:
    async def story() -> list[str]:
        turns, order = Turns(), list[str]()
        await asyncio.gather(
            *(
                turns.take(Rank.LANDING, bursts(order, name, *[Rank.LANDING] * 2))
                for name in ("a", "b", "c")
            )
        )
        return order

    assert asyncio.run(story()) == ["a"] + ["a", "b", "c"] * 2 + ["b", "c"]


def test_a_newcomer_waits_for_one_turn_only() -> None:
    """Between two turns the loop does everything else that is due."""

    async def story() -> None:
        turns, order = Turns(), list[str]()
        busy = [
            asyncio.create_task(
                turns.take(Rank.LANDING, bursts(order, "busy", *[Rank.LANDING] * 9))
            )
            for _ in range(5)
        ]
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        before = len(order)
        await turns.take(Rank.NEW_LANDING, bursts(order, "new"))
        assert order.index("new") <= before + 1
        await asyncio.gather(*busy)
        assert order.count("busy") == 50

    asyncio.run(story())


def test_who_goes_away_gives_the_place_up() -> None:
    async def story() -> list[str]:
        turns, order = Turns(), list[str]()
        first = asyncio.create_task(turns.take(Rank.LANDING, bursts(order, "first")))
        gone = asyncio.create_task(turns.take(Rank.LANDING, bursts(order, "gone")))
        stays = asyncio.create_task(turns.take(Rank.LANDING, bursts(order, "stays")))
        await asyncio.sleep(0)
        gone.cancel()
        await asyncio.gather(first, stays)
        assert gone.cancelled()
        await turns.take(Rank.AIM, bursts(order, "later"))
        return order

    assert asyncio.run(story()) == ["first", "stays", "later"]


def test_who_comes_alone_does_not_wait() -> None:
    async def story() -> list[str]:
        turns, order = Turns(), list[str]()
        taking = turns.take(Rank.NEW_LANDING, bursts(order, "now"))
        with pytest.raises(StopIteration):
            taking.send(None)  # ran to its end without waiting for anything
        return order

    assert asyncio.run(story()) == ["now"]


def test_a_failure_is_the_asker_s_and_nobody_else_s() -> None:
    async def story() -> list[str]:
        turns, order = Turns(), list[str]()

        def fails() -> Rank | None:
            raise OSError("disk")

        failing = turns.take(Rank.NEW_LANDING, fails)
        done = await asyncio.gather(
            failing, turns.take(Rank.LANDING, bursts(order, "well")), return_exceptions=True
        )
        with pytest.raises(OSError, match="disk"):
            raise done[0] or AssertionError
        return order

    assert asyncio.run(story()) == ["well"]


@pytest.mark.parametrize(
    ("landing", "sent_bytes", "next_bytes", "rest_bytes", "rank"),
    [
        (False, 0, 131_072, 200_000, Rank.AIM),
        (True, 0, 131_072, 200_000, Rank.NEW_LANDING),
        (True, 0, 16_384, 200_000, Rank.NEW_LANDING),
        (True, 0, 16_383, 200_000, Rank.LANDING),  # credit by the crumb
        (True, 0, 1, 200_000, Rank.LANDING),
        (True, 0, 700, 700, Rank.NEW_LANDING),  # a small segment, whole
        (True, (1 << 20) - 1, 131_072, 200_000, Rank.NEW_LANDING),
        (True, 1 << 20, 131_072, 200_000, Rank.LANDING),
    ],
)
def test_what_a_turn_is_worth(
    landing: bool, sent_bytes: int, next_bytes: int, rest_bytes: int, rank: Rank
) -> None:
    given = rank_of(
        landing=landing, sent_bytes=sent_bytes, next_bytes=next_bytes, rest_bytes=rest_bytes
    )
    assert given == rank


def test_a_socket_that_fills_costs_no_steps_of_the_loop() -> None:
    """What goes on when there is room does so in that step, without its task."""

    async def story() -> list[str]:
        turns, order, resumes = Turns(), list[str](), list[Callable[[], None]]()
        pause = Pause(Rank.LANDING, resumes.append)
        taking = asyncio.create_task(
            turns.take(Rank.NEW_LANDING, bursts(order, "full", pause, pause))
        )
        for count in (1, 2):
            for _ in range(4):
                await asyncio.sleep(0)
            assert order == ["full"] * count
            assert not taking.done()
            resumes.pop()()
        await taking
        return order

    assert asyncio.run(story()) == ["full"] * 3


def test_who_is_called_back_waits_for_its_turn() -> None:
    async def story() -> list[str]:
        turns, order, resumes = Turns(), list[str](), list[Callable[[], None]]()
        pause = Pause(Rank.LANDING, resumes.append)
        full = asyncio.create_task(turns.take(Rank.LANDING, bursts(order, "full", pause)))
        for _ in range(4):
            await asyncio.sleep(0)
        others = [
            asyncio.create_task(turns.take(Rank.NEW_LANDING, bursts(order, name)))
            for name in ("one", "two")
        ]
        await asyncio.sleep(0)
        resumes.pop()()
        await asyncio.gather(full, *others)
        return order

    assert asyncio.run(story()) == ["full", "one", "two", "full"]


def test_who_went_away_is_not_called_back() -> None:
    async def story() -> list[str]:
        turns, order, resumes = Turns(), list[str](), list[Callable[[], None]]()
        pause = Pause(Rank.LANDING, resumes.append)
        gone = asyncio.create_task(turns.take(Rank.LANDING, bursts(order, "gone", pause)))
        for _ in range(4):
            await asyncio.sleep(0)
        gone.cancel()
        await asyncio.gather(gone, return_exceptions=True)
        resumes.pop()()
        await turns.take(Rank.LANDING, bursts(order, "next"))
        return order

    assert asyncio.run(story()) == ["gone", "next"]
