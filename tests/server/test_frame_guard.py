"""What is written while a frame is under way waits for its end."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import Any, cast

from terraport_server.frame_guard import MAX_HELD_BYTES, FrameGuard


class Recorder:
    """Notes what a transport is told."""

    def __init__(self) -> None:
        self.told: list[Any] = []

    def write(self, data: bytes) -> None:
        self.told.append(bytes(data))

    def writelines(self, parts: Iterable[bytes]) -> None:
        self.told += [bytes(part) for part in parts]

    def close(self) -> None:
        self.told.append("close")

    def abort(self) -> None:
        self.told.append("abort")

    def is_closing(self) -> bool:
        return "close" in self.told

    def get_write_buffer_size(self) -> int:
        return 7

    def get_extra_info(self, name: str) -> str:
        return name


def guarded() -> tuple[FrameGuard, list[Any]]:
    recorder = Recorder()
    return FrameGuard(cast("asyncio.Transport", recorder)), recorder.told


def test_outside_of_frames_nothing_waits() -> None:
    guard, told = guarded()
    guard.write(b"a")
    guard.writelines([b"b", b"c"])
    assert guard.get_extra_info("peername") == "peername"
    guard.close()
    assert told == [b"a", b"b", b"c", "close"]


def test_control_frames_and_close_follow_the_frame() -> None:
    guard, told = guarded()
    guard.begin()
    guard.write(b"pong 1")
    guard.write(b"pong 2")
    assert guard.get_write_buffer_size() == 12 + 7
    assert not guard.is_closing()
    guard.close()
    assert guard.is_closing()
    assert told == []
    guard.end()
    assert told == [b"pong 1", b"pong 2", "close"]
    guard.end()
    assert told == [b"pong 1", b"pong 2", "close"]


def test_the_rest_of_a_frame_comes_before_what_waited() -> None:
    guard, told = guarded()
    guard.begin()
    guard.write(b"pong")
    guard.finish(b"rest of the header", b"rest of the payload")
    guard.end()
    assert told == [b"rest of the header", b"rest of the payload", b"pong"]


def test_a_client_that_makes_too_much_wait_is_dropped() -> None:
    guard, told = guarded()
    guard.begin()
    for _ in range(MAX_HELD_BYTES // 125):
        guard.write(bytes(125))
    assert told == []
    guard.write(bytes(125))
    assert told == ["abort"]
    guard.end()
    assert told == ["abort"]


def test_abort_does_not_wait() -> None:
    guard, told = guarded()
    guard.begin()
    guard.write(b"pong")
    guard.abort()
    assert told == ["abort"]
