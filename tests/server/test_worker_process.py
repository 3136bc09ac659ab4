"""When a worker counts as silent."""

from __future__ import annotations

from typing import Any

from terraport_server.worker_process import TICK_S, WorkerProcess


class _Channel:
    def __init__(self) -> None:
        self.said: list[tuple[str, dict[str, Any]]] = []

    def say(self, kind: str, **fields: Any) -> None:
        self.said.append((kind, fields))


def test_silence_is_counted_in_looks_and_ends_with_a_word() -> None:
    worker = WorkerProcess(0, None, _Channel())  # type: ignore[arg-type]
    looks = 0
    while not worker.is_silent:
        worker.tick()
        looks += 1
    # Several missed words, and well below what a client waits for.
    assert 0.5 < looks * TICK_S <= 0.8
    assert worker.silent_s == looks * TICK_S
    assert worker.heard()
    assert not worker.heard()
    assert not worker.is_silent
    assert worker.silent_s == 0.0


def test_it_is_told_only_what_changes() -> None:
    channel = _Channel()
    worker = WorkerProcess(1, None, channel)  # type: ignore[arg-type]
    worker.listen((1,))
    assert channel.said == []
    for slots in ((0, 1), (0, 1), (1,)):
        worker.listen(slots)
    assert channel.said == [("listen", {"slots": (0, 1)}), ("listen", {"slots": (1,)})]
