"""Landings over loopback: throughput against plain asyncio TCP streams, latency, plans.

::

    python benchmarks/landing.py                       # about four minutes
    python benchmarks/landing.py --only throughput
    python benchmarks/landing.py --smoke               # seconds, to see that it works

Server and clients are processes of their own. The payload is random bytes (what compression
leaves), laid out as one scene of segments of two whole chunks, 128 KiB each with their header.

* **throughput**: one client, and 64 clients, land on everything. Both servers send frames of the
  same lengths in interleaved rounds of one run to the same client, which only drains its sockets.
  Ratios are medians of the ratios within rounds; CPU is the server's, user and system, per byte.
* **latency**: land to first payload byte, idle; while 64 clients stream at 4 MB/s each; while they
  stream as fast as they can.
* **supersede**: payload bytes of a landing that still arrive after the client sent the next one,
  beyond the credit that the client had granted.
* **plan**: a landing on 1,000 of a million segments: index query, selection, plan, encoding; and
  the query alone against libspatialindex in the same run.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import os
import platform
import socket
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from parts.drain_client import DrainClient
from parts.random_scene import TILE_M, write_random_scene
from parts.service_process import ServiceProcess, free_port
from parts.swarm import drain_all, drain_paced

from terraport_payload import Cover
from terraport_payload.hidden import HiddenFaces
from terraport_server.session.interface import (
    MakePlan,
    SceneView,
    SegmentTable,
    SendMessage,
    SessionLimits,
)
from terraport_server.session.session import Session
from terraport_store import PackedRTree
from terraport_wire import (
    FRAME_HEADER_BYTES,
    KEY_DTYPE,
    MAX_CHUNK_BYTES,
    Budgets,
    Direction,
    Hello,
    Land,
    Plan,
    decode,
    encode,
)

PLENTY = 1 << 40
CHUNK = MAX_CHUNK_BYTES


@dataclass(frozen=True)
class Size:
    """How large scenes are and how often each measurement runs: in full, or as a smoke test."""

    side: int
    rounds: int
    clients: int
    segments_of_many: int
    """Segments per client and round where there are many clients."""
    landings: int
    plan_side: int
    """Square root of the segments of the planned scene."""
    pin: bool = False
    """Throughput with servers on the first core and clients on the others."""


FULL = Size(side=20, rounds=9, clients=64, segments_of_many=100, landings=400, plan_side=1000)
SMOKE = Size(side=6, rounds=2, clients=8, segments_of_many=9, landings=10, plan_side=100)


def settings() -> dict[str, Any]:
    """Bounds that do not come into play."""
    return {
        "max_sessions_per_ip": 256,
        "max_radius_m": 10_000.0,
        "max_credit_bytes": PLENTY,
        "max_messages_per_s": 1e6,
        "log_level": "error",
        "idle_timeout_s": 600.0,
    }


def frame_bytes(chunk: int) -> int:
    """Bytes of one payload frame on the wire, WebSocket header included."""
    length = chunk + FRAME_HEADER_BYTES
    return length + (2 if length < 126 else 4 if length < 1 << 16 else 10)


def wire_bytes(plan: Plan) -> int:
    """Bytes on the wire of the payload of a plan whose segments are whole chunks."""
    return int(plan.show["bytes"].sum()) // CHUNK * frame_bytes(CHUNK)


def serve_raw(lengths: list[int], port: int) -> None:
    """Child process: asyncio streams that send frames of these lengths for each request.

    A request is four bytes: how many frames.
    """
    rng = np.random.default_rng(1)
    frames = [rng.bytes(length) for length in lengths]

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while request := await reader.read(4):
            for frame in frames[: int.from_bytes(request, "big")]:
                writer.write(frame)
                await writer.drain()
        writer.close()

    async def forever() -> None:
        server = await asyncio.start_server(answer, "127.0.0.1", port)
        await server.serve_forever()

    asyncio.run(forever())


def connect(port: int) -> socket.socket:
    """Connect, waiting for a server that is still starting."""
    until_s = time.monotonic() + 30
    while True:
        try:
            sock = socket.create_connection(("127.0.0.1", port))
        except OSError:
            if time.monotonic() > until_s:
                raise
            time.sleep(0.05)
        else:
            sock.settimeout(60)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return sock


def cpu_s(pid: int) -> float:
    """CPU seconds that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure_throughput(
    service: ServiceProcess, raw: tuple[int, int], size: Size, count: int, segments: int
) -> dict[str, float]:
    """Interleaved rounds of service and raw streams; *raw* is the port and pid of the latter."""
    plain = [connect(raw[0]) for _ in range(count)]
    side_m = TILE_M * size.side
    # A square of segments about the centre, whole where all are wanted.
    radius_m = side_m if segments == size.side**2 else TILE_M * (segments**0.5 - 1) / 2 - 1
    centre = (side_m / 2 + TILE_M / 2, 0.5, side_m / 2 + TILE_M / 2)
    rows = []
    for number in range(size.rounds + 1):
        # New ones in each round: bytes are only counted, and a ping (every 20 s) would be taken for
        # payload.
        clients = [DrainClient("127.0.0.1", service.port, "pit") for _ in range(count)]
        for client in clients:
            client.hello()
        left = [0] * count

        before = service.cpu_s(), cpu_s(raw[1])
        began_s = time.perf_counter()
        for which in range(count):
            left[which] = wire_bytes(clients[which].begin(centre, radius_m))
        expected_bytes = left[0]
        ours = drain_all([client.socket for client in clients], left)
        seconds = time.perf_counter() - began_s
        for client in clients:
            client.drain()
            client.close()
        frames = expected_bytes // frame_bytes(CHUNK)
        middle = service.cpu_s(), cpu_s(raw[1])
        began_s = time.perf_counter()
        for sock in plain:
            sock.sendall(frames.to_bytes(4, "big"))
        theirs = drain_all(plain, [frames * frame_bytes(CHUNK)] * count)
        raw_seconds = time.perf_counter() - began_s
        after = service.cpu_s(), cpu_s(raw[1])
        gb = count * frames * CHUNK / 1e9
        if number:  # the first round warms the page cache
            rows.append(
                (
                    gb / seconds,
                    gb / raw_seconds,
                    (middle[0] - before[0]) / gb,
                    (after[1] - middle[1]) / gb,
                    ours,
                    theirs,
                )
            )
    for sock in plain:
        sock.close()
    table = np.array(rows)
    return {
        "clients": count,
        "gb_per_client": gb / count,
        "service_gb_per_s": statistics.median(table[:, 0]),
        "raw_gb_per_s": statistics.median(table[:, 1]),
        "ratio": statistics.median(table[:, 0] / table[:, 1]),
        "service_cpu_s_per_gb": float(table[:, 2].mean()),
        "raw_cpu_s_per_gb": float(table[:, 3].mean()),
        "cpu_ratio": float(table[:, 2].mean() / max(1e-9, table[:, 3].mean())),
        "fairness": statistics.median(table[:, 4]),
        "raw_fairness": statistics.median(table[:, 5]),
    }


def measure_latency(service: ServiceProcess, size: Size, pause_s: float) -> dict[str, Any]:
    """Land again and again at random places, holding nothing; ms."""
    rng = np.random.default_rng(2)
    client = DrainClient("127.0.0.1", service.port, "pit")
    client.hello()
    plan_ms, first_ms, ready_ms = [], [], []
    for _ in range(size.landings):
        x, z = rng.uniform(0, size.side * TILE_M, size=2)
        time.sleep(pause_s)
        began_s = time.perf_counter()
        client.begin((x, 0.5, z), 12.0)
        plan_ms.append(1e3 * (time.perf_counter() - began_s))
        client.next()
        first_ms.append(1e3 * (time.perf_counter() - began_s))
        client.drain()
        ready_ms.append(1e3 * (time.perf_counter() - began_s))
    client.close()
    return {
        "landings": size.landings,
        "plan": percentiles(plan_ms),
        "first_byte": percentiles(first_ms),
        "ready": percentiles(ready_ms),
    }


def keep_busy(
    port: int, size: Size, bytes_per_s: float | None, going: Any, enough: Any, amount: Any
) -> None:
    """Child process: many clients that stream until told to stop."""
    side_m = TILE_M * size.side
    centre = (side_m / 2, 0.5, side_m / 2)
    began_s = time.perf_counter()
    received = 0
    while not enough.is_set():
        clients = [DrainClient("127.0.0.1", port, "pit") for _ in range(size.clients)]
        for client in clients:
            client.hello()
        planned_bytes = [wire_bytes(client.begin(centre, side_m)) for client in clients]
        left = list(planned_bytes)
        sockets = [client.socket for client in clients]
        if not going.is_set():
            going.set()
            began_s = time.perf_counter()
        if bytes_per_s is None:
            drain_all(sockets, left, enough.is_set)
        else:
            drain_paced(sockets, left, bytes_per_s, enough.is_set)
        received += sum(planned_bytes) - sum(left)
        for client in clients:
            client.close()
    amount.value = received / 1e6 / (time.perf_counter() - began_s)


def measure_busy(service: ServiceProcess, size: Size, bytes_per_s: float | None) -> dict[str, Any]:
    """Measure latency while others stream."""
    context = multiprocessing.get_context("spawn")
    going, enough, amount = context.Event(), context.Event(), context.Value("d", 0.0)
    crowd = context.Process(
        target=keep_busy, args=(service.port, size, bytes_per_s, going, enough, amount)
    )
    crowd.start()
    assert going.wait(60)
    time.sleep(0.3)
    latency = measure_latency(service, size, 0.002)
    enough.set()
    crowd.join(120)
    return latency | {"others": size.clients, "others_mb_per_s": amount.value}


def measure_supersede(service: ServiceProcess, size: Size) -> dict[str, Any]:
    """Land everywhere, then elsewhere in the middle of it; old bytes beyond the credit granted."""
    late: list[int] = []
    side_m = TILE_M * size.side
    credit = 8 * CHUNK
    for _ in range(min(30, size.landings)):
        client = DrainClient("127.0.0.1", service.port, "pit")
        client.hello(credit_bytes=credit)
        left = wire_bytes(client.begin((side_m / 2, 0.5, side_m / 2), side_m))
        buffer = bytearray(1 << 18)
        got = 0
        while got < 2 * CHUNK:
            got += client.socket.recv_into(buffer, 2 * CHUNK - got)
        client.wish((-50.0, 0.0, 0.0), 1.0)
        client.socket.settimeout(0.2)
        try:
            while got < left:
                got += client.socket.recv_into(buffer)
        except TimeoutError:
            pass
        late.append(max(0, got - credit - credit // CHUNK * (frame_bytes(CHUNK) - CHUNK)))
        client.close()
    return {"bytes_beyond_credit": percentiles([float(count) for count in late]), "chunk": CHUNK}


def measure_plan(size: Size) -> dict[str, Any]:
    """Plan landings on about a thousand segments of a large scene, in this process."""
    # A square grid of segments; only the table exists, no payload.
    side = size.plan_side
    number = np.arange(side * side)
    bounds = np.zeros((side * side, 6), dtype=np.float32)
    bounds[:, 0], bounds[:, 2] = TILE_M * (number % side), TILE_M * (number // side)
    bounds[:, 3:] = bounds[:, :3] + np.array([TILE_M, 1.0, TILE_M], dtype=np.float32)
    rng = np.random.default_rng(3)
    count = len(bounds)
    table = SegmentTable(
        bounds=bounds,
        lengths=rng.integers(50_000, 300_000, count, dtype=np.uint32),
        hashes=rng.integers(0, 1 << 63, count, dtype=np.uint64),
        faces=rng.integers(2_000, 20_000, count, dtype=np.uint32),
        vertices=rng.integers(1_000, 12_000, count, dtype=np.uint32),
        texture_bytes=np.zeros(count, np.uint64),
    )
    began_s = time.perf_counter()
    tree = PackedRTree(bounds)
    packed_s = time.perf_counter() - began_s
    # A session that has said hello and has credit for everything.
    # One base face under each segment.
    cover = Cover(np.arange(count + 1, dtype=np.uint32), np.arange(count, dtype=np.uint32))
    hidden = HiddenFaces(cover, count)
    view = SceneView("pit", "1", "pit", table, tree.within, hidden)
    limits = SessionLimits(max_messages_per_s=1e9)
    session = Session(view, limits, session_id="benchmark", now_s=0.0)
    session.receive(Hello(client="benchmark", budgets=Budgets(), credit_bytes=PLENTY), 0.0)
    session.next_action()
    # From the bytes of `land` to those of `plan`; the first ten landings warm the caches.
    plan_ms, query_ms, loaded = [], [], []
    for generation in range(size.landings + 10):
        x, z = rng.uniform(0.2, 0.8, 2) * side * TILE_M
        land = Land(
            generation=generation,
            position=(x, 0.5, z),
            radius_m=171.0,
            have=np.zeros(0, KEY_DTYPE),
            taken_bytes=0,
        )
        data = encode(land)
        began_s = time.perf_counter()
        message = decode(data, Direction.CLIENT_TO_SERVER, max_bytes=1 << 20)
        session.receive(message, 0.0)
        while True:
            action = session.next_action()
            if isinstance(action, MakePlan):
                session.make_plan(0.0)
                continue
            assert isinstance(action, SendMessage)
            if isinstance(action.message, Plan):
                break
        encode(action.message)
        plan_ms.append(1e3 * (time.perf_counter() - began_s))
        loaded.append(len(action.message.show))
        query_ms.append(timed_ms(lambda x=x, z=z: tree.within((x, 0.5, z), 171.0)))
    return {
        "segments": count,
        "loaded": statistics.median(loaded),
        "land_to_encoded_plan": percentiles(plan_ms[10:]),
        "query": percentiles(query_ms[10:]),
        "build_s": packed_s,
    }


def timed_ms(work: Callable[[], object]) -> float:
    """Milliseconds of one call."""
    began_s = time.perf_counter()
    work()
    return 1e3 * (time.perf_counter() - began_s)


def percentiles(values: list[float]) -> dict[str, float]:
    """Median, 99th percentile and largest."""
    return {
        "p50": float(np.percentile(values, 50)),
        "p99": float(np.percentile(values, 99)),
        "max": max(values),
    }


MEASUREMENTS = ("throughput", "latency", "supersede", "plan")


def main() -> None:
    """Run the measurements that are asked for and print one JSON document."""
    form = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--smoke", action="store_true", help="seconds, to see that it works")
    parser.add_argument("--only", choices=MEASUREMENTS, help="one part")
    parser.add_argument("--pin", action="store_true", help="servers on one core, clients on others")
    arguments = parser.parse_args()
    size = replace(SMOKE if arguments.smoke else FULL, pin=arguments.pin)
    measurements = (arguments.only,) if arguments.only else MEASUREMENTS
    result: dict[str, Any] = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, Linux {platform.release()}",
        "python": platform.python_version(),
        "size": asdict(size),
    }
    if measurements != ("plan",):
        with tempfile.TemporaryDirectory() as folder:
            write_random_scene(
                Path(folder) / "pit", side=size.side, segment_bytes=2 * CHUNK, spread=1.0
            )
            with ServiceProcess(Path(folder), **settings()) as service:
                measure_service(service, size, measurements, result)
    if "plan" in measurements:
        result["plan_ms"] = measure_plan(size)
    print(json.dumps(result, indent=1))


def measure_service(
    service: ServiceProcess, size: Size, measurements: tuple[str, ...], result: dict[str, Any]
) -> None:
    """Fill in what needs a running service."""
    if "throughput" in measurements:
        raw_port = free_port()
        lengths = [frame_bytes(CHUNK)] * (2 * size.side**2)
        streams = multiprocessing.get_context("spawn").Process(
            target=serve_raw, args=(lengths, raw_port), daemon=True
        )
        streams.start()
        assert streams.pid is not None
        raw = (raw_port, streams.pid)
        cores = sorted(os.sched_getaffinity(0))
        if size.pin and len(cores) > 1:
            for pid in (service.pid, streams.pid):
                os.sched_setaffinity(pid, cores[:1])
            os.sched_setaffinity(0, cores[1:])
        result["throughput"] = [
            measure_throughput(service, raw, size, 1, size.side**2),
            measure_throughput(service, raw, size, size.clients, size.segments_of_many),
        ]
        streams.terminate()
        streams.join(5)
        os.sched_setaffinity(service.pid, cores)
        os.sched_setaffinity(0, cores)
    if "latency" in measurements:
        result["latency_ms"] = {
            "idle": measure_latency(service, size, 0.002),
            "others_at_4_mb_per_s": measure_busy(service, size, 4e6),
            "others_as_fast_as_they_can": measure_busy(service, size, None),
        }
    if "supersede" in measurements:
        result["supersede"] = measure_supersede(service, size)


if __name__ == "__main__":
    main()
