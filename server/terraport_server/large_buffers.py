"""Large buffers under TLS: kept by the process instead of being asked of the system each time.

Under TLS a payload of some 100 KiB passes through three buffers of its size: as it was read, as it
was encrypted, and as the socket takes it. glibc gives buffers of 128 KiB and more back at once, so
that each comes page by page, zeroed, from the kernel: half of what TLS cost.
"""

from __future__ import annotations

import ctypes
from typing import Final

__all__ = ["keep_large_buffers"]

_M_TRIM_THRESHOLD: Final = -1
_M_MMAP_THRESHOLD: Final = -3
"""Of malloc.h, which Python does not have."""

_LARGEST_KEPT_BYTES: Final = 8 << 20
_MAX_KEPT_BYTES: Final = 64 << 20
"""What a process keeps of memory that it does not use."""


def keep_large_buffers(*, wanted: bool) -> bool:
    """Let this process keep freed buffers; tell whether the C library took it (glibc does)."""
    if not wanted:
        return False
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # musl, macOS, Windows
        return False
    kept = mallopt(_M_MMAP_THRESHOLD, _LARGEST_KEPT_BYTES)
    return bool(kept and mallopt(_M_TRIM_THRESHOLD, _MAX_KEPT_BYTES))
