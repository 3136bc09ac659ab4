"""Help and errors of arguments are printed without a slow import.

``terraport build --help`` took 3 CPU seconds when it imported all that a build needs. CPU time is
no test, but what is imported is: each of these packages takes .1 s and more.
"""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from terraport.cli.lazy import VERBS

SLOW = {
    "numpy", "scipy", "numba", "pyproj", "PIL", "trimesh", "pycolmap", "laspy", "fastapi",
    "uvicorn",
    "httpx", "websockets", "terraport_store", "psutil", "jinja2",
}  # fmt: skip

PROGRAM = """
import contextlib, io, json, sys
from terraport.cli import main
slow = {}
for words in json.loads(sys.argv[1]):
    sys.argv = ["terraport", *words]
    before = set(sys.modules)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        with contextlib.suppress(SystemExit):
            main()
    slow[" ".join(words)] = sorted(set(sys.modules) - before)
print(json.dumps(slow))
"""


def slow_imports(calls: list[list[str]]) -> dict[str, list[str]]:
    """Run the command line on all of `calls` in one process; return each one's slow imports."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, json.dumps(calls)],
        capture_output=True,
        text=True,
        check=True,
    )
    imported: dict[str, list[str]] = json.loads(done.stdout)
    return {
        call: slow
        for call, modules in imported.items()
        if (slow := sorted(SLOW.intersection(modules)))
    }


def test_every_help_is_printed_without_slow_imports() -> None:
    pytest.importorskip("terraport_research")
    below = [["evaluate", name] for name in ("reconstruction", "segmentation", "thesis", "study")]
    below += [["token", name] for name in ("new-key", "create", "show")]
    calls = [[], *([verb.name] for verb in VERBS), *below]
    assert slow_imports([[*call, "--help"] for call in calls]) == {}


def test_wrong_arguments_are_refused_without_slow_imports() -> None:
    assert (
        slow_imports(
            [
                ["build", "pit.laz", "--depht", "9"],
                ["build", "missing.laz"],
                ["inspect", "missing.laz"],
                ["export", "scene", "-o", "lines.dxf", "--interval", "two"],
                ["export", "scene", "-o", "lines.dxf"],
                ["land", "http://127.0.0.1:1/scenes/pit", "here"],
                ["serve"],
                ["synth", "--points", "many"],
            ]
        )
        == {}
    )
