"""How long one step of the service's event loop is, in CPU time: what everybody else waits for.

The service runs in this process. On its loop something comes by in every step and reads the
thread's CPU clock, so that what it measures does not depend on what else the machine does.
"""

from __future__ import annotations

import asyncio
import time
from typing import Any, Final

__all__ = ["LoopSteps"]

MOST_SAMPLES: Final = 400_000


class LoopSteps:
    """CPU milliseconds between two steps of a running loop.

    Parameters
    ----------
    loop
        Of another thread.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._last_s: float | None = None
        self._goes_on = True
        self.steps_ms: list[float] = []
        self.cpu_s = 0.0
        loop.call_soon_threadsafe(self._step)

    def stop(self) -> dict[str, Any]:
        """End, and return percentiles; steps in which nothing was done are left out."""
        self._goes_on = False
        steps = sorted(ms for ms in self.steps_ms if ms > 0.02)
        if not steps:
            return {"steps": 0}
        p99 = steps[min(len(steps) - 1, int(0.99 * len(steps)))]
        return {
            "steps": len(steps),
            "p50_ms": round(steps[len(steps) // 2], 2),
            "p99_ms": round(p99, 2),
            "max_ms": round(steps[-1], 2),
            "cpu_s": round(self.cpu_s, 2),
        }

    def _step(self) -> None:
        now_s = time.thread_time()
        if self._last_s is not None and len(self.steps_ms) < MOST_SAMPLES:
            self.steps_ms.append(1e3 * (now_s - self._last_s))
            self.cpu_s += now_s - self._last_s
        self._last_s = now_s
        if self._goes_on:
            self._loop.call_soon(self._step)
