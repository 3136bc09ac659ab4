"""Builds of several tiles on a disk that fills up: a clear error, nothing by halves, and going on.

A build that nobody disturbs says what scene and work directory take. Then a disk of each share of
that (a tmpfs; needs root) takes both, so that it fills in another stage each time: the message must
name the place and what is free, the scene must be absent or whole. The disk is made larger and the
same command given again: it goes on with what is finished, and must publish the same bytes.
`scene` puts the scene alone on a disk that is too small for it.

Without root the largest file that a process may write is bounded instead, at the same shares of
the largest file that the build writes.

    python benchmarks/full_disk.py            8 sizes, about 5 minutes
    python benchmarks/full_disk.py --smoke    half of it
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from parts.hill_surveys import BUILD_OPTIONS, write_hill
from parts.killed_command import check_scene, finished_tiles, run, scene_bytes

SHARES: Final = (0.02, 0.1, 0.3, 0.5, 0.7, 0.85, 0.95)
ROOM: Final = 4
"""Times what a build takes: the disk after it was made larger."""

MAIN: Final = "import sys; from terraport.cli import main; sys.exit(main())"
WORDS: Final = re.compile(r"no space left|bytes free|free some")


def _bytes_in(*folders: Path) -> int:
    files = (path for folder in folders for path in folder.rglob("*") if path.is_file())
    return sum(-(-path.stat().st_size // 4096) * 4096 for path in files)


@contextmanager
def disk(folder: Path, size_bytes: int) -> Iterator[None]:
    """Mount a disk of a size."""
    folder.mkdir()
    size = f"size={max(size_bytes, 1 << 16)}"
    subprocess.run(["mount", "-t", "tmpfs", "-o", size, "none", str(folder)], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", str(folder)], check=True)
        folder.rmdir()


def enlarge(folder: Path, size_bytes: int) -> None:
    """Make a mounted disk larger."""
    subprocess.run(["mount", "-o", f"remount,size={size_bytes}", str(folder)], check=True)


def build(survey: Path, scene: Path, work: Path) -> list[str]:
    """Give the command."""
    return ["build", str(survey), "-o", str(scene), "--work", str(work), *BUILD_OPTIONS]


def fail(command: list[str], most_bytes: int | None = None) -> tuple[int, str]:
    """Run a command that has too little room; return its exit status and what it said."""

    def bound() -> None:
        if most_bytes is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, resource.RLIM_INFINITY))

    ended = subprocess.run(
        [sys.executable, "-c", MAIN, *command],
        capture_output=True,
        text=True,
        preexec_fn=bound,
        check=False,
    )
    return ended.returncode, ended.stderr.strip()


def look(
    title: str, code: int, said: str, where: Path, scene: Path, work: Path, has_room: bool
) -> list[str]:
    """Print what a build said that had too little room; return what is wrong."""
    version, findings = check_scene(scene)
    finished = len(finished_tiles(work)) if work.exists() else 0
    wrong = []
    if not has_room and code != 1:
        wrong.append(f"exit status {code}")
    if code and not (WORDS.search(said) and str(where) in said):
        wrong.append("the message does not say so")
    if findings or (code and version is not None):
        wrong.append(f"version {version} is published, {findings[:2]}")
    print(f"{title}: {finished} results of tiles; {said or 'no error'}")
    return [f"{title}: {text}" for text in wrong]


def go_on(title: str, command: list[str], scene: Path, work: Path, expected: object) -> list[str]:
    """Give the command again with room; return what is wrong."""
    finished = finished_tiles(work)
    run(command)
    after = finished_tiles(work)
    again = sum(after.get(name) != time for name, time in finished.items())
    print(
        f"{title}, with room: {len(after) - len(finished)} more, {again} a second time", flush=True
    )
    wrong = [f"{title}: {again} results were computed a second time"] if again else []
    return wrong if scene_bytes(scene) == expected else [*wrong, f"{title}: other bytes"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--shares", type=float, nargs="+", default=SHARES)
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    shares = [0.5] if arguments.smoke else arguments.shares
    folder = Path(tempfile.mkdtemp(prefix="full-disk-"))
    is_root = os.geteuid() == 0
    wrong: list[str] = []
    try:
        # (1) With room: the bytes, and what they take.
        survey, small = folder / "hill.xyz", folder / "disk"
        write_hill(survey)
        scene, work = folder / "whole" / "hill", folder / "whole.work"
        run(build(survey, scene, work))
        expected, took = scene_bytes(scene), _bytes_in(scene, work)
        largest = max(p.stat().st_size for p in work.rglob("*") if p.is_file())
        print(f"scene and work directory take {took:,} bytes, the largest file {largest:,}")
        for share in shares:
            title = f"{share:.0%}"
            if is_root:
                # (2) Scene and work directory on a small disk, then on the same made larger.
                with disk(small, int(share * took)):
                    scene, work = small / "hill", small / "work"
                    code, said = fail(build(survey, scene, work))
                    wrong += look(title, code, said, small, scene, work, share >= 1)
                    enlarge(small, ROOM * took)
                    wrong += go_on(title, build(survey, scene, work), scene, work, expected)
            else:
                # (3) Files no larger than a share of the largest.
                scene, work = folder / f"{share}" / "hill", folder / f"{share}.work"
                code, said = fail(build(survey, scene, work), int(share * largest))
                wrong += look(title, code, said, folder, scene, work, share >= 1)
                wrong += go_on(title, build(survey, scene, work), scene, work, expected)
        if is_root:
            # (4) The scene alone on a small disk.
            with disk(small, _bytes_in(folder / "whole") // 2):
                scene, work = small / "hill", folder / "whole.work"
                shutil.rmtree(work / "pack")
                code, said = fail(build(survey, scene, work))
                wrong += look("scene", code, said, small, scene, work, has_room=False)
                enlarge(small, ROOM * took)
                wrong += go_on("scene", build(survey, scene, work), scene, work, expected)
        print("\n".join(wrong) or "all as it should be")
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
