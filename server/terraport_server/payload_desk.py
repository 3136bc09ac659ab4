"""Hands out the payload bytes of one scene to all of its clients: checked once, never copied twice.

A segment's hash is compared when it is first asked for, by whichever client comes first; from then
on its bytes go from the page cache to any number of sockets without this process touching them. A
client that finds a wrong hash nevertheless says so (``reject``), and the segment is checked again.
Why not every time: ``docs/decisions/0017-payload-by-sendfile.md``.

The event loop's thread never waits for a disk: what is not in the page cache is read in a thread
first, once for all clients that want it at that moment.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from concurrent.futures import Executor

from terraport_server.actions import SendChunk
from terraport_store import PayloadRange, RangeError, Scene

__all__ = ["PayloadDesk"]

_NOWAIT = getattr(os, "RWF_NOWAIT", 0)
"""Linux 4.14: fail instead of waiting for the disk."""

_PROBE = [bytearray(1)]
"""Where a probe's byte goes; nobody looks at it."""


class PayloadDesk:
    """The payloads of one open scene. Lives on one event loop.

    Parameters
    ----------
    scene
        Open while anybody holds it.
    readers
        Threads that may wait for the disk; those of the event loop by default.
    hold, release
        Keep the scene open, and let it go, around the work of a thread.
    """

    def __init__(
        self,
        scene: Scene,
        readers: Executor | None,
        *,
        hold: Callable[[], None],
        release: Callable[[], None],
    ) -> None:
        self._scene = scene
        self._readers = readers
        self._hold = hold
        self._release = release
        self._fetching: dict[tuple[str, int, int], asyncio.Future[None]] = {}

    def part(
        self, chunk: SendChunk, encoding: str, *, as_file: bool
    ) -> PayloadRange | memoryview | None:
        """Return the chunk's bytes, or where they lie; ``None`` where that would take a wait.

        After ``None``, :meth:`fetch` the chunk and ask again.

        Parameters
        ----------
        chunk
        encoding
        as_file
            Whether the caller can send from a file; bytes are returned otherwise.
        """
        scene, segment = self._scene, chunk.segment
        if not scene.is_verified(segment, encoding):
            return None
        found = scene.payload_range(segment, encoding, chunk.offset, chunk.length)
        if found is None:
            data = memoryview(scene.payload(segment, encoding))
            return data[chunk.offset : chunk.offset + chunk.length]
        if not _is_cached(found):
            return None
        if as_file:
            return found
        part = os.pread(found.descriptor, found.length, found.offset)
        if len(part) < found.length:  # cut short since it was checked: let the check say so
            scene.distrust(segment, encoding)
            return None
        return memoryview(part)

    async def fetch(self, chunk: SendChunk, encoding: str) -> None:
        """Bring the chunk's bytes into memory, and compare the segment's hash unless that was done.

        Cancelling it leaves the thread to finish for the others.

        Raises
        ------
        StoreError
            When the payload is not what the index says, or the pack is too short.
        OSError
            When the disk fails.
        """
        checked = self._scene.is_verified(chunk.segment, encoding)
        key = (encoding, chunk.segment, chunk.offset if checked else 0)
        fetching = self._fetching.get(key)
        if fetching is None:
            work = self._touch if checked else self._check
            self._hold()
            fetching = asyncio.get_running_loop().run_in_executor(
                self._readers, work, chunk, encoding
            )
            self._fetching[key] = fetching
            fetching.add_done_callback(lambda done: self._fetched(key, done))
        await asyncio.shield(fetching)

    def distrust(self, segment: int) -> None:
        """Compare the segment's hashes again before it is sent once more."""
        for encoding in self._scene.manifest.encodings:
            self._scene.distrust(segment, encoding)

    def _fetched(self, key: tuple[str, int, int], done: asyncio.Future[None]) -> None:
        del self._fetching[key]
        self._release()
        if not done.cancelled():
            done.exception()  # seen, though whoever asked may have gone

    def _check(self, chunk: SendChunk, encoding: str) -> None:
        self._scene.payload(chunk.segment, encoding)

    def _touch(self, chunk: SendChunk, encoding: str) -> None:
        found = self._scene.payload_range(chunk.segment, encoding, chunk.offset, chunk.length)
        if found is None:
            return
        got = len(os.pread(found.descriptor, found.length, found.offset))
        if got < found.length:
            self._scene.distrust(chunk.segment, encoding)
            raise RangeError(found.offset, found.length, found.offset + got)


def _is_cached(part: PayloadRange) -> bool:
    """Tell whether the first page of a range, and so what was read with it, is in memory."""
    if not _NOWAIT:
        return True
    try:
        return bool(os.preadv(part.descriptor, _PROBE, part.offset, _NOWAIT))
    except BlockingIOError:
        return False
    except OSError:
        return True  # not on this file system, or the disk fails: the send will tell
