"""The cache on disk: bounded, checked, whole, shared."""

from __future__ import annotations

import multiprocessing
import os
import random
import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import xxhash

from terraport_store.byte_cache import ByteCache, CacheKey


def payload(number: int, length: int = 10_000) -> tuple[CacheKey, bytes]:
    data = random.Random(number).randbytes(length)
    return CacheKey("scene", xxhash.xxh3_64_intdigest(data), length), data


def put(cache: ByteCache, number: int, length: int = 10_000) -> CacheKey:
    key, data = payload(number, length)
    cache.put(key, data)
    return key


def path_of(cache: ByteCache, key: CacheKey) -> Path:
    (file,) = cache.folder.glob(f"scene/*/{key.xxh3:016x}-{key.length}")
    return file


def test_keeps_what_was_put(tmp_path: Path) -> None:
    cache = ByteCache(tmp_path / "c", 100_000)
    key, data = payload(1)
    assert cache.open(key) is None
    assert cache.put(key, data).read() == data
    file = cache.open(key)
    assert file is not None
    assert file.read() == data
    assert cache.used_bytes == 10_000
    assert ByteCache(tmp_path / "c", 100_000).used_bytes == 10_000


def test_the_same_again_counts_once(tmp_path: Path) -> None:
    cache = ByteCache(tmp_path, 100_000)
    put(cache, 1)
    put(cache, 1)
    assert cache.used_bytes == 10_000


def test_least_recently_used_goes_first(tmp_path: Path) -> None:
    cache = ByteCache(tmp_path, 100_000)
    keys = [put(cache, number) for number in range(10)]
    for age, key in enumerate(keys):
        then = time.time() - 5000 + age
        os.utime(path_of(cache, key), (then, then))
    cache.open(keys[0])  # used now
    put(cache, 10)
    assert cache.has(keys[0])
    assert not cache.has(keys[1])
    assert cache.has(keys[9])
    assert cache.used_bytes <= 100_000


def test_never_beyond_the_bound(tmp_path: Path) -> None:
    cache = ByteCache(tmp_path, 55_000)
    for number in range(40):
        put(cache, number)
        on_disk = sum(path.stat().st_size for path in tmp_path.glob("scene/*/*"))
        assert on_disk <= 55_000
        assert cache.used_bytes == on_disk
    with pytest.raises(OSError, match="no room for 60000 bytes"):
        put(cache, 99, 60_000)


@pytest.mark.parametrize("damage", ["flip", "cut", "longer", "empty"])
def test_a_damaged_file_is_dropped(tmp_path: Path, damage: str) -> None:
    cache = ByteCache(tmp_path, 100_000)
    key = put(cache, 1)
    path = path_of(cache, key)
    data = path.read_bytes()
    path.write_bytes(
        {
            "flip": data[:5] + bytes([data[5] ^ 1]) + data[6:],
            "cut": data[:-1],
            "longer": data + b"x",
            "empty": b"",
        }[damage]
    )
    assert cache.open(key) is None
    assert not path.exists()
    assert cache.used_bytes == 0


def test_an_open_file_outlives_its_entry(tmp_path: Path) -> None:
    cache = ByteCache(tmp_path, 100_000)
    key, data = payload(1)
    file = cache.put(key, data)
    cache.discard(key)
    assert file.read() == data
    descriptor = file.descriptor
    del file
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(descriptor)


@contextmanager
def full_disk(after_bytes: int) -> Iterator[None]:
    """Let the system refuse to write further into any file, as a full disk does."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (after_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_leaves_nothing_behind(tmp_path: Path) -> None:
    cache = ByteCache(tmp_path, 100_000)
    kept = put(cache, 1)
    key, data = payload(2)
    with full_disk(4096), pytest.raises(OSError, match="File too large"):
        cache.put(key, data)
    assert not cache.has(key)
    assert list((tmp_path / "tmp").iterdir()) == []
    assert cache.used_bytes == 10_000
    assert cache.open(kept) is not None
    cache.put(key, data)
    assert cache.has(key)


def test_left_overs_of_dead_writers_are_swept(tmp_path: Path) -> None:
    cache = ByteCache(tmp_path, 100_000)
    left = tmp_path / "tmp" / "1-1"
    left.write_bytes(b"half")
    fresh = tmp_path / "tmp" / "2-2"
    fresh.write_bytes(b"being written")
    os.utime(left, (0, 0))
    assert cache.sweep()
    assert not left.exists()
    assert fresh.exists()


def test_a_wrong_count_is_set_right(tmp_path: Path) -> None:
    """As a process leaves it that dies between counting and writing."""
    cache = ByteCache(tmp_path, 100_000)
    put(cache, 1)
    (tmp_path / "used").write_bytes((77_000).to_bytes(8, "little"))
    assert cache.used_bytes == 77_000
    assert ByteCache(tmp_path, 100_000).used_bytes == 10_000


def work(folder: Path, seed: int, wrong: multiprocessing.Queue[str]) -> None:
    """Put, read and drop at random; whatever is read must be whole."""
    cache = ByteCache(folder, 120_000)
    choice = random.Random(seed)
    for _ in range(150):
        key, data = payload(choice.randrange(25))
        file = cache.open(key)
        if file is not None and file.read() != data:
            wrong.put("read something else")
        if file is None:
            try:
                if cache.put(key, data).read() != data:
                    wrong.put("put something else")
            except OSError as error:
                if "no room" not in str(error):
                    wrong.put(repr(error))
        if choice.random() < 0.05:
            cache.discard(key)
        if cache.used_bytes > 120_000:
            wrong.put(f"{cache.used_bytes} bytes")


def test_several_processes_share_it(tmp_path: Path) -> None:
    context = multiprocessing.get_context("fork")
    wrong: multiprocessing.Queue[str] = context.Queue()
    workers = [context.Process(target=work, args=(tmp_path, seed, wrong)) for seed in range(3)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join(60)
        assert worker.exitcode == 0
    assert wrong.empty(), wrong.get()
    files = list(tmp_path.glob("scene/*/*"))
    assert files
    for path in files:
        assert f"{xxhash.xxh3_64_hexdigest(path.read_bytes())}-10000" == path.name
    assert list((tmp_path / "tmp").iterdir()) == []
