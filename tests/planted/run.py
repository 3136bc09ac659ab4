"""Plant the faults of ``faults.toml`` one after the other and say which test notices each.

``python tests/planted/run.py [--speed changed|full] [--before COMMIT] [NAME ...]`` works in a copy
of the last commit (a git worktree in the system's folder for temporary files, kept for the next
run: its kernels are compiled), runs what ``.ci/run changed`` would run until the first failure, and
prints a table. Nothing of it is in the default run: each fault takes from seconds to minutes.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import importlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final

if __name__ == "__main__":  # run as a script: the package "planted" lies in tests/
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from planted.table import FAULTS, Fault

ROOT: Final = Path(__file__).resolve().parents[2]
COPY: Final = Path(tempfile.gettempdir(), f"terraport-planted-{os.getuid()}")
PACKAGES: Final = (
    "client_sdk/python", "payload", "pipeline", "research", "server", "store", "wire",
)  # fmt: skip
BUILT: Final = (
    "client_sdk/web/node_modules", "server/terraport_server/page",
    "tests/browser/godot/node_modules",
)  # fmt: skip
"""What a checkout has and git has not."""
NEAREST: Final = (3, 24)
"""Test files that run first and in one process: most faults need no more."""
SECONDS: Final = 900
"""After which no further test of a fault is begun; long, for busy machines."""
LANGUAGES: Final = {
    ".py": "Python", ".ts": "TypeScript", ".cs": "C#", ".cpp": "C++", ".hlsl": "HLSL",
    ".md": "Markdown", ".yaml": "YAML", ".json": "JSON",
}  # fmt: skip
FAILED: Final = re.compile(r"^(?:FAILED|ERROR) (\S+?)(?:\[.*)?(?: - .*)?$|^ *FAIL +(.+)$", re.M)
"""pytest's line of a failed test, or vitest's."""


@dataclass(frozen=True, slots=True)
class Caught:
    """What came of one fault."""

    fault: Fault
    by: str | None
    """The first test that failed; None where everything passed."""
    seconds: float


def main() -> int:
    """Plant, test, print; exit code 1 where a fault was noticed by nothing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="faults; all where none is named")
    parser.add_argument("--speed", choices=("changed", "full"), default="changed")
    parser.add_argument("--before", help="commit; say whether it had the test")
    parser.add_argument("--lock", type=Path, help="file to lock while a fault is tested")
    arguments = parser.parse_args()
    chosen = [fault for fault in FAULTS if not arguments.names or fault.name in arguments.names]
    make_copy()
    sys.path.insert(0, str(COPY / ".ci"))
    changed = importlib.import_module("changed")
    tree = changed.this_tree([])
    columns = ["fault", "language", "file", "what", "caught by", "s"]
    columns += ["before"] if arguments.before else []
    print(f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}", flush=True)
    caught: dict[str, Caught] = {}
    # What the nearest tests notice comes first: the rest may wait long for the lock.
    for near in (True, False):
        for fault in [candidate for candidate in chosen if candidate.name not in caught]:
            selection = tree.select([fault.path] if arguments.speed == "changed" else tree.files)
            steps = changed.commands([fault.path], selection, exitfirst=True)
            commands = [command for step in steps for command in nearest_alone(*step)]
            lock_path = arguments.lock if not near else None
            with lock(lock_path), planted(fault):
                began_s = time.monotonic()
                by = first_failure(
                    [command for command in commands if is_quick(command[0]) is near]
                )
                seconds = time.monotonic() - began_s
            if by or not near:
                caught[fault.name] = Caught(fault, by, seconds)
                print(row(caught[fault.name], arguments.before), flush=True)
    missed = sum(outcome.by is None for outcome in caught.values())
    print(f"\n{len(chosen) - missed} of {len(chosen)} caught", flush=True)
    return int(missed > 0)


def make_copy() -> None:
    """Bring the copy to the last commit, with what is built in this checkout."""
    if not (COPY / ".git").exists():
        _git(ROOT, "worktree", "prune")
        _git(ROOT, "worktree", "add", "--detach", "--force", str(COPY), "HEAD")
    _git(COPY, "checkout", "-q", "--detach", "--force", _git(ROOT, "rev-parse", "HEAD"))
    for path in BUILT:
        if (COPY / path).is_symlink() or (COPY / path).exists() or not (ROOT / path).exists():
            continue
        if path.endswith("node_modules"):
            (COPY / path).symlink_to((ROOT / path).resolve())
        else:
            shutil.copytree(ROOT / path, COPY / path)


@contextlib.contextmanager
def planted(fault: Fault) -> Iterator[None]:
    """Edit the copy, and undo it: also the time of the file, by which compiled kernels are kept."""
    file = COPY / fault.path
    before = file.read_bytes()
    times = file.stat()
    text = before.decode("utf-8")
    if text.count(fault.old) != 1:
        raise SystemExit(
            f"{fault.name}: {fault.old!r} is {text.count(fault.old)} times in {fault.path}"
        )
    try:
        file.write_bytes(text.replace(fault.old, fault.new).encode("utf-8"))
        yield
    finally:
        file.write_bytes(before)
        os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))


@contextlib.contextmanager
def lock(path: Path | None) -> Iterator[None]:
    """Hold a file's lock, where one is named: on a machine that is shared."""
    with contextlib.ExitStack() as stack:
        if path is not None:
            fcntl.flock(stack.enter_context(path.open("a")), fcntl.LOCK_EX)
        yield


def is_quick(command: list[str]) -> bool:
    """Whether it runs no tests side by side."""
    return "-n" not in command


def first_failure(commands: list[tuple[list[str], Path]]) -> str | None:
    """Run until something fails; return what did."""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(str(COPY / package) for package in (*PACKAGES, ".ci")),
        "TERRAPORT_CHANGED_UNTIL": str(time.time() + SECONDS),
        "NO_COLOR": "1",
    }
    for command, folder in commands:
        done = subprocess.run(
            command, cwd=folder, env=environment, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, errors="replace", check=False,
        )  # fmt: skip
        if done.returncode not in (0, 5):  # 5: no test was left to run
            match = FAILED.search(done.stdout)
            name = next(filter(None, match.groups())) if match else " ".join(command[-2:])
            return name.replace("|", "/")
    return None


def nearest_alone(command: list[str], folder: Path) -> Iterator[tuple[list[str], Path]]:
    """Split the tests: the nearest in one process, without the start of several."""
    if "deadline" not in command:
        yield command, folder
        return
    at = command.index("-n")
    first = command.index("deadline") + 1
    tests, few, more = command[first:], *NEAREST
    for some in (tests[:few], tests[few:more]):
        if some:
            yield [*command[:at], "-p", "deadline", *some], folder
    if tests[more:]:
        yield [*command[:first], *tests[more:]], folder


def row(caught: Caught, before: str | None) -> str:
    """One line of the table."""
    fault = caught.fault
    language = LANGUAGES.get(PurePosixPath(fault.path).suffix, "")
    by = f"`{caught.by}`" if caught.by else "**nothing**"
    cells = [fault.name, language, f"`{fault.path}`", fault.what, by, f"{caught.seconds:.0f}"]
    if before is not None:
        cells.append("-" if caught.by is None else "yes" if existed(caught.by, before) else "no")
    return f"| {' | '.join(cells)} |"


def existed(test: str, commit: str) -> bool:
    """Whether a commit has the test: its file and, in it, its name."""
    path, _, name = re.split(r" > ", test)[0].strip().partition("::")
    for prefix in ("", "client_sdk/web/"):
        text = _git(ROOT, "show", f"{commit}:{prefix}{path}")
        if text:
            return re.split("::|[.]", name)[-1] in text
    return False


def _git(folder: Path, *arguments: str) -> str:
    options: dict[str, Any] = {"capture_output": True, "text": True, "check": False}
    return str(subprocess.run(["git", *arguments], cwd=folder, **options).stdout).strip()


if __name__ == "__main__":
    sys.exit(main())
