"""Publication under bad conditions: killed, disk full, two at once."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from store.tiny_scene import TinyScene, write_tiny_scene

from terraport_store import OutOfSpaceError, Scene, SceneBusyError, SceneWriter, validate_scene
from terraport_store.publishing import hash_file, new_staging_folder, require_space

KILLER = Path(__file__).with_name("kill_publisher.py")


def run_killer(path: Path, mode: str) -> list[dict[str, object]]:
    """Run the helper process; one JSON line per killed child."""
    environment = {**os.environ, "PYTHONPATH": str(KILLER.parents[1])}
    done = subprocess.run(
        [sys.executable, str(KILLER), mode, str(path)],
        check=True,
        capture_output=True,
        text=True,
        timeout=120,
        env=environment,
    )
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_killed_at_every_file_system_act(tmp_path: Path) -> None:
    """Kill -9 before the 1st, 2nd, 3rd, ... act of a publication: the old or the new scene, whole,
    always."""
    answers = run_killer(tmp_path / "s", "acts")
    killed = [answer for answer in answers if answer["killed"]]
    assert len(killed) >= 20
    assert [answer for answer in answers if answer["findings"]] == []
    names = [answer["name"] for answer in killed]
    switch = names.index("tiny 1")
    assert names == ["tiny 0"] * switch + ["tiny 1"] * (len(names) - switch)
    assert 0 < switch < len(names), "no kill before or none after the publishing act"
    assert answers[-1] == {"killed": False, "findings": [], "name": "tiny 1", "left": 0}


def test_killed_at_random_moments(tmp_path: Path) -> None:
    """Kill -9 at random while publishing one version after another, 40 times."""
    answers = run_killer(tmp_path / "s", "random")
    assert len(answers) == 40
    assert all(answer["killed"] for answer in answers)
    assert [answer for answer in answers if answer["findings"]] == []
    assert len({answer["name"] for answer in answers}) == 40


def test_two_publishers_at_once(tiny: TinyScene) -> None:
    with (
        SceneWriter(tiny.path),
        pytest.raises(SceneBusyError, match="another process is publishing"),
    ):
        SceneWriter(tiny.path)
    write_tiny_scene(tiny.path, seed=1)
    assert validate_scene(tiny.path) == []


def test_left_overs_are_swept_up(tiny: TinyScene) -> None:
    (tiny.path / ".v-0123456789abcdef.tmp").mkdir()
    (tiny.path / ".v-0123456789abcdef.tmp" / "segments.pack").write_bytes(b"x")
    (tiny.path / ".scene-0123456789abcdef.json.tmp").write_bytes(b"x")
    (tiny.path / ".other.tmp").write_bytes(b"x")
    folder = new_staging_folder(tiny.path)
    assert sorted(p.name for p in tiny.path.iterdir() if p.name.startswith(".")) == sorted(
        [folder.name, ".other.tmp"]
    )


def test_space_is_asked_for(tmp_path: Path) -> None:
    require_space(tmp_path, 0)
    with pytest.raises(OutOfSpaceError, match="free some space and run again"):
        require_space(tmp_path, 1 << 60)


def test_hash_of_a_file(tmp_path: Path) -> None:
    """XXH3-64 of nothing, by its specification."""
    (tmp_path / "f").write_bytes(b"")
    assert hash_file(tmp_path / "f") == "2d06800538d394c2"


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 4 MiB; skips where none can be mounted."""
    mount = tmp_path / "disk"
    mount.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(mount)]
    try:
        subprocess.run(command, check=True, capture_output=True, timeout=10)
    except (OSError, subprocess.CalledProcessError) as error:
        pytest.skip(f"cannot mount a tmpfs: {error}")
    try:
        yield mount
    finally:
        subprocess.run(["umount", "-l", str(mount)], check=True, timeout=10)


def fill(disk: Path, leave_bytes: int) -> Path:
    ballast = disk / "ballast"
    free = os.statvfs(disk)
    size = free.f_bavail * free.f_frsize - leave_bytes
    with ballast.open("wb") as file:
        file.write(bytes(size))
    return ballast


@pytest.mark.parametrize("leave_kib", [0, 4, 8, 16, 24, 32, 40])
def test_disk_full_while_writing(
    small_disk: Path, leave_kib: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk fills up after the check for space: the old version stands, nothing is left
    behind."""
    scene = small_disk / "s"
    old = write_tiny_scene(scene, seed=0)
    before = sorted(p.name for p in scene.rglob("*"))
    real = SceneWriter.add_segment

    def late(writer: SceneWriter, *args: object, **options: object) -> int:
        if not (small_disk / "ballast").exists():
            fill(small_disk, leave_kib * 1024)
        return real(writer, *args, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(SceneWriter, "add_segment", late)
    with pytest.raises(OutOfSpaceError, match="nothing was published, free some space"):
        write_tiny_scene(scene, seed=1)
    monkeypatch.undo()
    assert sorted(p.name for p in scene.rglob("*")) == before
    assert validate_scene(scene) == []
    with Scene.open(scene) as opened:
        assert opened.manifest == old.manifest
    (small_disk / "ballast").unlink()
    write_tiny_scene(scene, seed=1)
    assert validate_scene(scene) == []


def test_disk_full_from_the_start(small_disk: Path) -> None:
    fill(small_disk, 500_000)
    with pytest.raises(OutOfSpaceError, match=r"bytes free at .*, expected at least 1048576"):
        write_tiny_scene(small_disk / "s")
    assert not (small_disk / "s").exists()


@pytest.mark.parametrize("limit_bytes", [0, 300, 500, 1000, 2000])
def test_file_size_limit_reached(tmp_path: Path, limit_bytes: int) -> None:
    """The same without a file system of its own: a limit of the process."""
    scene = tmp_path / "s"
    old = write_tiny_scene(scene, seed=0)
    before = sorted(p.name for p in scene.rglob("*"))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, hard))
    try:
        with pytest.raises(OutOfSpaceError):
            write_tiny_scene(scene, seed=1)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert sorted(p.name for p in scene.rglob("*")) == before
    with Scene.open(scene) as opened:
        assert opened.manifest == old.manifest
