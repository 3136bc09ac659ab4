"""The command line's frame, in processes of its own."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import run_terraport

from terraport.cli.lazy import VERBS
from terraport.version import __version__

_WITHOUT = """
import importlib.util, sys

BLOCKED = set({blocked!r})

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in BLOCKED:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
        return None

sys.meta_path.insert(0, Blocker())
"""

EXTRAS = (
    "contourpy",
    "embreex",
    "ezdxf",
    "fast_simplification",
    "fastapi",
    "jinja2",
    "laspy",
    "numba",
    "PIL",
    "prometheus_client",
    "psutil",
    "pyarrow",
    "pycolmap",
    "pydantic_settings",
    "pye57",
    "pyogrio",
    "pypcd4",
    "pyproj",
    "rasterio",
    "scipy",
    "shapely",
    "sklearn",
    "trimesh",
    "uvicorn",
)
"""What only extras bring."""


def without_extras(code: str) -> subprocess.CompletedProcess[str]:
    """Run Python code as if only the core were installed."""
    program = _WITHOUT.format(blocked=list(EXTRAS)) + code
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False
    )


_MANY = """
import contextlib, io, json
from terraport.cli import app

answers = []
for arguments in {calls!r}:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            app(arguments, prog_name="terraport")
            code = 0
        except SystemExit as exit:
            code = exit.code
    answers.append([code or 0, out.getvalue(), err.getvalue()])
print(json.dumps(answers))
"""


def many(calls: list[list[str]], *, core_only: bool = False) -> list[tuple[int, str, str]]:
    """Run several command lines in one process; return code, stdout and stderr of each."""
    program = _MANY.format(calls=calls)
    if core_only:
        program = _WITHOUT.format(blocked=list(EXTRAS)) + program
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    return [tuple(answer) for answer in json.loads(done.stdout)]


def test_help_lists_every_verb_and_version_is_the_distributions() -> None:
    shown = run_terraport("--help")
    assert shown.returncode == 0
    for verb in VERBS:
        assert f" {verb.name} " in shown.stdout
    assert run_terraport("--version").stdout == f"terraport {__version__}\n"


def test_every_verb_explains_itself() -> None:
    """With all extras installed each is really there."""
    commands = [[verb.name] for verb in VERBS]
    commands += [["token", name] for name in ("new-key", "create", "show")]
    commands += [["evaluate", "reconstruction"]]
    answers = many([[*command, "--help"] for command in commands])
    for command, (code, out, err) in zip(commands, answers, strict=True):
        assert code == 0, err
        example = f"terraport {' '.join(command)} "
        assert any(f"{line.strip()} ".startswith(example) for line in out.splitlines()), command


def test_the_core_alone_is_enough_for_the_sdk() -> None:
    """Everything that `terraport` exports, without any extra."""
    code = (
        "import terraport, terraport.cli.land, sys\n"
        "assert all(getattr(terraport, name) for name in terraport.__all__)\n"
        "from terraport.errors import MissingExtraError\n"
        "import numpy as np\n"
        "from terraport_payload import SegmentMesh\n"
        "flat = np.zeros((3, 3), np.float32)\n"
        "try: terraport.to_trimesh(SegmentMesh(flat, np.array([[0, 1, 2]], np.uint32), flat))\n"
        "except MissingExtraError as error: print(error)\n"
    )
    shown = without_extras(code)
    assert shown.returncode == 0, shown.stderr
    assert shown.stdout == (
        'to_trimesh() needs packages that are not installed: pip install "trimesh"\n'
    )


WHOLE: dict[str, list[str]] = {
    "demo": ["--no-serve"],
    "label": ["scene"],
    "mv": ["scene", "other"],
    "diff": ["scene", "other"],
    "rm": ["scene"],
    "upload": ["scene", "s3://bucket/scene"],
    "export": ["scene", "-o", "points.laz"],
    "segment": ["pit.laz", "-o", "pit.seg"],
    "teach": ["scene"],
    "synth": ["-o", "quarry"],
    "evaluate": ["reconstruction", "-o", "evaluation"],
    "list": [],
}
"""Arguments of a call that is refused for nothing but the missing extra; else one file."""


def test_a_verb_without_its_extra_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its help is printed all the same; and a picture is refused before the landing."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pit.laz").write_bytes(b"")
    # Some verbs need none of these packages until they meet a scene.
    verbs = [v for v in VERBS if v.extra is not None and v.name not in {"token", "label", "upload"}]
    calls = [[verb.name, *WHOLE.get(verb.name, ["pit.laz"])] for verb in verbs]
    helps = [[verb.name, "--help"] for verb in verbs]
    picture = ["land", "http://127.0.0.1:9/scenes/x", "0", "0", "0", "--png", "x.png"]
    answers = many([["--help"], picture, *helps, *calls], core_only=True)
    (_, listed, _), (code, _, err), *others = answers
    assert code == 2
    assert err.startswith("error: --png needs packages that are not installed")
    assert "terraport[pipeline]" in err
    for verb, (code, out, err) in zip(verbs, others[: len(verbs)], strict=True):
        assert f" {verb.name} " in listed
        assert code == 0, err
        assert f"terraport {verb.name}" in out
    for verb, (code, _, err) in zip(verbs, others[len(verbs) :], strict=True):
        assert (verb.name, code) == (verb.name, 2), err
        assert err.startswith("error: ")
        assert f'install "terraport[{verb.extra}]"' in err
    assert [path.name for path in tmp_path.iterdir()] == ["pit.laz"]


ERRORS = [
    (["fly"], 2, "No such command 'fly'"),
    (["buil"], 2, "Did you mean 'build'?"),
    (["land", "http://127.0.0.1:9/scenes/x", "0", "-5.5", "-1e1"], 1, "no connection to ws://"),
    (["land", "pit", "0", "0", "0"], 2, "error: URL 'pit', expected http"),
    (["land", "http://127.0.0.1:9", "0", "0"], 2, "z"),
    (["land", "http://127.0.0.1:9", "0", "0", "up"], 2, "z"),
    (["land", "http://h/scenes/x", "0", "0", "0", "--radus", "3"], 2, "--radus"),
    (["land", "http://h/scenes/x", "0", "0", "0", "--encoding", "segment-2"], 2, "--encoding"),
    (["land", "http://h/scenes/x", "0", "0", "0", "--glb", "/no/where.glb"], 2, "/no"),
    (["land", "http://h/scenes/x", "0", "0", "0", "--timeout", "-1"], 2, "plan_s is -1"),
]


def test_errors_are_one_line_and_an_exit_code() -> None:
    for (arguments, code, text), answer in zip(
        ERRORS, many([call for call, _, _ in ERRORS]), strict=True
    ):
        assert (answer[0], text in answer[2]) == (code, True), (arguments, answer)


def test_ctrl_c_ends_with_130_and_no_traceback() -> None:
    """While it waits for a server that accepts and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"http://127.0.0.1:{silent.getsockname()[1]}/scenes/x"
        process = subprocess.Popen(
            [Path(sys.executable).with_name("terraport"), "land", url, "0", "0", "0"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=dict(os.environ),
        )
        connection, _ = silent.accept()  # it is up, and waits for an answer
        with connection:
            time.sleep(0.1)
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=20)
    assert process.returncode == 130
    assert "Traceback" not in errors
    assert "stopped" in errors
