"""Room for the connections that the settings allow.

A connection takes two descriptors while it streams; many systems start a process with 1,024 in
all. Without this, ``max_connections`` would be a promise that the system breaks first.
"""

from __future__ import annotations

import logging
from typing import Final

from terraport_server.logs import log

__all__ = ["make_room"]

_PER_CONNECTION: Final = 2
_OTHERS: Final = 256
"""Packs, threads' pipes, log, listening sockets."""


def make_room(max_connections: int) -> None:
    """Raise this process's limit of open files as far as it may be raised and is needed.

    Logs where that is less than *max_connections* want. Does nothing where the system has no such
    limit.
    """
    try:
        import resource  # Unix has it
    except ImportError:
        return
    wanted = _PER_CONNECTION * max_connections + _OTHERS
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= wanted:
        return
    granted = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    resource.setrlimit(resource.RLIMIT_NOFILE, (granted, hard))
    if granted < wanted:
        log(
            "few descriptors",
            level=logging.WARNING,
            allowed=granted,
            wanted=wanted,
            reason="raise the limit of open files, or lower max_connections",
        )
