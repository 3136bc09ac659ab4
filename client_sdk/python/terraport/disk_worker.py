"""The disk cache beside the event loop: reads before writes, one at a time, in a thread."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Final

from terraport.cache import CachedSegment, SegmentFacts
from terraport.disk_cache import DiskCache
from terraport.errors import CorruptSegmentError

__all__ = ["DiskWorker"]

_MAX_PENDING_BYTES: Final = 64 << 20
"""Payloads waiting to be written; of what comes while that many wait only the id is kept, and it
is written if memory still holds it when its turn comes."""


class DiskWorker:
    """Runs one session's disk cache.

    All methods but :meth:`run` belong to the session's event loop and return at once; the callbacks
    are called there.

    Parameters
    ----------
    disk : DiskCache
        From now on used by this worker alone (but for blobs, which are whole files).
    restored, lost
        Answer to :meth:`restore`, one of them for each segment.
    stored
        A segment is on disk.
    removed
        These were deleted to make room.
    in_memory
        What the memory cache holds of a segment; None where it holds nothing.
    """

    def __init__(
        self,
        disk: DiskCache,
        *,
        restored: Callable[[CachedSegment], None],
        lost: Callable[[int], None],
        stored: Callable[[SegmentFacts], None],
        removed: Callable[[list[int]], None],
        in_memory: Callable[[int], CachedSegment | None],
    ) -> None:
        self._disk = disk
        self._restored = restored
        self._lost = lost
        self._stored = stored
        self._removed = removed
        self._in_memory = in_memory
        self._reads: deque[tuple[int, int]] = deque()
        self._writes: deque[CachedSegment] = deque()
        self._deletions: deque[dict[int, int]] = deque()
        self._pending_bytes = 0
        self._later: dict[int, None] = {}  # ids, in order of their coming
        self._wake = asyncio.Event()
        self._idle = asyncio.Event()
        self._idle.set()

    def restore(self, segment: int, xxh3: int) -> None:
        """Read a segment; these go before everything else."""
        self._reads.append((segment, xxh3))
        self._work()

    def store(self, entry: CachedSegment) -> None:
        """Write a segment; where too much waits already, when that is written."""
        if self._pending_bytes + len(entry.payload) <= _MAX_PENDING_BYTES:
            self._pending_bytes += len(entry.payload)
            self._writes.append(entry)
        else:
            self._later[entry.facts.segment] = None
        self._work()

    def remove(self, segments: dict[int, int]) -> None:
        """Delete segments, given as xxh3 by id."""
        self._deletions.append(segments)
        self._work()

    async def drained(self) -> None:
        """Wait until nothing is left to do."""
        await self._idle.wait()

    async def run(self) -> None:
        """Work until cancelled. A call that is under way then finishes in its thread."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            while self._reads or self._writes or self._deletions or self._later:
                await self._step()
            self._idle.set()

    def _work(self) -> None:
        self._idle.clear()
        self._wake.set()

    async def _step(self) -> None:
        if self._reads:
            segment, xxh3 = self._reads.popleft()
            try:
                entry = await asyncio.to_thread(self._disk.get, segment, xxh3)
            except CorruptSegmentError:
                entry = None
            if entry is None:
                self._lost(segment)
            else:
                self._restored(entry)
        elif self._deletions:
            await asyncio.to_thread(self._disk.remove, self._deletions.popleft())
        elif self._writes:
            entry = self._writes.popleft()
            await self._put(entry)
            self._pending_bytes -= len(entry.payload)
        else:
            segment = next(iter(self._later))
            del self._later[segment]
            if (entry := self._in_memory(segment)) is not None:
                await self._put(entry)

    async def _put(self, entry: CachedSegment) -> None:
        removed = await asyncio.to_thread(self._disk.put, entry)
        if removed is not None:
            self._stored(entry.facts)
            if removed:
                self._removed(removed)
