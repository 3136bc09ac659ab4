"""One suite for every source: file, memory map, memory."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from terraport_store import FileSource, MemorySource, MmapSource, PayloadSource, RangeError

DATA = np.random.default_rng(2).integers(0, 256, 300_000).astype(np.uint8).tobytes()


@pytest.fixture(params=["file", "mmap", "memory"])
def make(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[bytes], PayloadSource]:
    def build(data: bytes) -> PayloadSource:
        path = tmp_path / "pack"
        path.write_bytes(data)
        makers = {"file": FileSource, "mmap": MmapSource, "memory": lambda _: MemorySource(data)}
        source: PayloadSource = makers[request.param](path)
        request.addfinalizer(source.close)
        return source

    return build


@pytest.mark.parametrize(
    ("offset", "length"), [(0, 0), (0, 1), (299_999, 1), (300_000, 0), (1234, 70_000), (0, 300_000)]
)
def test_reads_exactly_what_was_asked(
    make: Callable[[bytes], PayloadSource], offset: int, length: int
) -> None:
    source = make(DATA)
    assert source.size == len(DATA)
    assert bytes(source.read(offset, length)) == DATA[offset : offset + length]


@pytest.mark.parametrize(
    ("offset", "length"), [(-1, 1), (0, -1), (0, 300_001), (300_000, 1), (2**62, 2**62)]
)
def test_refuses_what_is_not_there(
    make: Callable[[bytes], PayloadSource], offset: int, length: int
) -> None:
    with pytest.raises(RangeError, match=f"{length} bytes at {offset}, expected within 0 to"):
        make(DATA).read(offset, length)


def test_threads_may_read_at_once(make: Callable[[bytes], PayloadSource]) -> None:
    source = make(DATA)

    def read(number: int) -> bool:
        offset = number * 997 % 290_000
        return bytes(source.read(offset, 5000)) == DATA[offset : offset + 5000]

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(read, range(400)))


def test_close_twice_is_fine(make: Callable[[bytes], PayloadSource]) -> None:
    source = make(DATA)
    source.close()
    source.close()


def test_view_in_use_survives_close(tmp_path: Path) -> None:
    """A frame that is being sent when the scene closes stays readable."""
    path = tmp_path / "pack"
    path.write_bytes(DATA)
    source = MmapSource(path)
    view = source.read(100, 50)
    source.close()
    assert bytes(view) == DATA[100:150]


def test_file_cut_short_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "pack"
    path.write_bytes(DATA)
    source = FileSource(path)
    with path.open("r+b") as file:
        file.truncate(1000)
    with pytest.raises(RangeError, match="expected within 0 to 1000"):
        source.read(900, 200)
    source.close()
