"""``terraport demo``: what is refused at once, whether it may open a browser.

That it runs, .ci/run sees.
"""

from __future__ import annotations

import socket
from pathlib import Path

import pytest
from typer.testing import CliRunner

from terraport.cli import app
from terraport_pipeline.cli.demo import has_display


def test_a_port_in_use_is_said_before_anything_is_made(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        result = CliRunner().invoke(
            app, ["demo", "--points", "20k", "--port", str(port), "--keep", str(tmp_path / "demo")]
        )
    assert result.exit_code == 1
    assert result.stdout == ""
    assert f"error: could not listen on 127.0.0.1:{port}: " in result.stderr
    assert "does; stop it, or choose another port: --port " in result.stderr
    assert not (tmp_path / "demo").exists()


def test_a_file_is_no_folder_to_keep_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    result = CliRunner().invoke(app, ["demo", "--keep", "file"])
    assert result.exit_code == 2
    assert "is a file" in result.stderr


def test_how_many_points_make_a_demo(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["demo", "--points", "5", "--keep", str(tmp_path / "demo")])
    assert result.exit_code == 2
    assert "received 5 points, expected 20,000 to 20,000,000 for a demo" in result.stderr


def test_a_number_that_is_no_port_is_refused() -> None:
    result = CliRunner().invoke(app, ["demo", "--port", "70000"])
    assert result.exit_code == 2
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(
    ("platform", "environment", "expected"),
    [
        ("linux", {}, False),
        ("linux", {"DISPLAY": ":0"}, True),
        ("linux", {"WAYLAND_DISPLAY": "wayland-0"}, True),
        ("linux", {"DISPLAY": ""}, False),
        ("darwin", {}, True),
        ("win32", {}, True),
        ("linux", {"DISPLAY": "localhost:10.0", "SSH_CONNECTION": "10.0.0.1 1 10.0.0.2 22"}, False),
        ("darwin", {"SSH_CONNECTION": "10.0.0.1 1 10.0.0.2 22"}, False),
    ],
)
def test_a_browser_is_opened_where_it_is_seen(
    monkeypatch: pytest.MonkeyPatch, platform: str, environment: dict[str, str], expected: bool
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SSH_CONNECTION"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr("sys.platform", platform)
    assert has_display() is expected
