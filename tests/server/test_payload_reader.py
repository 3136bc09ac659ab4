"""Payloads handed to clients: checked once, from the file where it can be, never wrong bytes."""

from __future__ import annotations

import asyncio
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from server.grid_scene import GridScene, write_grid_scene

from terraport_server.scenes import payload_reader
from terraport_server.scenes.payload_reader import MAX_COMPARED
from terraport_server.scenes.served_scene import ServedScene
from terraport_server.session.interface import SendChunk
from terraport_store import CorruptPayloadError, RangeError


@pytest.fixture(scope="module")
def pit(tmp_path_factory: pytest.TempPathFactory) -> GridScene:
    return write_grid_scene(tmp_path_factory.mktemp("reader") / "pit", cells=4)


def opened(pit: GridScene) -> ServedScene:
    return ServedScene("pit", pit.path)


def flip(pit: GridScene, served: ServedScene, segment: int) -> None:
    """Flip one bit of a payload on the disk."""
    where = served.scene.payload_range(segment, "segment-2", 0, 1)
    assert where is not None
    pack = next(pit.path.glob("v-*/*.pack"))
    data = bytearray(pack.read_bytes())
    data[where.offset + 9] ^= 1
    pack.write_bytes(data)


def whole(pit: GridScene, segment: int) -> SendChunk:
    length = len(pit.payloads[segment])
    return SendChunk(1, segment, 0, length, length, landing=True)


def ready(served: ServedScene, chunk: SendChunk, *, by_system_call: bool = True) -> bytes | None:
    """Return a chunk that was compared before and is in memory."""
    if not served.scene.is_verified(chunk.segment, "segment-2"):
        return None
    views, _ = served.payloads.views([chunk], by_system_call=by_system_call)
    return bytes(views[0]) if views else None


@pytest.mark.parametrize("by_system_call", [True, False])
def test_a_part_of_a_segment_is_handed_out_once_it_was_checked(
    pit: GridScene, by_system_call: bool
) -> None:
    async def story() -> None:
        served = opened(pit)
        chunk = whole(pit, 3)
        await served.payloads.fetch(chunk)
        assert ready(served, chunk, by_system_call=by_system_call) == pit.payloads[3]
        within = chunk._replace(offset=10, length=20)
        assert ready(served, within, by_system_call=by_system_call) == pit.payloads[3][10:30]
        served.retire()
        assert served.closed

    asyncio.run(story())


def test_clients_that_want_the_same_wait_for_one_read(
    pit: GridScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And one of them going away takes nothing from the others; the scene stays open meanwhile."""

    async def story() -> None:
        reads: list[int] = []
        go = threading.Event()
        with ThreadPoolExecutor(4) as readers:
            served = ServedScene("pit", pit.path, readers)
            payload = served.scene.payload

            def slow(segment: int, *arguments: Any, **options: Any) -> bytes | memoryview:
                reads.append(segment)
                go.wait(10)
                return payload(segment, *arguments, **options)

            monkeypatch.setattr(served.scene, "payload", slow)
            chunk = whole(pit, 1)
            waiting = [asyncio.create_task(served.payloads.fetch(chunk)) for _ in range(5)]
            await asyncio.sleep(0.05)
            waiting[0].cancel()
            served.retire()
            assert not served.closed
            go.set()
            done = await asyncio.gather(*waiting, return_exceptions=True)
            assert isinstance(done[0], asyncio.CancelledError)
            assert done[1:] == [None] * 4
            assert reads == [1]
            await asyncio.sleep(0)
            assert served.closed

    asyncio.run(story())


def test_a_flipped_byte_is_found_at_first_and_after_distrust(tmp_path: Path) -> None:
    async def story() -> None:
        pit = write_grid_scene(tmp_path / "pit", cells=2)
        served = opened(pit)
        chunk = whole(pit, 2)
        await served.payloads.fetch(chunk)
        flip(pit, served, 2)
        assert ready(served, chunk) is not None  # when it was checked, it was right
        served.payloads.distrust(2)
        assert ready(served, chunk) is None
        with pytest.raises(CorruptPayloadError, match="segment 2 has hash"):
            await served.payloads.fetch(chunk)
        assert ready(served, chunk) is None
        served.retire()

    asyncio.run(story())


def test_rejects_without_end_have_few_segments_compared_again(tmp_path: Path) -> None:
    """Each had a segment's hash compared anew for everybody, as often as a client may speak."""

    async def story() -> None:
        pit = write_grid_scene(tmp_path / "pit", cells=8)
        served = opened(pit)
        for segment in range(36):
            await served.payloads.fetch(whole(pit, segment))
        for segment in range(36):
            served.payloads.reject(segment, "127.0.0.2")
        again = [
            segment for segment in range(36) if not served.scene.is_verified(segment, "segment-2")
        ]
        assert again == list(range(20))
        served.payloads.reject(35, "127.0.0.3")  # each address has its own
        assert not served.scene.is_verified(35, "segment-2")
        served.retire()

    asyncio.run(story())


def test_a_pack_cut_short_is_told(tmp_path: Path) -> None:
    async def story() -> None:
        pit = write_grid_scene(tmp_path / "pit", cells=2)
        served = opened(pit)
        last = len(pit.payloads) - 1
        chunk = whole(pit, last)
        await served.payloads.fetch(chunk)
        pack = next(pit.path.glob("v-*/*.pack"))
        os.truncate(pack, pack.stat().st_size - len(pit.payloads[last]))
        assert ready(served, chunk) is None
        assert ready(served, chunk, by_system_call=False) is None
        with pytest.raises(RangeError):
            await served.payloads.fetch(chunk)
        served.retire()

    asyncio.run(story())


def test_what_is_in_the_page_cache_waits_for_no_thread(tmp_path: Path) -> None:
    """Beside picks each job for a thread was a wait for the interpreter, of up to 40 ms."""

    class NoThreads(ThreadPoolExecutor):
        def submit(self, *_: Any, **__: Any) -> Any:
            raise AssertionError("a job for a thread, expected none")

    async def story() -> None:
        pit = write_grid_scene(tmp_path / "pit", cells=4)
        with NoThreads(1) as readers:
            served = ServedScene("pit", pit.path, readers)
            count = len(pit.payloads)
            assert count == MAX_COMPARED + 4
            chunks = [whole(pit, segment) for segment in range(count)]
            views, compared = served.payloads.views(chunks, by_system_call=True)
            assert (len(views), compared) == (MAX_COMPARED, MAX_COMPARED)
            views, compared = served.payloads.views(chunks, by_system_call=True)
            assert (len(views), compared) == (count, 4), "no segment is compared twice"
            assert [bytes(view) for view in views] == list(pit.payloads)
            served.retire()

    asyncio.run(story())


def test_nothing_wrong_or_too_long_is_handed_out_by_the_loop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def story() -> None:
        pit = write_grid_scene(tmp_path / "pit", cells=4)
        served = opened(pit)
        flip(pit, served, 2)
        chunks = [whole(pit, segment) for segment in range(4)]
        views, _ = served.payloads.views(chunks, by_system_call=True)
        assert len(views) == 2
        assert not served.scene.is_verified(2, "segment-2")
        with pytest.raises(CorruptPayloadError, match="segment 2 has hash"):
            await served.payloads.fetch(chunks[2])
        monkeypatch.setattr(payload_reader, "MAX_COMPARED_BYTES", len(pit.payloads[3]) - 1)
        assert served.payloads.views(chunks[3:], by_system_call=True) == ([], 0)
        served.retire()

    asyncio.run(story())
