"""What a byte costs through TLS, by who ends it: the service, a proxy before it, or one that pulls.

::

    python benchmarks/tls.py --nginx /usr/sbin/nginx --caddy /usr/bin/caddy     # about 2 minutes
    python benchmarks/tls.py --smoke

Segments of 512 KiB are asked for over one connection (``pull.py`` has other sizes, without TLS),
and sent for landings over a WebSocket. CPU seconds of service and proxy for each GB, from the
kernel's accounting; the client's are its own. Every way in one run: a busy machine makes all of
them dearer alike. What is not there (nginx, its stream module, Caddy) is left out.
"""

from __future__ import annotations

import argparse
import os
import shutil
import socket
import ssl
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Final

from parts.drain_client import PLENTY, DrainClient
from parts.service_process import ServiceProcess, free_port, listening
from pull import cpu_of, write_scene

_HTTP: Final = """
user root; daemon off; worker_processes 1; pid {folder}/pid; events {{ }}
http {{
  access_log off; sendfile on; keepalive_requests 1000000;
  client_body_temp_path {folder}/b; fastcgi_temp_path {folder}/f; uwsgi_temp_path {folder}/u;
  scgi_temp_path {folder}/s; proxy_temp_path {folder}/p;
  upstream service {{ server 127.0.0.1:{to}; keepalive 8; keepalive_requests 1000000; }}
  server {{
    listen 127.0.0.1:{port} ssl; ssl_certificate {cert}; ssl_certificate_key {key};
    location / {{
      proxy_pass http://service; proxy_http_version 1.1; proxy_set_header Connection "";
      proxy_set_header Host $host;
      proxy_buffers 16 128k; proxy_buffer_size 64k; proxy_busy_buffers_size 256k;
      proxy_max_temp_file_size 0;
    }}
    location ~ /stream$ {{
      proxy_pass http://service; proxy_http_version 1.1;
      proxy_buffers 16 128k; proxy_buffer_size 64k;
      proxy_set_header Upgrade $http_upgrade; proxy_set_header Connection "upgrade";
      proxy_set_header Host $host;
    }}
    location /files/ {{ alias {scenes}/; }}
  }}
}}
"""

_STREAM: Final = """
user root; load_module {stream}; daemon off; worker_processes 1; pid {folder}/pid; events {{ }}
stream {{
  server {{
    listen 127.0.0.1:{port}; proxy_pass 127.0.0.1:{to}; proxy_buffer_size 256k;
  }}
}}
"""

_CADDY: Final = """
{{
  admin off
  auto_https off
  skip_install_trust
}}
https://localhost:{port} {{
  tls {cert} {key}
  encode gzip
  handle_path /files/* {{
    root * {scenes}
    file_server
  }}
  reverse_proxy 127.0.0.1:{to} {{
    flush_interval -1
  }}
}}
"""


def main() -> None:
    """Measure each way and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nginx", default=shutil.which("nginx"))
    parser.add_argument("--stream-module", type=Path, help="ngx_stream_module.so")
    parser.add_argument("--caddy", default=shutil.which("caddy"))
    parser.add_argument("--smoke", action="store_true")
    options = parser.parse_args()
    if options.smoke:
        side, total = 2, 4 << 20
    else:
        side, total = 8, 256 << 20
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        scenes = write_scene(folder, side, 512)
        cert, key = make_certificate(folder)
        segments = [f"/scenes/pit/segments/{n}.glb" for n in range(side * side)]
        pack = next((scenes / "pit").glob("v-*/segments.pack"))
        at = f"/files/{pack.relative_to(scenes)}\r\nRange: bytes="
        starts = range(0, pack.stat().st_size - (1 << 19), 1 << 19)
        ranges = [f"{at}{start}-{start + (1 << 19) - 1}" for start in starts]
        words = {"folder": folder, "scenes": scenes, "cert": cert, "key": key}
        print("| how | what | service | proxy | together |\n|---|---|---|---|---|")

        def row(
            what: str, service: ServiceProcess, port: int, asked: list[str], proxy: int | None
        ) -> None:
            is_pulled = asked is ranges
            for kind, get in (("GET", partial(drain, asked=asked)), ("landings", land)):
                if kind == "landings" and is_pulled:
                    continue
                get(port, total=1 << 20, secret=what != "no TLS")
                before_s, proxy_before_s = service.cpu_s(), cpu_of(proxy) if proxy else 0.0
                got = get(port, total=total, secret=what != "no TLS")
                own_s = service.cpu_s() - before_s
                proxy_s = cpu_of(proxy) - proxy_before_s if proxy else 0.0
                own, its = own_s / (got / 1e9), proxy_s / (got / 1e9)
                print(f"| {what} | {kind} | {own:.2f} | {its:.2f} | {own + its:.2f} |", flush=True)

        bounds = {"max_credit_bytes": PLENTY, "max_radius_m": 10_000.0, "max_messages_per_s": 1e6}
        secrets = {"tls_certificate": cert, "tls_key": key}
        with ServiceProcess(scenes, **secrets, **bounds) as service:
            row("own TLS (uvloop)", service, service.port, segments, None)
            if options.nginx and options.stream_module:
                more = words | {"stream": options.stream_module, "to": service.port}
                with proxy_of(options.nginx, _STREAM, more) as (pid, port):
                    row("nginx passes own TLS through", service, port, segments, pid)
        with (
            without_uvloop(folder),
            ServiceProcess(scenes, **secrets, **bounds) as service,
        ):
            row("own TLS (asyncio)", service, service.port, segments, None)
        with ServiceProcess(scenes, **bounds) as service:
            row("no TLS", service, service.port, segments, None)
            words["to"] = service.port
            for name, program, config in (
                ("Caddy", options.caddy, _CADDY),
                ("nginx", options.nginx, _HTTP),
            ):
                if program is None:
                    continue
                with proxy_of(program, config, words) as (pid, port):
                    row(f"{name} before the service", service, port, segments, pid)
                    row(f"{name} has the pack (pull)", service, port, ranges, pid)


def make_certificate(folder: Path) -> tuple[Path, Path]:
    """Make a certificate of localhost."""
    cert, key = folder / "cert.pem", folder / "key.pem"
    command = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt"]
    command += ["ec_paramgen_curve:prime256v1", "-nodes", "-days", "2", "-subj", "/CN=localhost"]
    command += ["-addext", "subjectAltName=DNS:localhost"]
    subprocess.run([*command, "-keyout", key, "-out", cert], check=True, capture_output=True)
    return cert, key


@contextmanager
def without_uvloop(folder: Path) -> Iterator[None]:
    """Let services that are started meanwhile find no uvloop."""
    (folder / "none").mkdir()
    (folder / "none" / "uvloop.py").write_text("raise ImportError\n")
    before = os.environ.get("PYTHONPATH", "")
    os.environ["PYTHONPATH"] = f"{folder / 'none'}{os.pathsep}{before}"
    try:
        yield
    finally:
        os.environ["PYTHONPATH"] = before


@contextmanager
def proxy_of(program: str, config: str, words: dict[str, object]) -> Iterator[tuple[int, int]]:
    """Run nginx or Caddy; its process and port."""
    port, folder = free_port(), Path(str(words["folder"]))
    path = folder / "proxy.conf"
    path.write_text(config.format(port=port, **words))
    command = [program, "-c", str(path), "-e", str(folder / "error.log")]
    if config is _CADDY:
        command = [program, "run", "--config", str(path), "--adapter", "caddyfile"]
    environment = os.environ | {"HOME": str(folder), "XDG_DATA_HOME": str(folder)}
    with listening(command, port, environment) as process:
        yield process, port


def client_context() -> ssl.SSLContext:
    """Return a context that trusts whoever answers: the certificate is made here."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    return context


def land(port: int, total: int, *, secret: bool) -> int:
    """Land on everything until so many bytes have come; return how many did."""
    secure = client_context() if secret else None
    client = DrainClient("localhost", port, "pit", secure=secure)
    client.hello()
    got_bytes = 0
    while got_bytes < total:
        got_bytes += client.land((0.0, 0.0, 0.0), 9000.0)[0]
        client.forget()
    client.close()
    return got_bytes


def drain(port: int, asked: list[str], total: int, *, secret: bool) -> int:
    """Ask one after the other over one connection until so many bytes have come."""
    raw = socket.create_connection(("127.0.0.1", port))
    if secret:
        raw = client_context().wrap_socket(raw, server_hostname="localhost")
    buffer, got_bytes, number = bytearray(1 << 20), 0, 0
    view = memoryview(buffer)
    with raw:
        while got_bytes < total:
            path, _, header = asked[number % len(asked)].partition("\r\n")
            header = f"{header}\r\n" if header else ""
            raw.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n{header}\r\n".encode())
            number += 1
            got = raw.recv_into(buffer)
            while b"\r\n\r\n" not in buffer[:got]:
                got += raw.recv_into(view[got:])
            head = bytes(view[:got]).partition(b"\r\n\r\n")[0]
            assert head[9:12] in {b"200", b"206"}, head
            length = int(head.lower().partition(b"content-length: ")[2].partition(b"\r")[0])
            left = length - (got - len(head) - 4)
            while left:
                left -= raw.recv_into(view[: min(left, len(view))])
            got_bytes += length
    return got_bytes


if __name__ == "__main__":
    main()
