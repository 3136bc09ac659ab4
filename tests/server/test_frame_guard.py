"""What is written while a frame is under way waits for its end."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import Any, cast

from terraport_server.frame_guard import MAX_HELD_BYTES, FrameGuard


class Recorder:
    """Notes what a transport is told."""

    def __init__(self) -> None:
        self.written: list[Any] = []

    def write(self, data: bytes) -> None:
        self.written.append(bytes(data))

    def writelines(self, buffers: Iterable[bytes]) -> None:
        self.written += [bytes(data) for data in buffers]

    def close(self) -> None:
        self.written.append("close")

    def abort(self) -> None:
        self.written.append("abort")

    def is_closing(self) -> bool:
        return "close" in self.written

    def get_write_buffer_size(self) -> int:
        return 7

    def get_extra_info(self, name: str) -> str:
        return name


def guarded() -> tuple[FrameGuard, list[Any]]:
    recorder = Recorder()
    return FrameGuard(cast("asyncio.Transport", recorder)), recorder.written


def test_outside_of_frames_nothing_waits() -> None:
    guard, written = guarded()
    guard.write(b"a")
    guard.writelines([b"b", b"c"])
    assert guard.get_extra_info("peername") == "peername"
    guard.close()
    assert written == [b"a", b"b", b"c", "close"]


def test_control_frames_and_close_follow_the_frame() -> None:
    guard, written = guarded()
    guard.begin()
    guard.write(b"pong 1")
    guard.write(b"pong 2")
    assert guard.get_write_buffer_size() == 12 + 7
    assert not guard.is_closing()
    guard.close()
    assert guard.is_closing()
    assert written == []
    guard.end()
    assert written == [b"pong 1", b"pong 2", "close"]
    guard.end()
    assert written == [b"pong 1", b"pong 2", "close"]


def test_the_rest_of_a_frame_comes_before_what_waited() -> None:
    guard, written = guarded()
    guard.begin()
    guard.write(b"pong")
    guard.finish(b"rest of the header", b"rest of the payload")
    guard.end()
    assert written == [b"rest of the header", b"rest of the payload", b"pong"]


def test_a_client_that_makes_too_much_wait_is_dropped() -> None:
    guard, written = guarded()
    guard.begin()
    for _ in range(MAX_HELD_BYTES // 125):
        guard.write(bytes(125))
    assert written == []
    guard.write(bytes(125))
    assert written == ["abort"]
    guard.end()
    assert written == ["abort"]


def test_abort_does_not_wait() -> None:
    guard, written = guarded()
    guard.begin()
    guard.write(b"pong")
    guard.abort()
    assert written == ["abort"]
