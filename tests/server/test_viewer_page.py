"""The viewer's files: what is read, and which form a client takes."""

from __future__ import annotations

from pathlib import Path

import pytest
import xxhash

from terraport_server.http.viewer import ViewerPage, chosen_coding


def test_files_with_their_compressed_twins(tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("<html>")
    (tmp_path / "assets" / "deep").mkdir(parents=True)
    (tmp_path / "assets" / "a-1.js").write_bytes(b"let a")
    (tmp_path / "assets" / "a-1.js.br").write_bytes(b"small")
    (tmp_path / "assets" / "a-1.js.gz").write_bytes(b"small too")
    (tmp_path / "assets" / "deep" / "b.bin").write_bytes(b"b")
    (tmp_path / ".sources").write_text("a note")
    page = ViewerPage(tmp_path)
    script = page.find("assets/a-1.js")
    assert script is not None
    assert script.forms == {"": b"let a", "br": b"small", "gzip": b"small too"}
    assert script.digest == xxhash.xxh3_64_hexdigest(b"let a")
    assert script.media_type == "text/javascript; charset=utf-8"
    assert script.is_fixed
    assert len({script.etag(coding) for coding in script.forms}) == 3
    assert not page.index.is_fixed
    other = page.find("assets/deep/b.bin")
    assert other is not None
    assert other.media_type == "application/octet-stream"
    for name in ("assets/a-1.js.br", ".sources", "assets", "assets/", "", "../x", "index"):
        assert page.find(name) is None


@pytest.mark.parametrize(
    ("accepted", "coding"),
    [
        (None, ""),
        ("", ""),
        ("identity", ""),
        ("gzip, deflate, br", "br"),
        ("GZIP", "gzip"),
        ("br;q=0, gzip;q=0.5", "gzip"),
        ("br; q=0.0, gzip;q=0.00", ""),
        ("*", "br"),
        ("*;q=0, gzip", "gzip"),
        ("zstd, deflate", ""),
        ("br;q=0.001", "br"),
        (",;,=,q=1", ""),
    ],
)
def test_the_coding_is_one_that_the_client_takes(accepted: str | None, coding: str) -> None:
    assert chosen_coding(accepted, {"": b"", "br": b"", "gzip": b""}) == coding


def test_no_coding_that_is_not_there() -> None:
    assert chosen_coding("br, gzip", {"": b"", "gzip": b""}) == "gzip"
    assert chosen_coding("br, gzip", {"": b""}) == ""
