"""Random access to the payloads of a pack: the interface, and a file on this machine.

Object storage: :mod:`terraport_store.remote_source`.
"""

from __future__ import annotations

import errno
import mmap
import os
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from terraport_store.errors import RangeError

__all__ = [
    "FileSource",
    "PayloadRange",
    "PayloadSource",
    "check_range",
    "read_cached",
]

_NOWAIT: Final = getattr(os, "RWF_NOWAIT", 0)
"""Linux 4.14: fail instead of waiting for the disk. Elsewhere a read may wait."""

_READ_AHEAD_BYTES: Final = 128 << 10
"""Bytes that the kernel usually reads together: of so few, one page tells for all."""

_PROBE: Final = [bytearray(1)]
"""Destination of reads that only find out whether a page is in memory."""


class PayloadRange(NamedTuple):
    """Bytes of an open file, for ``sendfile``."""

    descriptor: int
    """Stays open until the source is closed, or its keeper dropped; not to be closed or moved."""
    offset: int
    length: int
    keeper: object = None
    """Where the descriptor may be closed earlier: it is not while this is referred to."""


class PayloadSource(Protocol):
    """Random access to the bytes of one pack.

    Reads may overlap from any threads; close may not.
    """

    @property
    def size(self) -> int:
        """Length of the whole pack, bytes."""
        ...

    def read(self, offset: int, length: int) -> bytes | memoryview:
        """Read exactly *length* bytes.

        Parameters
        ----------
        offset, length : int
            Bytes, >= 0.

        Returns
        -------
        bytes or memoryview
            A view stays valid until :meth:`close`.

        Raises
        ------
        RangeError
            When the bytes do not all lie inside the source.
        OSError
            When the device fails.
        """
        ...

    def file_range(self, offset: int, length: int) -> PayloadRange | None:
        """Tell where in a file these bytes lie; ``None`` where the source is no file.

        Raises
        ------
        RangeError
            When the bytes do not all lie inside the source.
        """
        ...

    def held(self, offset: int, length: int) -> bytes | memoryview | None:
        """Return bytes that are in memory; ``None`` where they are not. Never waits."""
        ...

    def view(self, offset: int, length: int) -> memoryview | None:
        """Return bytes for a system call to read (``writev``); None where that would wait.

        Python must not read them: where the file was cut short that ends the process, while a
        system call fails. Good until :meth:`close`.
        """
        ...

    def recall(self, offset: int, length: int) -> bool:
        """Bring to hand what takes no network, and tell whether it is. May read a disk."""
        ...

    @property
    def checks_hashes(self) -> bool:
        """Whether nothing is handed out whose hash was not compared by the source itself."""
        ...

    def distrust(self, offset: int, length: int) -> None:
        """Compare the hash again before this is handed out once more, where the source does."""
        ...

    def expect(self, ranges: Sequence[tuple[int, int]]) -> None:
        """Prefetch ranges (offset, length) that will be read soon, in this order. Never waits."""
        ...

    def interrupt(self) -> None:
        """Let what waits for a network fail soon, now and from now on."""
        ...

    def close(self) -> None:
        """Free what the source holds; may be called again."""
        ...


class FileSource:
    """A pack on this machine, read with ``pread``: a file cut short is an error, never a crash.

    Parameters
    ----------
    pack : Path or int
        The pack; an open descriptor is closed with this.
    """

    def __init__(self, pack: Path | int) -> None:
        self._descriptor = _opened(pack)
        self._size = os.fstat(self._descriptor).st_size

    @property
    def size(self) -> int:
        """Length of the whole pack, bytes."""
        return self._size

    def read(self, offset: int, length: int) -> bytes:
        """Read exactly *length* bytes; see :class:`PayloadSource`."""
        check_range(offset, length, self._size)
        data = os.pread(self._descriptor, length, offset)
        while len(data) < length:  # a signal or the 2 GiB limit of one call
            more = os.pread(self._descriptor, length - len(data), offset + len(data))
            if not more:
                raise RangeError(offset, length, offset + len(data))
            data += more
        return data

    def file_range(self, offset: int, length: int) -> PayloadRange:
        """Tell where these bytes lie; see :class:`PayloadSource`."""
        check_range(offset, length, self._size)
        return PayloadRange(self._descriptor, offset, length)

    @cached_property
    def _mapped(self) -> memoryview:
        # As long as the file is now: what a file cut short has lost is never asked for.
        return memoryview(mmap.mmap(self._descriptor, 0, access=mmap.ACCESS_READ))

    def view(self, offset: int, length: int) -> memoryview | None:
        """Return a view of the mapped pack if its ends are in memory; see `PayloadSource`."""
        if offset < 0 or length <= 0 or offset + length > self._size:
            raise RangeError(offset, length, self._size)
        try:
            if length > _READ_AHEAD_BYTES:
                os.preadv(self._descriptor, _PROBE, offset, _NOWAIT)
            # Of a file cut short there is no last byte, and nothing is read.
            if not os.preadv(self._descriptor, _PROBE, offset + length - 1, _NOWAIT):
                return None
        except BlockingIOError:
            return None
        except OSError as error:
            if error.errno != errno.EOPNOTSUPP:  # the disk fails: whoever fetches is told why
                return None
        return self._mapped[offset : offset + length]

    def held(self, offset: int, length: int) -> None:
        """Return None: nothing is kept in memory; see :class:`PayloadSource`."""

    def recall(self, offset: int, length: int) -> bool:  # noqa: ARG002 - any
        """Return True; see :class:`PayloadSource`."""
        return True

    @property
    def checks_hashes(self) -> bool:
        """Return False: the reader does; see :class:`PayloadSource`."""
        return False

    def distrust(self, offset: int, length: int) -> None:
        """Do nothing; see :class:`PayloadSource`."""

    def expect(self, ranges: Sequence[tuple[int, int]]) -> None:
        """Start to read ranges from the disk; see :class:`PayloadSource`."""
        if hasattr(os, "posix_fadvise"):
            for offset, length in ranges:
                os.posix_fadvise(self._descriptor, offset, length, os.POSIX_FADV_WILLNEED)

    def interrupt(self) -> None:
        """Do nothing; see :class:`PayloadSource`."""

    def close(self) -> None:
        """Close the descriptor; may be called again. A view in use keeps the map."""
        self.__dict__.pop("_mapped", None)
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


def read_cached(where: PayloadRange, *, may_wait: bool = False) -> memoryview | None:
    """Return the bytes of a range; None where they are not all in memory, or the file ends before.

    Parameters
    ----------
    where
    may_wait
        Whether to read them even if that waits for the disk.
    """
    room = memoryview(bytearray(where.length))
    try:
        got = os.preadv(where.descriptor, [room], where.offset, 0 if may_wait else _NOWAIT)
    except OSError:
        return None
    return room if got == where.length else None


def check_range(offset: int, length: int, size: int) -> None:
    """Refuse a range that does not lie in *size* bytes.

    Raises
    ------
    RangeError
        With what was asked for and what there is.
    """
    if offset < 0 or length < 0 or offset + length > size:
        raise RangeError(offset, length, size)


def _opened(pack: Path | int) -> int:
    return pack if isinstance(pack, int) else os.open(pack, os.O_RDONLY | os.O_CLOEXEC)
