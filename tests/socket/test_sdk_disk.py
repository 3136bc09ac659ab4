"""The SDK's disk cache between runs, against the real service."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

from server.grid_scene import SIDE, TILE_M, GridScene

import terraport
from terraport_server import BackgroundServer

CENTRE = (SIDE * TILE_M / 2, 1.0, SIDE * TILE_M / 2)
CORNER = (1.0, 1.0, 1.0)


def run(work: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(work, 60))


def files(folder: Path, pattern: str) -> list[Path]:
    return sorted(folder.rglob(pattern))


def test_a_second_run_reads_from_disk(
    server: BackgroundServer, grid: GridScene, tmp_path: Path
) -> None:
    """No payload byte from the server; base mesh from disk too; same picture."""

    async def work() -> None:
        hashes = []
        for number in range(2):
            async with terraport.connect(server.scene_url("grid"), cache_dir=tmp_path) as session:
                landing = await session.land(CENTRE, radius_m=15.0)
                segments = await landing.ready(10)
                hashes.append(await session.visible_set_hash())
                await session.base()
                assert [s.payload for s in segments] == [grid.payloads[s.id] for s in segments]
                if number:
                    assert session.stats.payload_bytes == 0
                    assert {segment.source for segment in segments} == {"disk"}
                    assert landing.stats.disk_bytes == landing.plan.total_bytes
        assert hashes[0] == hashes[1]
        assert len(files(tmp_path, "base-*.gz")) == 1

    run(work())


def test_a_broken_file_is_sent_again_in_the_same_landing(
    server: BackgroundServer, grid: GridScene, tmp_path: Path
) -> None:
    """A flipped bit, a truncated file, a deleted file: found on reading, mended, whole."""

    async def work() -> None:
        async with terraport.connect(server.scene_url("grid"), cache_dir=tmp_path) as session:
            await (await session.land(CORNER, radius_m=25.0)).ready(10)
        flipped, cut, gone, *whole = files(tmp_path, "*.segment")
        assert whole
        flipped.write_bytes(flipped.read_bytes()[:-1] + b"?")
        cut.write_bytes(cut.read_bytes()[:200])
        connecting = terraport.connect(server.scene_url("grid"), cache_dir=tmp_path)
        async with connecting as session:
            gone.unlink()  # after the catalogue was read, as another process would
            landing = await session.land(CORNER, radius_m=25.0)
            segments = await landing.ready(10)
            assert landing.stats.rejected == 3
            assert landing.stats.streamed_segments == 3
            assert [s.payload for s in segments] == [grid.payloads[s.id] for s in segments]
        async with terraport.connect(server.scene_url("grid"), cache_dir=tmp_path) as session:
            landing = await session.land(CORNER, radius_m=25.0)
            await landing.ready(10)
            assert landing.stats.streamed_bytes == 0  # what was mended is on disk again

    run(work())


def test_a_small_disk_is_never_overfilled_and_nothing_is_missing(
    server: BackgroundServer, grid: GridScene, tmp_path: Path
) -> None:
    """The disk deletes while plans count on it: what is lost is sent again."""
    bound = 5 * max(map(len, grid.payloads))

    async def work() -> None:
        async with terraport.connect(
            server.scene_url("grid"),
            cache_dir=tmp_path,
            cache_bytes=0,
            max_bytes=1 << 30,
            disk_bytes=bound,
        ) as session:
            for number in range(20):
                position = (number * 17 % 60, 1.0, number * 23 % 60)
                landing = await session.land(position, radius_m=12.0)
                segments = await landing.ready(10)
                assert [s.payload for s in segments] == [grid.payloads[s.id] for s in segments]
            await session._worker.drained()
            assert sum(path.stat().st_size for path in files(tmp_path, "*.*")) <= bound

    run(work())
