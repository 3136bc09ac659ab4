"""How long a block takes and how much memory it holds, children included."""

from __future__ import annotations

import contextlib
import threading
import time
from types import TracebackType
from typing import Self

import psutil

__all__ = ["Measure"]

_INTERVAL_S = 0.05
"""Between two looks; shorter peaks can be missed."""


class Measure:
    """Watches time and resident memory of this process and its children.

    A context manager. Memory shared between parent and children counts once in each.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self.peak_bytes = 0
        self._process = psutil.Process()
        self._stop = threading.Event()
        self._watcher = threading.Thread(target=self._watch, name="memory watch", daemon=True)
        self._started = 0.0

    def __enter__(self) -> Self:
        self._started = time.monotonic()
        self._look()
        self._watcher.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._watcher.join()
        self._look()
        self.seconds = time.monotonic() - self._started

    def _watch(self) -> None:
        while not self._stop.wait(_INTERVAL_S):
            self._look()

    def _look(self) -> None:
        total = int(self._process.memory_info().rss)
        with contextlib.suppress(psutil.Error):
            for child in self._process.children(recursive=True):
                with contextlib.suppress(psutil.Error):  # it may end while we look
                    total += int(child.memory_info().rss)
        self.peak_bytes = max(self.peak_bytes, total)
