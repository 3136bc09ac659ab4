"""A time by which something must have happened, which is put off at almost no cost."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

__all__ = ["Deadline"]


class Deadline:
    """Calls back when it passes; starting it again puts it off.

    A timer of the event loop costs a microsecond to make and one to cancel. Here one is left
    alone while the deadline moves, and looks when it fires.

    Parameters
    ----------
    loop
    after_s
        From each start.
    passed
        Called once for each start that nothing stopped.
    """

    __slots__ = ("_after_s", "_due_s", "_loop", "_passed", "_timer")

    def __init__(
        self, loop: asyncio.AbstractEventLoop, after_s: float, passed: Callable[[], None]
    ) -> None:
        self._loop = loop
        self._after_s = after_s
        self._passed: Callable[[], None] | None = passed
        self._due_s: float | None = None
        self._timer: asyncio.TimerHandle | None = None

    @property
    def is_running(self) -> bool:
        """Whether it was started, and neither stopped nor passed since."""
        return self._due_s is not None

    def start(self) -> None:
        """Count from now, whether or not it was running; nothing after the end."""
        if self._passed is None:
            return
        self._due_s = self._loop.time() + self._after_s
        if self._timer is None:
            self._timer = self._loop.call_later(self._after_s, self._look)

    def stop(self) -> None:
        """Count no more, until the next start."""
        self._due_s = None

    def end(self) -> None:
        """Count never again: lets go of whoever would have been called."""
        self._due_s = self._passed = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _look(self) -> None:
        self._timer = None
        if self._due_s is None or self._passed is None:
            return
        left_s = self._due_s - self._loop.time()
        if left_s > 0:
            self._timer = self._loop.call_later(left_s, self._look)
        else:
            self._due_s = None
            self._passed()
