"""Waiting for what a real process does in its own time."""

from __future__ import annotations

import time
from collections.abc import Callable

__all__ = ["eventually"]


def eventually(reached: Callable[[], object], timeout_s: float = 10.0) -> None:
    """Wait until something holds; fails when it does not in time."""
    until_s = time.monotonic() + timeout_s
    while not reached():
        assert time.monotonic() < until_s, f"not within {timeout_s:g} s"
        time.sleep(0.02)
