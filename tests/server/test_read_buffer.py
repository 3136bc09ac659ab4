"""Ranges of files in one buffer: what lies together at once, and nothing that is not there."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from terraport_server import read_buffer
from terraport_server.read_buffer import ReadBuffer, read_cached
from terraport_store import PayloadRange

DATA = bytes(range(256)) * 8


@pytest.fixture
def descriptor(tmp_path: Path) -> Iterator[int]:
    (tmp_path / "pack").write_bytes(DATA)
    number = os.open(tmp_path / "pack", os.O_RDONLY)
    yield number
    os.close(number)


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """Offset and length of each read."""
    seen: list[tuple[int, int]] = []
    preadv = os.preadv

    def spy(descriptor: int, buffers: Any, offset: int, flags: int = 0) -> int:
        seen.append((offset, sum(map(len, buffers))))
        return preadv(descriptor, buffers, offset, flags)

    monkeypatch.setattr(os, "preadv", spy)
    return seen


def test_neighbours_are_read_at_once_and_views_passed(
    descriptor: int, reads: list[tuple[int, int]]
) -> None:
    mapped = memoryview(b"mapped")
    ranges: list[PayloadRange | memoryview] = [
        PayloadRange(descriptor, 10, 20),
        PayloadRange(descriptor, 30, 5),
        mapped,
        PayloadRange(descriptor, 35, 3),
        PayloadRange(descriptor, 100, 7),
    ]
    views = ReadBuffer(64).fill(ranges, fetched=False)
    assert [bytes(view) for view in views] == [
        DATA[10:30], DATA[30:35], b"mapped", DATA[35:38], DATA[100:107],
    ]  # fmt: skip
    assert reads == [(10, 25), (35, 3), (100, 7)]


def test_it_ends_where_the_file_or_the_room_ends(descriptor: int) -> None:
    buffer = ReadBuffer(50)
    beyond = [PayloadRange(descriptor, len(DATA) - 8, 8), PayloadRange(descriptor, len(DATA), 8)]
    assert [bytes(view) for view in buffer.fill(beyond, fetched=False)] == [DATA[-8:]]
    assert buffer.fill(beyond[1:], fetched=True) == []
    much = [PayloadRange(descriptor, 20 * number, 20) for number in range(4)]
    assert [bytes(view) for view in buffer.fill(much, fetched=False)] == [DATA[:20], DATA[20:40]]


def test_what_takes_a_wait_is_left_out_until_it_was_fetched(
    descriptor: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def not_in_memory(*_: Any) -> int:
        raise BlockingIOError

    monkeypatch.setattr(os, "preadv", not_in_memory)
    monkeypatch.setattr(read_buffer, "_NOWAIT", 8)
    ranges = [PayloadRange(descriptor, 0, 20), PayloadRange(descriptor, 20, 20)]
    buffer = ReadBuffer(64)
    assert buffer.fill(ranges, fetched=False) == []
    assert read_cached(ranges[0]) is None
    assert [bytes(view) for view in buffer.fill(ranges, fetched=True)] == [DATA[:20]]


def test_a_file_system_without_nowait_is_read_all_the_same(
    descriptor: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: Any) -> int:
        raise OSError(errno.EOPNOTSUPP, "not here")

    monkeypatch.setattr(os, "preadv", refused)
    monkeypatch.setattr(read_buffer, "_NOWAIT", 8)
    view = read_cached(PayloadRange(descriptor, 3, 9))
    assert view is not None
    assert bytes(view) == DATA[3:12]
