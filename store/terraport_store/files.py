"""The files of one scene: what they can be asked, and those in a folder.

The reader, the validator and the labels ask :class:`SceneFiles` and know no paths of their own, so
there is one way to read a scene. Paths are those of the manifest, relative to the scene. Which
files an address or a path stands for: :mod:`terraport_store.location`.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Protocol

from terraport_store.index import SegmentIndex
from terraport_store.manifest import FileInfo, Manifest
from terraport_store.source import FileSource, PayloadSource

__all__ = [
    "FolderFiles",
    "LocalCopy",
    "SceneFiles",
    "open_inside",
    "open_regular",
    "path_inside",
]

"""How packs in a folder are read."""

_BLOCK_BYTES = 1 << 20

_AS_THEY_ARE = os.O_RDONLY | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)
"""No link is followed. Windows has neither flag, and its links need a right that few have."""


@dataclass(frozen=True, slots=True)
class LocalCopy:
    """A local folder with the small files of one version, under their paths."""

    path: Path
    close: Callable[[], None]
    """Let it go; may be called again."""


class SceneFiles(Protocol):
    """The files of one scene. Any thread.

    Every method may wait, and raises FileNotFoundError (its ``filename`` is the path as given)
    where a file is missing, OSError or OriginError where it cannot be read.
    """

    @property
    def location(self) -> str:
        """Path or address, as messages name it."""
        ...

    def read(self, path: str, limit: int) -> bytes:
        """Read a whole file, ``limit`` + 1 bytes of it at most."""
        ...

    def fetch(self, file: FileInfo) -> bytes:
        """Read a file of a version, from a cache where there is one; its hash is not compared."""
        ...

    def size(self, path: str) -> int:
        """Bytes of a file."""
        ...

    def blocks(self, file: FileInfo) -> Iterator[bytes]:
        """Read a file from end to end, for its hash."""
        ...

    def stamp(self, path: str) -> Hashable | None:
        """Return something that differs once the file was replaced; None where there is none."""
        ...

    def open_pack(self, file: FileInfo, index: SegmentIndex) -> PayloadSource:
        """Open a pack whose payloads lie as the index says."""
        ...

    def local_copy(self, manifest: Manifest) -> LocalCopy:
        """Return a local folder with base, cover and regions of a version, checked."""
        ...

    def close(self) -> None:
        """Free what this holds; may be called again."""
        ...


def path_inside(folder: Path, path: str) -> Path:
    """Return the path of a file of a scene with links followed, which may not lead out of it.

    Scenes are published over the network: a link in one must not publish what lies elsewhere. The
    folder itself may be a link.

    Parameters
    ----------
    folder : Path
        The scene directory.
    path : str
        Relative to it; need not exist.

    Raises
    ------
    PermissionError
        When it leads out of the folder.
    """
    real = Path(os.path.realpath(folder / path))  # Path.resolve raises where links go in a circle
    if not real.is_relative_to(os.path.realpath(folder)):
        what = "a link leads out of the scene, expected a file inside of it"
        raise PermissionError(errno.EACCES, what, path)
    return real


def open_inside(folder: Path, path: str) -> int:
    """Open a file of a scene for reading, which no link leads out of; return the descriptor.

    As :func:`path_inside`, and what is opened lies in the folder even where somebody who can write
    to it puts a link there meanwhile. What is no file (a pipe, a device, a folder) is not opened.

    Parameters
    ----------
    folder : Path
        The scene directory.
    path : str
        Relative to it.

    Raises
    ------
    PermissionError
        When it leads out of the folder.
    OSError
        When it cannot be opened, or is no regular file.
    """
    real = path_inside(folder, path)
    if os.open not in os.supports_dir_fd:
        return open_regular(real)
    root = os.path.realpath(folder)
    at = os.open(root, _AS_THEY_ARE | os.O_DIRECTORY)
    try:
        *folders, name = real.relative_to(root).parts or (".",)
        for step in folders:
            inner = os.open(step, _AS_THEY_ARE | os.O_DIRECTORY, dir_fd=at)
            os.close(at)
            at = inner
        return open_regular(name, dir_fd=at)
    finally:
        os.close(at)


def open_regular(path: str | Path, *, dir_fd: int | None = None) -> int:
    """Open a regular file for reading, no link, without waiting; return the descriptor.

    Parameters
    ----------
    path : str or Path
    dir_fd : int, optional
        Folder that the path is relative to.

    Raises
    ------
    OSError
        When it cannot be opened, or is something else: a pipe waits for its other end for ever.
    """
    flags = _AS_THEY_ARE | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    descriptor = os.open(path, flags, dir_fd=dir_fd)
    if stat.S_ISREG(os.fstat(descriptor).st_mode):
        return descriptor
    os.close(descriptor)
    raise OSError(errno.EINVAL, "no regular file, expected one", str(path))


class FolderFiles:
    """The files of a scene directory; see :class:`SceneFiles`.

    Links out of the directory are not followed: PermissionError.
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory

    @property
    def location(self) -> str:
        """Path of the directory."""
        return str(self.directory)

    def read(self, path: str, limit: int) -> bytes:
        """Read a whole file; see :class:`SceneFiles`."""
        with self.open(path) as file:
            return file.read(limit + 1)

    def open(self, path: str) -> BinaryIO:
        """Open a file; raises as :func:`open_inside`."""
        with _named(path):
            return os.fdopen(open_inside(self.directory, path), "rb")

    def fetch(self, file: FileInfo) -> bytes:
        """Read a file of a version; see :class:`SceneFiles`."""
        return self.read(file.path, file.bytes)

    def size(self, path: str) -> int:
        """Bytes of a file; see :class:`SceneFiles`."""
        with _named(path):
            return path_inside(self.directory, path).stat().st_size

    def blocks(self, file: FileInfo) -> Iterator[bytes]:
        """Read a file from end to end; see :class:`SceneFiles`."""
        with self.open(file.path) as opened:
            while block := opened.read(_BLOCK_BYTES):
                yield block

    def stamp(self, path: str) -> Hashable | None:
        """Time, size and inode; see :class:`SceneFiles`."""
        try:
            status = (self.directory / path).lstat()
            # No link, and in the folder itself: to follow all links took ten times as long.
            if "/" in path or not stat.S_ISREG(status.st_mode):
                status = path_inside(self.directory, path).stat()
        except OSError:
            return None
        return (status.st_mtime_ns, status.st_size, status.st_ino)

    def open_pack(
        self,
        file: FileInfo,
        index: SegmentIndex,  # noqa: ARG002 - a file needs none
    ) -> PayloadSource:
        """Open a pack; see :class:`SceneFiles`."""
        with _named(file.path):
            descriptor = open_inside(self.directory, file.path)
        return FileSource(descriptor)

    def local_copy(self, manifest: Manifest) -> LocalCopy:  # noqa: ARG002 - all of it is local
        """Return the directory itself."""
        return LocalCopy(self.directory, lambda: None)

    def close(self) -> None:
        """Do nothing."""


@contextmanager
def _named(path: str) -> Iterator[None]:
    """Name a missing file as it was asked for."""
    try:
        yield
    except (FileNotFoundError, NotADirectoryError) as error:
        raise FileNotFoundError(error.errno, error.strerror, path) from None
