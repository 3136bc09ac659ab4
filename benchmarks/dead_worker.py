"""One worker of several dies or hangs: what becomes of those who connect; what watching costs.

::

    python benchmarks/dead_worker.py               # two minutes
    python benchmarks/dead_worker.py --smoke       # some seconds of each
    python benchmarks/dead_worker.py --bound 1.5   # exit status 1 where a client waits for longer

Another version: put its packages first in PYTHONPATH. `terraport serve --workers 2` as processes.

Faults. From the moment that one of them is killed (SIGKILL) or stopped (SIGSTOP), a new client
connects every 50 ms and waits for the answer to its WebSocket handshake: 101 is served, anything
else, or nothing in 15 s, is failed. Half of them fall to the worker that is gone. The slowest of
the quiet second before the fault is a measure of the machine, and added to `--bound`.

Costs. CPU time by the kernel's accounting: of the supervisor and of a worker while nothing happens,
and of all processes for a WebSocket handshake whose URL names no group, and one.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import signal
import statistics
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from server.grid_scene import write_grid_scene
from server.supervised import Supervised

FAULTS: Final = {"kill": signal.SIGKILL, "stop": signal.SIGSTOP}
WAIT_S: Final = 15.0
EVERY_S: Final = 0.05
SETTINGS: Final = {
    "max_connections_per_ip": "100000",
    "max_sessions_per_ip": "100000",
    "max_connections": "100000",
}
TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")


def request(query: str = "") -> bytes:
    """Return a handshake's request."""
    return (
        f"GET /scenes/pit/stream{query} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: Upgrade\r\n"
        "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
        "Sec-WebSocket-Protocol: terraport.v1.msgpack\r\n\r\n"
    ).encode()


async def handshake(port: int, query: str = "") -> tuple[str, float]:
    """Connect once; return what came of it, and after how long."""
    began_s = time.monotonic()
    outcome = "nothing"
    try:
        async with asyncio.timeout(WAIT_S):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(request(query))
            line = await reader.readline()
            outcome = line.split(b" ")[1].decode() if line.count(b" ") >= 2 else "closed"
            writer.transport.abort()
    except TimeoutError:
        outcome = f"nothing in {WAIT_S:g} s"
    except OSError as error:
        outcome = type(error).__name__
    return outcome, time.monotonic() - began_s


async def clients(port: int, seconds: float) -> list[tuple[str, float]]:
    """Connect anew every 50 ms for so long; return what came of each."""
    tasks = []
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        tasks.append(asyncio.create_task(handshake(port)))
        await asyncio.sleep(EVERY_S)
    return await asyncio.gather(*tasks)


def started(scenes: Path) -> Supervised:
    """Start the service; ready in two minutes at the latest."""
    service = Supervised(scenes, wait=False, **SETTINGS)
    service.until(lambda: "workers ready" in service.log, 120)
    return service


def play(scenes: Path, fault: str, seconds: float) -> dict[str, Any]:
    """Let one worker fail; return what became of the clients."""
    service = started(scenes)
    victim = service.worker_pids()[0]
    try:
        before = asyncio.run(clients(service.port, 1.0))
        os.kill(victim, FAULTS[fault])
        results = asyncio.run(clients(service.port, seconds))
    finally:
        if fault == "stop":
            # Else it was killed and replaced meanwhile.
            with contextlib.suppress(ProcessLookupError):
                os.kill(victim, signal.SIGCONT)
        service.__exit__(None, None, None)
    waits_ms = sorted(1000 * wait_s for _, wait_s in results)
    outcomes = Counter(outcome for outcome, _ in results)
    return {
        "clients": len(results),
        "failed": len(results) - outcomes["101"],
        "outcomes": dict(outcomes),
        "p50_ms": round(statistics.median(waits_ms), 1),
        "p99_ms": round(waits_ms[int(0.99 * len(waits_ms))], 1),
        "worst_ms": round(waits_ms[-1]),
        "over_1_s": sum(wait_ms > 1000 for wait_ms in waits_ms),
        "worst_before_ms": round(1000 * max(wait_s for _, wait_s in before)),
        "exit_code": service.process.returncode,
    }


def cpu_s(process: int) -> float:
    """CPU time of a process so far."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def costs(scenes: Path, seconds: float, handshakes: int) -> dict[str, Any]:
    """Return CPU time while nothing happens, and of handshakes."""
    service = started(scenes)
    try:
        supervisor, workers = service.process.pid, service.worker_pids()
        time.sleep(2.0)
        before = [cpu_s(process) for process in (supervisor, *workers)]
        time.sleep(seconds)
        after = [cpu_s(process) for process in (supervisor, *workers)]
        idle = [(end - begin) / seconds for begin, end in zip(before, after, strict=True)]
        result: dict[str, Any] = {
            "idle_supervisor_cpu": round(idle[0], 5),
            "idle_worker_cpu": round(statistics.mean(idle[1:]), 5),
        }
        for name, query in (("plain", ""), ("group", "?group=tour")):

            async def one_after_the_other(query: str = query) -> Counter[str]:
                outcomes = [(await handshake(service.port, query))[0] for _ in range(handshakes)]
                return Counter(outcomes)

            asyncio.run(one_after_the_other())  # warm
            begin = sum(cpu_s(process) for process in (supervisor, *workers))
            outcomes = asyncio.run(one_after_the_other())
            spent_s = sum(cpu_s(process) for process in (supervisor, *workers)) - begin
            result[f"{name}_handshake_cpu_ms"] = round(1000 * spent_s / handshakes, 3)
            result[f"{name}_handshakes"] = dict(outcomes)
        return result
    finally:
        service.__exit__(None, None, None)


def main() -> int:
    """Play all faults, measure the costs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--smoke", action="store_true")
    parser.add_argument("--bound", type=float, default=WAIT_S, help="seconds that a client waits")
    parser.add_argument("--only", choices=[*FAULTS, "costs"])
    arguments = parser.parse_args()
    seconds = 4.0 if arguments.smoke else 20.0
    is_good = True
    with tempfile.TemporaryDirectory() as name:
        scenes = Path(name) / "scenes"
        write_grid_scene(scenes / "pit")
        for fault in FAULTS:
            if arguments.only in {None, fault}:
                result = play(scenes, fault, seconds)
                print(json.dumps({fault: result}), flush=True)
                is_good &= result["failed"] == 0 and result["exit_code"] == 0
                bound_ms = 1000 * arguments.bound + result["worst_before_ms"]
                is_good &= result["worst_ms"] <= bound_ms
        if arguments.only in {None, "costs"}:
            handshakes = 20 if arguments.smoke else 500
            print(json.dumps({"costs": costs(scenes, seconds, handshakes)}), flush=True)
    return 0 if is_good else 1


if __name__ == "__main__":
    sys.exit(main())
