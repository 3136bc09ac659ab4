"""Payloads that can be handed out at once: open files of the cache, or bytes in memory.

Bytes are kept in memory only where the cache on disk took none; what is in a file is kept in memory
by the system, which knows better how much of it there is room for.
"""

from __future__ import annotations

import resource
import threading
from collections import OrderedDict
from typing import Final

from terraport_store.byte_cache import CachedFile, CacheKey

__all__ = ["Shelf"]

MAX_OPEN_FILES: Final = 1024
"""And a quarter of the descriptors that the process may have, if that is less: sockets need them
too, and opening a file again costs 0.1 ms."""

_NEWEST: Final = 32
"""Payloads in memory that stay whatever their size: what was just read is about to be sent."""


class Shelf:
    """Least recently used out first, within two bounds. Any thread.

    Parameters
    ----------
    max_bytes : int
        Of what is in memory; the newest 32 payloads stay even beyond it.
    """

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self.max_files = min(MAX_OPEN_FILES, resource.getrlimit(resource.RLIMIT_NOFILE)[0] // 4)
        """Files that are open at once."""
        self._bytes = 0
        self._files: OrderedDict[CacheKey, CachedFile] = OrderedDict()
        self._memory: OrderedDict[CacheKey, bytes] = OrderedDict()
        self._lock = threading.Lock()

    @property
    def memory_bytes(self) -> int:
        """Sum of the payloads that are held as bytes; open files are not in it."""
        return self._bytes

    def file(self, key: CacheKey) -> CachedFile | None:
        """Return the open file of a payload."""
        with self._lock:
            file = self._files.get(key)
            if file is not None:
                self._files.move_to_end(key)
            return file

    def payload(self, key: CacheKey) -> bytes | None:
        """Return a payload that is in memory."""
        with self._lock:
            payload = self._memory.get(key)
            if payload is not None:
                self._memory.move_to_end(key)
            return payload

    def has(self, key: CacheKey) -> bool:
        """Tell whether it is here in either form."""
        return key in self._files or key in self._memory

    def add(self, key: CacheKey, held: CachedFile | bytes) -> None:
        """Put a payload here; its hash is right."""
        with self._lock:
            if isinstance(held, CachedFile):
                self._files[key] = held
                self._files.move_to_end(key)
                while len(self._files) > self.max_files:
                    self._files.popitem(last=False)
                return
            before = self._memory.pop(key, None)
            self._bytes += len(held) - (len(before) if before is not None else 0)
            self._memory[key] = held
            while self._bytes > self._max_bytes and len(self._memory) > _NEWEST:
                _, gone = self._memory.popitem(last=False)
                self._bytes -= len(gone)

    def drop(self, key: CacheKey) -> None:
        """Take a payload away; whoever uses it goes on."""
        with self._lock:
            self._files.pop(key, None)
            gone = self._memory.pop(key, None)
            self._bytes -= len(gone) if gone is not None else 0

    def clear(self) -> None:
        """Drop files and payloads; whoever uses one goes on."""
        with self._lock:
            self._files.clear()
            self._memory.clear()
            self._bytes = 0
