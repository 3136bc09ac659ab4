"""File descriptors of the process: raise their limit, and reserve some for other uses.

Without a reserve a process that has run out of descriptors could not refuse connections, watch
scenes, or read files.
"""

from __future__ import annotations

import contextlib
import errno
import os
from typing import Final

__all__ = [
    "NO_DESCRIPTOR",
    "has_free_descriptors",
    "is_shortage",
    "most_packs",
    "raise_limit",
]

NO_DESCRIPTOR: Final = (
    "got a connection while all file descriptors of the service are in use, expected a free one; "
    "try again later, or raise the service's limit of open files (ulimit -n)"
)
"""Error text for the client of a refused connection."""

_RESERVED: Final = 64
"""Descriptors reserved from connections, or a quarter of all if that is less."""


def raise_limit() -> None:
    """Raise this process's soft limit of open files to the hard one."""
    try:
        import resource  # Unix has it
    except ImportError:
        return
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with contextlib.suppress(ValueError):  # macOS takes no unlimited soft limit
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))


def has_free_descriptors() -> bool:
    """Return whether a new connection leaves the reserve free.

    The system always assigns the lowest free number, so a high one means that nearly all are used.
    """
    most = _most_descriptors()
    if most is None:
        return True
    try:
        number = os.open(os.devnull, os.O_RDONLY)
    except OSError:
        return False
    os.close(number)
    return number < most - min(_RESERVED, most // 4)


def is_shortage(error: BaseException) -> bool:
    """Return whether an operation failed because no file descriptor was free."""
    return isinstance(error, OSError) and error.errno in {errno.EMFILE, errno.ENFILE}


def most_packs() -> int | None:
    """Return how many packs may be open; None = unlimited.

    Half of the descriptors: two each, since the map of a pack that was streamed has its own.
    """
    most = _most_descriptors()
    return None if most is None else most // 4


def _most_descriptors() -> int | None:
    try:
        import resource  # Unix has it
    except ImportError:
        return None
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return None if soft == resource.RLIM_INFINITY else soft
