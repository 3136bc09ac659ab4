"""Payload over HTTP: what it costs the service, and what many viewers behind a cache cost it.

::

    python benchmarks/pull.py                       # about 3 minutes
    python benchmarks/pull.py --nginx /usr/sbin/nginx --viewers 200
    python benchmarks/pull.py --smoke

* **files**: segments of 128 KiB, 512 KiB and 2 MiB one by one, and ranges as long of the pack, over
  one connection, whose client only reads; the same ranges of nginx. CPU seconds of the process for
  each GB, from the kernel's accounting.
* **cache**: viewers (a plan over HTTP and the ranges that it names, 20 at a time) land at one place
  through nginx as a caching proxy in front of the service. What nginx asked the service for,
  against what the viewers got.
* **folder**: the same viewers with nginx serving the scenes' folder as ``pull_base_url``. Payload
  bytes through the service, and its CPU for each landing, connecting and all.

* **s3**: the same viewers with the packs in a public bucket of a real S3 server (SeaweedFS), which
  the service does not see: `pull_base_url` names the bucket.

nginx is Debian's; without one the cache and the folder are left out.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import shutil
import socket
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import httpx
from parts.random_scene import TILE_M, write_random_scene
from parts.service_process import ServiceProcess, free_port, listening

from terraport_store import Scene
from terraport_store.origin import ObjectOptions
from terraport_store.upload import upload_scene
from terraport_wire import Direction, Plan, decode

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from s3_servers import s3_environment, weed_server

AT_ONCE: Final = 20
GAP: Final = 64 << 10
LONGEST: Final = 2 << 20
"""Ranges of a pack, as specified: bytes between two payloads, and of one request."""

_NGINX: Final = """
daemon off; worker_processes 1; pid {folder}/pid; error_log {folder}/error.log warn;
events {{ worker_connections 1024; }}
http {{
  access_log off; sendfile on; keepalive_requests 1000000;
  types {{ }} default_type application/octet-stream;
  client_body_temp_path {folder}/b; fastcgi_temp_path {folder}/f; uwsgi_temp_path {folder}/u;
  scgi_temp_path {folder}/s; proxy_temp_path {folder}/p;
  log_subrequest on;
  log_format origin "$upstream_status $upstream_bytes_received";
  proxy_cache_path {folder}/cache keys_zone=packs:10m max_size=4g;
  server {{
    listen 127.0.0.1:{port};
    location /scenes/ {{
      slice 1m;
      proxy_cache packs; proxy_cache_key $uri$slice_range; proxy_cache_lock on;
      proxy_cache_valid 200 206 1y; proxy_set_header Range $slice_range;
      proxy_http_version 1.1; proxy_set_header Connection "";
      proxy_pass http://127.0.0.1:{origin};
      access_log {folder}/origin.log origin;
    }}
    location /files/ {{ alias {scenes}/; }}
  }}
}}
"""


def main() -> None:
    """Run what is asked for and print a Markdown table of each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nginx", default=shutil.which("nginx"))
    parser.add_argument("--viewers", type=int, default=200)
    parser.add_argument("--only", choices=("files", "viewers", "s3"))
    parser.add_argument("--smoke", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        side, volume = (2, 1 << 20) if options.smoke else (8, 1 << 30)
        if options.only in {None, "files"}:
            print("| what is asked for | MB | CPU-s per GB | us a request |\n|---|---|---|---|")
            for kib in (128, 512, 2048):
                scenes = write_scene(folder, side, kib)
                measure_files(scenes, volume, kib, options.nginx)
        if options.nginx is not None and options.only in {None, "viewers"}:
            viewers = 2 if options.smoke else options.viewers
            measure_viewers(write_scene(folder, side, 32), options.nginx, viewers, side)
        if options.only in {None, "s3"}:
            viewers = 2 if options.smoke else options.viewers
            measure_s3(write_scene(folder, side, 31), viewers, side)


def write_scene(folder: Path, side: int, kib: int) -> Path:
    """Write a folder of one scene with segments of that size; bytes as of noise."""
    scenes = folder / f"of-{kib}"
    scenes.mkdir()
    write_random_scene(scenes / "pit", side=side, segment_bytes=kib << 10, spread=1.0)
    return scenes


def measure_files(scenes: Path, volume: int, kib: int, nginx: str | None) -> None:
    """Ask for segments, then for ranges of the pack, and for these of nginx beside it."""
    with Scene.open(scenes / "pit") as scene:
        pack = scene.manifest.files["segments.pack"]
        count = len(scene.index)
    step = kib << 10
    spans = [(start, min(start + step, pack.bytes) - 1) for start in range(0, pack.bytes, step)]
    ranges = [f"/scenes/pit/{pack.path}\r\nRange: bytes={a}-{b}" for a, b in spans]
    asked = {
        f"segments of {kib} KiB": [f"/scenes/pit/segments/{n}.glb" for n in range(count)],
        f"ranges of {kib} KiB": ranges,
    }
    with ServiceProcess(scenes) as service:
        for what, requests in asked.items():
            measure(what, service.port, requests, volume, service.cpu_s)
    if nginx is None:
        return
    port = free_port()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        config = _NGINX.format(folder=folder, port=port, origin=1, scenes=scenes)
        with serving(nginx, folder, config, port) as pid:
            there = [path.replace("/scenes/", "/files/") for path in ranges]
            measure("the same ranges of nginx", port, there, volume, lambda: cpu_of(pid))


def measure(
    what: str, port: int, requests: list[str], volume: int, cpu_s: Callable[[], float]
) -> None:
    """Ask until so many bytes have come; print a row."""
    drain(port, requests, 1)
    rounds = max(1, volume // drain(port, requests, 1))
    before_s = cpu_s()
    total = drain(port, requests, rounds)
    used_s = cpu_s() - before_s
    each_us = used_s / (rounds * len(requests)) * 1e6
    print(f"| {what} | {total / 1e6:.0f} | {used_s / (total / 1e9):.3f} | {each_us:.0f} |")


def cpu_of(pid: int) -> float:
    """CPU seconds of a process and its children so far."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    ticks = 0
    for process in (pid, *children):
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def drain(port: int, requests: list[str], rounds: int) -> int:
    """Ask one after the other over one connection; return the bytes of the bodies."""
    total, buffer = 0, bytearray(1 << 20)
    view = memoryview(buffer)
    with socket.create_connection(("127.0.0.1", port)) as raw:
        for request in requests * rounds:
            path, _, header = request.partition("\r\n")
            header = f"{header}\r\n" if header else ""
            raw.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n{header}\r\n".encode())
            got = raw.recv_into(buffer)
            head = bytes(view[: min(got, 4096)]).partition(b"\r\n\r\n")[0]
            assert head[9:12] in {b"200", b"206"}, head
            length = int(head.lower().partition(b"content-length: ")[2].partition(b"\r")[0])
            left = length - (got - len(head) - 4)
            while left:
                left -= raw.recv_into(view[: min(left, len(view))])
            total += length
    return total


def measure_viewers(scenes: Path, nginx: str, viewers: int, side: int) -> None:
    """Let many land at one place, through a cache and beside a folder of files."""
    print(
        "\n| packs from | viewers | they got, MB | asked of the service, MB (requests) | ", end=""
    )
    print("service CPU, ms a viewer |\n|---|---|---|---|---|")
    for what, path in (("a caching proxy", "scenes"), ("the folder", "files")):
        origin, port = free_port(), free_port()
        base = f"http://127.0.0.1:{port}/{path}"
        service = ServiceProcess(
            scenes,
            port=origin,
            pull_base_url=base,
            max_sessions_per_ip=256,
        )
        with tempfile.TemporaryDirectory() as name, service:
            folder = Path(name)
            folder.chmod(0o755)
            config = _NGINX.format(folder=folder, port=port, origin=origin, scenes=scenes)
            with serving(nginx, folder, config, port):
                before_s = service.cpu_s()
                got = asyncio.run(land_all(service.url, viewers, side, base))
                cpu_s = service.cpu_s() - before_s
            asked = origin_requests(folder / "origin.log")
        print(
            f"| {what} | {viewers} | {got / 1e6:.1f} | {sum(asked) / 1e6:.2f} ({len(asked)}) | "
            f"{cpu_s / viewers * 1e3:.1f} |"
        )


def measure_s3(scenes: Path, viewers: int, side: int) -> None:
    """Let many land at one place, with packs from a bucket."""
    print("\n| packs from | viewers | they got, MB | payload by the service, MB | ", end="")
    print("service CPU, ms a viewer |\n|---|---|---|---|---|")
    with weed_server(public=True) as s3_url, s3_environment(s3_url):
        upload_scene(scenes / "pit", "s3://packs/scenes/pit", ObjectOptions())
        with ServiceProcess(
            scenes,
            pull_base_url=f"{s3_url}/packs/scenes",
            max_sessions_per_ip=256,
        ) as service:
            before_s = service.cpu_s()
            base = f"{s3_url}/packs/scenes"
            got = asyncio.run(land_all(service.url, viewers, side, base))
            cpu_s = service.cpu_s() - before_s
            sent = payload_sent(service.url)
    print(
        f"| SeaweedFS | {viewers} | {got / 1e6:.1f} | {sent / 1e6:.2f} | "
        f"{cpu_s / viewers * 1e3:.1f} |"
    )


def payload_sent(url: str) -> float:
    """Payload bytes in frames, as the service itself counts them."""
    sent = 0.0
    for line in httpx.get(f"{url}/metrics").text.splitlines():
        if line.startswith("terraport_payload_bytes_total{"):
            sent += float(line.rpartition(" ")[2])
    return sent


@contextmanager
def serving(nginx: str, folder: Path, config: str, port: int) -> Iterator[int]:
    """Run nginx as the user that this runs as, root or not: it reads a folder of root's."""
    (folder / "nginx.conf").write_text(("user root;\n" if os.geteuid() == 0 else "") + config)
    command = [nginx, "-c", str(folder / "nginx.conf"), "-e", str(folder / "error.log")]
    with listening(command, port) as process:
        yield process


def origin_requests(log: Path) -> list[int]:
    """Bytes of every answer that the proxy had from the service."""
    asked: list[int] = []
    for line in log.read_text().splitlines() if log.exists() else []:
        fields = line.replace(",", " ").replace(":", " ").split()
        numbers = [int(field) for field in fields[len(fields) // 2 :] if field.isdecimal()]
        asked += [number for number in numbers if number]
    return asked


async def land_all(url: str, viewers: int, side: int, base: str) -> int:
    """Return the payload bytes that all viewers got, in ranges of packs under a base address."""
    room = asyncio.Semaphore(AT_ONCE)
    scene, middle_m = f"{url}/scenes/pit", side * TILE_M / 2

    async def land_one() -> int:
        async with room, httpx.AsyncClient(timeout=120) as http:
            pack = (await http.get(scene)).json()["files"]["segments.pack"]["path"]
            query = {"x": middle_m, "y": 0, "z": middle_m, "radius_m": side * TILE_M}
            answer = await http.get(f"{scene}/{pack.partition('/')[0]}/plan", params=query)
            plan = decode(answer.raise_for_status().content, Direction.SERVER_TO_CLIENT)
            assert isinstance(plan, Plan)
            assert plan.offsets is not None
            spans = sorted(zip(plan.offsets.tolist(), plan.show["bytes"].tolist(), strict=True))
            ranges: list[list[int]] = []
            for begin, length in spans:
                if ranges and begin - ranges[-1][1] <= GAP and begin - ranges[-1][0] < LONGEST:
                    ranges[-1][1] = begin + length
                else:
                    ranges.append([begin, begin + length])
            for begin, end in ranges:
                span = {"Range": f"bytes={begin}-{end - 1}"}
                got = await http.get(f"{base}/pit/{pack}", headers=span)
                assert len(got.raise_for_status().content) == end - begin
            return sum(length for _, length in spans)

    return sum(await asyncio.gather(*(land_one() for _ in range(viewers))))


if __name__ == "__main__":
    main()
