"""Which program listens on a port of this machine, where Linux says so without more rights."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Final

__all__ = ["port_holder"]

_PROC: Final = Path("/proc")
_LISTENING: Final = "0A"
"""TCP_LISTEN in /proc/net/tcp."""


def port_holder(port: int) -> str | None:
    """Name the program that listens on a TCP port, on any address: ``caddy (process 812)``.

    Its arguments are left out, but for the verb of ``terraport``: they may hold secrets.

    Returns
    -------
    str or None
        None where nothing listens, or the system does not say: it is no Linux, or the process is
        another user's.
    """
    inodes = _listening_inodes(port)
    if not inodes:
        return None
    # Of several that share it, the oldest: a service, not its workers.
    processes = sorted(int(entry.name) for entry in _PROC.iterdir() if entry.name.isdecimal())
    for process in processes:
        if _holds(process, inodes):
            return "this very process" if process == os.getpid() else _name_of(process)
    return None


def _listening_inodes(port: int) -> set[str]:
    """Links of the sockets that listen, as /proc/PID/fd shows them."""
    inodes = set()
    for table in ("tcp", "tcp6"):
        with contextlib.suppress(OSError):
            for line in (_PROC / "net" / table).read_text(encoding="ascii").splitlines()[1:]:
                fields = line.split()
                local_port = int(fields[1].rpartition(":")[2], 16)
                if local_port == port and fields[3] == _LISTENING:
                    inodes.add(f"socket:[{fields[9]}]")
    return inodes


def _holds(process: int, links: set[str]) -> bool:
    with contextlib.suppress(OSError):  # it has ended, or is another user's
        for descriptor in (_PROC / str(process) / "fd").iterdir():
            with contextlib.suppress(OSError):
                if str(descriptor.readlink()) in links:
                    return True
    return False


def _name_of(process: int) -> str:
    """Name a process for people: of an interpreter the script or module that it runs."""
    words: list[str] = []
    with contextlib.suppress(OSError):
        words = (_PROC / str(process) / "cmdline").read_text("utf-8", "replace").split("\0")
    name, *rest = [Path(words[0]).name if words else "", *words[1:], ""]
    if name.startswith("python"):
        if rest[0] == "-m" and len(rest) > 1:
            name = f"{name} -m {rest[1]}"
        elif rest[0] and not rest[0].startswith("-"):
            name, *rest = [Path(rest[0]).name, *rest[1:]]
    if name == "terraport" and rest and rest[0].isalpha():
        name = f"{name} {rest[0]}"
    return f"{name or 'a program'} (process {process})"
