"""Deadlines on a clock that the test moves."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from terraport_server.deadline import Deadline


class Loop(asyncio.AbstractEventLoop):
    """Time and timers alone."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.made = 0
        self._timers: list[tuple[float, Timer]] = []

    def time(self) -> float:
        return self.now_s

    def call_later(self, delay: float, callback: Callable[[], None]) -> Timer:  # type: ignore[override]
        self.made += 1
        timer = Timer(callback)
        self._timers.append((self.now_s + delay, timer))
        return timer

    def go_to(self, now_s: float) -> None:
        """Let time pass, timer by timer."""
        while due := [item for item in self._timers if item[0] <= now_s]:
            item = min(due, key=lambda one: one[0])
            self._timers.remove(item)
            self.now_s = max(self.now_s, item[0])
            item[1].fire()
        self.now_s = now_s


class Timer:
    def __init__(self, callback: Callable[[], None]) -> None:
        self._callback: Callable[[], None] | None = callback

    def cancel(self) -> None:
        self._callback = None

    def fire(self) -> None:
        if self._callback is not None:
            self._callback()


def test_it_passes_once() -> None:
    loop, passed = Loop(), list[float]()
    deadline = Deadline(loop, 10, lambda: passed.append(loop.now_s))
    deadline.start()
    loop.go_to(9)
    assert deadline.is_running
    loop.go_to(30)
    assert passed == [10]
    assert not deadline.is_running


def test_a_start_puts_it_off_without_a_timer_of_its_own() -> None:
    loop, passed = Loop(), list[float]()
    deadline = Deadline(loop, 10, lambda: passed.append(loop.now_s))
    for second in range(9):
        loop.go_to(second)
        deadline.start()
    assert loop.made == 1
    loop.go_to(30)
    assert passed == [18]


def test_a_stop_holds_until_the_next_start() -> None:
    loop, passed = Loop(), list[float]()
    deadline = Deadline(loop, 10, lambda: passed.append(loop.now_s))
    deadline.start()
    deadline.stop()
    loop.go_to(30)
    assert not passed
    deadline.start()
    loop.go_to(35)
    deadline.stop()
    deadline.start()
    loop.go_to(100)
    assert passed == [45]


def test_an_end_calls_nobody() -> None:
    loop, passed = Loop(), list[float]()
    deadline = Deadline(loop, 10, lambda: passed.append(loop.now_s))
    deadline.start()
    deadline.end()
    loop.go_to(100)
    assert not passed
