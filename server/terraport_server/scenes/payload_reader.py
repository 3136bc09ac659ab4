"""Reader of the segment payloads of one scene, shared by all clients.

The hash of a segment is compared when the segment is first read, for whichever client that is. From
then on its bytes go from the page cache to any number of sockets, and this process does not read
them. Segments in the page cache are compared on the event loop: that takes 25 us per megabyte, less
than to hand it to a thread. A client that receives wrong bytes says so (`without`), and the
hash is compared again.

The event loop never waits for a disk: what is not in the page cache is read by a thread first, once
for all clients that wait for it.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from functools import partial
from time import monotonic
from typing import Any, Final

from terraport_server.session.interface import SendChunk
from terraport_server.session.rate_limit import RatesByName
from terraport_store import RangeError, Scene, read_cached
from terraport_store.layout import ENCODING

__all__ = ["MAX_COMPARED", "MAX_COMPARED_BYTES", "REJECTS_PER_S", "PayloadReader"]

REJECTS_PER_S: Final = 2.0
"""Rate of rejected segments per client address that are compared again, averaged over 10 s. More
are damaged on the client's own side."""

MAX_COMPARED: Final = 32
"""Maximum number of segments whose hash is compared on the event loop per batch: .4 ms."""

MAX_COMPARED_BYTES: Final = 1 << 20
"""Longest segment that is compared on the event loop; others in a thread."""

_PREFETCHED_BYTES: Final = 1 << 20
"""Bytes of following segments that the kernel reads from disk while the first one is fetched."""


class PayloadReader:
    """Payloads of one open scene. Used on one event loop.

    Parameters
    ----------
    scene
    readers
        Threads that may wait for the disk; those of the event loop by default.
    hold, release
        Called before and after the work of a thread, to keep the scene open.
    fetchers
        Threads of this scene that may wait for a network; None for a scene on this machine.
    ahead_bytes
        Bytes prefetched from the network for each landing; 0 = none.
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
        """Bytes that :meth:`expect` takes per call; 0 = it must not be called."""
        self._scene = scene
        self._readers = readers
        self._fetchers = fetchers
        self._hold = hold
        self._release = release
        self._fetching: dict[tuple[int, int], asyncio.Future[Any]] = {}
        """Reads in progress, by segment and offset."""
        self._rejects = RatesByName(REJECTS_PER_S)

    def views(
        self,
        chunks: Sequence[SendChunk],
        *,
        by_system_call: bool,
        fetched: SendChunk | None = None,
    ) -> tuple[list[memoryview], int]:
        """Return the bytes of some chunks, up to the first that would have to wait.

        Segments that were not compared yet and are in the page cache are compared first,
        `MAX_COMPARED` at most.

        Parameters
        ----------
        chunks
        by_system_call
            Whether only a system call reads the bytes: then they are not copied. See
            :meth:`PayloadSource.view`.
        fetched
            Chunk that :meth:`fetch` just brought into memory: it is read even if that waits, since
            some file systems never report it as cached.

        Returns
        -------
        views : list
        compared : int
            Number of segments that were compared.
        """
        scene = self._scene
        views: list[memoryview] = []
        compared = 0
        for chunk in chunks:
            _, segment, offset, length, total, _ = chunk
            if not scene.is_verified(segment):
                if compared == MAX_COMPARED or not self._compare(segment, total):
                    break
                compared += 1
            view = scene.view(segment, ENCODING, offset, length) if by_system_call else None
            if view is None:
                is_fetched = fetched is not None and chunk[:3] == fetched[:3]
                if is_fetched or not by_system_call:
                    view = self._copy(chunk, may_wait=is_fetched)
            if view is None:
                break
            views.append(view)
        return views, compared

    async def fetch(self, chunk: SendChunk, following: Sequence[int] = ()) -> None:
        """Bring a chunk into memory, and compare the segment's hash unless that was done.

        Cancelling it leaves the thread to finish for other clients.

        Parameters
        ----------
        chunk
        following
            Segments that will be read next: the kernel begins to read them, so that they are in the
            page cache when this is done.

        Raises
        ------
        StoreError
            When the payload does not match the index, or the pack is too short.
        OSError
            When the disk fails.
        """
        is_verified = self._scene.is_verified(chunk.segment)
        key = (chunk.segment, chunk.offset if is_verified else 0)
        fetching = self._fetching.get(key)
        if fetching is None:
            ahead: list[int] = []
            if self._fetchers is None:
                ahead = [*self._first(following, _PREFETCHED_BYTES)]

            def work() -> None:
                self._scene.expect(ahead, ENCODING)
                (self._touch if is_verified else self._check)(chunk)

            fetching = self._run(chunk.segment, work)
            self._fetching[key] = fetching
            fetching.add_done_callback(lambda _: self._fetching.pop(key))
        await asyncio.shield(fetching)

    def expect(self, segments: Sequence[int]) -> int:
        """Prefetch the first of the segments that a client will be sent, from object storage.

        Returns
        -------
        int
            Payload bytes that are prefetched: ``ahead_bytes`` or a little more, or all.
        """
        first = [*self._first(segments, self.ahead_bytes)]
        self._scene.expect(first, ENCODING)
        return int(self._scene.rows.length[first].sum())

    async def glb(self, segment: int, *, unlit: bool = False) -> bytes:
        """Return a segment as GLB, made in a reader thread; its hash is compared first.

        Cancelling it leaves the thread to finish.

        Raises
        ------
        PayloadError, StoreError
            When the payload is damaged, or does not match the index.
        OSError
            When the disk fails.
        """
        work = partial(self._scene.glb, segment, unlit=unlit)
        return await asyncio.shield(self._run(segment, work))

    def reject(self, segment: int, client: str) -> None:
        """Have a segment's hash compared again that a client cannot use, within a rate per client.

        Beyond the rate that is the client's own fault.
        """
        if self._rejects.take(client, monotonic()):
            self.distrust(segment)

    def distrust(self, segment: int) -> None:
        """Compare the segment's hash again before it is sent to any client."""
        self._scene.distrust(segment)

    def _first(self, segments: Sequence[int], most_bytes: int) -> Iterator[int]:
        """Yield segments until they have a number of bytes."""
        lengths = self._scene.rows.length
        for segment in segments:
            if most_bytes <= 0:
                return
            most_bytes -= int(lengths[segment])
            yield segment

    def _copy(self, chunk: SendChunk, *, may_wait: bool) -> memoryview | None:
        part = (chunk.segment, ENCODING, chunk.offset, chunk.length)
        where = self._scene.payload_range(*part)
        if where is not None:
            return read_cached(where, may_wait=may_wait)
        data = self._scene.held(*part)
        return None if data is None else memoryview(data)

    def _compare(self, segment: int, total: int) -> bool:
        """Compare a segment that is in memory; if it is wrong, :meth:`fetch` reports it."""
        where = self._scene.payload_range(segment, ENCODING, 0, total)
        data = None if where is None or total > MAX_COMPARED_BYTES else read_cached(where)
        return data is not None and self._scene.compare(segment, ENCODING, data)

    def _run(self, segment: int, work: Callable[[], Any]) -> asyncio.Future[Any]:
        """Run work that reads a segment in a thread, with the scene held open until its end."""
        self._hold()
        running = asyncio.ensure_future(self._in_thread(segment, work))
        running.add_done_callback(self._ended)
        return running

    async def _in_thread(self, segment: int, work: Callable[[], Any]) -> Any:
        """Run work in a reader thread; if it needs the network, in one of the scene's own."""
        loop, readers = asyncio.get_running_loop(), self._readers
        if self._fetchers is not None:
            recall = self._scene.recall
            if not await loop.run_in_executor(readers, recall, segment, ENCODING):
                readers = self._fetchers
        return await loop.run_in_executor(readers, work)

    def _ended(self, done: asyncio.Future[Any]) -> None:
        self._release()
        if not done.cancelled():
            done.exception()  # retrieved, in case every waiter was cancelled

    def _check(self, chunk: SendChunk) -> None:
        self._scene.payload(chunk.segment)

    def _touch(self, chunk: SendChunk) -> None:
        file_range = self._scene.payload_range(chunk.segment, ENCODING, chunk.offset, chunk.length)
        if file_range is None:
            self._scene.payload(chunk.segment)
            return
        got = len(os.pread(file_range.descriptor, file_range.length, file_range.offset))
        if got < file_range.length:
            self._scene.distrust(chunk.segment)
            raise RangeError(file_range.offset, file_range.length, file_range.offset + got)
