"""What strangers learn, by a corpus of odd requests; hosts, headers, /docs and /metrics."""

from __future__ import annotations

import json
import logging
import re
import socket
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import httpx
import pytest
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient

from terraport_server import BackgroundServer
from terraport_server.auth.origins import host_is_ours

TOKEN = "sixteen-characters"
METRICS = "metrics-sixteen-characters"

PATHS = [
    "/", "/scenes", "/scenes/", "/scenes/pit", "/scenes/pit/", "/scenes/atlantis",
    "/scenes/pit/base.tsg", "/scenes/pit/base.glb",
    "/scenes/pit/regions.json",
    "/scenes/pit/labels.json", "/scenes/pit/segments/0.glb", "/scenes/pit/segments/999.glb",
    "/scenes/pit/segments/-1.glb", "/scenes/pit/segments/abc.glb", "/scenes/pit/segments/1e9.glb",
    "/scenes/pit/segments/99999999999999999999999999999999.glb", "/scenes/pit/report",
    "/scenes/pit/base.tsg?v=", "/scenes/pit/base.tsg?v=" + "9" * 4000,
    "/scenes/pit/base.tsg?v=%00", "/scenes/pit/stream", "/healthz", "/readyz", "/metrics",
    "/redoc", "/openapi.json", "/favicon.ico", "/.env", "/.git/config", "/scenes/..%2f..%2fetc",
    "/scenes/%2e%2e/%2e%2e/etc/passwd", "/../../etc/passwd", "//etc/passwd", "/scenes/pit%00",
    "/scenes/pit/../../../etc/passwd", "/scenes/%ff%fe", "/scenes/" + "a" * 3000,
    "/scenes/pit/scene.json", "/scenes/pit/segments.pack", "/scenes/pit/.", "/scenes/.",
    "/scenes/<script>alert(1)</script>", "/docs/oauth2-redirect", "/static/x", "/%",
    "/scenes/pit/segments/0.glb?v=1&v=2&v[]=3",
]  # fmt: skip

METHODS = ["GET", "HEAD", "POST", "OPTIONS", "TRACE", "CONNECT", "BREW"]

HEADERS: list[dict[str, str]] = [
    {},
    {"Range": "bytes=5-2"},
    {"Range": "bytes=99999999999999999999-"},
    {"Range": "bytes=" + ",".join(f"{n}-{n}" for n in range(500))},
    {"Range": "lines=1-2"},
    {"Range": "bytes=a-b"},
    {"If-None-Match": '"' * 200},
    {"If-Range": "x", "Range": "bytes=0-1"},
    {"Authorization": "Bearer " + "a.b.c"},
    {"Authorization": "Bearer " + "." * 5000},
    {"Authorization": "Basic \x80\xff"},
    {"Accept": "*/*;q=nan"},
    {"Content-Length": "0", "Content-Type": "application/json"},
    {"Upgrade": "websocket", "Connection": "Upgrade"},
    {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "1"},
    {"Upgrade": "h2c", "Connection": "Upgrade"},
    {"Expect": "100-continue"},
    {"Origin": "http://[bad"},
    {"X-Forwarded-For": "<script>, 1.2.3.4", "X-Forwarded-Proto": "gopher"},
    {"Forwarded": "for=unknown"},
]

LEAKS = re.compile(
    r"traceback|site-packages|\.py\b|uvicorn|starlette|fastapi|pydantic|httptools|websockets/|"
    r"python/?3?|uvloop|object at 0x|errno|exception",
    re.IGNORECASE,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("secret-place")
    write_grid_scene(folder / "pit", cells=2)
    return folder


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[BackgroundServer]:
    """Open, so that requests get as far as they can."""
    with BackgroundServer(folder) as running:
        yield running


@pytest.fixture(scope="module")
def guarded(folder: Path) -> Iterator[BackgroundServer]:
    with BackgroundServer(folder, token=TOKEN, metrics_token=METRICS) as running:
        yield running


def ask(server: BackgroundServer, request: bytes) -> bytes:
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as raw:
        raw.sendall(request)
        data = b""
        try:
            while piece := raw.recv(1 << 16):
                data += piece
        except ConnectionResetError:
            pass
        return data


def check(answer: bytes, request: bytes, folder: Path) -> None:
    """Check one answer: whatever it says, it says nothing of the inside."""
    assert answer, request
    head, _, body = answer.partition(b"\r\n\r\n")
    status = int(head.split()[1])
    assert status != 500, request
    names = [line.partition(b":")[0].lower() for line in head.split(b"\r\n")[1:]]
    assert b"server" not in names, request
    assert b"x-powered-by" not in names, request
    if b"model/gltf" in head or b"octet-stream" in head or b"GET /metrics" in request:
        body = b""
    if b'"format":"terraport-scene"' in body:  # a scene says what built it, to who may see it
        body = re.sub(rb'"build":.*"input":', b"", body)
    text = (head + b"\n" + body).decode("latin-1")
    assert not LEAKS.search(text), (request, text)
    assert folder.name not in text, request
    assert version("terraport") not in text, request
    if status >= 400 and body and b"application/json" in head:
        error = json.loads(body)["error"]
        assert set(error) == {"code", "message"}
        assert len(error["message"]) < 400


@pytest.mark.parametrize("method", METHODS)
def test_no_request_learns_of_the_inside(
    server: BackgroundServer, folder: Path, method: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.ERROR)
    for path in PATHS if method == "GET" else PATHS[::6]:
        request = f"{method} {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
        check(ask(server, request.encode()), request.encode(), folder)
    assert not caplog.records


@pytest.mark.parametrize("headers", HEADERS, ids=lambda headers: "+".join(headers) or "none")
def test_no_header_brings_it_out(
    server: BackgroundServer,
    folder: Path,
    headers: dict[str, str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.ERROR)
    lines = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
    close = "" if "Connection" in headers else "Connection: close\r\n"
    for path in ("/scenes/pit/base.tsg", "/scenes/pit/stream", "/nowhere"):
        request = f"GET {path} HTTP/1.1\r\nHost: localhost\r\n{close}{lines}\r\n".encode("latin-1")
        check(ask(server, request), request, folder)
    assert not caplog.records


def test_a_handshake_names_no_software(server: BackgroundServer) -> None:
    with PlainClient(server.scene_url("pit")) as client:
        assert client.socket.response is not None
        assert "server" not in client.socket.response.headers


def test_a_token_is_asked_for_before_anything_is_told(guarded: BackgroundServer) -> None:
    """A scene that is and one that is not look the same to who has no token."""
    for path in PATHS:
        if not path.startswith("/scenes/pit") or ".." in path:
            continue
        existing = httpx.get(f"{guarded.url}{path}")
        missing = httpx.get(f"{guarded.url}{path.replace('pit', 'tip')}")
        assert (existing.status_code, existing.content) == (missing.status_code, missing.content), (
            path
        )


def test_several_ranges_are_answered_by_the_whole(server: BackgroundServer) -> None:
    url = f"{server.url}/scenes/pit/base.tsg"
    whole = httpx.get(url)
    many = httpx.get(url, headers={"Range": "bytes=" + ",".join(["0-"] * 9)})
    assert (many.status_code, many.content) == (200, whole.content)


def test_pages_run_no_script_and_stand_in_no_frame(server: BackgroundServer, folder: Path) -> None:
    """The viewer alone has scripts; its own policy is looked at in test_page_endpoints."""
    report = folder / "pit" / "report.html"
    report.write_text("<h1>report</h1>")
    try:
        page = httpx.get(f"{server.url}/scenes/pit/report")
    finally:
        report.unlink()
    (policy,) = page.headers.get_list("content-security-policy")
    assert "default-src 'none'" in policy
    assert "script-src" not in policy
    assert page.headers["x-content-type-options"] == "nosniff"
    assert httpx.get(f"{server.url}/scenes").headers["referrer-policy"] == "no-referrer"


@pytest.mark.parametrize(
    ("host", "allowed", "expected"),
    [
        (None, (), True),
        ("localhost", (), True),
        ("LOCALHOST:8080", (), True),
        ("pit.localhost:1", (), True),
        ("127.0.0.1:8080", (), True),
        ("192.168.1.2", (), True),
        ("[::1]:8080", (), True),
        ("::1", (), True),
        ("evil.example:8080", (), False),
        ("127.0.0.1.evil.example", (), False),
        ("localhost.evil.example", (), False),
        ("", (), False),
        ("pit.example", ("pit.example",), True),
        ("pit.example:8080", ("pit.example",), True),
        ("pit.example:8080", ("pit.example:8080",), True),
    ],
)
def test_hosts(host: str | None, allowed: tuple[str, ...], expected: bool) -> None:
    assert host_is_ours(host, allowed) is expected


def test_a_name_that_was_pointed_here_does_not_open_an_open_service(
    server: BackgroundServer, guarded: BackgroundServer, folder: Path
) -> None:
    """DNS rebinding: the page's origin and the host it asks are the same, and not ours."""
    headers = {"Host": "evil.example", "Origin": "http://evil.example"}
    answer = httpx.get(f"{server.url}/scenes", headers=headers)
    assert (answer.status_code, answer.json()["error"]["code"]) == (421, "forbidden")
    with PlainClient(
        server.scene_url("pit"), origin="http://evil.example", additional_headers={"Host": "x.y"}
    ) as client:
        assert client.refused()[1] == 4403
    assert httpx.get(f"{guarded.url}/healthz", headers=headers).status_code == 200
    with BackgroundServer(folder, allowed_hosts=("evil.example",)) as named:
        assert httpx.get(f"{named.url}/scenes", headers=headers).status_code == 200


def test_metrics_and_docs_are_for_operators(
    guarded: BackgroundServer, folder: Path, tmp_path: Path
) -> None:
    url = f"{guarded.url}/metrics"
    for token in ("", TOKEN, "wrong", METRICS[:-1], METRICS + "x"):
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        assert httpx.get(url, headers=headers).status_code == 401
    right = httpx.get(url, headers={"Authorization": f"Bearer {METRICS}"})
    assert "terraport_refused_total" in right.text
    assert httpx.get(f"{guarded.url}/scenes", headers=right.request.headers).status_code == 401
    for path in ("/docs", "/openapi.json"):
        assert httpx.get(guarded.url + path).status_code == 404
    assert "metrics" not in httpx.get(guarded.url).text
    with BackgroundServer(folder, token=TOKEN) as closed:
        assert httpx.get(f"{closed.url}/metrics").status_code == 404
        # Nor do tokens that open scenes.
        headers = {"Authorization": f"Bearer {TOKEN}"}
        assert httpx.get(f"{closed.url}/metrics", headers=headers).status_code == 404
    (tmp_path / "tokens").write_text(f"prometheus {METRICS} +metrics\nheadset {TOKEN}\n")
    with BackgroundServer(folder, tokens_file=tmp_path / "tokens") as scoped:
        for token, status, scenes in ((METRICS, 200, 403), (TOKEN, 404, 200)):
            headers = {"Authorization": f"Bearer {token}"}
            assert httpx.get(f"{scoped.url}/metrics", headers=headers).status_code == status
            assert httpx.get(f"{scoped.url}/scenes/pit", headers=headers).status_code == scenes
    with BackgroundServer(folder, token=TOKEN, public_metrics=True) as shown:
        assert httpx.get(f"{shown.url}/metrics").status_code == 200


def test_pages_of_allowed_origins_may_read_answers(folder: Path) -> None:
    viewer = {"Origin": "https://viewer.example"}
    preflight = viewer | {
        "Access-Control-Request-Method": "GET",
        "Access-Control-Request-Headers": "authorization",
    }
    with BackgroundServer(
        folder, token=TOKEN, allowed_origins=("https://viewer.example",)
    ) as running:
        url = f"{running.url}/scenes/pit/base.tsg"
        allowed = httpx.options(url, headers=preflight)
        assert allowed.headers["access-control-allow-origin"] == "https://viewer.example"
        other = httpx.options(url, headers=preflight | {"Origin": "https://evil.example"})
        assert "access-control-allow-origin" not in other.headers
        read = httpx.get(url, headers=viewer | {"Authorization": f"Bearer {TOKEN}"})
        assert read.headers["access-control-allow-origin"] == "https://viewer.example"
        assert "access-control-allow-credentials" not in read.headers
