"""Landings over slow and long links, and how soon a newer landing takes over.

::

    python benchmarks/links.py                  # proxy, and real TCP where it can; about 8 minutes
    python benchmarks/links.py --only land
    python benchmarks/links.py --only congestion
    python benchmarks/links.py --smoke

Two kinds of link, both tools of their own (``--tools DIR`` or TERRAPORT_TOOLS; by default
``../shared/tools`` beside the checkout; without them this says so and ends):

* ``linkproxy.py`` delays and paces an application's bytes. It needs no rights; TCP ends at it, so
  the service sees a near peer that reads slowly.
* ``tunlink.py`` joins two network namespaces by a wire with delay, rate, a queue of 100 ms and
  loss: real TCP end to end, with its window, its slow start and its queue. It needs root and
  ``ip netns``.

The delay is one way, as in the tools: the round trip is twice that.

* **land**: the real SDK lands (its default credit); time from ``land`` to ready over the time that
  the payload alone takes at the link's rate. Bar: 1.15 of that, plus one round trip. And the same
  with smaller credits: what a link needs.
* **supersede**: 100 Mbit/s, 20 ms there and back; payload bytes of the old landing that come after
  the new ``land`` was sent (bar 512 KiB), and when its first byte comes (bar: one round trip and 50
  ms). On loopback: bytes beyond what the client had granted (bar: one chunk, 128 KiB).
* **congestion**: the congestion controls that the system lets anyone use, on a wire that loses
  packets.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from parts.drain_client import DrainClient
from parts.random_scene import TILE_M, write_random_scene
from parts.service_process import ServiceProcess, free_port

import terraport
from terraport_wire import Plan

TOOLS: Final = Path(__file__).resolve().parents[2] / "shared" / "tools"
SIDE: Final = 30
SEGMENT_BYTES: Final = 48 << 10
SPACES: Final = ("terraport-a", "terraport-b")
SERVER_ADDRESS: Final = "10.77.1.1"
CONTROLS: Final = tuple(
    Path("/proc/sys/net/ipv4/tcp_allowed_congestion_control").read_text().split()
    if Path("/proc/sys/net/ipv4/tcp_allowed_congestion_control").exists()
    else ()
)
SETTINGS: Final[dict[str, Any]] = {
    "max_credit_bytes": 1 << 40,
    "max_radius_m": 10_000.0,
    "max_messages_per_s": 1e4,
    "allow_open": True,
    "log_level": "warning",
}


@dataclass(frozen=True)
class Link:
    """A simulated link: one-way delay, rate, and the share of packets lost."""

    delay_ms: float
    mbit: float
    loss: float = 0.0

    @property
    def round_trip_s(self) -> float:
        """Twice the one-way delay."""
        return 2e-3 * self.delay_ms

    def __str__(self) -> str:
        """Name it."""
        loss = f", loss {100 * self.loss:g} %" if self.loss else ""
        return f"{self.mbit:g} Mbit/s, {self.delay_ms:g} ms one way{loss}"


# --- the client, in a process (and a namespace) of its own ---------------------------------------


async def sdk_landings(
    url: str, mbit: float, seconds: float, credit: int | None, rounds: int
) -> Any:
    """Land at disjoint places; what each took, and how many bytes it was."""
    target_bytes = mbit * 125_000 * seconds
    radius_m = min(70.0, TILE_M * (target_bytes / SEGMENT_BYTES / 3.6) ** 0.5)
    options = {} if credit is None else {"credit_bytes": credit}
    landings = []
    async with terraport.connect(url, cache_bytes=1, max_bytes=1 << 40, **options) as session:
        for number in range(rounds):
            position = (75.0 + 150.0 * (number % 2), 0.5, 75.0 + 150.0 * (number // 2 % 2))
            landing = await session.land(position, radius_m)
            await landing.ready(240)
            landings.append((landing.stats.ready_s, landing.stats.streamed_bytes))
    return landings


def superseded_landings(host: str, port: int, rounds: int, credit: int) -> list[Any]:
    """Land on everything, land elsewhere in the middle; late bytes and seconds.

    Late bytes are those of the old landing that are read after the new one was sent; `beyond` is
    what they are more than the credit that was open then, which no server may send.
    """
    client = DrainClient(host, port, "pit")
    client.hello(credit_bytes=credit)
    superseded, owed = [], 0

    def take() -> object:
        """Receive one frame; grant back what was read, half of the credit at a time."""
        nonlocal owed
        got = client.next()
        owed += _payload(got)
        if owed >= credit // 2:
            client.grant(owed)
            owed = 0
        return got

    for _ in range(rounds):
        client.begin((0.0, 0.5, 0.0), 9000.0)
        until_s, got, began_s = time.perf_counter() + 0.7, 0, time.perf_counter()
        while time.perf_counter() < until_s and got < 30 << 20:
            got += _payload(take())
        rate = got / (time.perf_counter() - began_s)
        open_credit, late, began_s = credit - owed, 0, time.perf_counter()
        client.wish((SIDE * TILE_M, 0.5, SIDE * TILE_M), 15.0)
        while not isinstance(now := client.next(), Plan):
            late += _payload(now)
        owed += late
        while not _payload(take()):
            pass
        first_s = time.perf_counter() - began_s
        owed += client.drain()
        superseded.append((late, first_s, max(0, late - open_credit), rate))
    client.close()
    return superseded


def _payload(received: object) -> int:
    return received if isinstance(received, int) else 0


def client_main(task: dict[str, Any]) -> Any:
    """Do one task and return what is printed as JSON."""
    if task["what"] == "land":
        return asyncio.run(
            sdk_landings(
                f"http://{task['host']}:{task['port']}/scenes/pit",
                task["mbit"],
                task["seconds"],
                task["credit"],
                task["rounds"],
            )
        )
    return superseded_landings(task["host"], task["port"], task["rounds"], task["credit"])


def run_client(prefix: tuple[str, ...], task: dict[str, Any]) -> Any:
    """Run a client process and return what it found."""
    command = [*prefix, sys.executable, __file__, "--client", json.dumps(task)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    if done.returncode:
        raise RuntimeError(f"the client failed: {done.stderr[-2000:]}")
    return json.loads(done.stdout)


# --- links ---------------------------------------------------------------------------------------


@contextlib.contextmanager
def proxied(
    tools: Path, service_port: int, link: Link
) -> Iterator[tuple[tuple[str, ...], str, int]]:
    """Start linkproxy.py; yields prefix, host and port for a client."""
    port = free_port()
    command = [sys.executable, str(tools / "linkproxy.py"), str(port), str(service_port)]
    process = subprocess.Popen([*command, str(link.delay_ms), str(link.mbit)])
    try:
        time.sleep(1.0)
        yield (), "127.0.0.1", port
    finally:
        process.kill()
        process.wait()


@contextlib.contextmanager
def namespaces(congestion: str | None) -> Iterator[None]:
    """Make two network namespaces, and delete them."""
    for space in SPACES:
        subprocess.run(["ip", "netns", "del", space], capture_output=True, check=False)
        subprocess.run(["ip", "netns", "add", space], check=True)
        if congestion is not None:
            setting = f"net.ipv4.tcp_congestion_control={congestion}"
            subprocess.run(
                ["ip", "netns", "exec", space, "sysctl", "-qw", setting],
                check=True,
                stdout=subprocess.DEVNULL,
            )
    try:
        yield
    finally:
        for space in SPACES:
            subprocess.run(["ip", "netns", "del", space], capture_output=True, check=False)


@contextlib.contextmanager
def wired(tools: Path, link: Link) -> Iterator[None]:
    """Start tunlink.py between the namespaces."""
    command = [sys.executable, str(tools / "tunlink.py"), *SPACES]
    command += [str(link.delay_ms), str(link.loss), str(link.mbit), "600"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        if process.stdout.readline().strip() != "ready":
            raise RuntimeError("tunlink.py did not come up")
        yield
    finally:
        process.kill()
        process.wait()


def can_wire() -> str | None:
    """Return why real TCP links cannot be made here; None where they can."""
    if os.geteuid() != 0:
        return "not root"
    if not Path("/dev/net/tun").exists():
        return "no /dev/net/tun"
    try:
        done = subprocess.run(["ip", "netns", "list"], capture_output=True, check=False)
    except FileNotFoundError:
        return "no ip command"
    return None if done.returncode == 0 else "ip netns does not work"


# --- measures ------------------------------------------------------------------------------------


def judge_landings(landings: list[Any], link: Link) -> dict[str, Any]:
    """Compare with what the bytes alone take."""
    ratios = [
        (ready_s - link.round_trip_s) / (count / (link.mbit * 125_000))
        for ready_s, count in landings
    ]
    return {
        "link": str(link),
        "payload_mb": round(statistics.median(count for _, count in landings) / 1e6, 1),
        "ready_s": round(statistics.median(ready_s for ready_s, _ in landings), 3),
        "ratio_less_round_trip": round(statistics.median(ratios), 3),
        "worst": round(max(ratios), 3),
        "bar": 1.15,
    }


def judge_superseded(landings: list[Any], round_trip_s: float) -> dict[str, Any]:
    """Medians and worst of late bytes and of the first new byte."""
    late, first_ms = (
        [landing[0] for landing in landings],
        [1e3 * landing[1] for landing in landings],
    )
    return {
        "late_kib": round(statistics.median(late) / 1024, 1),
        "late_kib_worst": round(max(late) / 1024, 1),
        "beyond_credit_worst": max(landing[2] for landing in landings),
        "before_mbit": round(statistics.median(landing[3] for landing in landings) / 125_000, 1),
        "first_new_ms": round(statistics.median(first_ms), 1),
        "first_new_ms_worst": round(max(first_ms), 1),
        "bar_ms": round(1e3 * round_trip_s + 50, 1),
    }


class Bench:
    """One service and the ways to reach it."""

    def __init__(self, scenes: Path, tools: Path, rounds: int, seconds: float) -> None:
        self.scenes = scenes
        self.tools = tools
        self.rounds = rounds
        self.seconds = seconds

    def land_task(self, link: Link, host: str, port: int, credit: int | None) -> dict[str, Any]:
        """Return what a client is told."""
        return {
            "what": "land", "host": host, "port": port, "mbit": link.mbit, "credit": credit,
            "seconds": self.seconds, "rounds": self.rounds,
        }  # fmt: skip

    def land_by_proxy(self, links: list[Link], windows: list[int | None]) -> list[dict[str, Any]]:
        """Land over linkproxy.py, with every credit window on every link; one row each."""
        rows = []
        with ServiceProcess(self.scenes, **SETTINGS) as service:
            for link in links:
                with proxied(self.tools, service.port, link) as (prefix, host, port):
                    for credit in windows:
                        task = self.land_task(link, host, port, credit)
                        row = judge_landings(run_client(prefix, task), link)
                        rows.append(row | {"credit": credit or "default"})
        return rows

    def by_wire(
        self, link: Link, congestion: str | None, *, credit: int | None = None
    ) -> dict[str, Any]:
        """Land over tunlink.py; with a credit, supersede."""
        server_prefix, client_prefix = (("ip", "netns", "exec", space) for space in SPACES)
        with namespaces(congestion), wired(self.tools, link):
            service = ServiceProcess(
                self.scenes,
                prefix=server_prefix,
                address=SERVER_ADDRESS,
                **(SETTINGS | {"host": "0.0.0.0"}),
            )
            with service:
                task = self.land_task(link, SERVER_ADDRESS, service.port, credit)
                if credit is not None:
                    landings = run_client(client_prefix, task | {"what": "supersede"})
                    row = judge_superseded(landings, link.round_trip_s)
                    return row | {"link": str(link), "credit_kib": credit // 1024}
                return judge_landings(run_client(client_prefix, task), link)

    def supersede_on_loopback(self, credit: int) -> dict[str, Any]:
        """Late bytes, with a small credit and with plenty."""
        with ServiceProcess(self.scenes, **SETTINGS) as service:
            task = {
                "what": "supersede", "host": "127.0.0.1", "port": service.port,
                "rounds": 3 * self.rounds, "credit": credit,
            }  # fmt: skip
            landings = run_client((), task)
        return judge_superseded(landings, 0.0) | {"credit_kib": credit // 1024}


def main() -> int:
    form = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument(
        "--tools", type=Path, default=Path(os.environ.get("TERRAPORT_TOOLS", TOOLS))
    )
    parser.add_argument("--only", choices=["land", "wire", "credit", "supersede", "congestion"])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=2.0, help="what the bytes alone take")
    parser.add_argument("--smoke", action="store_true", help="seconds, to see that it works")
    parser.add_argument("--client", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    # This very file is the client's process in another network namespace.
    if arguments.client is not None:
        print(json.dumps(client_main(json.loads(arguments.client))))
        return 0
    if not (arguments.tools / "linkproxy.py").is_file():
        print(f"skipped: no linkproxy.py in {arguments.tools} (--tools DIR or TERRAPORT_TOOLS)")
        return 0
    # What can be measured here: everything over the proxy, real TCP only with namespaces.
    links = [Link(delay, mbit) for mbit in (20, 50, 100) for delay in (20, 50, 150)]
    if arguments.smoke:
        arguments.rounds, arguments.seconds, links = 1, 0.2, links[:1]
    unwired = "smoke" if arguments.smoke else can_wire()
    result: dict[str, Any] = {
        "machine": f"{platform.machine()}, Python {platform.python_version()}"
    }
    if unwired is not None:
        result["real_tcp"] = f"skipped: {unwired}"
    with tempfile.TemporaryDirectory(prefix="links-") as folder:
        write_random_scene(Path(folder) / "pit", side=SIDE, segment_bytes=SEGMENT_BYTES)
        bench = Bench(Path(folder), arguments.tools, arguments.rounds, arguments.seconds)
        long_fat = Link(150, 100)
        wire = unwired is None
        # Each measurement is a call, so that --only runs nothing else.
        measures = {
            "land": lambda: bench.land_by_proxy(links, [None]),
            "wire": lambda: [bench.by_wire(link, None) for link in links],
            "credit": lambda: bench.land_by_proxy([long_fat], [n << 20 for n in (1, 2, 4, 8, 16)]),
            "supersede": lambda: [
                bench.supersede_on_loopback(1 << 20),
                *(
                    [
                        bench.by_wire(Link(delay, 100), None, credit=credit << 10)
                        for delay in (10, 20)
                        for credit in (16 << 10, 1024, 512)
                    ]
                    if wire
                    else []
                ),
            ],
            "congestion": lambda: [
                bench.by_wire(Link(20, 50, loss), name) | {"control": name}
                for loss in (0.0, 0.005, 0.02)
                for name in CONTROLS
            ],
        }
        for name, measure in measures.items():
            needs_wire = name in {"wire", "congestion"}
            skip = (needs_wire and not wire) or (arguments.smoke and name == "credit")
            if not skip and arguments.only in {None, name}:
                result[name] = measure()
    print(json.dumps(result, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
