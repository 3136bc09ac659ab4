"""The documentation's code blocks, and what runs them: the command line in this process."""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import pytest

from terraport.cli import app
from terraport_server import BackgroundServer
from terraport_server.settings import Settings

ROOT = Path(__file__).resolve().parents[1]
ADDRESS = "http://127.0.0.1:8080"
"""Where the pages' service is; the tests' is on a free port."""

_BLOCK = re.compile(
    r"(?P<comments>(?:^<!--(?:(?!-->).)*-->\n+)*)^```(?P<language>\w+)\n(?P<code>.*?)^```",
    re.MULTILINE | re.DOTALL,
)
_NOT_RUN = re.compile(r"<!-- not run: (?P<reason>[^>]+?) -->")
_EXPORT = re.compile(r"export (?P<name>\w+)=(?P<value>.*)")


@dataclass(frozen=True)
class Block:
    """One block of a page."""

    page: str
    line: int
    language: str
    code: str
    not_run: str
    """Why not, as the page says; empty where it is run."""

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def blocks_of(path: Path) -> list[Block]:
    """Find a page's blocks of shell and Python, in order."""
    text = path.read_text(encoding="utf-8")
    found = []
    for match in _BLOCK.finditer(text):
        if match["language"] in ("sh", "bash", "console", "python"):
            marked = _NOT_RUN.search(match["comments"])
            reason = marked["reason"] if marked else ""
            line = text.count("\n", 0, match.start("language")) + 1
            page = path.relative_to(ROOT).as_posix()
            found.append(Block(page, line, match["language"], match["code"], reason))
    return found


class Shell:
    """Runs blocks one after the other, with one service, in the current folder."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._servers = contextlib.ExitStack()
        self._monkeypatch = monkeypatch
        self._address = ADDRESS
        self.said = ""
        """What the last command printed."""
        monkeypatch.setattr("terraport_server.serving.run", self._serve)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._servers.close()

    def run(self, block: Block) -> None:
        """Run a block; an AssertionError names the line that failed."""
        if block.language == "python":
            code = block.code.replace(ADDRESS, self._address)
            with contextlib.redirect_stdout(io.StringIO()):
                exec(compile(code, str(block), "exec"), {"__name__": "page"})
            return
        for number, line in enumerate(_commands(block.code), block.line + 1):
            if line:
                self._command(f"{block.page}:{number}", line)

    def _command(self, where: str, line: str) -> None:
        exported = _EXPORT.fullmatch(line)
        if exported is not None:
            echo = ["bash", "-c", f"printf %s {exported['value']}"]
            value = subprocess.run(echo, capture_output=True, text=True, check=True).stdout
            self._monkeypatch.setenv(exported["name"], value)
            return
        words = shlex.split(line.replace(ADDRESS, self._address), comments=True)
        if not words:
            return
        assert words[0] == "terraport", (
            f"{where}: {line!r} is no terraport command: say why not run"
        )
        given, taken = "", ""
        while len(words) > 2 and words[-2] in ("<", ">"):
            *words, sign, name = words
            given, taken = (name, taken) if sign == "<" else (given, name)
        code = self._invoke(words[1:], Path(given).read_text() if given else "")
        assert code == 0, f"{where}: {line!r} ended with {code}: {self.said[-2000:]}"
        if taken:
            Path(taken).write_text(self.said)

    def _invoke(self, arguments: list[str], given: str) -> int:
        out, error = io.StringIO(), io.StringIO()
        self._monkeypatch.setattr("sys.stdin", io.StringIO(given))
        self._monkeypatch.setattr("sys.argv", ["terraport", *arguments])
        code: object = 0
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
            try:
                app(arguments, prog_name="terraport")
            except SystemExit as stopped:
                code = stopped.code
        self.said = out.getvalue()
        if code:
            self.said += error.getvalue()
        return code if isinstance(code, int) else int(bool(code))

    def _serve(self, settings: Settings, *_: object, **__: object) -> None:
        """Stand in for the foreground service: one in a thread, on a free port."""
        self._servers.close()
        given = settings.model_dump(exclude_unset=True, exclude={"host", "port", "workers"})
        directory = given.pop("scenes_dir", None) or given.pop("scenes_url")
        given.pop("scenes_url", None)
        server = self._servers.enter_context(BackgroundServer(directory, **given))
        self._address = server.url


def _commands(code: str) -> Iterator[str]:
    """Join continued lines; the others stay where they are, for their numbers."""
    pending = ""
    for line in code.splitlines():
        pending += line.removesuffix("\\")
        if line.endswith("\\"):
            yield ""
            continue
        yield pending.strip()
        pending = ""


def pages() -> list[Path]:
    """List the pages whose blocks must run."""
    return [
        ROOT / "README.md",
        *sorted((ROOT / "docs" / "tutorial").glob("*.md")),
        *sorted((ROOT / "docs" / "how-to").glob("*.md")),
    ]


def in_process(*arguments: object) -> None:
    """Run one command, for a fixture."""
    silent = io.StringIO()
    with contextlib.redirect_stdout(silent), contextlib.redirect_stderr(silent):
        code: object = 0
        try:
            app([*map(str, arguments)], prog_name="terraport")
        except SystemExit as stopped:
            code = stopped.code
    assert not code, silent.getvalue()


@contextlib.contextmanager
def working_in(folder: Path) -> Iterator[None]:
    """Stand in a folder for a while."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)
