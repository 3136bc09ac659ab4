"""What the client holds, in memory and on disk, and what the server must be told of it.

A segment is held while memory or disk has it. One that neither has any more must be named in an
``evict`` before the next ``land`` or ``aim`` (wire protocol, section 6.7): the server counts on
what it once sent.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

import numpy as np

from terraport.cache import CachedSegment, SegmentCache
from terraport_payload.types import AnyArray
from terraport_wire import HELD_DTYPE, ID_DTYPE, MAX_HELD_SEGMENTS, Evict

__all__ = ["Holdings"]


class Holdings:
    """Memory cache, the disk's catalogue, and the evictions that the server does not know yet.

    Parameters
    ----------
    cache : SegmentCache
        Payloads in memory.
    on_disk : mapping of int to int, optional
        xxh3 by segment id of what the disk holds.
    """

    __slots__ = ("_cache", "_disk", "_gone")

    def __init__(self, cache: SegmentCache, on_disk: Mapping[int, int] | None = None) -> None:
        self._cache = cache
        self._disk = dict(on_disk or {})
        self._gone: dict[int, int] = {}  # id to xxh3: dropped here, and the server not told yet

    @property
    def cache_bytes(self) -> int:
        """Payload bytes in memory."""
        return self._cache.bytes

    def __contains__(self, segment: int) -> bool:
        return segment in self._cache or segment in self._disk

    def in_memory(self, segment: int) -> bool:
        """Whether the payload is in memory."""
        return segment in self._cache

    def on_disk(self, segment: int) -> bool:
        """Whether the disk's catalogue has it."""
        return segment in self._disk

    def recall(self, segment: int) -> CachedSegment | None:
        """Return it from memory as the most recently used; None when memory does not have it."""
        return self._cache.get(segment)

    def peek(self, segment: int) -> CachedSegment | None:
        """Return it from memory without changing its age."""
        return self._cache.peek(segment)

    def hash_of(self, segment: int) -> int | None:
        """Return the xxh3 of what is held, or was until the server is told; None for neither."""
        entry = self._cache.peek(segment)
        if entry is not None:
            return entry.facts.xxh3
        return self._disk.get(segment, self._gone.get(segment))

    def disk_hashes(self, segments: Iterable[int]) -> tuple[tuple[int, int], ...]:
        """Return id and xxh3 of those of the segments that the disk has."""
        return tuple(
            (segment, self._disk[segment]) for segment in segments if segment in self._disk
        )

    def put(self, entry: CachedSegment, *, trim: bool) -> None:
        """Hold a payload in memory; `trim` False defers eviction."""
        self._gone.pop(entry.facts.segment, None)
        self._cache.put(entry)
        if trim:
            self.trim()

    def pin(self, segments: Iterable[int]) -> None:
        """Make exactly these the ones that memory must not evict."""
        self._cache.pin(segments)

    def trim(self) -> None:
        """Evict from memory down to its bound."""
        for facts in self._cache.trim():
            if facts.segment not in self._disk:
                self._gone[facts.segment] = facts.xxh3

    def add_disk(self, segment: int, xxh3: int) -> None:
        """Note that the disk has a segment."""
        self._disk[segment] = xxh3

    def drop_disk(self, segment: int) -> None:
        """Note that the disk no longer has a segment."""
        xxh3 = self._disk.pop(segment, None)
        if xxh3 is not None and segment not in self._cache:
            self._gone[segment] = xxh3

    def forget(self, segments: Iterable[int]) -> None:
        """Drop segments that the server knows to be gone: dropped by it, or rejected."""
        for segment in segments:
            self._cache.discard(segment)
            self._disk.pop(segment, None)
            self._gone.pop(segment, None)

    def evictions(self, spared: Collection[int]) -> list[Evict]:
        """Return, once, the messages that tell the server what is gone.

        Parameters
        ----------
        spared : collection of int
            Ids of a plan that is not ready: these must not be evicted now and are told later.
        """
        ids = sorted(segment for segment in self._gone if segment not in spared)
        for segment in ids:
            del self._gone[segment]
        return [
            Evict(segments=np.array(ids[start : start + MAX_HELD_SEGMENTS], dtype=ID_DTYPE))
            for start in range(0, len(ids), MAX_HELD_SEGMENTS)
        ]

    def offer(self) -> AnyArray:
        """Return the held table of ``hello`` and take every eviction as told by it.

        Memory first, most recently used first, then the disk. What does not fit into one message
        goes into the ``held`` messages after it.
        """
        self._gone.clear()
        rows: dict[int, int] = {}
        for segment in reversed(list(self._cache)):
            entry = self._cache.peek(segment)
            assert entry is not None
            rows[segment] = entry.facts.xxh3
        for segment, xxh3 in self._disk.items():
            rows.setdefault(segment, xxh3)
        return np.array(list(rows.items()), dtype=HELD_DTYPE)
