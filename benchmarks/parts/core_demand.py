"""How long a program would take on quiet cores, reckoned while other work runs beside it (Linux).

Wall times of a loaded machine say little. But at every look it can be seen how many of a program's
threads run or would run if there were a core (state R), and how much CPU time they have had since
the look before. CPU time spent while one thread wanted a core takes as long on a quiet machine;
while n wanted one, an n-th of it, for n up to the number of cores; time in which none wanted one
stays as it is. Work that ends between two looks is missed: look often.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable
from pathlib import Path

__all__ = ["CoreDemand"]


class CoreDemand:
    """Looks at the threads of some processes, and adds up what they would take alone.

    Parameters
    ----------
    cores : int
        Of the quiet machine.
    """

    def __init__(self, cores: int) -> None:
        self.quiet_s = 0.0
        """Time on quiet cores so far."""
        self.cpu_s = 0.0
        """CPU time that was seen."""
        self._cores = cores
        self._spent: dict[tuple[int, str], float] = {}
        self._looked = time.monotonic()

    def look(self, processes: Iterable[int]) -> None:
        """Look at all threads of these processes."""
        wanted, spent = 0, {}
        for process in processes:
            for thread, state, cpu_s in _threads(process):
                wanted += state == "R"
                spent[process, thread] = cpu_s
        now = time.monotonic()
        passed_s, self._looked = now - self._looked, now
        grown = sum(max(0.0, s - self._spent.get(key, 0.0)) for key, s in spent.items())
        self._spent = spent
        self.cpu_s += grown
        self.quiet_s += grown / min(wanted, self._cores) if wanted else passed_s

    @property
    def busy(self) -> float:
        """Share of the quiet cores' time that would be used, 0 to 1."""
        return self.cpu_s / self.quiet_s / self._cores if self.quiet_s else 0.0


def _threads(process: int) -> list[tuple[str, str, float]]:
    """Read (thread, state, CPU seconds) of a process; what has ended meanwhile is left out."""
    ticks_s = os.sysconf("SC_CLK_TCK")
    found = []
    try:
        for folder in Path(f"/proc/{process}/task").iterdir():
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            found.append((folder.name, fields[0], (int(fields[11]) + int(fields[12])) / ticks_s))
    except OSError:
        pass
    return found
