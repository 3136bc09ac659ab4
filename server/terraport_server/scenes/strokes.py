"""Cache of the strokes of served scenes, and of what they have taught.

To read, write and encode 16 MB takes more than a second of CPU. One such task runs at a time, in a
thread, and only encodes strokes that are new; all clients get the same bytes.
"""

from __future__ import annotations

import asyncio
import json
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import xxhash

from terraport_store import (
    FolderFiles,
    Stroke,
    Strokes,
    change_strokes,
    read_strokes,
    read_taught,
)
from terraport_store.layout import MAX_STROKES_BYTES, STROKES, TAUGHT

__all__ = ["CachedStrokes", "StrokeCache"]

_MAX_KEPT_BYTES: Final = MAX_STROKES_BYTES
"""Bound on the size of the cached files; in memory they take seven times that. The newest always
stays."""



@dataclass(frozen=True, slots=True, eq=False)
class CachedStrokes:
    """The strokes of a scene at one revision, and their JSON."""

    strokes: Strokes
    rows: dict[Stroke, bytes]
    """JSON of each stroke without its end: ``yours`` differs between clients."""
    stamp: Hashable
    """Of the file when it was read."""

    @property
    def size_bytes(self) -> int:
        """Approximate size of the file."""
        return sum(map(len, self.rows.values()))

    def response(self, who: str) -> Iterator[bytes]:
        """Yield the response to the bearer of a token, one piece per stroke."""
        yield b'{"strokes":['
        for number, (stroke, row) in enumerate(self.rows.items()):
            yours = b"true" if stroke.who == who else b"false"
            yield b'%b%b,"yours":%b}' % (b"," if number else b"", row, yours)
        yield b'],"revision":%b}' % json.dumps(self.strokes.revision).encode()


class StrokeCache:
    """Reader, writer and cache of strokes, on one event loop."""

    def __init__(self) -> None:
        self._kept: OrderedDict[Path, CachedStrokes] = OrderedDict()
        self._lock = asyncio.Lock()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="strokes")

    async def read(self, folder: Path) -> CachedStrokes:
        """Return the strokes of the scene in a folder; raises as :func:`read_strokes`."""
        async with self._lock:
            kept = await self._run(_read, folder, self._kept.get(folder))
            return self._keep(folder, kept)

    async def change(self, folder: Path, change: Callable[[Strokes], Strokes]) -> Strokes:
        """Change the strokes; raises as :func:`change_strokes`, and what *change* raises."""
        async with self._lock:
            kept = await self._run(_change, folder, self._kept.get(folder), change)
            return self._keep(folder, kept).strokes

    async def taught(self, folder: Path) -> tuple[bytes | None, str]:
        """Return `taught.json`, None without one, and its entity tag; raises as `read_taught`."""
        async with self._lock:
            loop = asyncio.get_running_loop()
            return await loop.run_in_executor(
                self._thread, lambda: _taught(folder, FolderFiles(folder).stamp(TAUGHT))
            )

    def stop(self) -> None:
        """Start no more tasks."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    async def _run(self, work: Callable[..., CachedStrokes], *arguments: object) -> CachedStrokes:
        return await asyncio.get_running_loop().run_in_executor(self._thread, work, *arguments)

    def _keep(self, folder: Path, kept: CachedStrokes) -> CachedStrokes:
        self._kept[folder] = kept
        self._kept.move_to_end(folder)
        while len(self._kept) > 1 and sum(one.size_bytes for one in self._kept.values()) > (
            _MAX_KEPT_BYTES
        ):
            self._kept.popitem(last=False)
        return kept


def _read(folder: Path, before: CachedStrokes | None) -> CachedStrokes:
    # The stamp first: a change while reading is then noticed by the next call.
    stamp = FolderFiles(folder).stamp(STROKES)
    if before is not None and before.stamp == stamp:
        return before
    strokes = read_strokes(folder, None if before is None else before.strokes)
    return _kept(strokes, before, stamp)


@lru_cache(maxsize=2)
def _taught(folder: Path, _stamp: Hashable) -> tuple[bytes | None, str]:
    data = read_taught(folder)
    return data, f'"{xxhash.xxh3_64_hexdigest(data or b"")}"'


def _change(
    folder: Path, before: CachedStrokes | None, change: Callable[[Strokes], Strokes]
) -> CachedStrokes:
    strokes = change_strokes(folder, change, None if before is None else before.strokes)
    # No stamp: the next read parses the file again, which is cheap for known strokes.
    return _kept(strokes, before, None)


def _kept(strokes: Strokes, before: CachedStrokes | None, stamp: Hashable) -> CachedStrokes:
    known = {} if before is None else before.rows
    rows = {stroke: known.get(stroke) or _row(stroke) for stroke in strokes.strokes}
    return CachedStrokes(strokes, rows, stamp)


def _row(stroke: Stroke) -> bytes:
    return json.dumps(stroke.document(), ensure_ascii=False, separators=(",", ":")).encode()[:-1]
