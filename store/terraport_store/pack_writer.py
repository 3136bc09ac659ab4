"""A pack while it is being written."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, BinaryIO

import xxhash

from terraport_store.errors import PublishError
from terraport_store.layout import ALIGNMENT, MAX_PAYLOAD_BYTES

__all__ = ["PackWriter"]


@dataclass(slots=True)
class PackWriter:
    """One pack being written, and its index rows so far."""

    file: BinaryIO
    digest: Any = field(default_factory=xxhash.xxh3_64)
    """Running XXH3-64 of the whole file."""
    size: int = 0
    """Bytes so far."""
    rows: list[tuple[int, int, int]] = field(default_factory=list)
    """Offset, length and hash of every payload."""

    def append(self, payload: bytes) -> None:
        """Add one payload at the next multiple of 64 bytes.

        Raises
        ------
        PublishError
            When the payload is empty or longer than 2^32 - 1 bytes.
        OSError
            When the disk does not take it.
        """
        if not 0 < len(payload) <= MAX_PAYLOAD_BYTES:
            raise PublishError(
                f"payload of {len(payload)} bytes, expected 1 to {MAX_PAYLOAD_BYTES}"
            )
        self.write(bytes(-self.size % ALIGNMENT))
        self.rows.append((self.size, len(payload), xxhash.xxh3_64_intdigest(payload)))
        self.write(payload)

    def write(self, data: bytes) -> None:
        """Add bytes as they are."""
        self.file.write(data)
        self.digest.update(data)
        self.size += len(data)

    def discard(self) -> None:
        """Close the file without caring whether its last bytes reach the disk."""
        with suppress(OSError):  # close() flushes first, which fails again on a full disk
            self.file.close()

    def finish(self) -> None:
        """Wait until everything is on the disk, and close the file."""
        self.file.flush()
        os.fsync(self.file.fileno())
        self.file.close()
