"""Bodies from files under TLS: the same bytes, and no more of them here than a client takes."""

from __future__ import annotations

import socket
import ssl
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from eventually import eventually
from server.grid_scene import SIDE, write_grid_scene
from server.plain_client import PlainClient, client_context
from server.test_access_watch import write_certificate
from terraport_server.secure_transport import SecureTransport

from terraport_server import BackgroundServer
from terraport_server.file_sender import FileSender
from terraport_wire import Land, PayloadFrame, Ready

BIG = 3 << 20
"""Bytes of the pack, more than small socket buffers take."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("files")
    write_certificate(folder, "localhost")
    grid = write_grid_scene(folder / "scenes" / "pit", cells=4)
    pack = grid.manifest.files["segments.pack"]
    with (grid.path / pack.path).open("ab") as file:  # behind its segments
        file.write(np.random.default_rng(1).bytes(BIG))
    manifest = grid.path / "scene.json"
    text = manifest.read_text()
    manifest.write_text(text.replace(f'"bytes": {pack.bytes}', f'"bytes": {pack.bytes + BIG}', 1))
    return folder


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[BackgroundServer]:
    with BackgroundServer(
        folder / "scenes", ssl_certfile=folder / "cert.pem", ssl_keyfile=folder / "key.pem"
    ) as running:
        yield running


@pytest.fixture
def pack(folder: Path) -> Path:
    return next((folder / "scenes" / "pit").glob("v-*/*.pack"))


def connect(server: BackgroundServer, receive_bytes: int = 0) -> ssl.SSLSocket:
    raw = socket.socket()
    if receive_bytes:
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
    raw.settimeout(20)
    raw.connect(("127.0.0.1", server.port))
    return client_context().wrap_socket(raw, server_hostname="localhost")


def ask(secure: ssl.SSLSocket, path: str, byte_range: str = "") -> None:
    line = f"Range: bytes={byte_range}\r\n" if byte_range else ""
    secure.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n{line}\r\n".encode())


def read_body(secure: ssl.SSLSocket) -> bytes:
    data = b""
    while b"\r\n\r\n" not in data:
        data += secure.recv(1 << 16)
    head, _, body = data.partition(b"\r\n\r\n")
    length = int(head.lower().partition(b"content-length: ")[2].partition(b"\r")[0])
    while len(body) < length:
        body += secure.recv(1 << 16)
    return body


def test_what_is_asked_for_again_and_again_is_the_files(
    server: BackgroundServer, pack: Path
) -> None:
    data = pack.read_bytes()
    path = f"/scenes/pit/{pack.parent.name}/{pack.name}"
    with connect(server) as secure:
        for start, stop in ((0, 1), (5, 100_005), (0, BIG), (17, len(data))):
            ask(secure, path, f"{start}-{stop - 1}")
            assert read_body(secure) == data[start:stop]
        for _ in range(2):  # the second one is answered by the connection
            ask(secure, "/scenes/pit/segments/3.glb")
            segment = read_body(secure)
        assert segment[:4] == b"glTF"
        assert segment in data


def test_of_a_body_that_is_not_read_one_piece_is_kept(
    server: BackgroundServer, pack: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was in memory as a whole."""
    transports: list[SecureTransport] = []
    serve = FileSender.can_serve

    def note(transport: SecureTransport) -> bool:
        transports.append(transport)
        return serve(transport)

    monkeypatch.setattr(FileSender, "can_serve", staticmethod(note))
    data = pack.read_bytes()
    with connect(server, 16 << 10) as secure:
        eventually(lambda: len(transports) == 1)  # the client is done with shaking hands first
        (transport,) = transports
        transport.raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 32 << 10)
        ask(secure, f"/scenes/pit/{pack.parent.name}/{pack.name}", f"0-{BIG - 1}")
        eventually(lambda: transport.get_write_buffer_size() > 0)
        assert transport.get_write_buffer_size() < 144 << 10
        assert read_body(secure) == data[:BIG]
        ask(secure, "/healthz")
        assert read_body(secure)


def test_a_landing_is_the_same_bytes_as_without_tls(server: BackgroundServer, folder: Path) -> None:
    def landed(url: str, context: ssl.SSLContext | None) -> dict[int, bytes]:
        got: dict[int, bytes] = {}
        options = {} if context is None else {"ssl": context}
        with PlainClient(url, **options) as client:
            client.hello()
            client.send(Land(generation=1, position=(0.0, 0.0, 0.0), radius_m=500.0))
            while not isinstance(message := client.receive(), Ready):
                if isinstance(message, PayloadFrame):
                    got[message.segment] = got.get(message.segment, b"") + bytes(message.chunk)
        return got

    secret = landed(server.scene_url("pit").replace("http://", "https://"), client_context())
    with BackgroundServer(folder / "scenes") as plain:
        assert secret == landed(plain.scene_url("pit"), None)
    assert len(secret) == SIDE**2
