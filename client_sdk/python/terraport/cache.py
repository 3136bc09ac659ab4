"""In-memory cache of payloads by key: least recently used first, bounded in bytes.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

from terraport.errors import UsageError

__all__ = ["Box", "CachedSegment", "SegmentCache"]

Box = tuple[float, float, float, float, float, float]
"""Least x, y, z, then greatest; metres, scene frame."""


@dataclass(frozen=True, slots=True)
class CachedSegment:
    """A payload whose checksums are right."""

    key: int
    """Content key: equal in all versions of the scene that have this payload."""
    box: Box
    payload: bytes = field(repr=False)


class SegmentCache:
    """Byte-bounded LRU of payloads. Not thread-safe; owned by one session.

    Parameters
    ----------
    max_bytes : int
        Maximum payload bytes, in addition to what :meth:`trim` must keep.

    Examples
    --------
    >>> box = (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
    >>> cache = SegmentCache(max_bytes=8)
    >>> for key in (1, 2, 3):
    ...     cache.put(CachedSegment(key, box, b"mesh"))
    >>> cache.trim(keep={1})
    >>> list(cache)
    [1, 3]
    """

    __slots__ = ("_entries", "_max_bytes", "bytes")

    def __init__(self, max_bytes: int) -> None:
        if max_bytes < 0:
            raise UsageError(f"cache bound is {max_bytes} bytes, expected 0 or more")
        self._max_bytes = max_bytes
        self._entries: OrderedDict[int, CachedSegment] = OrderedDict()
        self.bytes = 0
        """Payload bytes held now."""

    def __contains__(self, key: int) -> bool:
        return key in self._entries

    def __iter__(self) -> Iterator[int]:
        """Keys, least recently used first."""
        return iter(self._entries)

    def get(self, key: int) -> CachedSegment | None:
        """Return an entry and make it the most recently used; None when it is not held."""
        entry = self._entries.get(key)
        if entry is not None:
            self._entries.move_to_end(key)
        return entry

    def peek(self, key: int) -> CachedSegment | None:
        """Return an entry without changing its age."""
        return self._entries.get(key)

    def put(self, entry: CachedSegment) -> None:
        """Add or replace a payload as the most recently used; evicts nothing."""
        before = self._entries.pop(entry.key, None)
        self.bytes += len(entry.payload) - (0 if before is None else len(before.payload))
        self._entries[entry.key] = entry

    @property
    def is_full(self) -> bool:
        """Whether :meth:`trim` has something to do."""
        return self.bytes > self._max_bytes

    def trim(self, keep: Collection[int]) -> None:
        """Evict what is not in `keep` until the bound holds or nothing else is left."""
        for key in [key for key in self._entries if key not in keep]:
            if not self.is_full:
                return
            self.bytes -= len(self._entries.pop(key).payload)
