"""Landings over loopback: latency, and throughput against plain asyncio TCP streams.

::

    python benchmarks/landing.py            # about a minute
    python benchmarks/landing.py --smoke    # seconds, small numbers, only to see that it works

Server and client are two processes. The payload is random bytes (what compression leaves), laid
out as one scene; both servers send the same chunks in the same order, in interleaved rounds of one
run, to the same client, which only drains its socket. Reported: medians and percentiles, the ratio
of throughputs (median of the ratios within rounds), server CPU seconds per GB, and how many bytes
of a superseded landing still arrive.
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
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from websockets.client import ClientProtocol
from websockets.frames import Frame, Opcode
from websockets.http11 import Response
from websockets.typing import Subprotocol as SubprotocolName
from websockets.uri import parse_uri

from terraport_payload import Cover, SegmentMesh, encode_glb
from terraport_server.serving import run
from terraport_server.settings import Settings
from terraport_store import BuildInfo, HandOff, SceneInfo, SceneWriter
from terraport_wire import (
    HEADER_BYTES,
    MAX_CHUNK_BYTES,
    Budgets,
    Direction,
    Evict,
    Hello,
    Land,
    Message,
    PayloadFrame,
    Plan,
    Ready,
    Subprotocol,
    Welcome,
    decode,
    decode_frame,
    encode,
    is_payload,
)

PLENTY = 1 << 40
TILE_M = 10.0


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    segments: int
    segment_bytes: int
    rounds: int
    landings: int


FULL = Size(segments=400, segment_bytes=256 * 1024, rounds=9, landings=400)
SMOKE = Size(segments=25, segment_bytes=200 * 1024, rounds=2, landings=10)


def write_scene(path: Path, size: Size) -> None:
    """Publish a square grid of segments of random bytes."""
    side = round(size.segments**0.5)
    rng = np.random.default_rng(1)
    positions = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0]], dtype=np.float32)
    triangle = SegmentMesh(
        positions=positions,
        faces=np.array([[0, 1, 2]], dtype=np.uint32),
        normals=np.tile(np.array([0, 1, 0], dtype=np.float32), (3, 1)),
    )
    with SceneWriter(path) as writer:
        for number in range(side * side):
            x, z = TILE_M * (number % side), TILE_M * (number // side)
            writer.add_segment(
                rng.bytes(size.segment_bytes),
                region=0,
                bounds=(x, 0.0, z, x + TILE_M, 1.0, z + TILE_M),
                vertices=6000,
                faces=10_000,
            )
        base = encode_glb(triangle, step_m=2.0**-10, attribute_scales={}, keep_face_order=True)
        offsets = np.array([0, 0], dtype=np.uint32)
        writer.set_base(base, Cover(offsets, np.zeros(0, dtype=np.uint32)))
        writer.publish(
            SceneInfo(
                name="benchmark",
                origin=(0.0, 0.0, 0.0),
                step_m=2.0**-10,
                points=1,
                regions=1,
                hand_off=HandOff(deviation_m=0.0, tolerance_m=0.0),
                build=BuildInfo(terraport="benchmark"),
            )
        )


def serve(scenes_dir: Path, port: int, changed: dict[str, Any]) -> None:
    """Child process: the service."""
    run(
        Settings(
            scenes_dir=scenes_dir,
            port=port,
            log_level="error",
            max_messages_per_s=1e6,
            max_radius_m=10_000.0,
            max_credit_bytes=PLENTY,
            **changed,
        )
    )


def serve_raw(chunks: list[bytes], port: int) -> None:
    """Child process: asyncio streams that send all chunks for each byte received."""

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while await reader.read(1):
            for chunk in chunks:
                writer.write(chunk)
                await writer.drain()
        writer.close()

    async def forever() -> None:
        server = await asyncio.start_server(answer, "127.0.0.1", port)
        await server.serve_forever()

    asyncio.run(forever())


class RawClient:
    """A WebSocket client on a blocking socket: no thread, no queue, no task."""

    def __init__(self, port: int) -> None:
        uri = parse_uri(f"ws://127.0.0.1:{port}/scenes/pit/stream")
        self.protocol = ClientProtocol(
            uri, subprotocols=[SubprotocolName(Subprotocol.MSGPACK)], max_size=None
        )
        self.socket = connect(port)
        self.events: list[Any] = []
        self.protocol.send_request(self.protocol.connect())
        self._flush()
        while not any(isinstance(event, Response) for event in self.events):
            self._fill()
        self.events.clear()

    def send(self, *messages: Message) -> None:
        """Send messages in one write."""
        for message in messages:
            data = encode(message, Subprotocol.MSGPACK)
            assert isinstance(data, bytes)
            self.protocol.send_binary(data)
        self._flush()

    def receive(self) -> Message | PayloadFrame:
        """Receive one message or frame."""
        while True:
            while not self.events:
                self._fill()
            event = self.events.pop(0)
            if not isinstance(event, Frame) or event.opcode is not Opcode.BINARY:
                continue
            if is_payload(event.data):
                frame = decode_frame(event.data)
                assert isinstance(frame, PayloadFrame)
                return frame
            message = decode(event.data, Subprotocol.MSGPACK, Direction.SERVER_TO_CLIENT)
            assert isinstance(message, Message)
            return message

    def hello(self) -> Welcome:
        """Open the session."""
        self.send(
            Hello(
                protocol=(1, 0),
                client="benchmark",
                encoding="glb",
                budgets=Budgets(),
                credit_bytes=PLENTY,
            )
        )
        welcome = self.receive()
        assert isinstance(welcome, Welcome), welcome
        return welcome

    def _fill(self) -> None:
        data = self.socket.recv(1 << 20)
        assert data, "the server closed the connection"
        self.protocol.receive_data(data)
        self.events.extend(self.protocol.events_received())
        self._flush()  # pongs

    def _flush(self) -> None:
        for data in self.protocol.data_to_send():
            if data:
                self.socket.sendall(data)


def connect(port: int) -> socket.socket:
    """Connect, waiting for a server that is still starting."""
    until_s = time.monotonic() + 30
    while True:
        try:
            found = socket.create_connection(("127.0.0.1", port))
        except OSError:
            if time.monotonic() > until_s:
                raise
            time.sleep(0.05)
        else:
            found.settimeout(60)
            found.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return found


def drain(found: socket.socket, count: int) -> None:
    """Read so many bytes and forget them."""
    buffer = bytearray(1 << 18)
    while count > 0:
        got = found.recv_into(buffer, min(len(buffer), count))
        assert got, "the server closed the connection"
        count -= got


def chunk_lengths(size: Size) -> list[int]:
    """Payload bytes of each frame, in order."""
    full, rest = divmod(size.segment_bytes, MAX_CHUNK_BYTES)
    one = [MAX_CHUNK_BYTES] * full + ([rest] if rest else [])
    return one * size.segments


def frame_bytes(chunk: int) -> int:
    """Bytes of one frame on the wire, WebSocket header included."""
    length = chunk + HEADER_BYTES
    return length + (2 if length < 126 else 4 if length < 1 << 16 else 10)


def cpu_s(pid: int) -> float:
    """CPU seconds that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure_latency(port: int, size: Size) -> dict[str, list[float]]:
    """Land again and again at random places, holding nothing; ms."""
    rng = np.random.default_rng(2)
    side = round(size.segments**0.5)
    client = RawClient(port)
    client.hello()
    everything = np.arange(size.segments, dtype=np.uint32)
    first_ms, plan_ms, ready_ms = [], [], []
    for generation in range(size.landings):
        x, z = rng.uniform(0, side * TILE_M, size=2)
        client.send(Evict(segments=everything))
        began = time.perf_counter()
        land = Land(generation=generation, position=(x, 0.5, z), radius_m=12.0)
        client.send(land)
        assert isinstance(client.receive(), Plan)
        plan_ms.append(1e3 * (time.perf_counter() - began))
        assert isinstance(client.receive(), PayloadFrame)
        first_ms.append(1e3 * (time.perf_counter() - began))
        while not isinstance(client.receive(), Ready):
            pass
        ready_ms.append(1e3 * (time.perf_counter() - began))
        time.sleep(0.002)  # idle between landings
    client.socket.close()
    return {"plan": plan_ms, "first_byte": first_ms, "ready": ready_ms}


def measure_supersede(port: int, size: Size) -> list[int]:
    """Land everywhere, then elsewhere after the third frame; bytes of the old one after that."""
    client = RawClient(port)
    client.hello()
    everything = np.arange(size.segments, dtype=np.uint32)
    late: list[int] = []
    for generation in range(0, 2 * min(30, size.landings), 2):
        client.send(
            Evict(segments=everything),
            Land(generation=generation, position=(0.0, 0.0, 0.0), radius_m=9000.0),
        )
        for _ in range(4):
            client.receive()
        client.send(Land(generation=generation + 1, position=(-50.0, 0.0, 0.0), radius_m=1.0))
        old = 0
        while True:
            got = client.receive()
            if isinstance(got, PayloadFrame):
                old += len(got.chunk)
            elif isinstance(got, Ready) and got.generation == generation + 1:
                break
        late.append(old)
    client.socket.close()
    return late


def time_stream(client: RawClient, size: Size, generation: int) -> float:
    """Land everywhere and drain; seconds from land to the last payload byte."""
    lengths = chunk_lengths(size)
    client.send(Evict(segments=np.arange(size.segments, dtype=np.uint32)))
    began = time.perf_counter()
    side_m = TILE_M * round(size.segments**0.5)
    centre = (side_m / 2, 0.0, side_m / 2)
    client.send(Land(generation=generation, position=centre, radius_m=9000.0))
    # The plan is parsed, the payload is not: what was read with the plan is taken off the rest.
    plan_bytes = b""
    while len(plan_bytes) < 10:
        plan_bytes += client.socket.recv(1 << 16)
    plan_length = ws_length(plan_bytes)
    total = plan_length + sum(frame_bytes(length) for length in lengths)
    drain(client.socket, total - len(plan_bytes))
    seconds = time.perf_counter() - began
    ready = b""
    while len(ready) < 2 or len(ready) < ws_length(ready):
        ready += client.socket.recv(1 << 16)
    return seconds


def ws_length(data: bytes) -> int:
    """Bytes of the WebSocket frame that data begins with, header included."""
    short = data[1] & 0x7F
    if short < 126:
        return 2 + short
    width = 2 if short == 126 else 8
    return 2 + width + int.from_bytes(data[2 : 2 + width], "big")


def time_raw(found: socket.socket, total: int) -> float:
    """Ask for everything and drain; seconds."""
    began = time.perf_counter()
    found.sendall(b"x")
    drain(found, total)
    return time.perf_counter() - began


def measure_throughput(
    port: int, raw_port: int, pids: tuple[int, int], size: Size
) -> dict[str, float]:
    """Interleaved rounds of service and raw streams."""
    client, raw = RawClient(port), connect(raw_port)
    client.hello()
    payload_gb = size.segments * size.segment_bytes / 1e9
    raw_total = sum(frame_bytes(length) for length in chunk_lengths(size))
    ours, theirs, ours_cpu, theirs_cpu = [], [], [], []
    for number in range(size.rounds + 1):
        cpu = [cpu_s(pid) for pid in pids]
        seconds = time_stream(client, size, number)
        raw_seconds = time_raw(raw, raw_total)
        if number:  # the first round warms the page cache
            ours.append(payload_gb / seconds)
            theirs.append(payload_gb / raw_seconds)
            ours_cpu.append((cpu_s(pids[0]) - cpu[0]) / payload_gb)
            theirs_cpu.append((cpu_s(pids[1]) - cpu[1]) / payload_gb)
    client.socket.close()
    raw.close()
    return {
        "service_gb_per_s": statistics.median(ours),
        "raw_gb_per_s": statistics.median(theirs),
        "ratio": statistics.median(a / b for a, b in zip(ours, theirs, strict=True)),
        "service_cpu_s_per_gb": statistics.median(ours_cpu),
        "raw_cpu_s_per_gb": statistics.median(theirs_cpu),
    }


def free_port() -> int:
    """Find a port that is free now."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port: int = probe.getsockname()[1]
        return port


def percentiles(values: list[float]) -> dict[str, float]:
    """Median, 99th percentile and largest."""
    return {
        "p50": float(np.percentile(values, 50)),
        "p99": float(np.percentile(values, 99)),
        "max": max(values),
    }


def main() -> None:
    """Measure and print."""
    form = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--smoke", action="store_true", help="seconds, to see that it works")
    parser.add_argument("--source", default="file", choices=["file", "mmap"])
    parser.add_argument("--lowat", type=int, default=None, help="notsent_lowat_bytes")
    arguments = parser.parse_args()
    size = SMOKE if arguments.smoke else FULL
    changed: dict[str, Any] = {"payload_source": arguments.source}
    if arguments.lowat is not None:
        changed["notsent_lowat_bytes"] = arguments.lowat
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        write_scene(Path(folder) / "pit", size)
        rng = np.random.default_rng(1)
        chunks = [rng.bytes(frame_bytes(length)) for length in chunk_lengths(size)]
        port, raw_port = free_port(), free_port()
        service = context.Process(target=serve, args=(Path(folder), port, changed), daemon=True)
        streams = context.Process(target=serve_raw, args=(chunks, raw_port), daemon=True)
        service.start()
        streams.start()
        assert service.pid is not None
        assert streams.pid is not None
        try:
            latency = measure_latency(port, size)
            late = measure_supersede(port, size)
            throughput = measure_throughput(port, raw_port, (service.pid, streams.pid), size)
        finally:
            service.terminate()
            streams.terminate()
            service.join(20)
            streams.join(5)
    result = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "python": platform.python_version(),
        "settings": changed,
        "size": asdict(size),
        "latency_ms": {name: percentiles(values) for name, values in latency.items()},
        "superseded_late_bytes": percentiles([float(count) for count in late]),
        "throughput": throughput,
    }
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
