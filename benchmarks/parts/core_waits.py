"""How long a thread that could have gone on waited for a core, as Linux books it.

Where attackers, service and client share a machine, part of every wait is theirs for its cores.
This tells it apart: neither what a service does nor what it leaves waiting is in it.
"""

from __future__ import annotations

from pathlib import Path

__all__ = ["CoreWaits"]


class CoreWaits:
    """Waits for a core of the main threads of some processes.

    Parameters
    ----------
    *pids : int
        The event loop of a service is its main thread.

    Notes
    -----
    `proc(5)`, ``/proc/PID/task/TID/schedstat``: nanoseconds on a core, nanoseconds runnable and
    waiting for one, times it got one.
    """

    def __init__(self, *pids: int) -> None:
        self._files = [Path(f"/proc/{pid}/task/{pid}/schedstat") for pid in pids]
        self._before_ns = self._now_ns()

    def longest_ms(self) -> float:
        """Return the longest of their waits since the last call.

        The longest, and not all together: two may wait at the same time, and what is taken for the
        machine's must not be more than it was.
        """
        now_ns, before_ns = self._now_ns(), self._before_ns
        self._before_ns = now_ns
        return max(now - before for now, before in zip(now_ns, before_ns, strict=True)) / 1e6

    def _now_ns(self) -> list[int]:
        return [int(file.read_text().split()[1]) for file in self._files]
