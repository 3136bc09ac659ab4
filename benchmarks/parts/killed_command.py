"""The command in a process of its own, killed (SIGKILL) after some time or before a chosen act.

Acts are what the interpreter tells its audit hooks of: files renamed, linked, deleted, opened to
write. A hook that kills needs no debugger and no hook in the code that is tested.
"""

from __future__ import annotations

import contextlib
import json
import re
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import xxhash

from terraport_store.manifest import Manifest
from terraport_store.validate import validate_scene

__all__ = [
    "check_scene",
    "finished_tiles",
    "results",
    "run",
    "run_killed",
    "run_recorded",
    "scene_bytes",
]

_RUN: Final = r"""
import json, os, re, signal, sys

plan = json.loads(sys.argv.pop(1))
ACTS = {"os.rename", "os.link", "os.mkdir", "os.remove", "os.rmdir", "shutil.rmtree"}
pattern, acts = re.compile(plan["paths"]), []

def hook(event, args):
    if event == "open":
        written = args[2] & (os.O_WRONLY | os.O_RDWR) if isinstance(args[2], int) else 0
        if not written:
            return
        paths = args[:1]
    elif event in ACTS:
        paths = args[:2]
    else:
        return
    names = [os.fsdecode(path) for path in paths if isinstance(path, (str, bytes, os.PathLike))]
    if not any(pattern.search(name) for name in names):
        return
    if plan["kill_before"] == len(acts):
        os.kill(os.getpid(), signal.SIGKILL)
    acts.append([event, *names])
    if plan["record"]:
        with os.fdopen(os.open(plan["record"], os.O_RDWR | os.O_CREAT), "r+") as file:
            file.write(json.dumps(acts))

if plan["paths"]:
    sys.addaudithook(hook)
from terraport.cli import main
print("ready", flush=True)
sys.argv = ["terraport", *sys.argv[1:]]
sys.exit(main())
"""


def _start(
    command: Sequence[str], *, paths: str = "", kill_before: int = -1, record: Path | None = None
) -> subprocess.Popen[str]:
    plan = {"paths": paths, "kill_before": kill_before, "record": record and str(record)}
    return subprocess.Popen(
        [sys.executable, "-c", _RUN, json.dumps(plan), *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def run(command: Sequence[str]) -> float:
    """Run the command to its end; return the seconds after its start."""
    process = _start(command)
    assert process.stdout is not None
    process.stdout.readline()
    began = time.monotonic()
    _, stderr = process.communicate()
    if process.returncode:
        raise SystemExit(f"a command that nobody killed failed: {stderr}")
    return time.monotonic() - began


def run_recorded(command: Sequence[str], paths: str, record: Path) -> list[list[str]]:
    """Run the command to its end; return its acts on paths that match: event and names."""
    process = _start(command, paths=paths, record=record)
    _, stderr = process.communicate()
    if process.returncode:
        raise SystemExit(f"a command that nobody killed failed: {stderr}")
    acts: list[list[str]] = json.loads(record.read_bytes())
    record.unlink()
    return acts


def run_killed(
    command: Sequence[str],
    *,
    reached: Callable[[], bool] = lambda: True,
    after_s: float = 0.0,
    paths: str = "",
    before_act: int = -1,
) -> bool:
    """Kill the command; return whether it was still running.

    Waits until none of its children is left.

    Parameters
    ----------
    command : sequence of str
    reached, after_s
        Killed so many seconds after this is so.
    paths, before_act
        Killed before this act on paths that match; see :func:`run_recorded`.
    """
    process = _start(command, paths=paths, kill_before=before_act)
    assert process.stdout is not None
    process.stdout.readline()
    if before_act < 0:
        while process.poll() is None and not reached():
            time.sleep(0.01)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(after_s)
        process.kill()
    process.communicate()  # its children have the same pipes: this waits for the last of them
    return process.returncode < 0


def check_scene(scene: Path) -> tuple[str | None, list[str]]:
    """Return the version that is published, None where there is none, and what is wrong with it."""
    manifest = scene / "scene.json"
    if not manifest.exists():
        return None, []
    version = Manifest.from_bytes(manifest.read_bytes()).version
    return version, [str(finding) for finding in validate_scene(scene)]


def scene_bytes(scene: Path) -> dict[str, str]:
    """Hash every published file of a scene, the manifest included."""
    manifest = Manifest.from_bytes((scene / "scene.json").read_bytes())
    names = ["scene.json", *(file.path for file in manifest.files.values())]
    return {name: xxhash.xxh3_128_hexdigest((scene / name).read_bytes()) for name in names}


def results(folder: Path) -> dict[str, list[object]]:
    """Key, digest and values of every result in a folder, by its name."""
    documents = {
        path.parent.name: json.loads(path.read_bytes()) for path in folder.glob("*/stage.json")
    }
    return {name: [d["key"], d["digest"], d["values"]] for name, d in documents.items()}


def finished_tiles(work: Path) -> dict[str, int]:
    """When every tile's result was written, by its name."""
    times = {}
    for path in work.glob("*/stage.json"):
        if re.search(r"-\d{5}$", path.parent.name):
            with contextlib.suppress(FileNotFoundError):  # replaced at this moment
                times[path.parent.name] = path.stat().st_mtime_ns
    return times
