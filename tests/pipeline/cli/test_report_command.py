"""``terraport report``: what is refused before anything is drawn, and what is said at the end."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image
from store.tiny_scene import write_tiny_scene
from typer.testing import CliRunner

from terraport.cli import app


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["nowhere"], 1, "error: no scene at nowhere, expected a directory with scene.json"),
        (["."], 1, "error: no scene at ., expected a directory with scene.json; scenes in it: pit"),
        (["pit", "-o", "no/page.html"], 2, "error: received the output no/page.html, expected an"),
        (["pit", "--photos", "no"], 2, "'no' does not exist"),
        (["pit", "--photos", "pit/scene.json"], 2, "is a file"),
        (["pit", "--cameras", "no"], 2, "'no' does not exist"),
        (["pit", "--survey", "no.laz"], 2, "'no.laz' does not exist"),
        (["pit", "-o", "page.pdf"], 2, "error: received the output page.pdf, expected a name that"),
    ],
)
def test_what_cannot_be_is_said_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], code: int, text: str
) -> None:
    write_tiny_scene(tmp_path / "pit")
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["report", *arguments])
    assert (result.exit_code, result.stdout) == (code, "")
    assert text in " ".join(result.stderr.replace("│", " ").split())
    assert not (tmp_path / "pit" / "report.html").exists()


def test_both_pages_are_made_and_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_tiny_scene(tmp_path / "pit")
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["report", "pit", "--width", "160", "--rays", "0"])
    assert result.exit_code == 0, result.stderr
    first, second = result.stdout.splitlines()
    assert first.startswith("pit/report.html  ")
    assert second.startswith("pit/report.pdf  ")
    assert second.endswith(", one page")
    assert (tmp_path / "pit" / "report.pdf").read_bytes().startswith(b"%PDF-1.")
    with Image.open(tmp_path / "pit" / "preview.jpg") as preview:
        assert (preview.format, preview.width) == ("JPEG", 160)  # never enlarged
