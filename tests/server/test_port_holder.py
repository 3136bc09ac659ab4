"""Who listens on a port, as Linux says it."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from terraport_server.port_holder import port_holder

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux says so")

LISTEN = """
import socket
with socket.create_server(("127.0.0.1", 0)) as listener:
    print(listener.getsockname()[1], flush=True)
    input()
"""


@contextmanager
def listening(*command: str) -> Iterator[tuple[int, int]]:
    """Start a process that listens; its port and number."""
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        yield int(process.stdout.readline()), process.pid
        process.communicate("\n")


@pytest.mark.parametrize(
    ("file", "arguments", "name"),
    [
        ("terraport", ["serve", "--token", "never-shown-to-anybody"], "terraport serve"),
        ("tool.py", ["secret"], "tool.py"),
    ],
)
def test_a_script_is_named_without_its_arguments(
    tmp_path: Path, file: str, arguments: list[str], name: str
) -> None:
    script = tmp_path / file
    script.write_text(LISTEN)
    with listening(sys.executable, str(script), *arguments) as (port, process):
        assert port_holder(port) == f"{name} (process {process})"


def test_a_program_without_a_script_is_named_by_itself() -> None:
    with listening(sys.executable, "-c", LISTEN) as (port, process):
        assert port_holder(port) == f"{Path(sys.executable).name} (process {process})"


def test_this_process_and_nobody() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        assert port_holder(port) == "this very process"
    assert port_holder(port) is None


def test_where_the_system_does_not_say(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("terraport_server.port_holder._PROC", tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        assert port_holder(listener.getsockname()[1]) is None
