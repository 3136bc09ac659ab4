"""Payload over HTTP, asked of a running service: ranges, caches, damage, a proxy."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from server.grid_scene import GridScene, write_grid_scene

from terraport_server import BackgroundServer


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> GridScene:
    return write_grid_scene(tmp_path_factory.mktemp("payload") / "pit", cells=4)


@pytest.fixture(scope="module")
def server(grid: GridScene) -> Iterator[BackgroundServer]:
    with BackgroundServer(grid.path.parent) as running:
        yield running


def test_a_segment_as_glb(server: BackgroundServer, grid: GridScene) -> None:
    glb = grid.glb(7)
    with httpx.Client(base_url=server.url) as http:
        path = f"/scenes/pit/segments/7.glb?v={grid.manifest.version}"
        whole = http.get(path)
        etag = whole.headers["etag"]
        assert whole.content == glb
        assert whole.headers["content-type"] == "model/gltf-binary"
        assert whole.headers["content-length"] == str(len(glb))
        assert whole.headers["cache-control"] == "public, max-age=31536000, immutable"
        assert not etag.startswith("W/")

        same = http.get(path, headers={"If-None-Match": f'"x", {etag}'})
        assert (same.status_code, same.content) == (304, b"")
        head = http.head(path)
        assert (head.status_code, head.content) == (200, b"")
        assert head.headers["content-length"] == str(len(glb))
        assert head.headers["etag"] == etag
        # All of it on one connection: nothing was left over of any answer.
        assert http.get("/healthz").text == "ok\n"


def test_a_pack_and_ranges_of_it(server: BackgroundServer, grid: GridScene) -> None:
    pack = grid.manifest.files["segments.pack"]
    data = (grid.path / pack.path).read_bytes()
    url = f"{server.url}/scenes/pit/{pack.path}"
    whole = httpx.get(url)
    assert whole.content == data
    assert whole.headers["etag"] == f'"{pack.xxh3}"'
    assert whole.headers["cache-control"] == "public, max-age=31536000, immutable"
    assert whole.headers["content-type"] == "application/octet-stream"
    part = httpx.get(url, headers={"Range": "bytes=64-1063"})
    assert (part.status_code, part.content) == (206, data[64:1064])
    assert part.headers["content-range"] == f"bytes 64-1063/{len(data)}"
    assert httpx.head(url).headers["content-length"] == str(len(data))


@pytest.mark.parametrize(
    "path",
    [
        "scene.json",
        "v-000000000000/segments.pack",
        "{folder}/segments.idx",
        "{folder}/..%2fscene.json",
    ],
)
def test_nothing_else_of_the_folder_is_served(
    server: BackgroundServer, grid: GridScene, path: str
) -> None:
    folder = grid.manifest.files["segments.pack"].path.partition("/")[0]
    answer = httpx.get(f"{server.url}/scenes/pit/{path.format(folder=folder)}")
    assert answer.status_code == 404


def test_a_pack_asks_for_the_token(grid: GridScene) -> None:
    path = f"scenes/pit/{grid.manifest.files['segments.pack'].path}"
    token = "sixteen-characters"
    with BackgroundServer(grid.path.parent, token=token) as running:
        assert httpx.get(f"{running.url}/{path}").status_code == 401
        right = httpx.get(f"{running.url}/{path}", headers={"Authorization": f"Bearer {token}"})
        assert right.status_code == 200
        assert right.headers["cache-control"].startswith("private")


def test_the_newest_version_is_asked_about_again(server: BackgroundServer) -> None:
    answer = httpx.get(f"{server.url}/scenes/pit/segments/7.glb")
    assert answer.headers["cache-control"] == "no-cache"
    assert httpx.get(f"{server.url}/scenes/pit/segments/7.glb?v=other").status_code == 404


def test_requests_sent_ahead_are_answered_in_order(
    server: BackgroundServer, grid: GridScene
) -> None:
    asked = range(8)
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as raw:
        for n in asked:
            last = b"Connection: close\r\n" if n == asked[-1] else b""
            raw.sendall(
                b"GET /scenes/pit/segments/%d.glb HTTP/1.1\r\nHost: localhost\r\n%b\r\n" % (n, last)
            )
        data = b""
        while piece := raw.recv(1 << 16):
            data += piece
    for n in asked:
        head, _, data = data.partition(b"\r\n\r\n")
        assert head.startswith(b"HTTP/1.1 200 OK\r\n")
        glb = grid.glb(n)
        assert data.startswith(glb)
        data = data[len(glb) :]
    assert data == b""
    assert b"connection: close" in head


@pytest.mark.parametrize(
    ("wanted", "status", "part"),
    [
        ("bytes=0-0", 206, slice(0, 1)),
        ("bytes=10-29", 206, slice(10, 30)),
        ("bytes = 10 - 29", 206, slice(10, 30)),
        ("bytes=10-", 206, slice(10, None)),
        ("bytes=-7", 206, slice(-7, None)),
        ("bytes=10-99999999999", 206, slice(10, None)),
        ("bytes=-99999999999", 206, slice(None)),
        ("bytes=-0", 416, slice(0, 0)),
        ("bytes=99999999-", 416, slice(0, 0)),
        ("bytes=29-10", 200, slice(None)),
        ("bytes=-", 200, slice(None)),
        ("bytes=0-1,4-5", 200, slice(None)),
        ("lines=0-1", 200, slice(None)),
        ("bytes=0x1-2", 200, slice(None)),
    ],
)
@pytest.mark.parametrize("name", ["pack", "base.tsg"])
def test_one_valid_range_is_answered(
    server: BackgroundServer, grid: GridScene, name: str, wanted: str, status: int, part: slice
) -> None:
    path = grid.manifest.files["segments.pack"].path if name == "pack" else name
    url = f"{server.url}/scenes/pit/{path}"
    whole = httpx.get(url)
    answer = httpx.get(url, headers={"Range": wanted})
    assert (answer.status_code, answer.content) == (status, whole.content[part])
    if name != "base.tsg":
        assert httpx.head(url, headers={"Range": wanted}).status_code == 200
    stale = httpx.get(url, headers={"Range": wanted, "If-Range": 'W/"x"'})
    assert (stale.status_code, stale.content) == (200, whole.content)
    assert httpx.get(url, headers={"If-None-Match": f"W/{whole.headers['etag']}"}).content == b""


def test_a_pack_whose_file_was_deleted_is_served_while_its_version_is_open(tmp_path: Path) -> None:
    own = write_grid_scene(tmp_path / "pit", cells=2)
    pack = own.path / own.manifest.files["segments.pack"].path
    data = pack.read_bytes()
    with BackgroundServer(tmp_path) as running:
        pack.unlink()
        answer = httpx.get(f"{running.url}/scenes/pit/{pack.relative_to(own.path)}")
        assert (answer.status_code, answer.content) == (200, data)


def test_a_damaged_segment_is_told_and_never_sent(tmp_path: Path) -> None:
    own = write_grid_scene(tmp_path / "pit", cells=2)
    pack = own.path / own.manifest.files["segments.pack"].path
    data = bytearray(pack.read_bytes())
    offset = data.index(own.payloads[4])
    data[offset + 40] ^= 1
    pack.write_bytes(data)
    with BackgroundServer(tmp_path) as running:
        url = f"{running.url}/scenes/pit/segments"
        for _ in range(2):
            answer = httpx.get(f"{url}/4.glb")
            assert (answer.status_code, answer.json()["error"]["code"]) == (500, "segment_corrupt")
        assert httpx.get(f"{url}/5.glb").content == own.glb(5)


def test_a_proxy_asks_before_it_serves_a_pack(grid: GridScene) -> None:
    """Caddy's forward_auth: the answer is that of the pack itself, without its bytes."""
    pack = f"/scenes/pit/{grid.manifest.files['segments.pack'].path}"
    token, land = "sixteen-characters", "other-sixteen-chars"
    tokens = grid.path.parent.parent / "tokens"
    tokens.write_text(f"anna {token} pit\nbert {land} other\n")

    def ask(uri: str, token: str | None) -> int:
        headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        url = f"{running.url}/auth"
        return httpx.get(url, headers=headers | {"X-Forwarded-Uri": uri}).status_code

    with BackgroundServer(grid.path.parent, tokens_file=tokens) as running:
        for uri in (pack, f"{pack}?v=1", f"/terra{pack}"):
            assert [ask(uri, one) for one in (None, "wrong", land, token)] == [401, 401, 403, 204]
        others = (pack + "/x", "/scenes/pit/scene.json", "/scenes/pit/v-0/segments.pack", "/", "")
        assert {ask(uri, token) for uri in others} == {404}
        folder = grid.manifest.files["segments.pack"].path.partition("/")[0]
        assert ask(f"/scenes/pit/{folder}/..%2fscene.json", token) == 404


def test_a_client_that_leaves_within_a_body(server: BackgroundServer, grid: GridScene) -> None:
    for _ in range(4):
        with socket.create_connection(("127.0.0.1", server.port), timeout=10) as raw:
            raw.sendall(b"GET /scenes/pit/segments/3.glb HTTP/1.1\r\nHost: localhost\r\n\r\n")
    answer = httpx.get(f"{server.url}/scenes/pit/segments/3.glb")
    assert answer.content == grid.glb(3)
