"""The page at /: the viewer, its files, and the list where there is no viewer."""

from __future__ import annotations

import gzip
import socket
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from pydantic import ValidationError
from server.grid_scene import write_grid_scene

from terraport_server import BackgroundServer
from terraport_server.errors import SettingsError
from terraport_server.http.viewer import chosen_coding
from terraport_server.settings import Settings

TOKEN = "sixteen-characters"
SCRIPT = b"export const answer = 42;\n" * 40
INDEX = b'<!doctype html><script type="module" src="./assets/main-1a2b.js"></script>'


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scenes")
    write_grid_scene(folder / "pit", cells=2, name="<Pit> & co")
    return folder


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a build leaves, and a file beside it that nobody must get."""
    folder = tmp_path_factory.mktemp("built") / "page"
    (folder / "assets").mkdir(parents=True)
    (folder / "index.html").write_bytes(INDEX)
    (folder / "assets" / "main-1a2b.js").write_bytes(SCRIPT)
    (folder / "assets" / "main-1a2b.js.gz").write_bytes(gzip.compress(SCRIPT))
    (folder / "third-party.txt").write_text("three: MIT")
    (folder.parent / "secret.txt").write_text("secret")
    (folder / ".sources").write_text("secret")
    return folder


@pytest.fixture(scope="module")
def server(scenes: Path, built: Path) -> Iterator[BackgroundServer]:
    """One that asks for tokens: the page is public all the same."""
    with BackgroundServer(scenes, viewer_dir=built, token=TOKEN) as running:
        yield running


@pytest.fixture
def http(server: BackgroundServer) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=server.url) as client:
        yield client


def test_the_page_needs_no_token_and_names_no_scene(http: httpx.Client) -> None:
    answer = http.get("/")
    assert answer.content == INDEX
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    assert answer.headers["cache-control"] == "no-cache"
    assert http.get("/scenes").status_code == 401


@pytest.mark.parametrize("path", ["/", "/assets/main-1a2b.js", "/third-party.txt"])
def test_every_file_comes_with_the_policy(http: httpx.Client, path: str) -> None:
    """Of workers, too: they are held to what came with their own script."""
    headers = http.get(path).headers
    (policy,) = headers.get_list("content-security-policy")
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules["default-src"] == "'none'"
    assert rules["script-src"] == "'self' 'wasm-unsafe-eval'"
    assert rules["frame-ancestors"] == rules["base-uri"] == rules["form-action"] == "'none'"
    assert "unsafe-inline" not in policy
    assert "unsafe-eval'" not in policy.replace("wasm-unsafe-eval", "")
    assert "http" not in policy
    assert "xr-spatial-tracking=(self)" in headers["permissions-policy"]
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["x-frame-options"] == "DENY"


def test_named_by_its_hash_it_is_kept_for_ever(http: httpx.Client) -> None:
    answer = http.get("/assets/main-1a2b.js", headers={"Accept-Encoding": "identity"})
    assert answer.content == SCRIPT
    assert answer.headers["content-type"] == "text/javascript; charset=utf-8"
    assert answer.headers["cache-control"] == "public, max-age=31536000, immutable"
    assert "content-encoding" not in answer.headers
    assert answer.headers["vary"] == "Accept-Encoding"


def test_small_for_those_who_take_it(http: httpx.Client) -> None:
    answer = http.get("/assets/main-1a2b.js", headers={"Accept-Encoding": "br, gzip"})
    assert answer.headers["content-encoding"] == "gzip"
    assert int(answer.headers["content-length"]) < len(SCRIPT)
    assert answer.content == SCRIPT
    assert answer.headers["vary"] == "Accept-Encoding"


@pytest.mark.parametrize("path", ["/", "/assets/main-1a2b.js"])
def test_unchanged(http: httpx.Client, path: str) -> None:
    for coding in ("identity", "gzip"):
        first = http.get(path, headers={"Accept-Encoding": coding})
        headers = {"Accept-Encoding": coding, "If-None-Match": first.headers["etag"]}
        again = http.get(path, headers=headers)
        assert (again.status_code, again.content) == (304, b"")
        assert again.headers["etag"] == first.headers["etag"]
        assert http.get(path, headers=headers | {"If-None-Match": '"x"'}).status_code == 200


def test_the_head_alone(server: BackgroundServer) -> None:
    """As a browser or a proxy asks for it: a length, and not one byte of a body."""
    for path, size in (("/", len(INDEX)), ("/assets/main-1a2b.js", len(SCRIPT))):
        with socket.create_connection(("127.0.0.1", server.port), timeout=10) as raw:
            raw.sendall(
                f"HEAD {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n".encode()
            )
            answer = b""
            while piece := raw.recv(1 << 16):
                answer += piece
        head, _, body = answer.partition(b"\r\n\r\n")
        assert head.startswith(b"HTTP/1.1 200")
        assert f"content-length: {size}".encode() in head.lower()
        assert body == b""


@pytest.mark.parametrize(
    "path",
    [
        "/assets/", "/assets", "/assets/none.js", "/assets/main-1a2b.js.gz", "/.sources",
        "/assets/../index.html", "/assets/..%2f..%2fsecret.txt", "/assets/%2e%2e/secret.txt",
        "/..%2fsecret.txt", "/secret.txt", "/assets//etc/passwd", "/assets/%00",
        "/assets/..%5c..%5csecret.txt", "/assets/main-1a2b.js/", "/none", "/%2fetc%2fpasswd",
    ],
)  # fmt: skip
def test_nothing_else_answers(server: BackgroundServer, path: str) -> None:
    """As written: httpx would tidy the path up first."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as raw:
        raw.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n".encode())
        answer = b""
        while piece := raw.recv(1 << 16):
            answer += piece
    assert answer.startswith(b"HTTP/1.1 404"), answer
    assert b"secret" not in answer


def test_what_is_built_later_is_not_served(scenes: Path, built: Path) -> None:
    with BackgroundServer(scenes, viewer_dir=built) as running:
        late = built / "assets" / "late.js"
        late.write_text("late")
        try:
            assert httpx.get(f"{running.url}/assets/late.js").status_code == 404
        finally:
            late.unlink()


def test_the_address_of_a_scene_in_it(server: BackgroundServer) -> None:
    assert server.viewer_url("pit & co") == f"{server.url}/#scene=pit%20%26%20co"


def test_no_viewer(
    scenes: Path, built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with BackgroundServer(scenes, viewer=False, viewer_dir=built) as running:
        assert running.viewer_url("pit") is None
        page = httpx.get(running.url)
        assert (page.status_code, "Pit" in page.text) == (404, False)
        assert httpx.get(f"{running.url}/assets/main-1a2b.js").status_code == 404
    monkeypatch.setattr("terraport_server.http.viewer.BUILT_PAGE", tmp_path)
    with BackgroundServer(scenes) as running:
        assert running.viewer_url("pit") is None
        assert "pip install -e ." in httpx.get(running.url).text


def test_a_folder_without_a_page_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"viewer_dir: .* has no index\.html"):
        Settings(scenes_dir=tmp_path, viewer_dir=tmp_path).check()


def test_only_pages_that_are_named_may_frame_the_viewer(
    http: httpx.Client, scenes: Path, built: Path
) -> None:
    answer = http.get("/")
    assert "frame-ancestors 'none'" in answer.headers["content-security-policy"]
    assert answer.headers["x-frame-options"] == "DENY"
    named = ("https://mine.example", "https://*.example.org:8443")
    with BackgroundServer(scenes, viewer_dir=built, frame_ancestors=named) as running:
        page = httpx.get(f"{running.url}/")
        listed = httpx.get(f"{running.url}/scenes")
    assert page.headers["content-security-policy"].endswith(f"frame-ancestors {' '.join(named)}")
    assert "x-frame-options" not in page.headers
    assert listed.headers["x-frame-options"] == "DENY"


@pytest.mark.parametrize("named", ["https://a.example; script-src *", "a.example", "'self' *", ""])
def test_what_is_no_origin_may_not_frame(named: str) -> None:
    with pytest.raises(ValidationError, match="frame_ancestors"):
        Settings(frame_ancestors=(named,))


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
