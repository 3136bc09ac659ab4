"""Publish in forked children, kill them, and report what a reader then finds; one JSON line each.

Run as ``kill_publisher.py acts|random|labels SCENE``. A process of its own, because forking a test
process with threads is unsafe.
"""

from __future__ import annotations

import json
import os
import random
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

from store.tiny_scene import write_tiny_scene

from terraport_store import change_labels, read_labels, read_manifest, validate_scene

ACTS = frozenset({"open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "shutil.rmtree"})
"""Audit events of what changes a directory (Python raises them before the act)."""


def fork(work: Callable[[], None]) -> int:
    child = os.fork()
    if child == 0:
        try:
            work()
        finally:
            os._exit(0)
    return child


def report(scene: Path, *, killed: bool) -> None:
    findings = [str(finding) for finding in validate_scene(scene)]
    left = sum(entry.name.startswith(".") for entry in scene.iterdir())
    answer = {"killed": killed, "findings": findings, "name": read_manifest(scene).name}
    sys.stdout.write(json.dumps({**answer, "left": left}) + "\n")
    sys.stdout.flush()


def kill_at_act(scene: Path, number: int, act: Callable[[], object]) -> bool:
    """Do something and die right before one file-system act of it; False when there are fewer."""

    def work() -> None:
        seen = 0

        def count(event: str, arguments: tuple[object, ...]) -> None:
            nonlocal seen
            if event in ACTS and str(scene) in str(arguments[0]):
                seen += 1
                if seen == number:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(count)
        act()

    _, status = os.waitpid(fork(work), 0)
    return os.WIFSIGNALED(status)


def every_act(scene: Path) -> None:
    for number in range(1, 1000):
        write_tiny_scene(scene, seed=0)
        killed = kill_at_act(scene, number, lambda: write_tiny_scene(scene, seed=1))
        report(scene, killed=killed)
        if not killed:
            return


def every_act_of_labelling(scene: Path) -> None:
    """Change labels over older ones, killed at every file system act in turn; a JSON line each."""
    write_tiny_scene(scene, stable_ids=(4, 2, 9))
    for number in range(1, 1000):
        change_labels(scene, {4: "old", 2: "old"})
        killed = kill_at_act(scene, number, lambda: change_labels(scene, {4: "new", 2: "new"}))
        findings = [str(finding) for finding in validate_scene(scene)]
        left = sum(entry.name.startswith(".") for entry in scene.iterdir())
        answer = {"killed": killed, "findings": findings, "left": left}
        labels = {str(key): label for key, label in read_labels(scene).items()}
        sys.stdout.write(json.dumps({**answer, "labels": labels}) + "\n")
        sys.stdout.flush()
        if not killed:
            return


def random_moments(scene: Path) -> None:
    """Let each child publish at least once, then kill it at a random moment of a later
    publication."""
    write_tiny_scene(scene, seed=0)
    chance = random.Random(7)
    for trial in range(1, 41):

        def work(first: int = trial * 1000) -> None:
            for seed in range(first, first + 1000):
                write_tiny_scene(scene, seed=seed)

        before = read_manifest(scene).name
        child = fork(work)
        start = time.monotonic()
        while read_manifest(scene).name == before and time.monotonic() < start + 20:
            time.sleep(0.001)
        time.sleep(chance.uniform(0.0, 1.5) * (time.monotonic() - start))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        report(scene, killed=os.WIFSIGNALED(status))


if __name__ == "__main__":
    modes = {"acts": every_act, "random": random_moments, "labels": every_act_of_labelling}
    modes[sys.argv[1]](Path(sys.argv[2]))
