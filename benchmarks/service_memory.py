"""What a session, a large scene and a client that stops reading cost the service.

::

    python benchmarks/service_memory.py                 # about two minutes
    python benchmarks/service_memory.py --only stalled
    python benchmarks/service_memory.py --smoke

* **idle**: 2,000 sessions that do nothing; RSS per session. Bar 48 KiB.
* **sparse**: a scene of 20 GB (its pack is a hole in a file: no disk is used, everything else is
  real) while eight clients land in it; peak RSS. Bar 250 MB + 128 bytes per segment.
* **stalled**: clients that stop reading in the middle of a landing. What the process and the
  system's socket buffers hold for each (bar 1 MB), and what it does to the throughput of four
  others: rounds with and without, interleaved, median of the ratios (bar: 3 % less).

RSS is what the process has in memory, whatever it is; RssAnon is its own part of that. The page
cache that ``sendfile`` fills belongs to no process and is not counted.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import random
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

from parts.drain_client import DrainClient
from parts.light_client import Findings, LightClient
from parts.random_scene import TILE_M, write_random_scene
from parts.service_process import ServiceProcess
from parts.sparse_scene import write_sparse_scene

from terraport_store import Scene

MB: Final = 1e6
HERE: Final = (0.0, 0.0, 0.0)
EVERYWHERE_M: Final = 9000.0


def settings(clients: int) -> dict[str, Any]:
    """Bounds that let so many clients in from one address."""
    return {
        "max_connections": 2 * clients + 64,
        "max_sessions": clients + 16,
        "max_sessions_per_ip": clients + 16,
        "max_radius_m": 10_000.0,
        "max_credit_bytes": 1 << 40,
        "max_messages_per_s": 1e6,
        "log_level": "warning",
        "idle_timeout_s": 600.0,
    }


def measure_idle(folder: Path, count: int) -> dict[str, Any]:
    """Open sessions, wait, and see what the process takes."""
    write_random_scene(folder / "pit", side=30, segment_bytes=1000)
    with ServiceProcess(folder, **settings(count)) as service:
        # One client first: what the first session loads is no part of a session.
        warm = DrainClient("127.0.0.1", service.port, "pit")
        warm.hello()
        warm.land(HERE, 100.0)
        time.sleep(1.0)
        before = service.memory()
        clients = []
        for _ in range(count):
            client = DrainClient("127.0.0.1", service.port, "pit")
            client.hello()
            clients.append(client)
        time.sleep(2.0)
        after = service.memory()
        cpu_s, began_s = service.cpu_s(), time.monotonic()
        time.sleep(10.0)
        share = (service.cpu_s() - cpu_s) / (time.monotonic() - began_s)
        for client in [warm, *clients]:
            client.close()
        time.sleep(2.0)
        left = service.memory()
    return {
        "sessions": count,
        "rss_kib_per_session": round((after.rss - before.rss) / count / 1024, 1),
        "bar_kib": 48,
        "rss_mb": [round(sample.rss / MB, 1) for sample in (before, after, left)],
        "cpu_share_while_idle": round(share, 3),
    }


async def land_around(service: ServiceProcess, scene: Scene, seconds: float) -> dict[str, Any]:
    """Eight clients land here and there in a large scene."""
    findings, peak = Findings(), service.memory()
    edge_m = TILE_M * len(scene.index) ** 0.5
    until_s = time.monotonic() + seconds

    async def live(number: int) -> None:
        draw = random.Random(number)
        client = LightClient(
            f"{service.url}/scenes/sparse",
            scene.index,
            findings,
            name=f"client {number}",
            check_plan=lambda: False,
        )
        await client.connect()
        while time.monotonic() < until_s:
            await client.land((draw.uniform(0, edge_m), 0.5, draw.uniform(0, edge_m)), 40.0)
            await client.evict(client.held.nonzero()[0])
        await client.leave()

    async def watch() -> None:
        nonlocal peak
        while True:
            now = await asyncio.to_thread(service.memory)
            peak = max(peak, now, key=lambda sample: sample.rss)
            await asyncio.sleep(0.2)

    watching = asyncio.create_task(watch())
    await asyncio.gather(*(live(number) for number in range(8)))
    watching.cancel()
    return {
        "landings": findings.landings,
        "payload_mb": round(findings.payload_bytes / MB),
        "wrong": findings.wrong[:5],
        "peak": {name: round(value / MB, 1) for name, value in peak.as_dict().items()
                 if name not in {"descriptors", "threads"}},
    }  # fmt: skip


def measure_sparse(folder: Path, pack_bytes: int, seconds: float) -> dict[str, Any]:
    """Serve a scene that is larger than any memory."""
    manifest = write_sparse_scene(folder / "sparse", pack_bytes=pack_bytes, segment_bytes=1 << 17)
    count = manifest.counts.segments
    with ServiceProcess(folder, **settings(32)) as service, Scene.open(folder / "sparse") as scene:
        opened = service.memory()
        landed = asyncio.run(land_around(service, scene, seconds))
    bar = 250 * MB + 128 * count
    return {
        "pack_gb": round(manifest.files["segments.pack"].bytes / 1e9, 1),
        "segments": count,
        "rss_mb_opened": round(opened.rss / MB, 1),
        **landed,
        "bar_mb": round(bar / MB, 1),
    }


def stall(port: int) -> DrainClient:
    """Land on everything, read a little, and never again."""
    client = DrainClient("127.0.0.1", port, "pit")
    client.hello()
    client.begin(HERE, EVERYWHERE_M)
    client.socket.recv(1 << 16)
    return client


def socket_bytes(port: int) -> list[int]:
    """Bytes in the send queue of each of the service's client sockets, kernel overhead included."""
    listing = subprocess.run(
        ["ss", "-tmnH", "state", "established", f"sport = :{port}"],
        capture_output=True,
        text=True,
        check=False,
    ).stdout
    return sorted(int(queued_bytes) for queued_bytes in re.findall(r"skmem:\(.*?,w(\d+),", listing))


def measure_stalled(folder: Path, count: int, rounds: int, segment_bytes: int) -> dict[str, Any]:
    """Memory of stalled clients, and what one does to others."""
    write_random_scene(folder / "pit", side=12, segment_bytes=segment_bytes)
    with ServiceProcess(folder, **settings(count + 16)) as service:
        others = [DrainClient("127.0.0.1", service.port, "pit") for _ in range(4)]
        pool = ThreadPoolExecutor(len(others))

        def land_once(client: DrainClient) -> int:
            client.forget()
            return client.land(HERE, EVERYWHERE_M)[0]

        def throughput() -> tuple[float, float]:
            """Bytes per second, and CPU seconds of the service per byte."""
            began_s, cpu_s = time.perf_counter(), service.cpu_s()
            total = sum(pool.map(land_once, others))
            return total / (time.perf_counter() - began_s), (service.cpu_s() - cpu_s) / total

        # Memory: the same service before and with all the clients that do not read.
        for other in others:
            other.hello()
        throughput()
        time.sleep(0.5)
        before = service.memory()
        stalled = [stall(service.port) for _ in range(count)]
        time.sleep(1.0)
        after, queues = service.memory(), socket_bytes(service.port)[-count:]
        for client in stalled:
            client.close()
        # Throughput with and without a stalled client, in alternating order: drift cancels.
        ratios, alone, cpu = [], [], {True: 0.0, False: 0.0}
        for number in range(rounds):
            pair = {}
            for with_stalled in (number % 2 == 0, number % 2 == 1):
                guest = stall(service.port) if with_stalled else None
                time.sleep(0.2)
                pair[with_stalled], cpu_s = throughput()
                cpu[with_stalled] += cpu_s
                if guest is not None:
                    guest.close()
                    time.sleep(0.1)
            alone.append(pair[False])
            ratios.append(pair[True] / pair[False])
        for other in others:
            other.close()
    # What a stalled client costs is in two places: the process, and the kernel's send queue.
    own = (after.rss - before.rss) / count
    return {
        "stalled_clients": count,
        "process_kib_each": round(own / 1024, 1),
        "socket_kib_each": round(statistics.median(queues) / 1024, 1) if queues else None,
        "together_mb_each": round((own + (statistics.median(queues) if queues else 0)) / MB, 3),
        "bar_mb": 1.0,
        "others_gb_per_s": round(statistics.median(alone) / 1e9, 3),
        "others_ratio": round(statistics.median(ratios), 4),
        "others_ratio_quartiles": [
            round(ratio, 3) for ratio in statistics.quantiles(ratios, n=4)[::2]
        ],
        "bar_ratio": 0.97,
        "cpu_per_byte_ratio": round(cpu[True] / cpu[False], 4),
    }  # fmt: skip


def main() -> int:
    form = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--only", choices=["idle", "sparse", "stalled"])
    parser.add_argument("--sessions", type=int, default=2000)
    parser.add_argument("--pack-gb", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=41)
    parser.add_argument("--smoke", action="store_true", help="seconds, to see that it works")
    arguments = parser.parse_args()
    if arguments.smoke:
        arguments.sessions, arguments.pack_gb, arguments.rounds = 50, 1.0, 2
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    if hard < 2 * arguments.sessions:
        print(f"only {hard} open files are allowed: fewer sessions", file=sys.stderr)
        arguments.sessions = hard // 2 - 100
    stalled = (5, 2, 20_000) if arguments.smoke else (50, arguments.rounds, 256 << 10)
    seconds = 2.0 if arguments.smoke else 15.0
    measures = {
        "idle": lambda folder: measure_idle(folder, arguments.sessions),
        "sparse": lambda folder: measure_sparse(folder, int(arguments.pack_gb * 1e9), seconds),
        "stalled": lambda folder: measure_stalled(folder, *stalled),
    }
    result = {}
    for name, measure in measures.items():
        if arguments.only in {None, name}:
            with tempfile.TemporaryDirectory(prefix="service-memory-") as folder:
                result[name] = measure(Path(folder))
    print(json.dumps(result, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
