"""The disk cache on a real disk."""

from __future__ import annotations

import logging
import os
import time
from pathlib import Path

import pytest

from terraport.cache import CachedSegment
from terraport.disk import DiskCache
from terraport.errors import UsageError

SCENE = "0123456789abcdef"
BOX = (0.0, 1.0, 2.0, 3.0, 4.5, 5.0)


def entry(key: int, size: int = 1000) -> CachedSegment:
    return CachedSegment(key, BOX, bytes([key]) * size)


def age(folder: Path, seconds: float) -> None:
    """Make every file of a folder look older."""
    for path in folder.rglob("*.*"):
        used_s = path.stat().st_mtime - seconds
        os.utime(path, (used_s, used_s))


def test_what_is_put_comes_back_in_another_run(tmp_path: Path) -> None:
    assert DiskCache(tmp_path, SCENE).put(entry(3), ()) == (True, [])
    again = DiskCache(tmp_path, SCENE)
    assert again.catalogue() == {3: BOX}
    assert again.get(3) == entry(3).payload
    assert again.get(4) is None
    again.remove(3)
    assert (again.get(3), list(tmp_path.rglob("*.segment"))) == (None, [])
    assert DiskCache(tmp_path, SCENE[::-1]).catalogue() == {}, "scenes do not mix"


def test_the_bound_holds_and_the_longest_unused_goes_first(tmp_path: Path) -> None:
    disk = DiskCache(tmp_path, SCENE, max_bytes=5000)
    for key in range(4):
        disk.put(entry(key), ())
        age(tmp_path, 100)
    disk.get(0)  # used just now
    assert disk.put(entry(4), ()) == (True, [])
    assert disk.put(entry(5), keep={1}) == (True, [2, 3])
    assert sum(path.stat().st_size for path in tmp_path.rglob("*.segment")) <= 5000
    assert set(DiskCache(tmp_path, SCENE).catalogue()) == {0, 1, 4, 5}
    assert disk.put(entry(6), keep=range(6)) == (True, [])
    assert disk.put(entry(7), keep=range(7)) == (False, []), "nothing that is needed goes"


def test_the_bound_counts_other_scenes_and_earlier_runs(tmp_path: Path) -> None:
    other = DiskCache(tmp_path, SCENE[::-1])
    other.put(entry(9), ())
    age(tmp_path, 100)
    disk = DiskCache(tmp_path, SCENE, max_bytes=2000)
    disk.catalogue()
    assert disk.put(entry(1), ()) == (True, [])
    assert disk.put(entry(2), ()) == (True, [1])
    assert other.catalogue() == {}, "that went first, and is not ours to tell"
    assert disk.put(entry(3, size=9000), ()) == (False, [])
    assert disk.catalogue() == {2: BOX}


def test_a_base_mesh_is_checked_when_it_is_read(tmp_path: Path) -> None:
    disk = DiskCache(tmp_path, SCENE)
    disk.put_base("v1", b"mesh" * 100, ())
    assert disk.get_base("v1") == b"mesh" * 100
    assert disk.get_base("v2") is None
    (path,) = tmp_path.rglob("base-*.gz")
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    assert disk.get_base("v1") is None
    assert not path.exists()


def test_what_a_dead_process_left_is_cleared(tmp_path: Path) -> None:
    disk = DiskCache(tmp_path, SCENE)
    stale, fresh = tmp_path / SCENE / ".a.tmp", tmp_path / SCENE / ".b.tmp"
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
    """Said once, then silent."""
    disk = DiskCache(tmp_path, SCENE)
    (tmp_path / SCENE).rmdir()
    with caplog.at_level(logging.WARNING, logger="terraport"):
        assert disk.put(entry(1), ()) == disk.put(entry(2), ()) == (False, [])
    assert len(caplog.records) == 1
    assert "disk cache not written" in caplog.text


def test_a_directory_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=r"cache_dir .*file"):
        DiskCache(tmp_path / "file", SCENE)
