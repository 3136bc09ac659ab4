"""Bytes of files on their way to sockets: what is in the page cache, and nothing that takes a wait.

One system call reads what lies together and tells whether it is in memory, so nothing is asked
first. A send copies what was read out of here at once, while it is still in the processor's cache;
so one buffer does for all clients of a service.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Final

from terraport_store import PayloadRange

__all__ = ["ReadBuffer", "read_cached"]

_NOWAIT: Final = getattr(os, "RWF_NOWAIT", 0)
"""Linux 4.14: fail instead of waiting for the disk. Elsewhere a read may wait."""


class ReadBuffer:
    """Room for one batch of payload, used again and again. Lives on one event loop.

    Parameters
    ----------
    size
        Bytes.
    """

    def __init__(self, size: int) -> None:
        self._room = memoryview(bytearray(size))

    def at_hand(self, file_range: PayloadRange) -> memoryview | None:
        """Return all bytes of a range that fits in here, if no disk is waited for; else None.

        Good until the next call. Always None where the system cannot tell beforehand.
        """
        room = self._room[: file_range.length]
        if not _NOWAIT or len(room) < file_range.length:
            return None
        try:
            got = os.preadv(file_range.descriptor, [room], file_range.offset, _NOWAIT)
        except OSError:  # a wait, not on this file system, or the disk fails: a thread finds out
            return None
        return room if got == len(room) else None

    def fill(
        self, payloads: Sequence[PayloadRange | memoryview], *, fetched: bool
    ) -> list[memoryview]:
        """Read ranges; views are passed through.

        Parameters
        ----------
        payloads
        fetched
            Whether the first was brought into memory a moment ago. Then it is read whatever that
            takes: a file system may tell otherwise for ever.

        Returns
        -------
        list of memoryview
            Good until the next call. Ends before the first range that is not in memory (or cannot
            be read), or does not fit.
        """
        views: list[memoryview] = []
        room, at, count = self._room, 0, len(payloads)
        while len(views) < count:
            first = payloads[len(views)]
            if not isinstance(first, PayloadRange):
                views.append(first)
                continue
            descriptor, offset, length, keeper = first
            # What follows in the file, the next chunk or the neighbour, comes with it.
            together, end = [length], offset + length
            for other in payloads[len(views) + 1 :]:
                if not isinstance(other, PayloadRange):
                    break
                its_descriptor, its_offset, its_length, _ = other
                if its_offset != end or its_descriptor != descriptor:
                    break
                together.append(its_length)
                end += its_length
            length = end - offset
            if at + length > len(room):
                length = max(0, len(room) - at)
            got = _read(PayloadRange(descriptor, offset, length, keeper), room[at : at + length])
            if fetched and not views and got < together[0]:
                got = _read_plainly(first, room[: together[0]])
            for part in together:
                if got < part:
                    return views
                views.append(room[at : at + part])
                at, got = at + part, got - part
        return views


def read_cached(file_range: PayloadRange) -> memoryview | None:
    """Return the bytes of a range, where they are in memory."""
    room = memoryview(bytearray(file_range.length))
    return room if _read(file_range, room) == len(room) else None


def _read(file_range: PayloadRange, room: memoryview) -> int:
    """Read what is in memory; 0 where nothing is: whoever waits for the disk is told why."""
    if not _NOWAIT:
        return _read_plainly(file_range, room)
    try:
        return os.preadv(file_range.descriptor, [room], file_range.offset, _NOWAIT)
    except BlockingIOError:
        return 0
    except OSError:  # not on this file system, or the disk fails
        return _read_plainly(file_range, room)


def _read_plainly(file_range: PayloadRange, room: memoryview) -> int:
    try:
        data = os.pread(file_range.descriptor, len(room), file_range.offset)
    except OSError:
        return 0
    room[: len(data)] = data
    return len(data)
