"""What ``terraport serve`` says of the viewer before the log begins."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from terraport_server.cli import _viewer_line
from terraport_server.settings import Settings


@pytest.mark.parametrize(
    ("options", "scheme", "line"),
    [
        ({}, "http", "http://127.0.0.1:8080/"),
        ({"host": "0.0.0.0", "port": 99}, "https", "https://localhost:99/"),
        ({"host": "::"}, "http", "http://localhost:8080/"),
        ({"host": "::1"}, "http", "http://[::1]:8080/"),
        ({"host": "pit.example"}, "https", "https://pit.example:8080/"),
        ({"viewer": False}, "http", "switched off"),
    ],
)
def test_where_the_viewer_is(
    tmp_path: Path, options: dict[str, Any], scheme: str, line: str
) -> None:
    (tmp_path / "index.html").write_text("<html>")
    settings = Settings(scenes_dir=tmp_path, viewer_dir=tmp_path, **options)
    assert _viewer_line(settings, scheme) == line


def test_how_to_get_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("terraport_server.http.viewer.BUILT_PAGE", tmp_path)
    assert "pip install -e ." in _viewer_line(Settings(scenes_dir=tmp_path), "http")
