"""A bounded cache of payloads on disk, for all processes of a machine.

One file per payload, named by its hash and length, so that what lies under a name can be checked,
whoever put it there. A file appears whole (written beside, renamed) or not at all; it is never
changed, and whoever has it open keeps it when others delete it. No file is synced: what a power
cut leaves behind fails its hash and is fetched again.

::

    FOLDER/SCOPE/ab/ab34567890abcdef-55012     scope: the scene that it belongs to
    FOLDER/tmp/                                what is being written
    FOLDER/used                                bytes in all, under a lock; set right by each sweep

The payload's hash is no cryptographic one: within a scene nobody gains by a false match, across
scenes somebody might, so each scene has its own scope. Versions of one scene share what is equal.
"""

from __future__ import annotations

import contextlib
import fcntl
import itertools
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

import xxhash

__all__ = ["ByteCache", "CacheKey", "CachedFile"]

_ROOM_AFTER_SWEEP: Final = 0.9
"""Share of the bound that a sweep leaves: sweeping looks at every file, so it should be rare."""

_TOUCH_S: Final = 60.0
"""How much later a use is worth noting: "least recently used" is right to so many seconds."""

_LEFT_OVER_S: Final = 3600.0
"""Age of a file in tmp/ whose writer must be dead."""


class CacheKey(NamedTuple):
    """Which payload, by its contents."""

    scope: str
    xxh3: int
    length: int


class CachedFile:
    """One payload in an open file; closed with the last reference to it."""

    __slots__ = ("descriptor", "length")

    def __init__(self, descriptor: int, length: int) -> None:
        self.descriptor = descriptor
        self.length = length

    def read(self) -> bytes:
        """Read all of it; shorter where the file was damaged."""
        return os.pread(self.descriptor, self.length, 0)

    def __del__(self) -> None:
        os.close(self.descriptor)


class ByteCache:
    """The cache in one folder. Any thread, any number of processes.

    Parameters
    ----------
    folder : Path
        Made where it is missing, readable by its owner alone.
    max_bytes : int
        Bound of all payloads together, over all processes; the smallest bound wins.

    Raises
    ------
    OSError
        When the folder cannot be made or written to.
    """

    def __init__(self, folder: Path, max_bytes: int) -> None:
        self.folder = folder
        self.max_bytes = max_bytes
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._tmp = folder / "tmp"
        self._tmp.mkdir(mode=0o700, exist_ok=True)
        self._mutex = threading.Lock()
        self._used = _open_rw(folder / "used")
        self._sweeping = _open_rw(folder / "sweeping")
        self._sweep_mutex = threading.Lock()
        self._numbers = itertools.count()
        self.sweep()

    @property
    def used_bytes(self) -> int:
        """Payload bytes that are kept, by all processes."""
        with self._counter() as used:
            return used

    def open(self, key: CacheKey) -> CachedFile | None:
        """Open a payload that is kept, and compare its hash; a wrong one is deleted.

        Returns
        -------
        CachedFile or None
            None where it is not kept, or not to be read.
        """
        path = self._path(key)
        try:
            descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        except OSError:
            return None
        file = CachedFile(descriptor, key.length)
        try:
            whole = xxhash.xxh3_64_intdigest(file.read()) == key.xxh3
            status = os.fstat(descriptor)
        except OSError:
            whole = False
        if not whole or status.st_size != key.length:
            self.discard(key)
            return None
        if time.time() - status.st_mtime > _TOUCH_S:
            with contextlib.suppress(OSError):
                os.utime(path)
        return file

    def has(self, key: CacheKey) -> bool:
        """Tell whether a payload is kept; it may be gone, or wrong, when it is opened."""
        return self._path(key).exists()

    def put(self, key: CacheKey, data: bytes) -> CachedFile:
        """Keep a payload whose hash is right, and open it.

        Raises
        ------
        OSError
            When the disk is full or fails, or there is no room although old payloads were deleted.
            Nothing is left behind.
        """
        path = self._path(key)
        self._reserve(key.length)
        temporary = self._tmp / f"{os.getpid()}-{next(self._numbers)}"
        descriptor = -1
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            descriptor = os.open(
                temporary, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600
            )
            written = 0
            while written < len(data):
                written += os.write(descriptor, memoryview(data)[written:])
            if path.exists():  # another process was faster; two files of one name count once
                self._give_back(key.length)
            temporary.replace(path)
        except OSError:
            self._give_back(key.length)
            if descriptor >= 0:
                os.close(descriptor)
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)
            raise
        return CachedFile(descriptor, key.length)

    def discard(self, key: CacheKey) -> None:
        """Delete a payload; whoever has it open keeps it."""
        with contextlib.suppress(OSError):
            self._path(key).unlink()
            self._give_back(key.length)

    def sweep(self) -> bool:
        """Count what there is; where it is too much, delete what was not used for longest.

        Returns
        -------
        bool
            False where another process or thread is at it.
        """
        if not self._sweep_mutex.acquire(blocking=False):
            return False
        try:
            try:
                fcntl.flock(self._sweeping, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                return False
            try:
                self._sweep()
            finally:
                fcntl.flock(self._sweeping, fcntl.LOCK_UN)
        finally:
            self._sweep_mutex.release()
        return True

    def __del__(self) -> None:
        for name in ("_used", "_sweeping"):  # threads may still be at it before
            if name in self.__dict__:
                os.close(self.__dict__[name])

    def _sweep(self) -> None:
        with self._counter() as before:
            pass
        files = sorted(_payload_files(self.folder))
        stored_bytes = sum(size for _, size, _ in files)
        room = int(self.max_bytes * _ROOM_AFTER_SWEEP)
        kept = stored_bytes
        for _, size, path in files if stored_bytes > room else ():
            if kept <= room:
                break
            with contextlib.suppress(OSError):
                path.unlink()
                kept -= size
        late = time.time() - _LEFT_OVER_S
        for entry in os.scandir(self._tmp):
            with contextlib.suppress(OSError):
                if entry.stat().st_mtime < late:
                    Path(entry.path).unlink()
        with self._counter() as now:  # what others added meanwhile was perhaps not seen
            self._set_counter(kept + max(0, now - before))

    def _reserve(self, length: int) -> None:
        for attempt in (1, 2):
            with self._counter() as used:
                if used + length <= self.max_bytes:
                    self._set_counter(used + length)
                    return
            if attempt == 2 or not self.sweep():
                break
        raise OSError(f"no room for {length} bytes in {self.folder} (at most {self.max_bytes})")

    def _give_back(self, length: int) -> None:
        with contextlib.suppress(OSError), self._counter() as used:
            self._set_counter(max(0, used - length))

    @contextlib.contextmanager
    def _counter(self) -> Iterator[int]:
        """Lock the counter and read it."""
        with self._mutex:
            fcntl.flock(self._used, fcntl.LOCK_EX)
            try:
                yield int.from_bytes(os.pread(self._used, 8, 0), "little")
            finally:
                fcntl.flock(self._used, fcntl.LOCK_UN)

    def _set_counter(self, used: int) -> None:
        os.pwrite(self._used, used.to_bytes(8, "little"), 0)

    def _path(self, key: CacheKey) -> Path:
        name = f"{key.xxh3:016x}"
        return self.folder / key.scope / name[:2] / f"{name}-{key.length}"


def _payload_files(folder: Path) -> Iterator[tuple[float, int, Path]]:
    """Last use, size and path of every payload; what vanishes meanwhile is left out."""
    for scope in _folders(folder):
        if scope.name in {"tmp", "open"}:
            continue
        for shard in _folders(Path(scope.path)):
            with contextlib.suppress(OSError):
                for entry in os.scandir(shard.path):
                    with contextlib.suppress(OSError):
                        status = entry.stat(follow_symlinks=False)
                        yield status.st_mtime, status.st_size, Path(entry.path)


def _folders(folder: Path) -> list[os.DirEntry[str]]:
    try:
        return [entry for entry in os.scandir(folder) if entry.is_dir(follow_symlinks=False)]
    except OSError:
        return []


def _open_rw(path: Path) -> int:
    return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
