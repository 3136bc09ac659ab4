"""Landings with a ring of the coarser level, over real sockets."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import numpy as np
import pytest
from server.grid_scene import SIDE, TILE_M, GridScene, write_grid_scene

import terraport
from terraport.errors import UsageError
from terraport_payload import box_distances_m
from terraport_payload.types import Float64
from terraport_server import BackgroundServer
from terraport_store import Scene

CENTRE = (SIDE * TILE_M / 2 + 2, 1.0, SIDE * TILE_M / 2 + 2)
CORNER = (1.0, 1.0, 1.0)
COUNT = SIDE * SIDE


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> GridScene:
    return write_grid_scene(tmp_path_factory.mktemp("served") / "two", levels=2)


@pytest.fixture(scope="module")
def served(two: GridScene) -> Iterator[str]:
    with BackgroundServer(two.path.parent) as server:
        yield server.scene_url("two")


def distances(two: GridScene, position: tuple[float, ...]) -> Float64:
    with Scene.open(two.path) as scene:
        return box_distances_m(scene.index.bounds, position)


def rows(two: GridScene, position: tuple[float, ...], full_m: float, ring_m: float) -> list[int]:
    away = distances(two, position)
    near = np.flatnonzero(away <= full_m)
    return [*near.tolist(), *(np.flatnonzero((away > full_m) & (away <= ring_m)) + COUNT).tolist()]


def test_a_ring_comes_at_the_coarser_level_and_hides_the_base(two: GridScene, served: str) -> None:
    async def work() -> None:
        async with terraport.connect(served) as session:
            assert (session.scene.segment_count, session.scene.levels) == (COUNT, 2)
            landing = await session.land(CENTRE, 6.0, coarse_radius_m=18.0)
            shown = await landing.ready(10)
            assert [segment.id for segment in shown] == rows(two, CENTRE, 6.0, 18.0)
            assert landing.plan.effective_radius_m == 18.0
            for segment in shown:
                assert segment.payload == two.payloads[segment.id]
            # A face of the grid's base lies under one segment, two faces to each.
            assert int(session.hidden_faces.sum()) == 2 * len(shown)

    asyncio.run(asyncio.wait_for(work(), 30))


def test_a_hop_exchanges_levels_and_sends_nothing_twice(two: GridScene, served: str) -> None:
    async def work() -> None:
        async with terraport.connect(served) as session:
            sent: set[int] = set()
            for position in (CENTRE, CORNER, CENTRE, CORNER):
                landing = await session.land(position, 6.0, coarse_radius_m=30.0)
                await landing.ready(10)
                wanted = rows(two, position, 6.0, 30.0)
                assert list(session.visible) == wanted
                load = set(landing.plan.load["id"].tolist())
                assert load == set(wanted) - sent
                sent |= load
            assert session.stats.repeated_bytes == 0

    asyncio.run(asyncio.wait_for(work(), 30))


def test_a_budget_cuts_the_ring_first_and_an_aim_fetches_it(two: GridScene, served: str) -> None:
    async def work() -> None:
        near = rows(two, CENTRE, 6.0, 6.0)
        async with terraport.connect(served, max_segments=len(near) + 2) as session:
            landing = await session.land(CENTRE, 6.0, coarse_radius_m=30.0)
            await landing.ready(10)
            visible = list(session.visible)
            assert visible[: len(near)] == near
            assert [row >= COUNT for row in visible[len(near) :]] == [True, True]
            assert landing.plan.omitted_by == "max_segments"
            assert 6.0 < landing.plan.effective_radius_m < 30.0
        async with terraport.connect(served) as session:
            session.aim(CENTRE, 6.0, coarse_radius_m=18.0)
            for _ in range(200):
                if session.stats.prefetched_bytes:
                    break
                await asyncio.sleep(0.02)
            await asyncio.sleep(0.2)
            landing = await session.land(CENTRE, 6.0, coarse_radius_m=18.0)
            await landing.ready(10)
            assert len(landing.plan.load) == 0
            with pytest.raises(UsageError, match="coarse_radius_m"):
                await session.land(CENTRE, 6.0, coarse_radius_m=5.0)

    asyncio.run(asyncio.wait_for(work(), 30))
