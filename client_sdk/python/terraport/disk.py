"""Disk cache of segments and base meshes, and the tasks that read and write it.

::

    CACHE_DIR/<16 hex: the scene's URL>/<key: 16 hex>-<box: 48 hex>.segment    the payload
    CACHE_DIR/<16 hex: the scene's URL>/base-<what the manifest calls it>.gz   the base mesh

A segment's file is named by its key and its box (six float32), so the
contents are known without opening files. Payloads and gzip have checksums. Files are written under
a temporary name and renamed, so other processes never see a partial file. Nothing is fsynced: after
a crash the checksums find damaged files, and the server has all segments. When the disk is full or
read-only, the cache logs it once and stops writing.

Bounded in bytes over the whole directory; the least recently used files are deleted first. Several
processes may share a directory.
"""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import logging
import os
import re
import struct
import time
import uuid
import zlib
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Final

from terraport.cache import Box, CachedSegment
from terraport.core import SessionCore
from terraport.errors import UsageError

__all__ = ["DEFAULT_DISK_BYTES", "DiskCache", "DiskWorker"]

DEFAULT_DISK_BYTES: Final = 4 << 30
"""About ten quarries of 100 M points."""

_BOX: Final = struct.Struct("<6f")
_NAME: Final = re.compile(r"([0-9a-f]{16})-([0-9a-f]{48})\.segment")
_ROOM: Final = 0.9
"""Share of the bound that is kept when the cache is full, so that not every write scans it."""
_STALE_S: Final = 3600.0
"""Age in seconds after which a temporary file belongs to a process that died."""
_MAX_PENDING_BYTES: Final = 64 << 20
"""Maximum payload bytes queued for writing; later ones are written if memory still has them."""

_log = logging.getLogger("terraport")


class DiskCache:
    """The files of one scene. Every method blocks.

    Parameters
    ----------
    directory : Path
        Shared by all scenes; created if it is not there.
    scene_key : str
        16 hexadecimal digits, from :attr:`terraport.address.SceneUrl.key`.
    max_bytes : int
        Bound over the whole directory.

    Raises
    ------
    UsageError
        The directory cannot be made.
    """

    def __init__(
        self, directory: str | Path, scene_key: str, max_bytes: int = DEFAULT_DISK_BYTES
    ) -> None:
        self._root = Path(directory)
        self._folder = self._root / scene_key
        self._max_bytes = max_bytes
        self._bytes = 0
        self._names: dict[int, str] = {}
        self._has_complained = False
        try:
            self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        except OSError as error:
            raise UsageError(f"cache_dir {directory}: {error.strerror or error}") from error

    def catalogue(self) -> dict[int, Box]:
        """Scan the directory; return the boxes of this scene's segments by key."""
        self._bytes = 0
        found = {}
        for path, size, used_s in self._files():
            if path.name.startswith(".") and time.time() - used_s > _STALE_S:
                _unlink(path)
                continue
            self._bytes += size
            key = self._key_of(path)
            if key is not None:
                self._names[key] = path.name
                found[key] = _BOX.unpack(bytes.fromhex(path.stem[17:]))
        return found

    def get(self, key: int) -> bytes | None:
        """Read one segment, unchecked; None if its file does not exist."""
        return _read(self._folder / self._names.get(key, "-"))

    def put(self, entry: CachedSegment, keep: Collection[int]) -> tuple[bool, list[int]]:
        """Write one segment.

        Returns
        -------
        (bool, list of int)
            Whether it was written: not where it does not fit. And the keys of this scene that were
            deleted to make room, never one of `keep`.
        """
        name = f"{entry.key:016x}-{_BOX.pack(*entry.box).hex()}.segment"
        is_written, removed = self._write(self._folder / name, entry.payload, keep)
        if is_written:
            self._names[entry.key] = name
        return is_written, removed

    def remove(self, key: int) -> None:
        """Delete one segment."""
        if key in self._names:
            _unlink(self._folder / self._names.pop(key))

    def get_base(self, name: str) -> bytes | None:
        """Read the base mesh that the manifest calls so; None when it is not there or not whole."""
        path = self._folder / f"base-{name}.gz"
        data = _read(path)
        if data is not None:
            try:
                return gzip.decompress(data)
            except (OSError, EOFError, zlib.error):
                _unlink(path)
        return None

    def put_base(self, name: str, data: bytes, keep: Collection[int]) -> tuple[bool, list[int]]:
        """Write the base mesh that the manifest calls so; returns what :meth:`put` does."""
        packed = gzip.compress(data, compresslevel=1)
        return self._write(self._folder / f"base-{name}.gz", packed, keep)

    def _write(self, path: Path, data: bytes, keep: Collection[int]) -> tuple[bool, list[int]]:
        removed: list[int] = []
        if len(data) <= self._max_bytes < self._bytes + len(data):
            removed = self._make_room(len(data), keep)
        if self._bytes + len(data) > self._max_bytes:
            return False, removed
        temporary = path.with_name(f".{uuid.uuid4().hex}.tmp")
        try:
            temporary.write_bytes(data)
            temporary.replace(path)
        except OSError as error:
            _unlink(temporary)
            if not self._has_complained:
                self._has_complained = True
                _log.warning("disk cache not written: %s", error)
            return False, removed
        self._bytes += len(data)
        return True, removed

    def _make_room(self, needed: int, keep: Collection[int]) -> list[int]:
        """Delete what was used longest ago; return the keys of this scene that are gone."""
        files = sorted(self._files(), key=lambda item: item[2])
        self._bytes = sum(size for _, size, _ in files)
        target = int(self._max_bytes * _ROOM) - needed
        removed = []
        for path, size, _ in files:
            key = self._key_of(path)
            if self._bytes <= target:
                break
            if path.name.startswith(".") or key in keep:  # being written, or needed now
                continue
            _unlink(path)
            self._bytes -= size
            if key is not None:
                removed.append(key)
        return removed

    def _key_of(self, path: Path) -> int | None:
        match = _NAME.fullmatch(path.name) if path.parent == self._folder else None
        return None if match is None else int(match[1], 16)

    def _files(self) -> list[tuple[Path, int, float]]:
        """Every file of the whole directory: path, bytes, time of last use."""
        files = []
        for folder, _, names in os.walk(self._root):
            for name in names:
                path = Path(folder, name)
                try:
                    status = path.stat()
                except OSError:
                    continue  # another process deleted it
                files.append((path, status.st_size, status.st_mtime))
        return files


class DiskWorker:
    """Run a disk cache in threads: reads at once, writes one after the other.

    Parameters
    ----------
    disk : DiskCache
    core : SessionCore
        Told what was read, written and deleted.
    pump : callable
        Called after that.
    """

    def __init__(self, disk: DiskCache, core: SessionCore, pump: Callable[[], None]) -> None:
        self._disk = disk
        self._core = core
        self._pump = pump
        self._writes: asyncio.Queue[tuple[int, CachedSegment | None]] = asyncio.Queue()
        self._pending_bytes = 0
        self._reads: set[asyncio.Task[None]] = set()

    def restore(self, keys: tuple[int, ...]) -> None:
        """Read segments, in this order."""
        task = asyncio.create_task(self._restore(keys), name="terraport-disk-reads")
        self._reads.add(task)
        task.add_done_callback(self._reads.discard)

    def store(self, entry: CachedSegment) -> None:
        """Write a segment; where too much waits already, when that is written."""
        is_kept = self._pending_bytes + len(entry.payload) <= _MAX_PENDING_BYTES
        self._pending_bytes += len(entry.payload) if is_kept else 0
        self._writes.put_nowait((entry.key, entry if is_kept else None))

    def remove(self, key: int) -> None:
        """Delete a segment's file."""
        self._disk.remove(key)

    async def drained(self) -> None:
        """Wait until everything is written."""
        await self._writes.join()

    async def run(self) -> None:
        """Write until cancelled. A call that is under way then finishes in its thread."""
        try:
            while True:
                key, given = await self._writes.get()
                entry = given or self._core.peek(key)
                if entry is not None:
                    keep = self._core.needed
                    is_written, removed = await asyncio.to_thread(self._disk.put, entry, keep)
                    self._core.disk_changed(entry if is_written else None, removed)
                self._pending_bytes -= 0 if given is None else len(given.payload)
                self._writes.task_done()
        finally:
            for task in self._reads:
                task.cancel()

    async def _restore(self, keys: tuple[int, ...]) -> None:
        for key in keys:
            payload = await asyncio.to_thread(self._disk.get, key)
            if payload is None:
                self._core.lost(key)
            else:
                self._core.restored(key, payload)
            self._pump()


def _read(path: Path) -> bytes | None:
    try:
        data = path.read_bytes()
    except OSError:
        return None
    with contextlib.suppress(OSError):
        os.utime(path)  # used just now: last to be deleted
    return data


def _unlink(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()
