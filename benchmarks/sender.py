"""What the sending path costs: bytes, system calls, first bytes, sessions.

::

    python benchmarks/sender.py                        # about five minutes
    python benchmarks/sender.py --only throughput
    python benchmarks/sender.py --smoke                # seconds, to see that it works

CPU is what the kernel has booked for the service's process; it says more than time on a machine
that others use, too.

* **throughput**: 64 clients, and one, beside plain asyncio streams of the same frames; interleaved
  rounds of one run (``landing.py``). Frames are 128 KiB, segments two of them.
* **calls**: system calls of the service per frame while 64 clients stream, counted by ``strace``;
  none where there is no strace.
* **landing**: land -> first byte of an idle service, and the CPU of a landing on nothing: message
  in, plan and ready out.
* **sessions**: RSS of sessions that have landed once, CPU while a part of them lands once a minute,
  and how long those landings take.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import platform
import re
import resource
import shutil
import signal
import subprocess
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from landing import (
    CHUNK,
    FULL,
    SMOKE,
    Size,
    frame_bytes,
    measure_latency,
    measure_throughput,
    percentiles,
    serve_raw,
    settings,
    wire_bytes,
)
from parts.drain_client import DrainClient
from parts.random_scene import TILE_M, write_random_scene
from parts.service_process import ServiceProcess, free_port
from parts.swarm import drain_all

NOWHERE: Final = (-500.0, 0.0, -500.0)
_LINK_BYTES_PER_S: Final = 100e6 / 8
_CALLS: Final = re.compile(r"^\s*[\d.]+\s+[\d.]+\s+\d+\s+(\d+)\s+(?:\d+\s+)?(\w+)$", re.MULTILINE)


def measure_against_streams(service: ServiceProcess, size: Size) -> list[dict[str, float]]:
    """Throughput and CPU beside plain asyncio streams: many clients, and one."""
    port = free_port()
    lengths = [frame_bytes(CHUNK)] * (2 * size.side**2)
    context = multiprocessing.get_context("spawn")
    streams = context.Process(target=serve_raw, args=(lengths, port), daemon=True)
    streams.start()
    assert streams.pid is not None
    raw = (port, streams.pid)
    rows = [
        measure_throughput(service, raw, size, size.clients, size.segments_of_many),
        measure_throughput(service, raw, size, 1, size.side**2),
    ]
    streams.terminate()
    streams.join(5)
    return rows


def measure_calls(service: ServiceProcess, size: Size) -> dict[str, Any]:
    """Count system calls of a landing of many clients, per frame."""
    if shutil.which("strace") is None:
        return {"skipped": "no strace"}
    clients = [DrainClient("127.0.0.1", service.port, "pit") for _ in range(size.clients)]
    for client in clients:
        client.hello()
        client.land((size.side * TILE_M / 2, 0.5, size.side * TILE_M / 2), 20.0)
    command = ["strace", "-c", "-f", "-p", str(service.pid)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as tracer:
        time.sleep(1.5)
        left = [0] * len(clients)
        radius_m = TILE_M * (size.segments_of_many**0.5 - 1) / 2 - 1
        centre = (size.side * TILE_M / 2 + TILE_M / 2, 0.5, size.side * TILE_M / 2 + TILE_M / 2)
        for number, client in enumerate(clients):
            left[number] = wire_bytes(client.begin(centre, radius_m))
        frames = sum(left) // frame_bytes(CHUNK)
        drain_all([client.socket for client in clients], left)
        tracer.send_signal(signal.SIGINT)
        assert tracer.stderr is not None
        table = tracer.stderr.read()
    for client in clients:
        client.close()
    calls = {name: int(count) for count, name in _CALLS.findall(table) if name != "total"}
    top = sorted(calls.items(), key=lambda entry: -entry[1])[:8]
    return {
        "frames": frames,
        "calls_per_frame": round(sum(calls.values()) / frames, 2),
        "most": {name: round(count / frames, 3) for name, count in top},
    }


def measure_landing(service: ServiceProcess, size: Size) -> dict[str, Any]:
    """Time the first byte, and the CPU of landings on nothing."""
    latency = measure_latency(service, size, 0.002)
    client = DrainClient("127.0.0.1", service.port, "pit")
    client.hello()
    count = 10 * size.landings
    before_s = service.cpu_s()
    for _ in range(count):
        client.begin(NOWHERE, 1.0)
        client.drain()
    cpu_s = service.cpu_s() - before_s
    client.close()
    return {
        "plan_ms": latency["plan"],
        "first_byte_ms": latency["first_byte"],
        "empty_landing_cpu_ms": round(1e3 * cpu_s / count, 3),
    }


def measure_sessions(folder: Path, count: int, landing: int, seconds: float) -> dict[str, Any]:
    """Open sessions that land once, and let some of them land again and again."""
    write_random_scene(folder / "pit", side=60, segment_bytes=20_000)
    edge_m = 60 * TILE_M
    with ServiceProcess(folder, max_sessions=count + 16, max_sessions_per_ip=count + 16) as service:
        warm = DrainClient("127.0.0.1", service.port, "pit")
        warm.hello()
        warm.land((300.0, 0.5, 300.0), 30.0)
        time.sleep(1.0)
        before = service.memory()
        clients = []
        for number in range(count):
            # So many from each of some addresses: a port of one address is had once.
            address = f"127.0.{number // 250 % 250}.{2 + number % 250}"
            client = DrainClient("127.0.0.1", service.port, "pit", address=address)
            client.hello()
            client.land((number % 60 * TILE_M, 0.5, number // 60 % 60 * TILE_M), 12.0)
            clients.append(client)
        time.sleep(2.0)
        after = service.memory()
        # Landings of some, spread over the time; a service that keeps up needs few milliseconds.
        ready_ms, cpu_s, began_s = [], service.cpu_s(), time.monotonic()
        times_bytes: list[float] = []
        landings = max(1, int(landing * seconds / 60.0))
        for number in range(landings):
            wait_s = began_s + number * seconds / landings - time.monotonic()
            time.sleep(max(0.0, wait_s))
            client = clients[number % landing]
            x_m = (100.0 + 7.0 * number) % edge_m
            got, took_s = client.land((x_m, 0.5, 300.0 + number % 200), 25.0)
            ready_ms.append(1e3 * took_s)
            # No link here: what a landing took is added to what its bytes take on one.
            if got:
                times_bytes.append(1.0 + took_s / (got / _LINK_BYTES_PER_S))
        share = (service.cpu_s() - cpu_s) / (time.monotonic() - began_s)
        for client in [warm, *clients]:
            client.close()
    return {
        "sessions": count,
        "rss_kib_per_session": round((after.rss - before.rss) / count / 1024, 1),
        "landing_once_a_minute": landing,
        "landings": landings,
        "ready_ms": percentiles(ready_ms),
        "ready_times_bytes_at_100_mbit": percentiles(times_bytes),
        "cpu_share": round(share, 3),
    }


def main() -> None:
    """Run the measurements that are asked for and print one JSON document."""
    form = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--smoke", action="store_true", help="seconds, to see that it works")
    parser.add_argument("--only", choices=["throughput", "calls", "landing", "sessions"])
    parser.add_argument("--rounds", type=int, default=3, help="of throughput")
    parser.add_argument("--sessions", type=int, default=10_000)
    parser.add_argument("--seconds", type=float, default=60.0, help="of sessions that land")
    arguments = parser.parse_args()
    size = SMOKE if arguments.smoke else FULL
    if arguments.smoke:
        arguments.sessions, arguments.seconds = 50, 2.0
    size = replace(size, rounds=1 if arguments.smoke else arguments.rounds)
    result: dict[str, Any] = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, Linux {platform.release()}",
        "python": platform.python_version(),
        "load": os.getloadavg()[0],
    }
    measures = {
        "throughput": measure_against_streams,
        "calls": measure_calls,
        "landing": measure_landing,
    }
    if arguments.only != "sessions":
        with tempfile.TemporaryDirectory(prefix="sender-") as folder:
            pit = Path(folder) / "pit"
            write_random_scene(pit, side=size.side, segment_bytes=2 * CHUNK, spread=1.0)
            with ServiceProcess(Path(folder), **settings()) as service:
                for name, measure in measures.items():
                    if arguments.only in {None, name}:
                        result[name] = measure(service, size)
    if arguments.only in {None, "sessions"}:
        _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
        count = min(arguments.sessions, hard - 200)
        with tempfile.TemporaryDirectory(prefix="sender-") as folder:
            result["sessions"] = measure_sessions(
                Path(folder), count, max(1, count // 10), arguments.seconds
            )
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
