"""The disk cache on a real disk."""

from __future__ import annotations

import logging
import os
import time
from pathlib import Path

import pytest
import xxhash

from terraport.cache import CachedSegment, SegmentFacts
from terraport.disk_cache import DiskCache
from terraport.errors import CorruptSegmentError, UsageError

KEY = "0123456789abcdef"


def entry(segment: int, size: int = 1000, fill: int = 7) -> CachedSegment:
    payload = bytes([fill]) * size
    xxh3 = xxhash.xxh3_64_intdigest(payload)
    facts = SegmentFacts(segment, size, xxh3, 5, 6, (0.0, 1.0, 2.0, 3.0, 4.0, 5.0))
    return CachedSegment(facts, payload)


def age(folder: Path, seconds: float) -> None:
    """Make every file of a folder look older."""
    for path in folder.rglob("*.*"):
        used_s = path.stat().st_mtime - seconds
        os.utime(path, (used_s, used_s))


def test_what_is_put_comes_back_in_another_run(tmp_path: Path) -> None:
    cached = entry(3)
    assert DiskCache(tmp_path, KEY).put(cached) == []
    again = DiskCache(tmp_path, KEY)
    assert again.catalogue() == {3: cached.facts.xxh3}
    assert again.get(3, cached.facts.xxh3) == cached
    assert again.get(4, cached.facts.xxh3) is None


def test_scenes_do_not_mix(tmp_path: Path) -> None:
    DiskCache(tmp_path, KEY).put(entry(3))
    assert DiskCache(tmp_path, KEY[::-1]).catalogue() == {}


@pytest.mark.parametrize("where", [0, 8, 20, 60, 64, 500, -1])
def test_any_flipped_byte_is_found_and_the_file_deleted(tmp_path: Path, where: int) -> None:
    disk, cached = DiskCache(tmp_path, KEY), entry(3)
    disk.put(cached)
    (path,) = tmp_path.rglob("*.segment-2")
    data = bytearray(path.read_bytes())
    data[where] ^= 1
    path.write_bytes(data)
    with pytest.raises(CorruptSegmentError, match=f"segment 3 from {path}"):
        disk.get(3, cached.facts.xxh3)
    assert not path.exists()
    assert disk.get(3, cached.facts.xxh3) is None


@pytest.mark.parametrize("length", [0, 10, 64, 1000])
def test_any_truncation_is_found(tmp_path: Path, length: int) -> None:
    disk, cached = DiskCache(tmp_path, KEY), entry(3)
    disk.put(cached)
    (path,) = tmp_path.rglob("*.segment-2")
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(CorruptSegmentError):
        disk.get(3, cached.facts.xxh3)


def test_the_bound_holds_and_the_longest_unused_goes_first(tmp_path: Path) -> None:
    disk = DiskCache(tmp_path, KEY, max_bytes=5 * 1064)
    for segment in range(4):
        disk.put(entry(segment, fill=segment))
        age(tmp_path, 100)
    disk.get(0, entry(0, fill=0).facts.xxh3)  # used just now
    assert disk.put(entry(4, fill=4)) == []
    removed = disk.put(entry(5, fill=5))
    assert removed == [1, 2]
    assert sum(path.stat().st_size for path in tmp_path.rglob("*.segment-2")) <= 5 * 1064
    assert set(DiskCache(tmp_path, KEY).catalogue()) == {0, 3, 4, 5}


def test_the_bound_counts_other_scenes_and_earlier_runs(tmp_path: Path) -> None:
    other = DiskCache(tmp_path, KEY[::-1])
    other.put(entry(9))
    age(tmp_path, 100)
    disk = DiskCache(tmp_path, KEY, max_bytes=2 * 1064)
    disk.catalogue()
    assert disk.put(entry(1)) == []
    assert disk.put(entry(2)) == [1]  # the other scene's file went first, and is not ours to tell
    assert other.catalogue() == {}


def test_larger_than_the_bound_is_not_written(tmp_path: Path) -> None:
    disk = DiskCache(tmp_path, KEY, max_bytes=500)
    assert disk.put(entry(1)) is None
    assert disk.catalogue() == {}


def test_the_newer_of_two_versions_of_a_segment_counts(tmp_path: Path) -> None:
    disk = DiskCache(tmp_path, KEY)
    disk.put(entry(1, fill=1))
    age(tmp_path, 50)
    disk.put(entry(1, fill=2))
    assert disk.catalogue() == {1: entry(1, fill=2).facts.xxh3}
    assert len(list(tmp_path.rglob("*.segment-2"))) == 1


def test_blobs_are_checked_too(tmp_path: Path) -> None:
    disk = DiskCache(tmp_path, KEY)
    disk.put_blob("base-glb-v1", b"mesh")
    assert disk.get_blob("base-glb-v1") == b"mesh"
    assert disk.get_blob("base-glb-v2") is None
    (path,) = tmp_path.rglob("*.blob")
    path.write_bytes(b"mush")
    assert disk.get_blob("base-glb-v1") is None
    assert not path.exists()


def test_what_a_dead_process_left_is_cleared(tmp_path: Path) -> None:
    disk = DiskCache(tmp_path, KEY)
    stale, fresh = tmp_path / KEY / ".a.tmp", tmp_path / KEY / ".b.tmp"
    stale.write_bytes(b"half")
    fresh.write_bytes(b"half")
    long_ago = time.time() - 7200
    os.utime(stale, (long_ago, long_ago))
    assert disk.catalogue() == {}
    assert not stale.exists()
    assert fresh.exists()


def test_a_disk_that_cannot_be_written_is_no_error(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Said once, then silent; nothing half-written stays."""
    disk = DiskCache(tmp_path, KEY)
    (tmp_path / KEY).rmdir()
    with caplog.at_level(logging.WARNING, logger="terraport"):
        assert disk.put(entry(1)) is None
        assert disk.put(entry(2)) is None
    assert len(caplog.records) == 1
    assert "disk cache not written" in caplog.text


def test_a_directory_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=r"cache_dir .*file"):
        DiskCache(tmp_path / "file", KEY)
