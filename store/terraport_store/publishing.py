"""The file-system acts of publishing: write, sync, rename, replace, lock, tidy up.

Order (and why it is safe to be killed between any two steps) is in ``spec/scene-format.md``,
section "Publishing". POSIX only: it needs ``flock``, ``fsync`` of directories and atomic
``rename``.
"""

from __future__ import annotations

import errno
import fcntl
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import xxhash

from terraport_store.errors import OutOfSpaceError, SceneBusyError
from terraport_store.layout import MANIFEST_NAME, STAGING, VERSION_FOLDER

__all__ = [
    "PublishLock",
    "hash_file",
    "new_staging_folder",
    "out_of_space_named",
    "remove_versions",
    "replace_file",
    "replace_manifest",
    "require_space",
    "sweep_left_overs",
    "sync_folder",
    "write_synced",
]

_FULL: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""Disk full, quota reached, file-size limit reached: one thing to the user."""

_NO_LOCKS: Final = frozenset({errno.EBADF, errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL})
"""What file systems without directory locks answer."""

_MARGIN_BYTES: Final = 1 << 20
"""Free space asked for beyond what will be written: directory blocks and the manifest."""


class PublishLock:
    """Keeps other processes from publishing the same scene.

    A lock on the directory itself, so nothing is left behind; the system frees it if this process
    dies. File systems that cannot lock a directory (some network ones) go without: there, publish
    from one process at a time.

    Parameters
    ----------
    scene_dir : Path
        Must exist.

    Raises
    ------
    SceneBusyError
        When another process holds it.
    """

    def __init__(self, scene_dir: Path) -> None:
        self._descriptor = os.open(scene_dir, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno in _NO_LOCKS:
                return
            self.release()
            if error.errno in {errno.EWOULDBLOCK, errno.EACCES}:
                raise SceneBusyError(str(scene_dir)) from None
            raise

    def release(self) -> None:
        """Let others publish; may be called again."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


@contextmanager
def out_of_space_named(path: Path) -> Iterator[None]:
    """Turn "no space" errors of the system into :class:`OutOfSpaceError`."""
    try:
        yield
    except OSError as error:
        if error.errno in _FULL:
            raise OutOfSpaceError(str(path)) from error
        raise


def require_space(path: Path, needed_bytes: int) -> None:
    """Check that a disk has room before anything is written to it.

    Parameters
    ----------
    path : Path
        An existing directory on the disk.
    needed_bytes : int
        What will be written; 1 MiB is added for directories and the manifest.

    Raises
    ------
    OutOfSpaceError
        With both numbers.
    """
    free = shutil.disk_usage(path).free
    if free < needed_bytes + _MARGIN_BYTES:
        raise OutOfSpaceError(str(path), needed_bytes=needed_bytes + _MARGIN_BYTES, free_bytes=free)


def sweep_left_overs(scene_dir: Path) -> None:
    """Delete what dead publications left; the lock is held."""
    for entry in list(scene_dir.iterdir()):
        if STAGING.fullmatch(entry.name):
            if entry.is_dir():
                shutil.rmtree(entry)
            else:
                entry.unlink()


def new_staging_folder(scene_dir: Path) -> Path:
    """Delete what dead publications left (the lock is held) and make a folder for this one."""
    sweep_left_overs(scene_dir)
    folder = scene_dir / f".v-{secrets.token_hex(8)}.tmp"
    folder.mkdir()
    return folder


def hash_file(path: Path) -> str:
    """Compute the XXH3-64 of a file, 16 hexadecimal digits, 1 MiB at a time."""
    digest = xxhash.xxh3_64()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def write_synced(path: Path, data: bytes) -> None:
    """Write a new file and wait until it is on the disk."""
    with path.open("xb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def sync_folder(path: Path) -> None:
    """Wait until a folder's entries are on the disk."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def replace_manifest(scene_dir: Path, data: bytes) -> None:
    """Publish: put a new ``scene.json`` in place of the old one, in one step."""
    replace_file(scene_dir, MANIFEST_NAME, f".scene-{secrets.token_hex(8)}.json.tmp", data)


def replace_file(scene_dir: Path, name: str, temporary_name: str, data: bytes) -> None:
    """Put a file of a scene directory in place of an older one, in one step, on the disk.

    The lock is held; the temporary name is one that :func:`sweep_left_overs` knows.
    """
    temporary = scene_dir / temporary_name
    try:
        write_synced(temporary, data)
        temporary.replace(scene_dir / name)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync_folder(scene_dir)


def remove_versions(scene_dir: Path, *, keep: set[str]) -> None:
    """Delete version folders but those to keep; one that will not go is left for the next time."""
    for entry in list(scene_dir.iterdir()):
        if VERSION_FOLDER.fullmatch(entry.name) and entry.name not in keep:
            shutil.rmtree(entry, ignore_errors=True)
