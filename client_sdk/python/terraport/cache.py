"""The client's memory of segments: a byte-bounded LRU with pins.

What is pinned (the visible segments, those of a plan on its way, and what the newest plan has
nearby) is never evicted; everything else goes, least recently used first, as soon as the bound is
exceeded. Pins may exceed the bound: a landing must be held whole, and its size is bounded by the
budgets of the landing instead.

PURE: no I/O, no clock. "Recently" is counted in accesses, not in time.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from terraport.errors import UsageError

__all__ = ["CachedSegment", "SegmentCache", "SegmentFacts"]


@dataclass(frozen=True, slots=True)
class SegmentFacts:
    """What the index says of one segment."""

    segment: int
    """Segment id."""
    length: int
    """Payload bytes."""
    xxh3: int
    """xxh3-64 of the payload."""
    faces: int
    vertices: int
    bounds: tuple[float, float, float, float, float, float]
    """min x, y, z, max x, y, z in metres, scene frame."""


@dataclass(frozen=True, slots=True)
class CachedSegment:
    """A payload with what is known of it."""

    facts: SegmentFacts
    payload: bytes = field(repr=False)


class SegmentCache:
    """Byte-bounded LRU of payloads with pins. Not thread-safe; owned by one session.

    Parameters
    ----------
    max_bytes : int
        Bound on the payload bytes kept beside what is pinned; 0 keeps pinned segments only.

    Examples
    --------
    >>> def payload(segment):
    ...     return CachedSegment(SegmentFacts(segment, 4, 0, 1, 3, (0, 0, 0, 1, 1, 1)), b"mesh")
    >>> cache = SegmentCache(max_bytes=8)
    >>> for segment in (1, 2, 3):
    ...     cache.put(payload(segment))
    >>> cache.pin([1])
    >>> [facts.segment for facts in cache.trim()]
    [2]
    """

    __slots__ = ("_bytes", "_entries", "_max_bytes", "_pinned")

    def __init__(self, max_bytes: int) -> None:
        if max_bytes < 0:
            raise UsageError(f"cache bound is {max_bytes} bytes, expected 0 or more")
        self._max_bytes = max_bytes
        self._entries: OrderedDict[int, CachedSegment] = OrderedDict()
        self._pinned: frozenset[int] = frozenset()
        self._bytes = 0

    @property
    def max_bytes(self) -> int:
        """The bound."""
        return self._max_bytes

    @property
    def bytes(self) -> int:
        """Payload bytes held now, pinned ones included."""
        return self._bytes

    @property
    def pinned(self) -> frozenset[int]:
        """Ids that are not evicted, held or not."""
        return self._pinned

    def __len__(self) -> int:
        return len(self._entries)

    def __contains__(self, segment: int) -> bool:
        return segment in self._entries

    def __iter__(self) -> Iterator[int]:
        """Ids held, least recently used first."""
        return iter(self._entries)

    def get(self, segment: int) -> CachedSegment | None:
        """Return the entry and make it the most recently used; None when it is not held."""
        entry = self._entries.get(segment)
        if entry is not None:
            self._entries.move_to_end(segment)
        return entry

    def peek(self, segment: int) -> CachedSegment | None:
        """Return the entry without changing its age."""
        return self._entries.get(segment)

    def put(self, entry: CachedSegment) -> None:
        """Add (or replace) a payload as the most recently used; evicts nothing.

        Eviction is a step of its own, :meth:`trim`: between a ``land`` and its ``plan`` nothing may
        be evicted, because the plan may count on it.
        """
        self.discard(entry.facts.segment)
        self._entries[entry.facts.segment] = entry
        self._bytes += len(entry.payload)

    def discard(self, segment: int) -> bool:
        """Drop one entry, pinned or not; return whether it was held."""
        entry = self._entries.pop(segment, None)
        if entry is None:
            return False
        self._bytes -= len(entry.payload)
        return True

    def pin(self, segments: Iterable[int]) -> None:
        """Make exactly these ids the pinned ones. Evicts nothing; call :meth:`trim` for that."""
        self._pinned = frozenset(segments)

    def trim(self) -> list[SegmentFacts]:
        """Evict unpinned entries, least recently used first, until the bound holds or none is left.

        Returns
        -------
        list of SegmentFacts
            What was evicted, in that order.
        """
        if self._bytes <= self._max_bytes:
            return []
        evicted = []
        for segment in [segment for segment in self._entries if segment not in self._pinned]:
            if self._bytes <= self._max_bytes:
                break
            evicted.append(self._entries[segment].facts)
            self.discard(segment)
        return evicted
