"""Hands out the payload bytes of one scene to all of its clients: checked once, never copied twice.

A segment's hash is compared when it is first asked for, by whichever client comes first; from then
on its bytes go from the page cache to any number of sockets without this process touching them.
What is in the page cache is compared on the event loop: a megabyte takes a fortieth of a
millisecond there, and to hand it to a thread takes as long as others keep the interpreter. A client
that finds a wrong hash nevertheless says so (``reject``), and the segment is checked again.
Why not every time: ``docs/decisions/0017-payload-by-sendfile.md``.

The event loop's thread never waits for a disk: what is not in the page cache is read in a thread
first, once for all clients that want it at that moment.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from time import monotonic
from typing import Any, Final

from terraport_server.session.interface import SendChunk
from terraport_server.session.rate_limit import RatesByName
from terraport_store import RangeError, Scene, StoreError, read_cached

__all__ = ["COMPARED_AT_ONCE", "DOUBTS_PER_S", "LARGEST_COMPARED_BYTES", "PayloadDesk"]

DOUBTS_PER_S: Final = 2.0
"""Segments that one address may have compared again for everybody, averaged over 10 s: twenty at
once. A line or a cache that spoils more than that is the client's own."""

COMPARED_AT_ONCE: Final = 32
"""Segments whose hash is compared on the event loop for one batch: .4 ms."""

LARGEST_COMPARED_BYTES: Final = 1 << 20
"""Longest segment that is compared on the event loop; others in a thread."""

_AHEAD_BYTES: Final = 1 << 20
"""Of segments that were never sent: compared together, while one before them is on its way."""


class PayloadDesk:
    """The payloads of one open scene. Lives on one event loop.

    Parameters
    ----------
    scene
        Open while anybody holds it.
    readers
        Threads that may wait for the disk; those of the event loop by default.
    hold, release
        Keep the scene open, and let it go, around the work of a thread.
    fetchers
        Threads that may wait for a network; None for a scene on this machine. They are the scene's
        own, so that no other scene waits when its storage is slow.
    ahead_bytes
        What one client's landing is fetched ahead.
    """

    def __init__(
        self,
        scene: Scene,
        readers: Executor | None,
        *,
        hold: Callable[[], None],
        release: Callable[[], None],
        fetchers: Executor | None = None,
        ahead_bytes: int = 0,
    ) -> None:
        self.ahead_bytes = ahead_bytes
        """How much :meth:`expect` takes at a time; 0 = it is not to be called."""
        self._scene = scene
        self._readers = readers
        self._fetchers = fetchers
        self._hold = hold
        self._release = release
        self._fetching: dict[tuple[str, int, int], asyncio.Future[None]] = {}
        self._ahead: dict[tuple[str, int], asyncio.Future[None]] = {}
        self._doubters = RatesByName(DOUBTS_PER_S)

    def views(
        self,
        chunks: Sequence[SendChunk],
        encoding: str,
        *,
        by_system_call: bool,
        fetched: SendChunk | None = None,
    ) -> tuple[list[memoryview], int]:
        """Return the bytes of some chunks, up to the first that would have to wait.

        Segments that were never sent and are in the page cache are compared with their hash first,
        `COMPARED_AT_ONCE` at most.

        Parameters
        ----------
        chunks
        encoding
        by_system_call
            Whether only a system call reads the bytes: then they are not copied. See
            :meth:`PayloadSource.view`.
        fetched
            Chunk that :meth:`fetch` just brought into memory: it is read whatever that takes, since
            some file systems never say that they have it.

        Returns
        -------
        views : list
        compared : int
            Segments that were compared.
        """
        scene = self._scene
        views: list[memoryview] = []
        compared = 0
        for chunk in chunks:
            _, segment, offset, length, total, _ = chunk
            if not scene.is_verified(segment, encoding):
                if compared == COMPARED_AT_ONCE or not self._compare(segment, encoding, total):
                    break
                compared += 1
            view = scene.view(segment, encoding, offset, length) if by_system_call else None
            if view is None and (chunk == fetched or not by_system_call):
                view = self._copy(chunk, encoding, may_wait=chunk == fetched)
            if view is None:
                break
            views.append(view)
        return views, compared

    def _copy(self, chunk: SendChunk, encoding: str, *, may_wait: bool) -> memoryview | None:
        part = (chunk.segment, encoding, chunk.offset, chunk.length)
        where = self._scene.payload_range(*part)
        if where is not None:
            return read_cached(where, may_wait=may_wait)
        data = self._scene.held(*part)
        return None if data is None else memoryview(data)

    def _compare(self, segment: int, encoding: str, total: int) -> bool:
        """Compare a segment that is in memory; if it is wrong, :meth:`fetch` reports it."""
        where = self._scene.payload_range(segment, encoding, 0, total)
        data = None if where is None or total > LARGEST_COMPARED_BYTES else read_cached(where)
        return data is not None and self._scene.compare(segment, encoding, data)

    async def fetch(self, chunk: SendChunk, encoding: str, following: Sequence[int] = ()) -> None:
        """Bring the chunk's bytes into memory, and compare the segment's hash unless that was done.

        Cancelling it leaves the thread to finish for the others.

        Parameters
        ----------
        chunk
        encoding
        following
            Segments that will be asked for next: where the scene is a folder, those that were never
            sent are compared meanwhile, a megabyte of them together. One at a time, each was a wait
            for a thread that has the interpreter no sooner than others let go of it.

        Raises
        ------
        StoreError
            When the payload is not what the index says, or the pack is too short.
        OSError
            When the disk fails.
        """
        ahead = self._ahead.get((encoding, chunk.segment))
        if ahead is not None and not ahead.done():
            await asyncio.shield(ahead)
            if self._scene.is_verified(chunk.segment, encoding):
                return  # read just now, and right; else it is looked at again, and the fault told
        checked = self._scene.is_verified(chunk.segment, encoding)
        key = (encoding, chunk.segment, chunk.offset if checked else 0)
        fetching = self._fetching.get(key)
        if fetching is None:
            work = self._touch if checked else self._check
            self._hold()
            loop = asyncio.get_running_loop()
            if self._fetchers is None:
                fetching = loop.run_in_executor(self._readers, work, chunk, encoding)
            else:
                fetching = loop.create_task(self._bring(self._fetchers, work, chunk, encoding))
            self._fetching[key] = fetching
            fetching.add_done_callback(lambda done: self._fetched(key, done))
            if not checked and self._fetchers is None:
                self._check_ahead(following, encoding)
        await asyncio.shield(fetching)

    def _check_ahead(self, segments: Sequence[int], encoding: str) -> None:
        """Have hashes compared that will be asked for; what is wrong is told to who sends it."""
        lengths, left_bytes = self._scene.index_for(encoding).length, _AHEAD_BYTES
        unchecked: list[int] = []
        for segment in segments:
            if (
                (encoding, segment) in self._ahead
                or (encoding, segment, 0) in self._fetching
                or self._scene.is_verified(segment, encoding)
            ):
                continue
            left_bytes -= int(lengths[segment])
            if left_bytes < 0:
                break
            unchecked.append(segment)
        if not unchecked:
            return
        self._hold()
        work = asyncio.get_running_loop().run_in_executor(
            self._readers, self._check_all, unchecked, encoding
        )
        keys = [(encoding, segment) for segment in unchecked]
        self._ahead |= dict.fromkeys(keys, work)
        work.add_done_callback(lambda done: self._compared(keys, done))

    def expect(self, segments: Sequence[int], encoding: str) -> int:
        """Hear what a client will be sent next; the first of it is fetched ahead.

        Returns
        -------
        int
            Payload bytes that were taken note of, ``ahead_bytes`` or a little more.
        """
        lengths = self._scene.index_for(encoding).length
        total = count = 0
        for segment in segments:
            if total >= self.ahead_bytes:
                break
            total += int(lengths[segment])
            count += 1
        self._scene.expect(segments[:count], encoding)
        return total

    async def whole(self, segment: int) -> bytes | memoryview:
        """Return a whole GLB; its hash is compared unless that was done.

        Cancelling it leaves the thread to finish. Raises as :meth:`fetch`.
        """
        self._hold()
        reading = asyncio.ensure_future(self._whole(segment))
        reading.add_done_callback(self._ended)
        return await asyncio.shield(reading)

    async def _whole(self, segment: int) -> bytes | memoryview:
        scene, loop, readers = self._scene, asyncio.get_running_loop(), self._readers
        if self._fetchers is not None:
            recalled = await loop.run_in_executor(readers, scene.recall, segment, "glb")
            readers = readers if recalled else self._fetchers
        return await loop.run_in_executor(readers, scene.payload, segment)

    def doubted(self, segment: int, client: str) -> None:
        """Hear that a client rejects a segment: its hashes are compared again, within a rate.

        They are compared for everybody. Beyond the rate it is sent once more as it is.
        """
        if self._doubters.take(client, monotonic()):
            self.distrust(segment)

    def distrust(self, segment: int) -> None:
        """Compare the segment's hashes again before it is sent once more."""
        for encoding in self._scene.manifest.encodings:
            self._scene.distrust(segment, encoding)

    def _compared(self, keys: Iterable[tuple[str, int]], done: asyncio.Future[None]) -> None:
        for key in keys:
            del self._ahead[key]
        self._ended(done)

    def _fetched(self, key: tuple[str, int, int], done: asyncio.Future[None]) -> None:
        del self._fetching[key]
        self._ended(done)

    def _ended(self, done: asyncio.Future[Any]) -> None:
        self._release()
        if not done.cancelled():
            done.exception()  # seen, though whoever asked may have gone

    async def _bring(
        self,
        fetchers: Executor,
        work: Callable[[SendChunk, str], None],
        chunk: SendChunk,
        encoding: str,
    ) -> None:
        """Do the work where it may wait: what the local disk has is not held up by a network."""

        def work_if_local() -> bool:
            local = self._scene.recall(chunk.segment, encoding)
            if local:
                work(chunk, encoding)
            return local

        loop = asyncio.get_running_loop()
        if not await loop.run_in_executor(self._readers, work_if_local):
            await loop.run_in_executor(fetchers, work, chunk, encoding)

    def _check(self, chunk: SendChunk, encoding: str) -> None:
        self._scene.payload(chunk.segment, encoding)

    def _check_all(self, segments: Sequence[int], encoding: str) -> None:
        for segment in segments:
            with contextlib.suppress(StoreError, OSError):
                self._scene.payload(segment, encoding)

    def _touch(self, chunk: SendChunk, encoding: str) -> None:
        file_range = self._scene.payload_range(chunk.segment, encoding, chunk.offset, chunk.length)
        if file_range is None:
            self._scene.payload(chunk.segment, encoding)
            return
        got = len(os.pread(file_range.descriptor, file_range.length, file_range.offset))
        if got < file_range.length:
            self._scene.distrust(chunk.segment, encoding)
            raise RangeError(file_range.offset, file_range.length, file_range.offset + got)
