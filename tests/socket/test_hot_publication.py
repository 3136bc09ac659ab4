"""A new version is published while clients land: old sessions finish on theirs, new ones get it."""

from __future__ import annotations

import asyncio
import gc
import random
import shutil
import weakref
from pathlib import Path

import httpx
from server.grid_scene import SIDE, TILE_M, GridScene, write_grid_scene

import terraport
from terraport_pipeline.upkeep.changing import move_scene, remove_scene
from terraport_server import BackgroundServer

CENTRE = (SIDE * TILE_M / 2, 1.0, SIDE * TILE_M / 2)
VERSIONS = 4


def test_publication_while_clients_land(tmp_path: Path) -> None:
    """Three publications under eight clients that never pause; every byte is of its version."""
    written: dict[str, GridScene] = {}
    scene = tmp_path / "scenes" / "pit"

    def publish(seed: int) -> GridScene:
        grid = write_grid_scene(scene, seed=seed)
        written[grid.manifest.version] = grid
        return grid

    first = publish(0)

    async def client(server: BackgroundServer, number: int, over: asyncio.Event) -> set[str]:
        """Land all the time; a client in two comes back for the new version when it hears of it."""
        chance = random.Random(number)
        seen: set[str] = set()
        while not over.is_set():
            async with terraport.connect(server.url, credit_bytes=100_000) as session:
                began_with = session.scene.version
                seen.add(began_with)
                while not over.is_set():
                    position = (chance.uniform(0, 60), 1.0, chance.uniform(0, 60))
                    landing = await session.land(position, radius_m=chance.uniform(5, 40))
                    segments = await landing.ready(20)
                    assert session.scene.version == began_with
                    payloads = written[began_with].payloads
                    assert all(segment.payload == payloads[segment.id] for segment in segments)
                    await asyncio.sleep(0.01)
                    if session.newest_version is not None and number % 2:
                        break
                assert session.stats.connections == 1
                assert session.stats.repeated_bytes == 0
                assert session.stats.rejected == 0
        return seen

    async def work(server: BackgroundServer) -> None:
        over = asyncio.Event()
        clients = [asyncio.create_task(client(server, number, over)) for number in range(8)]
        for seed in range(1, VERSIONS):
            await asyncio.sleep(0.4)
            newest = await asyncio.to_thread(publish, seed)
            async with asyncio.timeout(10), httpx.AsyncClient() as http:
                served = None
                while served != newest.manifest.version:
                    await asyncio.sleep(0.02)
                    served = (await http.get(server.scene_url("pit"))).json()["version"]
        await asyncio.sleep(0.4)
        over.set()
        seen = await asyncio.gather(*clients)
        assert all(versions == {first.manifest.version} for versions in seen[::2])
        assert all(versions == set(written) for versions in seen[1::2])

    with BackgroundServer(
        tmp_path / "scenes", scene_poll_s=0.05, max_messages_per_s=10_000
    ) as server:
        asyncio.run(asyncio.wait_for(work(server), 60))
        rejected = server.service.metrics.rejected_segments
        assert rejected.collect()[0].samples[0].value == 0


def test_the_old_version_can_be_deleted_and_leaves_nothing_behind(tmp_path: Path) -> None:
    """Its files go while a session still lands in it; with the session go memory and descriptors.

    Publishing replaces the scene's directory; a link in its place is how a place with history
    (releases side by side) publishes: both ways of deleting are looked at.
    """
    old = write_grid_scene(tmp_path / "v1", cells=24)
    new = write_grid_scene(tmp_path / "v2", seed=1, cells=24)
    scenes = tmp_path / "scenes"
    scenes.mkdir()
    (scenes / "pit").symlink_to(tmp_path / "v1", target_is_directory=True)

    async def work(server: BackgroundServer) -> None:
        async with terraport.connect(server.url) as session:
            await (await session.land((5.0, 1.0, 5.0), radius_m=4.0)).ready(10)
            served = weakref.ref(server.service.registry.get("pit"))
            (scenes / "next").symlink_to(tmp_path / "v2", target_is_directory=True)
            (scenes / "next").replace(scenes / "pit")
            async with asyncio.timeout(10):
                while session.newest_version is None:  # noqa: ASYNC110 - raises no event
                    await asyncio.sleep(0.01)
            shutil.rmtree(tmp_path / "v1")
            # Not landed in before, not read before: it comes from the file that has no name now.
            landing = await session.land(CENTRE, radius_m=100.0)
            segments = await landing.ready(20)
            assert {segment.id: segment.payload for segment in segments} == dict(
                enumerate(old.payloads)
            )
            async with terraport.connect(server.url) as other:
                landing = await other.land(CENTRE, radius_m=100.0)
                payloads = {segment.id: segment.payload for segment in await landing.ready(20)}
                assert payloads == dict(enumerate(new.payloads))
                assert _open_files(tmp_path / "v1") != []
        async with asyncio.timeout(10):
            while _open_files(tmp_path / "v1") or served() is not None:
                gc.collect()
                await asyncio.sleep(0.05)

    with BackgroundServer(scenes, scene_poll_s=0.05) as server:
        asyncio.run(asyncio.wait_for(work(server), 60))


def _open_files(below: Path) -> list[str]:
    """Files of a directory that this process holds open, deleted ones too."""
    paths = []
    for entry in Path("/proc/self/fd").iterdir():
        try:
            target = str(entry.readlink())
        except OSError:
            continue
        if target.startswith(f"{below}/"):
            paths.append(target)
    return paths


def test_a_scene_that_is_moved_or_removed_is_noticed(tmp_path: Path) -> None:
    """Served under its new name within seconds, then no more; who is in it goes on."""
    (tmp_path / "scenes").mkdir()
    grid = write_grid_scene(tmp_path / "scenes" / "pit", cells=2)

    async def work(server: BackgroundServer) -> None:
        async with httpx.AsyncClient(base_url=server.url) as http:

            async def served(*names: str) -> None:
                async with asyncio.timeout(10):
                    listed = None
                    while listed != [*names]:
                        await asyncio.sleep(0.02)
                        scenes = (await http.get("/scenes")).json()["scenes"]
                        listed = [scene["id"] for scene in scenes]

            await served("pit")
            async with terraport.connect(server.scene_url("pit")) as session:
                source, target = (str(tmp_path / "scenes" / name) for name in ("pit", "well"))
                await asyncio.to_thread(move_scene, source, target)
                await served("well")
                landing = await session.land(CENTRE, radius_m=500)
                assert len(await landing.ready(20)) == len(grid.payloads)
            await asyncio.to_thread(remove_scene, target, only_work=False)
            await served()

    with BackgroundServer(tmp_path / "scenes", scene_poll_s=0.05) as server:
        asyncio.run(work(server))
