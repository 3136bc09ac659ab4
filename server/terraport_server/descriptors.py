"""Room for the connections that the settings allow.

A connection takes two descriptors while it streams; many systems start a process with 1,024 in
all. Without this, ``max_connections`` would be a promise that the system breaks first.
"""

from __future__ import annotations

import logging
from typing import Final

from terraport_server.logs import log

__all__ = ["make_room", "most_packs"]

_PER_CONNECTION: Final = 2
_OTHERS: Final = 256
"""A few packs, threads' pipes, log, listening sockets."""
_PACKS: Final = 16_384
"""Of scenes in a folder, where the system lets a process have so many."""


def make_room(max_connections: int) -> None:
    """Raise this process's limit of open files as far as it may be raised and could be needed.

    Logs where that is less than *max_connections* want. Does nothing where the system has no such
    limit.
    """
    try:
        import resource  # Unix has it
    except ImportError:
        return
    wanted = _PER_CONNECTION * max_connections + _OTHERS
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


def most_packs() -> int | None:
    """Return how many packs may be open: half of what the process may; None = without bound.

    With more, no connection could be accepted any more.
    """
    try:
        import resource  # Unix has it
    except ImportError:
        return None
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return None if soft == resource.RLIM_INFINITY else soft // 2
