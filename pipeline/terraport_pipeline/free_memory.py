"""Memory that a command allows itself when nobody says how much."""

from __future__ import annotations

from pathlib import Path
from typing import Final

__all__ = ["MEMORY_SHARE", "available_memory_bytes", "default_memory_bytes"]

MEMORY_SHARE: Final = 0.8
"""Share of the memory that is free at the start which a command allows itself."""


def available_memory_bytes() -> int:
    """Return what is free for this process: on the machine, or in its container if that is less."""
    import psutil  # needed by builds, not to print help

    free = int(psutil.virtual_memory().available)
    try:
        limit = Path("/sys/fs/cgroup/memory.max").read_text(encoding="ascii").strip()
        used = int(Path("/sys/fs/cgroup/memory.current").read_text(encoding="ascii"))
    except (OSError, ValueError):
        return free
    return free if limit == "max" else max(0, min(free, int(limit) - used))


def default_memory_bytes() -> int:
    """Memory that a build allows itself when not told."""
    return int(MEMORY_SHARE * available_memory_bytes())
