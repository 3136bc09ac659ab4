"""Lost connections over real sockets: nothing whole is sent again, and nothing is missing."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

import pytest
from sdk.proxy import Proxy
from server.grid_scene import SIDE, TILE_M, GridScene, write_grid_scene

import terraport
from terraport import Timeouts, backoff
from terraport.errors import ConnectionFailedError, ServerError
from terraport_server import BackgroundServer

CENTRE = (SIDE * TILE_M / 2, 1.0, SIDE * TILE_M / 2)
EVERYWHERE_M = 100.0


@pytest.fixture(autouse=True)
def _short_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fiftieth of the protocol's waits: 10 ms first."""
    monkeypatch.setattr(backoff, "FIRST_WAIT_S", 0.01)
    monkeypatch.setattr(backoff, "LONGEST_WAIT_S", 0.6)


def run(work: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(work, 60))


def test_a_landing_survives_any_number_of_cuts(server: BackgroundServer, big: GridScene) -> None:
    """3.7 MB through a line that is cut nine times: each segment comes whole exactly once."""

    async def work() -> None:
        async with Proxy(server.url) as proxy:
            chance = random.Random(3)
            proxy.cuts = [chance.randrange(70_000, 400_000) for _ in range(9)]
            url = f"{proxy.url}/scenes/big"
            async with terraport.connect(url, credit_bytes=100_000) as session:
                landing = await session.land(CENTRE, radius_m=EVERYWHERE_M)
                seen = [segment.id async for segment in landing]
                assert sorted(seen) == list(range(36))
                assert [s.payload for s in landing.segments] == big.payloads
                total = sum(map(len, big.payloads))
                stats = session.stats
                assert stats.connections == 10
                assert landing.stats.plans > 1
                # Whole segments: each once. Parts that a cut destroyed: less than one segment each.
                assert stats.payload_bytes == total
                assert stats.repeated_bytes == 0
                assert stats.received_bytes < total + 10 * max(map(len, big.payloads)) + 100_000

    run(work())


def test_after_it_is_ready_a_cut_changes_nothing(server: BackgroundServer) -> None:
    """The visible set stays, and a second visit is free on the new connection too."""

    async def work() -> None:
        async with (
            Proxy(server.url) as proxy,
            terraport.connect(f"{proxy.url}/scenes/grid") as session,
        ):
            await (await session.land(CENTRE, radius_m=15.0)).ready(10)
            before = await session.visible_set_hash()
            await proxy.cut()
            landing = await session.land(CENTRE, radius_m=15.0)
            await landing.ready(10)
            assert session.stats.connections == 2
            assert landing.stats.streamed_bytes == 0
            assert await session.visible_set_hash() == before

    run(work())


def test_picks_and_landings_wait_for_the_next_connection(server: BackgroundServer) -> None:
    async def work() -> None:
        async with (
            Proxy(server.url) as proxy,
            terraport.connect(f"{proxy.url}/scenes/grid") as session,
        ):
            proxy.refuse = True
            await proxy.cut()
            pick = asyncio.create_task(session.pick((5.0, 50.0, 5.0)))
            landing = asyncio.create_task(session.land(CENTRE, radius_m=15.0))
            await asyncio.sleep(0.1)
            assert not pick.done()
            proxy.refuse = False
            assert (await pick).segment == 0
            await (await landing).ready(10)

    run(work())


def test_nobody_there_for_too_long_ends_the_session(server: BackgroundServer) -> None:
    """Everyone who waits gets the reason."""

    async def work() -> None:
        async with (
            Proxy(server.url) as proxy,
            terraport.connect(
                f"{proxy.url}/scenes/big",
                credit_bytes=20_000,
                timeouts=Timeouts(reconnect_s=0.3, connect_s=0.2),
            ) as session,
        ):
            landing = await session.land(CENTRE, radius_m=EVERYWHERE_M)
            proxy.refuse = True
            await proxy.cut()
            with pytest.raises(ConnectionFailedError, match="no connection to ws://"):
                await landing.ready(30)
            with pytest.raises(terraport.errors.SessionClosedError):
                await session.land(CENTRE)

    run(work())


def test_a_bit_flipped_on_the_way_is_found_and_sent_again(
    server: BackgroundServer, big: GridScene
) -> None:
    """TCP's checksum misses one in 65,536; the segment's own does not."""

    async def work() -> None:
        async with (
            Proxy(server.url) as proxy,
            terraport.connect(f"{proxy.url}/scenes/big") as session,
        ):
            proxy.flip_at = 3_000_000
            landing = await session.land(CENTRE, radius_m=EVERYWHERE_M)
            segments = await landing.ready(20)
            assert proxy.flip_at is None
            assert landing.stats.rejected == 1
            assert session.stats.connections == 1
            assert [segment.payload for segment in segments] == big.payloads

    run(work())


def test_a_server_that_restarts_with_a_new_version(tmp_path: Path) -> None:
    """What did not change is kept by hash; base and picture are of the new version."""
    write_grid_scene(tmp_path / "grid", seed=0)

    async def work() -> None:
        async with Proxy("http://127.0.0.1:1") as proxy:
            with BackgroundServer(tmp_path) as first:
                proxy._target = ("127.0.0.1", first.port)
                connecting = terraport.connect(f"{proxy.url}/scenes/grid")
                session = await connecting.__aenter__()
                landing = await session.land(CENTRE, radius_m=15.0)
                await landing.ready(10)
                old_base = await session.base()
            # The service drained and is gone; another one, with another version, takes its place.
            write_grid_scene(tmp_path / "grid", seed=1)
            with BackgroundServer(tmp_path) as second:
                proxy._target = ("127.0.0.1", second.port)
                landing = await session.land(CENTRE, radius_m=15.0)
                await landing.ready(20)
                assert session.scene.version != old_base.version
                assert landing.stats.streamed_bytes == landing.plan.total_bytes
                assert (await session.base()).version == session.scene.version
                assert session.stats.connections == 2
                await connecting.__aexit__(None, None, None)

    run(work())


def test_a_refusal_that_is_final_is_not_repeated(tmp_path: Path) -> None:
    """The scene is gone when the client comes back: it says so at once."""
    write_grid_scene(tmp_path / "grid")
    (tmp_path / "empty").mkdir()

    async def work() -> None:
        async with Proxy("http://127.0.0.1:1") as proxy:
            with BackgroundServer(tmp_path) as first, BackgroundServer(tmp_path / "empty") as other:
                proxy._target = ("127.0.0.1", first.port)
                async with terraport.connect(f"{proxy.url}/scenes/grid") as session:
                    proxy._target = ("127.0.0.1", other.port)
                    await proxy.cut()
                    with pytest.raises(ServerError) as caught:
                        await session.land(CENTRE)
                    assert caught.value.code == "unknown_scene"
                    assert session.stats.connections == 1

    run(work())
