from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from terraport_pipeline.errors import BuildLockedError
from terraport_pipeline.workflow.scene_lock import build_process, scene_locked

HOLDER = """
import sys
from pathlib import Path
from terraport_pipeline.workflow.scene_lock import scene_locked
with scene_locked(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_two_scenes_do_not_meet(tmp_path: Path) -> None:
    with scene_locked(tmp_path / "a"), scene_locked(tmp_path / "b"):
        pass
    assert not list(tmp_path.iterdir())


def test_another_process_is_kept_out_and_named(tmp_path: Path) -> None:
    scene = tmp_path / "pit"
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(scene)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with (
            pytest.raises(BuildLockedError, match=f"is running \\(process {holder.pid}\\)"),
            scene_locked(scene),
        ):
            pass
        holder.kill()
        holder.wait()
    # Killed, it left its file behind; the lock is free all the same.
    assert (tmp_path / ".pit.lock").exists()
    with scene_locked(scene):
        pass
    assert not list(tmp_path.iterdir())


def test_the_lock_is_freed_by_an_error(tmp_path: Path) -> None:
    scene = tmp_path / "pit"
    with pytest.raises(KeyboardInterrupt), scene_locked(scene):
        raise KeyboardInterrupt
    with scene_locked(scene):
        pass


def test_who_builds_now(tmp_path: Path) -> None:
    scene = tmp_path / "pit"
    assert build_process(scene) is None
    with scene_locked(scene):
        assert build_process(scene) == str(os.getpid())
    # Of a build that was killed the file is left.
    (tmp_path / ".pit.lock").write_text("4711")
    assert build_process(scene) is None
