"""The service is killed in the middle of landings: clients come back to the next one."""

from __future__ import annotations

import asyncio

import pytest
from faults.service import Service
from server.grid_scene import SIDE, TILE_M, GridScene, write_grid_scene

import terraport
from terraport import backoff

CENTRE = (SIDE * TILE_M / 2, 1.0, SIDE * TILE_M / 2)
EVERYWHERE_M = 100.0
CLIENTS = 2
KILLS = 2
EACH = 3
"""Segments that every client gets between two kills, of 36."""


@pytest.fixture(scope="module")
def big(tmp_path_factory: pytest.TempPathFactory) -> GridScene:
    """36 segments of about 300 KB."""
    scenes = tmp_path_factory.mktemp("s") / "scenes"
    return write_grid_scene(scenes / "big", cells=80)


def test_killed_in_a_landing_and_started_again(
    big: GridScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every segment comes whole, exactly once; what was whole before a kill is not sent again.

    A small credit makes the landings long: a thousand grants each.
    """
    monkeypatch.setattr(backoff, "FIRST_WAIT_S", 0.05)
    total = sum(map(len, big.payloads))

    async def client(url: str, arrived: asyncio.Semaphore) -> None:
        async with terraport.connect(f"{url}/scenes/big", credit_bytes=20_000) as session:
            landing = await session.land(CENTRE, radius_m=EVERYWHERE_M)
            async for _ in landing:
                arrived.release()
            segments = await landing.ready(30)
            # In order of arrival; a landing that was planned anew begins at the centre again.
            payloads = {segment.id: segment.payload for segment in segments}
            assert [payloads[number] for number in range(SIDE * SIDE)] == big.payloads
            assert len(segments) == SIDE * SIDE
            # Whoever is done before the second kill has seen only one.
            assert 2 <= session.stats.connections <= 1 + KILLS
            assert session.stats.repeated_bytes == 0
            assert session.stats.payload_bytes == total

    async def work() -> None:
        with Service(big.path.parent) as service:
            arrived = [asyncio.Semaphore(0) for _ in range(CLIENTS)]
            tasks = [asyncio.create_task(client(service.url, arrival)) for arrival in arrived]
            for _ in range(KILLS):
                for arrival in arrived:
                    for _ in range(EACH):
                        await arrival.acquire()
                service.kill()
                await asyncio.to_thread(service.start)
            await asyncio.gather(*tasks)

    asyncio.run(asyncio.wait_for(work(), 90))
