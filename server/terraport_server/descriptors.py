"""Limit of file descriptors: enough for the allowed connections, and a reserve.

A connection takes one descriptor; many systems start a process with a limit of 1,024. Without this
module, a process could run out of descriptors long before it has ``max_connections`` connections.
"""

from __future__ import annotations

import errno
import logging
from typing import Final

from terraport_server.logging import log

__all__ = ["NO_DESCRIPTOR", "first_reserved", "is_shortage", "make_room", "most_packs"]

NO_DESCRIPTOR: Final = (
    "got a connection while all file descriptors of the service are in use, expected a free one; "
    "try again later, or raise the service's limit of open files (ulimit -n)"
)
"""Error text for the client of a refused connection."""

_OTHERS: Final = 256
"""A few packs, threads' pipes, log, listening sockets."""
_PACKS: Final = 16_384
"""Of scenes in a folder, where the system lets a process have so many."""
_RESERVED: Final = 64
"""Descriptors reserved from connections, or a quarter of all if that is less: for refusing further
connections, watching scenes, and reading files."""


def make_room(max_connections: int) -> None:
    """Raise this process's limit of open files as far as it may be raised and could be needed.

    Logs where that is less than *max_connections* want. Does nothing where the system has no such
    limit.
    """
    try:
        import resource  # Unix has it
    except ImportError:
        return
    wanted = max_connections + _OTHERS
    most = wanted + _PACKS
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= most:
        return
    granted = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(resource.RLIMIT_NOFILE, (granted, hard))
    if granted < wanted:
        log(
            "few descriptors",
            level=logging.WARNING,
            allowed=granted,
            wanted=wanted,
            reason="raise the limit of open files, or lower max_connections",
        )


def first_reserved() -> int | None:
    """Return the lowest descriptor number that no connection may keep; None = unlimited.

    The system always assigns the lowest free number, so a connection with a higher number means
    that nearly all are in use.
    """
    most = _most_descriptors()
    return None if most is None else most - min(_RESERVED, most // 4)


def is_shortage(error: BaseException) -> bool:
    """Return whether an operation failed because no file descriptor was free."""
    return isinstance(error, OSError) and error.errno in {errno.EMFILE, errno.ENFILE}


def most_packs() -> int | None:
    """Return how many packs may be open: half of what the process may; None = without bound.

    With more, no connection could be accepted any more.
    """
    most = _most_descriptors()
    return None if most is None else most // 2


def _most_descriptors() -> int | None:
    """Return how many descriptors this process may have; None = unlimited."""
    try:
        import resource  # Unix has it
    except ImportError:
        return None
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return None if soft == resource.RLIM_INFINITY else soft
