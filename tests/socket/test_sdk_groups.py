"""Groups over real sockets: a guide, members that stall, are cut, leave or come late."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest
from sdk.proxy import Proxy
from server.grid_scene import SIDE, TILE_M

import terraport
from terraport import Group, Session, backoff, sync
from terraport.errors import GroupError, ServerError
from terraport_server import BackgroundServer

CENTRE = (SIDE * TILE_M / 2, 1.0, SIDE * TILE_M / 2)
CORNER = (5.0, 1.0, 5.0)


@pytest.fixture(autouse=True)
def _short_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backoff, "FIRST_WAIT_S", 0.01)
    monkeypatch.setattr(backoff, "LONGEST_WAIT_S", 0.6)


def run(work: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(work, 60))


async def opened(stack: AsyncExitStack, url: str, **options: Any) -> Session:
    return await stack.enter_async_context(terraport.connect(f"{url}/scenes/grid", **options))


async def party(
    stack: AsyncExitStack, url: str, name: str, members: int
) -> tuple[list[Session], list[Group]]:
    """A guide and members, all of whom see each other."""
    sessions = [await opened(stack, url) for _ in range(1 + members)]
    groups = [
        await session.join_group(name, role="member" if number else "guide", name=f"n{number}")
        for number, session in enumerate(sessions)
    ]
    for group in groups:
        await group.members_present(1 + members, 10)
    return sessions, groups


def test_the_guide_lands_everybody(server: BackgroundServer) -> None:
    """Each by its own budgets and from its own cache; the barrier opens when all are there."""

    async def work() -> None:
        async with AsyncExitStack() as stack:
            sessions, groups = await party(stack, server.url, "all", 2)
            small = await opened(stack, server.url, max_segments=3)
            tight = await small.join_group("all", name="small")
            await tight.members_present(4, 10)
            assert [(m.name, m.role) for m in tight.members] == [
                ("n0", "guide"), ("n1", "member"), ("n2", "member"), ("small", "member")
            ]  # fmt: skip
            await (await sessions[1].land(CENTRE, 15.0)).ready(10)  # holds it already
            call = await groups[0].land_group(CENTRE, 15.0)
            calls = [group.newest or await group.next_landing(10) for group in [*groups, tight]]
            landings = [
                await landing_call.land() for landing_call in calls if landing_call is not None
            ]
            arrivals = await call.all_there(10)
            assert arrivals.complete
            assert arrivals.ready == (1, 2, 3, 4)
            assert [await landing_call.all_there(10) for landing_call in calls] == [arrivals] * 4
            assert len(small.visible) == 3
            assert sessions[0].visible == sessions[1].visible == sessions[2].visible
            assert landings[1].stats.streamed_bytes == 0
            # And again, as members do it: in a loop.

            async def follow(group: Group) -> int:
                async for call in group:
                    await call.land((call.position[0] + group.member, 1.0, call.position[2]))
                    if (await call.all_there()).complete and call.position == CORNER:
                        await group.leave()
                return 1

            tasks = [asyncio.create_task(follow(group)) for group in [*groups[1:], tight]]
            await asyncio.sleep(0.1)
            call = await groups[0].land_group(CORNER, 12.0)
            await call.land()
            assert (await call.all_there(10)).complete
            assert await asyncio.gather(*tasks) == [1, 1, 1], "the loop ends when it is left"

    run(work())


def test_a_member_whose_line_stalls_holds_nobody_beyond_the_deadline(
    server: BackgroundServer,
) -> None:
    async def work() -> None:
        async with AsyncExitStack() as stack:
            proxy = await stack.enter_async_context(Proxy(server.url))
            _, groups = await party(stack, server.url, "stall", 1)
            slow = await opened(stack, proxy.url)
            stalled = await slow.join_group("stall")
            await groups[0].members_present(3, 10)
            proxy.flows.clear()
            call = await groups[0].land_group(CENTRE, 15.0, deadline_s=0.5)
            other = groups[1].newest or await groups[1].next_landing(10)
            began_s = asyncio.get_running_loop().time()
            for landing_call in (call, other):
                await (await landing_call.land()).ready(10)
            arrivals = await other.all_there(10)
            assert asyncio.get_running_loop().time() - began_s < 2.0
            assert (arrivals.ready, arrivals.missing) == ((1, 2), (stalled.member,))
            proxy.flows.set()
            late = stalled.newest or await stalled.next_landing(10)
            await (await late.land()).ready(10)
            assert (await late.all_there(10)).missing == (stalled.member,)
            assert slow.visible == tuple(sorted(slow.visible)) != ()

    run(work())


def test_a_member_that_is_cut_takes_its_seat_again_and_arrives(server: BackgroundServer) -> None:
    async def work() -> None:
        async with AsyncExitStack() as stack:
            proxy = await stack.enter_async_context(Proxy(server.url))
            _, groups = await party(stack, server.url, "cut", 1)
            unlucky = await opened(stack, proxy.url, credit_bytes=3000)
            seat = await unlucky.join_group("cut")
            await groups[0].members_present(3, 10)
            call = await groups[0].land_group(CENTRE, 25.0)
            mine = seat.newest or await seat.next_landing(10)
            landing = await mine.land()
            await proxy.cut()
            for group in groups:
                landing_call = group.newest or await group.next_landing(10)
                await landing_call.land()
            arrivals = await call.all_there(10)
            assert arrivals.ready == (1, 2, 3)
            await landing.ready(10)
            assert unlucky.stats.connections == 2
            assert unlucky.stats.repeated_bytes == 0
            assert seat.member == 3
            assert seat.newest is mine, "the same group landing is not told twice"

    run(work())


def test_a_guide_that_is_cut_stays_the_guide_and_one_that_leaves_frees_the_seat(
    server: BackgroundServer,
) -> None:
    async def work() -> None:
        async with AsyncExitStack() as stack:
            proxy = await stack.enter_async_context(Proxy(server.url))
            lead = await opened(stack, proxy.url)
            guide = await lead.join_group("lead", role="guide")
            member = await opened(stack, server.url)
            group = await member.join_group("lead")
            await proxy.cut()
            call = await guide.land_group(CENTRE, 15.0)
            assert call.guide == guide.member == 1
            other = group.newest or await group.next_landing(10)
            await other.land()
            third = await opened(stack, server.url)
            with pytest.raises(ServerError) as refused:
                await third.join_group("lead", role="guide")
            assert refused.value.code == "group_refused"
            assert "has one" in refused.value.message
            await guide.leave()
            assert (await other.all_there(10)).ready == (2,), "nobody waits for who has left"
            with pytest.raises(GroupError):
                await guide.land_group(CENTRE, 15.0)
            assert (await third.join_group("lead", role="guide")).role == "guide"

    run(work())


def test_replicas_are_told_apart_by_the_url(scenes_dir: Path) -> None:
    """The SDK connects anew by a URL that names the group, once, where the server asks for it."""

    async def work(url: str) -> None:
        async with AsyncExitStack() as stack:
            session = await opened(stack, url)
            assert session.limits.groups == "query"
            landing = await session.land(CENTRE, 15.0)
            await landing.ready(10)
            group = await session.join_group("replica", role="guide")
            assert session.stats.connections == 2
            await session.join_group("replica", role="guide")
            assert session.stats.connections == 2
            other = await opened(stack, url, group="replica")
            await other.join_group("replica")
            assert other.stats.connections == 1
            await group.members_present(1, 10)
            await other.join_group("elsewhere")
            assert other.stats.connections == 2
            assert (await session.land(CENTRE, 15.0)).plan.load_bytes == 0

    with BackgroundServer(scenes_dir, group_routing="query") as server:
        run(work(server.url))


def test_where_there_are_no_groups_it_is_said(scenes_dir: Path) -> None:
    async def work(url: str) -> None:
        async with terraport.connect(f"{url}/scenes/grid") as session:
            with pytest.raises(ServerError, match="no groups are served"):
                await session.join_group("tour")

    with BackgroundServer(scenes_dir, group_routing="off") as server:
        run(work(server.url))


def test_only_a_token_that_says_so_may_guide(scenes_dir: Path, tmp_path: Path) -> None:
    tokens = tmp_path / "tokens"
    tokens.write_text(f"lead {'g' * 20} +guide\nvisitor {'v' * 20}\n")

    async def work(url: str) -> None:
        async with AsyncExitStack() as stack:
            visitor = await opened(stack, url, token="v" * 20)
            with pytest.raises(ServerError, match="does not allow"):
                await visitor.join_group("tour", role="guide")
            await visitor.join_group("tour")
            lead = await opened(stack, url, token="g" * 20)
            assert (await lead.join_group("tour", role="guide")).role == "guide"

    with BackgroundServer(scenes_dir, tokens_file=tokens, group_guides="token") as server:
        run(work(server.url))


def test_without_asyncio(server: BackgroundServer) -> None:
    url = f"{server.url}/scenes/grid"
    with sync.connect(url) as lead, sync.connect(url) as other:
        guide = lead.join_group("sync", role="guide", name="Ann")
        member = other.join_group("sync")
        guide.members_present(2, 10)
        assert guide.members[0].name == "Ann"
        call = guide.land_group(CENTRE, 15.0)
        called = next(iter(member))
        for landing_call in (call, called):
            landing_call.land().ready(10)
        assert call.all_there(10).complete
        assert called.all_there(10) == call.all_there(10)
        assert lead.visible == other.visible
        member.leave()
        assert list(member) == []
