"""The SDK over real sockets, against the real service."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from eventually import eventually
from hypothesis import example, given, settings
from hypothesis import strategies as st
from server.grid_scene import SIDE, STEP_M, TILE_M, GridScene, tile_mesh, write_grid_scene

import terraport
from terraport.errors import (
    ConnectionFailedError,
    HttpError,
    LandingIncompleteError,
    LandingTimeoutError,
    ServerError,
    SessionClosedError,
    UsageError,
)
from terraport_payload import box_distances_m
from terraport_server import BackgroundServer
from terraport_store import Scene

CENTRE = (SIDE * TILE_M / 2, 1.0, SIDE * TILE_M / 2)
CORNER = (1.0, 1.0, 1.0)
EVERYWHERE_M = 100.0


def run(work: Coroutine[Any, Any, None]) -> None:
    """Run one test's coroutine; nothing may take longer than this."""
    asyncio.run(asyncio.wait_for(work, 60))


def brute_force(grid: GridScene, position: tuple[float, ...], radius_m: float) -> list[int]:
    with Scene.open(grid.path) as scene:
        return np.flatnonzero(box_distances_m(scene.index.bounds, position) <= radius_m).tolist()


def test_a_landing_brings_every_segment_within_the_radius(
    server: BackgroundServer, grid: GridScene
) -> None:
    """Ids by brute force, bytes by the index, vertices to half a grid step, attributes too."""

    async def work() -> None:
        async with terraport.connect(server.scene_url("grid")) as session:
            assert session.scene.version == grid.manifest.version
            landing = await session.land(CENTRE, radius_m=12.0)
            segments = await landing.ready(10)
            assert [segment.id for segment in segments] == brute_force(grid, CENTRE, 12.0)
            assert session.visible == tuple(segment.id for segment in segments)
            assert sum(len(segment.payload) for segment in segments) == landing.plan.load_bytes
            assert landing.stats.streamed_bytes == landing.plan.load_bytes
            assert session.stats.payload_bytes == landing.plan.load_bytes
            for segment in segments:
                assert segment.payload == grid.payloads[segment.id]
                mesh, truth = segment.arrays(), tile_mesh(*divmod(segment.id, SIDE), 12)
                assert (segment.faces, segment.vertices) == (len(truth.faces), len(truth.positions))
                np.testing.assert_allclose(
                    np.sort(mesh.positions[:, 0]), np.sort(truth.positions[:, 0]), atol=STEP_M
                )
                np.testing.assert_allclose(
                    np.sort(mesh.attributes["grade"]),
                    np.sort(truth.attributes["grade"]),
                    atol=2.0**-10,
                )
                low, high = np.array(segment.bounds).reshape(2, 3)
                np.testing.assert_array_equal(mesh.positions.min(axis=0), low.astype(np.float32))
                np.testing.assert_array_equal(mesh.positions.max(axis=0), high.astype(np.float32))

    run(work())


def test_iteration_gives_each_segment_once_nearest_first(
    server: BackgroundServer, grid: GridScene
) -> None:
    async def work() -> None:
        async with terraport.connect(server.scene_url("grid")) as session:
            landing = await session.land(CORNER, radius_m=25.0)
            seen = [segment.id async for segment in landing]
            assert seen == landing.plan.load["id"].tolist()
            again = [segment.id async for segment in landing]
            assert again == seen
            landing = await session.land(CORNER, radius_m=40.0)
            sources = {segment.id: segment.source async for segment in landing}
            assert [sources[segment] for segment in seen] == ["memory"] * len(seen)
            assert sorted(sources) == brute_force(grid, CORNER, 40.0)

    run(work())


positions = st.tuples(st.floats(0, 60), st.floats(0, 2), st.floats(0, 60))


def test_after_every_hop_exactly_what_is_within_the_radius_is_shown(
    server: BackgroundServer, grid: GridScene
) -> None:
    """By brute force, with no room in memory but for that; the same place again takes no byte."""

    async def walk(hops: list[tuple[tuple[float, float, float], float]]) -> None:
        async with terraport.connect(
            server.scene_url("grid"), cache_bytes=0, max_bytes=1 << 30
        ) as session:
            for position, radius_m in hops:
                landing = await session.land(position, radius_m)
                segments = await landing.ready(10)
                within = brute_force(grid, position, radius_m)
                assert [segment.id for segment in segments] == within == list(session.visible)
                assert session.hidden_faces.sum() == 2 * len(within)
            again = await session.land(position, radius_m)
            await again.ready(10)
            assert again.plan.load_bytes == 0
            assert session.stats.repeated_bytes == 0

    # Inside: the scene's bytes are no argument to be printed.
    @settings(max_examples=10)
    @given(hops=st.lists(st.tuples(positions, st.floats(3, 25)), min_size=2, max_size=6))
    @example(hops=[(CENTRE, 25.0), ((40.0, 1.0, 35.0), 20.0), (CENTRE, 25.0)])
    def check(hops: list[tuple[tuple[float, float, float], float]]) -> None:
        run(walk(hops))

    check()


def test_a_newer_landing_supersedes_the_older(server: BackgroundServer, big: GridScene) -> None:
    """Everyone who waits for the older one is told; the newer is whole; no byte comes twice."""

    async def work() -> None:
        async with terraport.connect(server.scene_url("big"), credit_bytes=100_000) as session:
            first = await session.land(CENTRE, radius_m=EVERYWHERE_M)
            waiting = asyncio.create_task(first.ready())
            iterating = asyncio.create_task(_all(first))
            await _until(lambda: len(first.segments) >= 2)
            second = await session.land(CENTRE, radius_m=15.0)
            for task in (waiting, iterating):
                with pytest.raises(terraport.LandingSuperseded, match="superseded by landing 2"):
                    await task
            segments = await second.ready(20)
            assert [segment.id for segment in segments] == brute_force(big, CENTRE, 15.0)
            assert session.stats.repeated_bytes == 0
            assert len(first.segments) < len(big.payloads)

    run(work())


def test_base_and_hidden_faces(server: BackgroundServer) -> None:
    """Two base faces lie under each segment; hidden are those of the visible segments."""

    async def work() -> None:
        async with terraport.connect(server.scene_url("grid")) as session:
            first, second = await asyncio.gather(session.base(), session.base())
            assert first is second
            assert len(first.mesh.faces) == 2 * SIDE * SIDE
            landing = await session.land(CENTRE, radius_m=12.0)
            await landing.ready(10)
            hidden = landing.hidden_faces
            assert hidden.sum() == 2 * len(session.visible)
            assert (session.hidden_faces == hidden).all()
            model = terraport.mixed_model(
                first, {s.id: s.arrays() for s in landing.segments}, hidden
            )
            assert len(model.faces) == 72 - 2 * len(session.visible) + sum(
                segment.faces for segment in landing.segments
            )

    run(work())


def test_a_server_url_means_its_only_scene(tmp_path: Path, server: BackgroundServer) -> None:
    write_grid_scene(tmp_path / "alone")

    async def work() -> None:
        with BackgroundServer(tmp_path) as alone:
            async with terraport.connect(alone.url.replace("http", "ws")) as session:
                assert session.scene.id == "alone"
                assert session.url == f"{alone.url}/scenes/alone"
                assert (await session.manifest())["origin"][0] == 500_000.0
        with pytest.raises(UsageError, match="serves 3 scenes \\(big, feet, grid\\), expected one"):
            async with terraport.connect(server.url):
                pass

    run(work())


def test_refusals_have_their_own_errors(server: BackgroundServer) -> None:
    """A bad landing leaves the session whole; a wrong scene or nobody there ends the attempt."""

    async def work() -> None:
        async with terraport.connect(server.scene_url("grid")) as session:
            with pytest.raises(ServerError, match="radius_too_large") as caught:
                await session.land(CENTRE, radius_m=501.0)
            assert caught.value.code == "radius_too_large"
            with pytest.raises(UsageError):
                await session.land(CENTRE, radius_m=-1.0)
            await (await session.land(CENTRE, radius_m=1.0)).ready(10)
        with pytest.raises(ServerError) as caught:
            async with terraport.connect(server.scene_url("nowhere")):
                pass
        assert caught.value.code == "unknown_scene"
        with pytest.raises(ConnectionFailedError, match="after 1 attempt"):
            async with terraport.connect("http://127.0.0.1:9/scenes/grid"):
                pass
        with pytest.raises(HttpError, match="did not answer"):
            async with terraport.connect("http://127.0.0.1:9"):
                pass

    run(work())


def test_timeouts_and_cancelling_end_the_wait_alone(server: BackgroundServer) -> None:
    async def work() -> None:
        async with terraport.connect(server.scene_url("big"), credit_bytes=20_000) as session:
            landing = await session.land(CENTRE, radius_m=EVERYWHERE_M)
            with pytest.raises(LandingTimeoutError, match=r"of 36 segments after 0.001 s"):
                await landing.ready(0.001)
            waiting = asyncio.create_task(landing.ready())
            await asyncio.sleep(0)
            waiting.cancel()
            await asyncio.gather(waiting, return_exceptions=True)
            picking = asyncio.create_task(session.pick(CENTRE))
            await asyncio.sleep(0)
            picking.cancel()
            await asyncio.gather(picking, return_exceptions=True)
            assert len(await landing.ready(30)) == 36
            with pytest.raises(UsageError, match="timeout_s is -1"):
                await landing.ready(-1)

    run(work())


def test_a_closed_session_says_so_to_everyone(server: BackgroundServer) -> None:
    async def work() -> None:
        async with terraport.connect(server.scene_url("big"), credit_bytes=20_000) as session:
            landing = await session.land(CENTRE, radius_m=EVERYWHERE_M)
            waiting = asyncio.create_task(landing.ready())
            await asyncio.sleep(0)
        with pytest.raises(SessionClosedError, match="closed here"):
            await waiting
        with pytest.raises(SessionClosedError):
            await session.land(CENTRE)
        with pytest.raises(SessionClosedError):
            session.aim(CENTRE)
        await session.aclose()  # again: nothing happens
        assert [
            task for task in asyncio.all_tasks() if task.get_name().startswith("terraport")
        ] == []

    run(work())


def test_a_deadline_makes_the_inner_set_presentable(server: BackgroundServer) -> None:
    """With a credit that keeps the outer part waiting."""

    async def work() -> None:
        async with terraport.connect(server.scene_url("big"), credit_bytes=4_000) as session:
            landing = await session.land(
                (5.0, 1.0, 5.0), radius_m=EVERYWHERE_M, inner_radius_m=4.0, deadline_s=0.001
            )
            inner = await landing.presentable(20)
            assert [segment.id for segment in inner] == [0]
            assert not landing.is_ready
            assert landing.hidden_faces.sum() == 2
            assert session.visible == ()
            with pytest.raises(UsageError, match="with inner_radius_m"):
                await session.land(CENTRE, deadline_s=1.0)

    run(work())


def test_a_payload_that_is_broken_on_the_servers_disk_is_named(tmp_path: Path) -> None:
    """Never sent as good: the landing is ready but for it, and the base stays over it."""
    grid = write_grid_scene(tmp_path / "grid")
    with Scene.open(grid.path) as scene:
        pack, offset = scene.file_path("segments.pack"), int(scene.index.offset[0])
    with pack.open("r+b") as file:
        file.seek(offset + 100)
        byte = file.read(1)
        file.seek(offset + 100)
        file.write(bytes([byte[0] ^ 1]))

    async def work() -> None:
        with BackgroundServer(tmp_path) as server:
            async with terraport.connect(server.url) as session:
                landing = await session.land(CORNER, radius_m=15.0)
                with pytest.raises(LandingIncompleteError, match=r"ready but for 1 segment.*: 0$"):
                    await landing.ready(10)
                assert landing.missing == (0,)
                rest = await landing.ready(10, allow_missing=True)
                assert [segment.id for segment in rest] == [
                    segment for segment in brute_force(grid, CORNER, 15.0) if segment != 0
                ]
                assert session.hidden_faces.sum() == 2 * len(rest)
                with pytest.raises(LandingIncompleteError):
                    await _all(landing)

    run(work())


async def _all(landing: terraport.Landing) -> list[terraport.Segment]:
    return [segment async for segment in landing]


async def _until(reached) -> None:
    """Wait until something holds, looking again whenever the loop is free."""
    async with asyncio.timeout(20):
        while not reached():  # noqa: ASYNC110 - counters of the session raise no event
            await asyncio.sleep(0.002)


def test_a_first_connection_waits_for_a_service_that_is_replaced(tmp_path: Path) -> None:
    """It drains, is gone for a moment, and the next one answers; a wrong address fails at once."""
    write_grid_scene(tmp_path / "alone", cells=2)
    first = BackgroundServer(tmp_path, drain_timeout_s=20.0)
    first.start()
    url = f"{first.url}/scenes/alone"

    async def check() -> None:
        async with terraport.connect(url, credit_bytes=1) as holding:
            landing = await holding.land(CENTRE, EVERYWHERE_M)
            stopping = asyncio.create_task(asyncio.to_thread(first.stop))
            await asyncio.to_thread(eventually, lambda: first.service.draining)
            late = terraport.connect(url)
            connecting = asyncio.create_task(late.__aenter__())
            refused = first.service.metrics.refused.labels("draining")
            await asyncio.to_thread(eventually, lambda: refused._value.get() >= 1)
            assert not connecting.done()
            assert not landing.is_ready
        await stopping
        with BackgroundServer(tmp_path, port=first.port):
            session = await connecting
            assert session.scene.id == "alone"
            await late.__aexit__(None, None, None)
        with pytest.raises(ConnectionFailedError, match="after 1 attempt"):
            async with terraport.connect(url):
                pass

    run(check())


@pytest.mark.parametrize(
    ("budget", "total"),
    [("max_triangles", "total_triangles"), ("max_bytes", "total_bytes"), ("max_segments", None)],
)
def test_budgets_are_never_exceeded(server: BackgroundServer, budget: str, total: str) -> None:
    async def work() -> None:
        limit = {"max_triangles": 2000, "max_bytes": 6_000, "max_segments": 7}[budget]
        async with terraport.connect(server.scene_url("grid"), **{budget: limit}) as session:
            for position in (CENTRE, CORNER):
                landing = await session.land(position, radius_m=EVERYWHERE_M)
                await landing.ready(10)
                plan = landing.plan
                count = len(plan.show)
                assert (getattr(plan, total) if total else count) <= limit
                assert plan.omitted_by == budget
                assert plan.effective_radius_m < EVERYWHERE_M

    run(work())


def test_picks_find_the_ground_whether_loaded_or_not(server: BackgroundServer) -> None:
    async def work() -> None:
        async with terraport.connect(server.scene_url("grid")) as session:
            hits = await asyncio.gather(
                *(session.pick((x, 50.0, 5.0), (0, -1, 0)) for x in (5.0, 15.0, 25.0))
            )
            assert [hit.segment for hit in hits] == [0, 1, 2]
            assert hits[0].height_m == pytest.approx(100.0 + hits[0].position[1], abs=1e-6)
            assert hits[0].attributes["grade"] == pytest.approx(0.55, abs=0.01)
            assert await session.pick((-500.0, 0.0, 0.0)) is None
            with pytest.raises(UsageError, match="direction"):
                await session.pick(CENTRE, (0, 0, 0))

    run(work())


def test_tokens(scenes_dir: Path, token: str) -> None:
    """The right one opens stream and files; a wrong one is refused, and appears in no error."""

    async def work() -> None:
        with BackgroundServer(scenes_dir, token=token) as closed:
            url = closed.scene_url("grid")
            async with terraport.connect(url, token) as session:
                await (await session.land(CENTRE, radius_m=5.0)).ready(10)
                await session.base()
            for wrong in (None, "wrong-token-0123456789"):
                with pytest.raises(ServerError) as caught:
                    async with terraport.connect(url, wrong):
                        pass
                assert caught.value.code == "unauthorised"
                assert "wrong-token" not in str(caught.value)
            with pytest.raises(HttpError, match="answered 401"):
                async with terraport.connect(closed.url, "wrong-token-0123456789"):
                    pass

    run(work())
