"""Segments and base meshes on disk, from one run to the next.

::

    CACHE_DIR/<16 hex: the scene's URL>/<segment id>-<16 hex: xxh3>.segment-2   64 bytes + payload
    CACHE_DIR/<16 hex: the scene's URL>/<name>-<16 hex: xxh3>.blob              the bytes

    segment file   0        8                       56       64
                   +--------+-----------------------+--------+-----------
                   |TPSDKSG1| row of the load table | xxh3   | payload ...
                   +--------+-----------------------+--------+-----------
                                                     of the row

Content is named by its hash and checked whenever it is read; what is wrong is deleted and counts as
absent. Files are written beside and renamed, so that another process never sees half of one.
Nothing is fsynced: after a crash the hash finds what was lost, and the server has it all. The cache
is a convenience: when the disk is full or read-only, it says so once in the log and is silent.

Bounded in bytes over the whole directory; what was used longest ago goes first. Several processes
may share a directory.

Every method blocks; call them from one thread at a time, not the event loop's.
"""

from __future__ import annotations

import contextlib
import logging
import os
import re
import time
import uuid
from pathlib import Path
from typing import Final

import numpy as np
import xxhash

from terraport.cache import CachedSegment, SegmentFacts
from terraport.errors import CorruptSegmentError, UsageError
from terraport.landing_state import facts_of_table
from terraport.payloads import ENCODING
from terraport_wire import LOAD_DTYPE

__all__ = ["DEFAULT_DISK_BYTES", "DiskCache"]

DEFAULT_DISK_BYTES: Final = 4 << 30
"""About ten quarries of 100 M points."""

_MAGIC: Final = b"TPSDKSG1"
_HEADER_BYTES: Final = 64
_ROOM: Final = 0.9
"""When full, down to this part of the bound, so that not every write looks at the directory."""
_STALE_S: Final = 3600.0
"""A temporary file older than this was left by a process that died."""

_log = logging.getLogger("terraport")


class DiskCache:
    """The cache of one scene.

    Parameters
    ----------
    directory : Path
        Shared by all scenes; created if it is not there.
    scene_key : str
        16 hexadecimal digits, from :attr:`terraport.urls.SceneUrl.key`.
    max_bytes : int
        Bound over the whole directory.

    Raises
    ------
    UsageError
        The directory cannot be made.
    """

    def __init__(
        self,
        directory: str | Path,
        scene_key: str,
        max_bytes: int = DEFAULT_DISK_BYTES,
    ) -> None:
        self._root = Path(directory)
        self._folder = self._root / scene_key
        self._max_bytes = max_bytes
        self._bytes = 0
        self._name = re.compile(rf"(\d+)-([0-9a-f]{{16}})\.{re.escape(ENCODING)}")
        self._complained = False
        try:
            self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        except OSError as error:
            raise UsageError(f"cache_dir {directory}: {error.strerror or error}") from error

    def catalogue(self) -> dict[int, int]:
        """Look at the directory; return xxh3 by segment id of what is there for this scene.

        Where a segment is there with two hashes (of two versions of the scene), the newer file
        counts and the older is deleted.
        """
        held: dict[int, tuple[float, int]] = {}
        self._bytes = 0
        now_s = time.time()
        for path, size, used_s in self._files():
            if path.name.startswith(".") and now_s - used_s > _STALE_S:
                _unlink(path)
                continue
            self._bytes += size
            match = self._name.fullmatch(path.name) if path.parent == self._folder else None
            if match is None:
                continue
            segment, xxh3 = int(match[1]), int(match[2], 16)
            other = held.get(segment)
            if other is not None:
                loser = other[1] if other[0] <= used_s else xxh3
                _unlink(self._path(segment, loser))
                if loser == xxh3:
                    continue
            held[segment] = (used_s, xxh3)
        return {segment: xxh3 for segment, (_, xxh3) in held.items()}

    def get(self, segment: int, xxh3: int) -> CachedSegment | None:
        """Read one segment.

        Returns
        -------
        CachedSegment or None
            None when it is not there (any more).

        Raises
        ------
        CorruptSegmentError
            The file is not what its name says; it has been deleted.
        """
        path = self._path(segment, xxh3)
        data = _read(path)
        if data is None:
            return None
        facts, payload = _parsed(data), data[_HEADER_BYTES:]
        actual = xxhash.xxh3_64_intdigest(payload)
        if facts is None or facts.segment != segment or facts.xxh3 != xxh3 or actual != xxh3:
            _unlink(path)
            raise CorruptSegmentError(segment, actual, xxh3, str(path))
        with contextlib.suppress(OSError):
            os.utime(path)  # used just now: last to be deleted
        return CachedSegment(facts, payload)

    def put(self, entry: CachedSegment) -> list[int] | None:
        """Write one segment.

        Returns
        -------
        list of int or None
            Segments of this scene that were deleted to make room; None when this one could not be
            written, or is larger than the bound.
        """
        facts = entry.facts
        row = np.array(
            [
                (
                    facts.segment,
                    facts.length,
                    facts.xxh3,
                    facts.faces,
                    facts.vertices,
                    facts.bounds,
                )
            ],
            dtype=LOAD_DTYPE,
        ).tobytes()
        header = _MAGIC + row + xxhash.xxh3_64_intdigest(row).to_bytes(8, "little")
        return self._write(self._path(facts.segment, facts.xxh3), header + entry.payload)

    def remove(self, segments: dict[int, int]) -> None:
        """Delete segments, given as xxh3 by id."""
        for segment, xxh3 in segments.items():
            _unlink(self._path(segment, xxh3))

    def get_blob(self, name: str) -> bytes | None:
        """Read what was put under a name; None when it is not there or not whole."""
        for path in self._folder.glob(f"{name}-*.blob"):
            data = _read(path)
            if data is not None and path.stem == f"{name}-{xxhash.xxh3_64_hexdigest(data)}":
                with contextlib.suppress(OSError):
                    os.utime(path)
                return data
            _unlink(path)
        return None

    def put_blob(self, name: str, data: bytes) -> list[int] | None:
        """Write bytes under a name of letters, digits and dashes; returns what :meth:`put` does."""
        return self._write(self._folder / f"{name}-{xxhash.xxh3_64_hexdigest(data)}.blob", data)

    def _path(self, segment: int, xxh3: int) -> Path:
        return self._folder / f"{segment}-{xxh3:016x}.{ENCODING}"

    def _write(self, path: Path, data: bytes) -> list[int] | None:
        if len(data) > self._max_bytes:
            return None
        removed = self._make_room(len(data)) if self._bytes + len(data) > self._max_bytes else []
        temporary = path.with_name(f".{uuid.uuid4().hex}.tmp")
        try:
            temporary.write_bytes(data)
            temporary.replace(path)
        except OSError as error:
            _unlink(temporary)
            if not self._complained:
                self._complained = True
                _log.warning("disk cache not written: %s", error)
            return None
        self._bytes += len(data)
        return removed

    def _make_room(self, needed: int) -> list[int]:
        """Delete what was used longest ago; return the ids of this scene that are gone."""
        files = sorted(self._files(), key=lambda item: item[2])
        self._bytes = sum(size for _, size, _ in files)
        target = int(self._max_bytes * _ROOM) - needed
        removed = []
        for path, size, _ in files:
            if self._bytes <= target:
                break
            if path.name.startswith("."):
                continue  # another process is writing it
            _unlink(path)
            self._bytes -= size
            match = self._name.fullmatch(path.name) if path.parent == self._folder else None
            if match is not None:
                removed.append(int(match[1]))
        return removed

    def _files(self) -> list[tuple[Path, int, float]]:
        """Every file of the whole directory: path, bytes, time of last use."""
        files = []
        for path in self._root.glob("*/*"):
            try:
                status = path.stat()
            except OSError:
                continue  # another process deleted it
            files.append((path, status.st_size, status.st_mtime))
        return files


def _parsed(data: bytes) -> SegmentFacts | None:
    """Return what a segment file's header says; None when it is none."""
    row = data[8:56]
    if len(data) <= _HEADER_BYTES or data[:8] != _MAGIC:
        return None
    if xxhash.xxh3_64_intdigest(row).to_bytes(8, "little") != data[56:_HEADER_BYTES]:
        return None
    facts = next(iter(facts_of_table(np.frombuffer(row, dtype=LOAD_DTYPE)).values()))
    return facts if facts.length == len(data) - _HEADER_BYTES else None


def _read(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None


def _unlink(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()
