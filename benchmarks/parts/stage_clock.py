"""What each named stage of a process costs: wall seconds, CPU seconds, peak memory."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

__all__ = ["Clock", "resident_mib"]

T = TypeVar("T")


class Clock:
    """Wall seconds, CPU seconds and peak memory of named stages."""

    def __init__(self) -> None:
        self.stages: dict[str, dict[str, float]] = {}

    def __call__(self, stage: str, work: Callable[[], T]) -> T:
        """Do the work and note what it cost."""
        _reset_peak()
        wall, cpu = time.perf_counter(), time.process_time()
        result = work()
        self.stages[stage] = {
            "s": round(time.perf_counter() - wall, 3),
            "cpu_s": round(time.process_time() - cpu, 3),
            "MiB": _status_mib("VmHWM"),
        }
        return result


def _status_mib(field: str) -> int:
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith(field + ":"):
            return int(line.split()[1]) // 1024
    return 0


def _reset_peak() -> None:
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        return  # the figure is then the largest so far


def resident_mib() -> int:
    """Return what this process has resident now."""
    return _status_mib("VmRSS")
