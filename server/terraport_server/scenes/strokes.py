"""Strokes of served scenes, kept while they are asked for: a list of 2,000 is written once.

Reading, writing and telling 16 MB takes more than a second of a processor. One of it is done at a
time, in a thread, and only of what has changed; everybody is told by the same bytes.
"""

from __future__ import annotations

import asyncio
import json
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

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

__all__ = ["KeptStrokes", "KeptTaught", "StrokeDesk"]

_MAX_KEPT_BYTES: Final = MAX_STROKES_BYTES
"""Of the files whose strokes are kept, together; in memory they take some seven times that. The
newest stays whatever it has."""

_MAX_KEPT_TAUGHT: Final = 2
"""Scenes whose `taught.json` is kept."""


@dataclass(frozen=True, slots=True, eq=False)
class KeptStrokes:
    """The strokes of a scene as of one revision, and how they are told."""

    strokes: Strokes
    rows: dict[Stroke, bytes]
    """Each as JSON, but for whether it is one's own."""
    stamp: Hashable
    """Of the file."""

    @property
    def size_bytes(self) -> int:
        """Of the file, about."""
        return sum(map(len, self.rows.values()))

    def told_to(self, who: str) -> Iterator[bytes]:
        """Write the answer to somebody, a piece for each stroke."""
        yield b'{"strokes":['
        for number, (stroke, row) in enumerate(self.rows.items()):
            yours = b"true" if stroke.who == who else b"false"
            yield b'%b%b,"yours":%b}' % (b"," if number else b"", row, yours)
        yield b'],"revision":%b}' % json.dumps(self.strokes.revision).encode()


class KeptTaught(NamedTuple):
    """A file of what strokes have taught, for all who ask."""

    data: bytes | None
    """None where there is none."""
    etag: str
    """Quotes included."""
    stamp: Hashable


class StrokeDesk:
    """Reads and changes strokes; lives on one event loop."""

    def __init__(self) -> None:
        self._kept: OrderedDict[Path, KeptStrokes] = OrderedDict()
        self._taught: OrderedDict[Path, KeptTaught] = OrderedDict()
        self._turn = asyncio.Lock()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="strokes")

    async def read(self, folder: Path) -> KeptStrokes:
        """Return the strokes of the scene in a folder; raises as :func:`read_strokes`."""
        async with self._turn:
            kept = await self._run(_read, folder, self._kept.get(folder))
            return self._keep(folder, kept)

    async def change(self, folder: Path, change: Callable[[Strokes], Strokes]) -> Strokes:
        """Change them; raises as :func:`change_strokes`, and what *change* raises."""
        async with self._turn:
            kept = await self._run(_change, folder, self._kept.get(folder), change)
            return self._keep(folder, kept).strokes

    async def taught(self, folder: Path) -> KeptTaught:
        """Return what they have taught; raises as :func:`read_taught`."""
        async with self._turn:
            loop = asyncio.get_running_loop()
            before = self._taught.get(folder)
            taught = await loop.run_in_executor(self._thread, _read_taught, folder, before)
            self._taught[folder] = taught
            self._taught.move_to_end(folder)
            if len(self._taught) > _MAX_KEPT_TAUGHT:
                self._taught.popitem(last=False)
            return taught

    def stop(self) -> None:
        """Begin nothing more."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    async def _run(self, work: Callable[..., KeptStrokes], *arguments: object) -> KeptStrokes:
        return await asyncio.get_running_loop().run_in_executor(self._thread, work, *arguments)

    def _keep(self, folder: Path, kept: KeptStrokes) -> KeptStrokes:
        self._kept[folder] = kept
        self._kept.move_to_end(folder)
        while len(self._kept) > 1 and sum(one.size_bytes for one in self._kept.values()) > (
            _MAX_KEPT_BYTES
        ):
            self._kept.popitem(last=False)
        return kept


def _read(folder: Path, before: KeptStrokes | None) -> KeptStrokes:
    # The stamp first: what is written meanwhile is read the next time.
    stamp = FolderFiles(folder).stamp(STROKES)
    if before is not None and before.stamp == stamp:
        return before
    strokes = read_strokes(folder, None if before is None else before.strokes)
    return _kept(strokes, before, stamp)


def _read_taught(folder: Path, before: KeptTaught | None) -> KeptTaught:
    stamp = FolderFiles(folder).stamp(TAUGHT)
    if before is not None and before.stamp == stamp:
        return before
    data = read_taught(folder)
    return KeptTaught(data, f'"{xxhash.xxh3_64_hexdigest(data or b"")}"', stamp)


def _change(
    folder: Path, before: KeptStrokes | None, change: Callable[[Strokes], Strokes]
) -> KeptStrokes:
    strokes = change_strokes(folder, change, None if before is None else before.strokes)
    return _kept(strokes, before, None)  # the next look reads it anew, which is cheap by now


def _kept(strokes: Strokes, before: KeptStrokes | None, stamp: Hashable) -> KeptStrokes:
    known = {} if before is None else before.rows
    rows = {stroke: known.get(stroke) or _row(stroke) for stroke in strokes.strokes}
    return KeptStrokes(strokes, rows, stamp)


def _row(stroke: Stroke) -> bytes:
    return json.dumps(stroke.document(), ensure_ascii=False, separators=(",", ":")).encode()[:-1]
