from __future__ import annotations

from pathlib import Path

from terraport_store.byte_cache import ByteCache, CacheKey
from terraport_store.shelf import Shelf


def key(number: int) -> CacheKey:
    return CacheKey("scene", number, 100)


def test_memory_is_bounded_but_for_the_newest() -> None:
    shelf = Shelf(5000)
    for number in range(200):
        shelf.add(key(number), bytes(100))
        shelf.payload(key(0))
    assert shelf.memory_bytes == 5000
    assert shelf.has(key(0))
    assert not shelf.has(key(1))
    tight = Shelf(0)
    for number in range(200):
        tight.add(key(number), bytes(100))
    assert tight.memory_bytes == 32 * 100
    assert tight.payload(key(199)) == bytes(100)


def test_the_same_again_counts_once() -> None:
    shelf = Shelf(5000)
    shelf.add(key(1), bytes(100))
    shelf.add(key(1), bytes(100))
    assert shelf.memory_bytes == 100
    shelf.drop(key(1))
    shelf.drop(key(1))
    assert shelf.memory_bytes == 0


def test_open_files_are_bounded_and_stay_open_for_their_users(tmp_path: Path) -> None:
    cache, shelf = ByteCache(tmp_path, 1 << 20), Shelf(0)
    shelf.max_files = 20
    first = cache.put(key(0), bytes(100))
    for number in range(shelf.max_files + 1):
        shelf.add(key(number), first if number == 0 else cache.put(key(number), bytes(100)))
    assert shelf.file(key(0)) is None
    assert shelf.file(key(shelf.max_files)) is not None
    assert first.read() == bytes(100)
    shelf.clear()
    assert shelf.file(key(shelf.max_files)) is None
