"""A pack in object storage: payloads by range requests, checked, kept, and read ahead.

What is read is a payload or a part of one, so that is what is fetched and kept. Every payload is
compared with its hash before anyone sees it: when it comes from the network (a wrong one is asked
for once more), when its cache file is opened, and whenever :meth:`RemoteSource.read` is asked.

Payloads that will be wanted soon are fetched in groups: neighbours in the pack by one request,
several requests at once. Whoever needs a payload of a group that has not begun begins it himself;
so nobody waits behind what others may want later.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import numpy as np
import xxhash

from terraport_store.byte_cache import ByteCache, CacheKey
from terraport_store.errors import CorruptPayloadError, OriginError, StoreError
from terraport_store.index import SegmentIndex
from terraport_store.origin import Origin
from terraport_store.shelf import Shelf
from terraport_store.source import PayloadRange, check_range, read_cached

__all__ = ["RemoteSource"]

MAX_GROUP_BYTES: Final = 1 << 20
"""One request of several payloads: 10 ms at 100 MB/s, so the first of them is not held up much."""

MAX_GAP_BYTES: Final = 64 << 10
"""Bytes nobody asked for that are fetched rather than asking twice: 1 ms at 60 MB/s, and requests
take 5 to 50."""

_AHEAD_LANDINGS: Final = 8
"""Landings whose read-ahead may wait at once; hints beyond it are dropped, which costs speed."""


class _Group:
    """Neighbouring payloads fetched by one request."""

    __slots__ = ("begun", "done", "error", "found", "pieces", "wrong")

    def __init__(self, pieces: list[int]) -> None:
        self.pieces = pieces
        self.begun = False
        self.done = threading.Event()
        self.found: dict[int, bytes] = {}
        self.wrong: dict[int, StoreError] = {}
        self.error: Exception | None = None


class RemoteSource:
    """Reads a pack by range requests; see :class:`~terraport_store.source.PayloadSource`.

    Parameters
    ----------
    origin : Origin
        The scene's place.
    path : str
        The pack, relative to it.
    size : int
        Bytes of the pack.
    index : SegmentIndex
        Where its payloads lie, and their hashes.
    shelf : Shelf
        What is at hand; shared with other packs.
    cache : ByteCache or None
        On disk; shared with other packs and processes.
    scope : str
        Keeps the scene's entries from other scenes'.
    """

    def __init__(
        self,
        origin: Origin,
        path: str,
        size: int,
        index: SegmentIndex,
        *,
        shelf: Shelf,
        cache: ByteCache | None,
        scope: str,
    ) -> None:
        self._origin = origin
        self._path = path
        self._size = size
        self._offsets, self._lengths, self._hashes = index.offset, index.length, index.xxh3
        self._shelf = shelf
        self._cache = cache
        self._scope = scope
        self._counts = origin.counts
        options = origin.options
        # Without a disk, what is read ahead must fit into memory beside what is being sent.
        room = 1 << 62 if cache is not None else options.memory_bytes // 2
        self._ahead_bound = min(_AHEAD_LANDINGS * options.read_ahead_bytes, room)
        self._ahead_bytes = 0
        self._groups: dict[int, _Group] = {}
        self._lock = threading.Lock()
        self._crew = ThreadPoolExecutor(options.requests, thread_name_prefix="ahead")
        self._closed = False

    @property
    def size(self) -> int:
        """Length of the whole pack, bytes."""
        return self._size

    def read(self, offset: int, length: int) -> bytes | memoryview:
        """Read exactly *length* bytes; see :class:`PayloadSource`.

        Raises
        ------
        RangeError
            When the bytes do not all lie inside the source.
        CorruptPayloadError
            When what lies there does not have the index's hash, twice.
        OriginError
            When it could not be had within the time allowed.
        FileNotFoundError
            When there is no such pack any more.
        """
        check_range(offset, length, self._size)
        if not length:
            return b""
        piece = self._piece(offset, length)
        if piece is None:
            return self._origin.range(self._path, offset, length)
        data = self._payload(piece)
        start = offset - int(self._offsets[piece])
        return data if length == len(data) else memoryview(data)[start : start + length]

    def file_range(self, offset: int, length: int) -> PayloadRange | None:
        """Tell where in the cache the bytes lie; None where no open file has them."""
        check_range(offset, length, self._size)
        piece = self._piece(offset, length)
        file = None if piece is None else self._shelf.file(self._key(piece))
        if piece is None or file is None:
            return None
        return PayloadRange(file.descriptor, offset - int(self._offsets[piece]), length, file)

    def held(self, offset: int, length: int) -> memoryview | None:
        """Return bytes that are in memory; see :class:`PayloadSource`."""
        piece = self._piece(offset, length)
        data = None if piece is None else self._shelf.payload(self._key(piece))
        if piece is None or data is None:
            return None
        start = offset - int(self._offsets[piece])
        return memoryview(data)[start : start + length]

    def view(self, offset: int, length: int) -> memoryview | None:
        """Return bytes from memory or the cache file; see :class:`PayloadSource`."""
        where = self.file_range(offset, length)
        return self.held(offset, length) if where is None else read_cached(where)

    def recall(self, offset: int, length: int) -> bool:
        """Open the payload's cache file, if there is one."""
        piece = self._piece(offset, length)
        return piece is not None and self._recall(self._key(piece))

    @property
    def checks_hashes(self) -> bool:
        """Return True; see :class:`PayloadSource`."""
        return True

    def distrust(self, offset: int, length: int) -> None:
        """Open the payload's cache file anew before it is handed out again."""
        piece = self._piece(offset, length)
        if piece is not None:
            self._shelf.drop(self._key(piece))

    def expect(self, ranges: Sequence[tuple[int, int]]) -> None:
        """Fetch what is not kept, in the background; see :class:`PayloadSource`."""
        pieces = []
        for offset, length in ranges:
            piece = self._piece(offset, length)
            if piece is None or self._shelf.has(self._key(piece)):
                continue
            if piece not in self._groups:
                pieces.append(piece)
        if pieces and self._ahead_bytes < self._ahead_bound:
            self._submit(self._plan_ahead, pieces)

    def interrupt(self) -> None:
        """Let what waits fail soon, and take no more hints."""
        self._closed = True
        self._origin.interrupt()
        self._crew.shutdown(wait=False, cancel_futures=True)

    def close(self) -> None:
        """End what is under way; may be called again."""
        self.interrupt()
        with self._lock:
            waiting = {id(group): group for group in self._groups.values() if not group.begun}
            self._groups.clear()
        for group in waiting.values():
            group.error = OriginError(self._origin.url, "closed while it was waited for")
            group.done.set()

    def _payload(self, piece: int) -> bytes:
        """One whole payload whose hash is right."""
        key = self._key(piece)
        while True:
            data = self._shelf.payload(key)
            if data is not None:
                return data
            file = self._shelf.file(key)
            if file is not None or self._recall(key):
                file = file or self._shelf.file(key)
                data = b"" if file is None else file.read()
                if xxhash.xxh3_64_intdigest(data) == key.xxh3:
                    return data
                # Rotten since it was opened: others must not have it either.
                self._counts.add(wrong=1)
                self._shelf.drop(key)
                if self._cache is not None:
                    self._cache.discard(key)
            data = self._fetch(piece)
            if data is not None:
                return data

    def _recall(self, key: CacheKey) -> bool:
        if self._shelf.has(key):
            return True
        file = None if self._cache is None else self._cache.open(key)
        if file is None:
            return False
        self._counts.add(payloads_from_disk=1)
        self._shelf.add(key, file)
        return True

    def _fetch(self, piece: int) -> bytes | None:
        """Fetch one payload now, or wait for whoever is at it; None: look again."""
        with self._lock:
            group = self._groups.get(piece)
            mine = group is None or not group.begun
            if group is None:
                group = _Group([piece])
                self._groups[piece] = group
                self._ahead_bytes += self._span(group)[1]
            group.begun = True
        if mine:
            self._run(group)
        else:
            group.done.wait()
        if piece in group.found:
            return group.found[piece]
        if piece in group.wrong:
            raise group.wrong[piece]
        if group.error is not None:
            raise group.error
        return None

    def _plan_ahead(self, pieces: list[int]) -> None:
        """Open what is kept; put the other payloads into groups, and have them fetched."""
        if self._cache is not None:
            pieces = self._open_ahead(self._cache, pieces)
        order = {piece: rank for rank, piece in enumerate(pieces)}
        groups: list[_Group] = []
        with self._lock:
            for piece in sorted(set(pieces) - self._groups.keys()):
                last = groups[-1] if groups else None
                if last is None or not self._may_join(last, piece):
                    last = _Group([])
                    groups.append(last)
                last.pieces.append(piece)
                self._groups[piece] = last
            self._ahead_bytes += sum(self._span(group)[1] for group in groups)
        # What is wanted first is fetched first.
        for group in sorted(groups, key=lambda group: min(order[piece] for piece in group.pieces)):
            self._submit(self._run_if_waiting, group)

    def _open_ahead(self, cache: ByteCache, pieces: list[int]) -> list[int]:
        """Open the first payloads that are kept; return those that are not."""
        missing = []
        room = self._shelf.max_files // 4  # what is opened must still be open when it is sent
        for piece in pieces:
            key = self._key(piece)
            if room > 0 and self._recall(key):
                room -= 1
            elif not cache.has(key):
                missing.append(piece)
        return missing

    def _may_join(self, group: _Group, piece: int) -> bool:
        first, last = group.pieces[0], group.pieces[-1]
        begin, end = int(self._offsets[first]), int(self._offsets[last] + self._lengths[last])
        start, stop = int(self._offsets[piece]), int(self._offsets[piece] + self._lengths[piece])
        return start - end <= MAX_GAP_BYTES and stop - begin <= MAX_GROUP_BYTES

    def _run_if_waiting(self, group: _Group) -> None:
        with self._lock:
            if group.begun:
                return
            group.begun = True
        self._run(group)

    def _run(self, group: _Group) -> None:
        """Fetch a group, check it, keep it. Never raises: the group says what went wrong."""
        start, length = self._span(group)
        try:
            data = memoryview(self._origin.range(self._path, start, length))
            for piece in group.pieces:
                offset = int(self._offsets[piece]) - start
                self._take(group, piece, bytes(data[offset : offset + int(self._lengths[piece])]))
        except Exception as error:  # noqa: BLE001 - raised in whoever waits for it
            group.error = error
        finally:
            with self._lock:
                for piece in group.pieces:
                    self._groups.pop(piece, None)
                self._ahead_bytes -= length
            group.done.set()

    def _take(self, group: _Group, piece: int, data: bytes) -> None:
        key = self._key(piece)
        actual = xxhash.xxh3_64_intdigest(data)
        if actual != key.xxh3:  # the network's fault, perhaps
            self._counts.add(wrong=1)
            offset = int(self._offsets[piece])
            try:
                data = self._origin.range(self._path, offset, key.length)
            except (StoreError, OSError) as error:
                group.wrong[piece] = (
                    error
                    if isinstance(error, StoreError)
                    else OriginError(self._origin.url, str(error))
                )
                return
            actual = xxhash.xxh3_64_intdigest(data)
            if actual != key.xxh3:
                self._counts.add(wrong=1)
                group.wrong[piece] = CorruptPayloadError(
                    piece, offset, key.xxh3, actual, file=self._path
                )
                return
        group.found[piece] = data
        self._counts.add(payloads_fetched=1)
        if self._cache is not None:
            try:
                self._shelf.add(key, self._cache.put(key, data))
            except OSError:
                self._counts.add(uncached=1)
            else:
                return
        self._shelf.add(key, data)

    def _submit(self, work: object, *arguments: object) -> None:
        try:
            self._crew.submit(work, *arguments)  # type: ignore[arg-type]
        except RuntimeError:
            return  # interrupted: nobody wants it any more

    def _span(self, group: _Group) -> tuple[int, int]:
        """Offset and length of what is asked for."""
        first, last = group.pieces[0], group.pieces[-1]
        start = int(self._offsets[first])
        return start, int(self._offsets[last]) + int(self._lengths[last]) - start

    def _piece(self, offset: int, length: int) -> int | None:
        """Return the payload that a range lies in; None where it lies in none, or in several."""
        piece = int(np.searchsorted(self._offsets, np.uint64(offset), side="right")) - 1
        if piece < 0:
            return None
        end = int(self._offsets[piece]) + int(self._lengths[piece])
        return piece if offset + length <= end else None

    def _key(self, piece: int) -> CacheKey:
        return CacheKey(self._scope, int(self._hashes[piece]), int(self._lengths[piece]))
