"""Run what a change may break, nearest first, in at most five minutes.

``python .ci/changed.py [BASE]``: BASE is the merge base with origin/main or main unless it is
given; the change is what differs from it, committed or not. ``--list`` runs nothing. What is left
when the time is over is skipped and counted: `.ci/run` without an argument runs everything.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from selection import Selection, Tree

ROOT = Path(__file__).resolve().parents[1]
PRODUCT = (
    "client_sdk/python/terraport/",
    *("payload/", "pipeline/", "research/", "server/", "store/", "wire/"),
)  # fmt: skip
WEB = "client_sdk/web/"
WEB_SOURCES = (f"{WEB}src/", f"{WEB}test/")
CORPUS = "tests/conformance/"
SHOWN = 12
"""Test files named for each changed file."""


def main() -> int:
    """Say what is run and why; run it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("base", nargs="?", help="commit to compare with")
    parser.add_argument("--seconds", type=float, default=240.0, help="no test begins later")
    parser.add_argument("--list", action="store_true", help="say what would be run")
    parser.add_argument("-x", "--exitfirst", action="store_true", help="stop at the first failure")
    arguments = parser.parse_args()
    until = time.time() + arguments.seconds
    changed = changed_files(arguments.base)
    if not changed:
        print("changed: nothing")
        return 0
    selection = select(changed)
    for path in changed:
        tests = [test.path for test in selection.of(path)]
        more = f" and {len(tests) - SHOWN} more" if len(tests) > SHOWN else ""
        names = f": {', '.join(tests[:SHOWN])}{more}" if tests else ""
        print(f"changed: {path} -> {len(tests)} test files{names}")
    worst = 0
    for command, folder in commands(changed, selection, exitfirst=arguments.exitfirst):
        print(f"-- {' '.join(command[:8])}", flush=True)
        if not arguments.list:
            environment = os.environ | {
                "TERRAPORT_CHANGED_UNTIL": str(until),
                "PYTHONPATH": os.pathsep.join(
                    filter(None, [str(ROOT / ".ci"), os.environ.get("PYTHONPATH")])
                ),
            }
            code = subprocess.run(command, cwd=folder, env=environment, check=False).returncode
            worst = max(worst, abs(code))
            if worst and arguments.exitfirst:
                break
    return worst


def changed_files(base: str | None) -> list[str]:
    """List what differs from a commit, with files that are new or gone."""
    if base is None:
        base = next(filter(None, (_git("merge-base", "HEAD", m) for m in ("origin/main", "main"))))
    differs = _git("diff", "--name-only", "--no-renames", base)
    new = _git("ls-files", "--others", "--exclude-standard")
    return sorted({path for path in f"{differs}\n{new}".split("\n") if path})


def select(changed: list[str]) -> Selection:
    """Find the tests of a change in this checkout."""
    return this_tree(changed).select(changed)


def this_tree(changed: list[str]) -> Tree:
    """Return the files of this checkout, with those of a change that are gone or new."""
    files = {*_git("ls-files").split("\n"), *changed} - {""}

    def read(path: str) -> str:
        file = ROOT / path
        return file.read_text(encoding="utf-8") if file.is_file() else ""

    return Tree(files, read)


def commands(
    changed: list[str], selection: Selection, *, exitfirst: bool
) -> Iterator[tuple[list[str], Path]]:
    """Everything to run and where, the cheap before the dear."""
    pytest = [sys.executable, "-m", "pytest", "-q", *(["-x"] if exitfirst else [])]
    existing = [path for path in changed if (ROOT / path).is_file()]
    examples = [path for path in existing if path.startswith(PRODUCT) and path.endswith(".py")]
    if examples:
        # Exit code 5, no example in them, is no failure.
        code = "import pytest, sys; sys.exit(pytest.main(sys.argv[1:]) % 5)"
        yield [sys.executable, "-c", code, "-q", "--doctest-modules", *examples], ROOT
    if any(path.startswith((WEB, CORPUS)) for path in changed):
        sources = [path.removeprefix(WEB) for path in existing if path.startswith(WEB_SOURCES)]
        some = all(
            path.startswith(WEB_SOURCES) or not path.startswith((WEB, CORPUS)) for path in changed
        )
        which = ["related", "--run", *sources] if some and sources else ["run"]
        vitest = ["node_modules/.bin/vitest", *which]
        yield [*vitest, *(["--bail=1"] if exitfirst else [])], ROOT / WEB
    if any(path.startswith(f"{WEB}src") for path in changed):
        yield ["node_modules/.bin/vite", "build", "--logLevel=warn"], ROOT / WEB
    for path in existing:
        if path.endswith(".py") and path.count("/") == 1:
            folder = path.partition("/")[0]
            smoke = {"benchmarks": ["--smoke"], "fuzz": ["--seconds", "5"]}.get(folder)
            if smoke is not None:
                yield [sys.executable, path, *smoke], ROOT
    if any(path.startswith("docker/") for path in changed):
        yield [sys.executable, "docker/verify.py"], ROOT
    tests = [test.path for test in selection.tests if (ROOT / test.path).is_file()]
    if tests:
        # In this order, a file at a time to a worker: the nearest are begun first.
        workers = ["-n", "logical", "--maxprocesses", "8", "--dist", "loadfile"]
        yield [*pytest, *workers, "--no-loadscope-reorder", "-p", "deadline", *tests], ROOT


def _git(*arguments: str) -> str:
    command = ["git", *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
