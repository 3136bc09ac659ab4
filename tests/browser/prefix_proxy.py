"""A proxy that shows a service below a path of its own, as a company's web server would."""

from __future__ import annotations

import socket
import socketserver
import threading
from types import TracebackType
from typing import Self
from urllib.parse import urlsplit

__all__ = ["PrefixProxy"]

_TIMEOUT_S = 30.0


class PrefixProxy:
    """A context manager; one request for each connection, WebSockets included.

    Parameters
    ----------
    target
        Address of the service.
    prefix
        Path that it is shown below, ``/maps/pit``; anything else is 404.
    """

    def __init__(self, target: str, prefix: str) -> None:
        url = urlsplit(target)
        self._target = (str(url.hostname), url.port or 80)
        self._prefix = prefix
        self.strays: list[str] = []
        """Request lines that asked beside the prefix."""
        proxy = self

        class Handler(socketserver.BaseRequestHandler):
            def handle(self) -> None:
                proxy._serve(self.request)

        self._server = socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)

    @property
    def url(self) -> str:
        """Address of the service behind it, with a slash at the end."""
        return f"http://127.0.0.1:{self._server.server_address[1]}{self._prefix}/"

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
        self._thread.join()

    def _serve(self, client: socket.socket) -> None:
        client.settimeout(_TIMEOUT_S)
        head = b""
        while b"\r\n\r\n" not in head:
            chunk = client.recv(1 << 16)
            if not chunk:
                return
            head += chunk
        line, _, rest = head.partition(b"\r\n")
        method, path, version = line.decode("latin-1").split(" ")
        if not path.startswith(f"{self._prefix}/"):
            self.strays.append(f"{method} {path}")
            client.sendall(b"HTTP/1.1 404 Not Found\r\ncontent-length: 0\r\n\r\n")
            return
        rest = rest.replace(b"Connection: keep-alive", b"Connection: close")
        with socket.create_connection(self._target, _TIMEOUT_S) as service:
            inner = path.removeprefix(self._prefix)
            service.sendall(f"{method} {inner} {version}\r\n".encode("latin-1") + rest)
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
