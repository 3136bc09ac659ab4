"""Fifty clients for an hour: landings, aborted landings, slow clients, cut links.

::

    python benchmarks/soak.py                       # one hour, under a quarter of a core
    python benchmarks/soak.py --minutes 10
    python benchmarks/soak.py --attacks             # with attackers beside them
    python benchmarks/soak.py --smoke               # 20 s

``terraport serve`` runs as a process of its own; 45 light clients (parts/light_client.py) and five
sessions of the real SDK land every five seconds each at a place of their own. One landing in ten is
given up in the middle by the next one, one in fifty loses its link in the middle and comes back
with what it holds, and one client in twenty reads at 400 KB/s. Light clients check every byte and
every plan; the SDK checks itself (hashes, repeats), and its landings are compared with brute force.

``--attacks``: in every second phase of three minutes, beside them every attack of ``fuzz/attacks``
in turn, two seconds of one and three seconds' pause, each time from another two of 200 addresses; a
token is asked for, and all clients are counted by their address. So landings beside attackers are
compared with those of the same hour without.

After each landing a light client forgets half of what it does not show, and sometimes much more,
so that there is always something to send and something to keep.

Fails (exit status 1) where anything was wrong, lost or repeated, where the service's log has an
error, or where memory grows: the slope of RSS over time, Theil and Sen's (the median of the slopes
of all pairs of samples: a third of them may be outliers), after a warm-up of a fifth of the time.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import os
import platform
import random
import sys
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / "fuzz"))

from attacks.load import ATTACKS
from parts.expected_plan import expect
from parts.light_client import Findings, LightClient, LostError, ReadyLanding
from parts.random_scene import TILE_M, write_random_scene
from parts.service_process import ServiceProcess

import terraport
from terraport.errors import LandingSupersededError, TerraportError
from terraport_store import Scene, SegmentIndex
from terraport_wire import KEY_DTYPE, MAX_PLAN_SEGMENTS, Land

SIDE: Final = 30
SEGMENT_BYTES: Final = 24 << 10
RADIUS_M: Final = 28.0
"""About 40 segments a landing."""
SLOW_BYTES_PER_S: Final = 400e3
LONGEST_LANDING_S: Final = 30.0
SLOPE_BAR_MB_PER_H: Final = 1.0
PHASE_S: Final = 180.0
"""Without attackers, then with them, and so on; shorter where the whole is."""
ATTACK_S: Final = 2.0
ATTACK_PERIOD_S: Final = 5.0
ATTACKERS: Final = 2
TOKEN: Final = "a-token-of-enough-characters"


@dataclass(frozen=True)
class Mix:
    """How many clients there are, how often they land, and which share of them misbehaves how."""

    clients: int
    sdk_clients: int
    period_s: float
    aborted: float
    slow: float
    cut: float


class Trial:
    """One run of all clients against one service."""

    def __init__(self, url: str, index: SegmentIndex, mix: Mix, seed: int) -> None:
        self.url = url
        self.index = index
        self.mix = mix
        self.seed = seed
        self.findings = Findings()
        self.sdk = {"landings": 0, "aborted": 0, "connections": 0}

    def somewhere(self, draw: random.Random) -> tuple[float, float, float]:
        """Half of all landings are at one of eight places that everybody knows."""
        edge_m = SIDE * TILE_M
        if draw.random() < 0.5:
            cell = draw.randrange(8)
            return (edge_m * (cell % 4 + 0.5) / 4, 0.5, edge_m * (cell // 4 + 0.5) / 2)
        return (draw.uniform(0, edge_m), 0.5, draw.uniform(0, edge_m))

    async def light(self, number: int, until_s: float) -> None:
        """One light client's life."""
        draw = random.Random(1000 * self.seed + number)
        slow = number < round(self.mix.slow * self.mix.clients + 0.49)
        client = LightClient(
            self.url,
            self.index,
            self.findings,
            name=f"client {number}",
            credit_bytes=256 << 10 if slow else 16 << 20,
            bytes_per_s=SLOW_BYTES_PER_S if slow else None,
            token=TOKEN,
        )
        await self._connect(client, draw)
        next_s = time.monotonic() + draw.uniform(0, self.mix.period_s)
        while next_s < until_s:
            await asyncio.sleep(max(0.0, next_s - time.monotonic()))
            next_s += self.mix.period_s
            await self._live(client, draw)
        with suppress(LostError):
            await client.leave()

    async def _live(self, client: LightClient, draw: random.Random) -> None:
        """One landing, whatever becomes of it."""
        position, fate = self.somewhere(draw), draw.random()
        mix = self.mix
        try:
            async with asyncio.timeout(LONGEST_LANDING_S):
                if fate < mix.aborted:
                    await client.land(position, RADIUS_M, give_up_after=draw.randrange(30))
                    position = self.somewhere(draw)
                elif fate < mix.aborted + mix.cut:
                    await client.land(position, RADIUS_M, give_up_after=draw.randrange(30))
                    self.findings.cuts += 1
                    client.cut()
                    await asyncio.sleep(draw.uniform(0.0, 0.5))
                    await self._connect(client, draw)
                await client.land(position, RADIUS_M)
                self._forget(client, draw)
        except TimeoutError:
            self.findings.say(f"a landing was not ready after {LONGEST_LANDING_S:g} s")
        except LostError as error:
            self.findings.say(f"a connection was lost: {error}")
            await self._connect(client, draw)

    async def _connect(self, client: LightClient, draw: random.Random) -> None:
        for attempt in range(6):
            try:
                await client.connect()
            except (OSError, LostError) as error:
                self.findings.say(f"no connection: {error}")
                await asyncio.sleep(draw.uniform(0.5, 1.0) * 2**attempt)
            else:
                return

    def _forget(self, client: LightClient, draw: random.Random) -> None:
        hidden = np.flatnonzero(client.held & ~client.shown)
        share = 1.0 if draw.random() < 0.1 else 0.5
        gone = np.array([segment for segment in hidden if draw.random() < share], dtype=np.uint32)
        if len(gone):
            client.forget(gone)

    async def full(self, number: int, until_s: float) -> None:
        """One session of the SDK, with a cache of 2 MB."""
        draw = random.Random(1000 * self.seed + number)
        async with terraport.connect(
            self.url, token=TOKEN, cache_bytes=2 << 20, max_bytes=1 << 40
        ) as session:
            next_s = time.monotonic() + draw.uniform(0, self.mix.period_s)
            while next_s < until_s:
                await asyncio.sleep(max(0.0, next_s - time.monotonic()))
                next_s += self.mix.period_s
                try:
                    await self._live_fully(session, draw)
                except (TerraportError, TimeoutError) as error:
                    self.findings.say(f"SDK client {number}: {error!r}")
            if session.stats.repeated_bytes:
                self.findings.repeated += 1
            if session.stats.rejected:
                self.findings.say(f"SDK client {number}: {session.stats.rejected} wrong hashes")
            self.sdk["connections"] += session.stats.connections

    async def _live_fully(self, session: terraport.Session, draw: random.Random) -> None:
        position = self.somewhere(draw)
        first = await session.land(position, RADIUS_M)
        if draw.random() < self.mix.aborted:
            self.sdk["aborted"] += 1
            position = self.somewhere(draw)
            landing = await session.land(position, RADIUS_M)
            with suppress(LandingSupersededError):
                await first.ready(LONGEST_LANDING_S)
        else:
            landing = first
        segments = await landing.ready(LONGEST_LANDING_S)
        self.sdk["landings"] += 1
        land = Land(
            generation=1,
            position=position,
            radius_m=RADIUS_M,
            have=np.zeros(0, KEY_DTYPE),
            taken_bytes=0,
        )
        expected = expect(self.index, land, max_segments=MAX_PLAN_SEGMENTS)
        shown = {segment.id for segment in segments}
        absent = set(expected) - shown
        if absent:
            self.findings.lost += len(absent)
            self.findings.say(f"SDK: {len(absent)} segments within the radius are not shown")
        if beyond := shown - set(expected):
            self.findings.say(f"SDK: {len(beyond)} segments beyond the radius are shown")

    async def run(self, seconds: float) -> None:
        """All clients, until the time is over."""
        until_s = time.monotonic() + seconds
        lights = self.mix.clients - self.mix.sdk_clients
        async with asyncio.TaskGroup() as group:
            for number in range(self.mix.clients):
                life = self.light if number < lights else self.full
                group.create_task(life(number, until_s))


def is_beside(since_s: float, phase_s: float) -> tuple[bool, bool]:
    """Whether that long after the begin attackers have their phase, and one is at work."""
    phase, within_s = divmod(since_s, phase_s)
    has_phase = phase % 2 == 1
    return has_phase, has_phase and within_s % ATTACK_PERIOD_S < ATTACK_S


def attack(port: int, began_s: float, phase_s: float, stop: Any, done: Any) -> None:
    """Child process: in their phases one attack after the other, from two addresses each time."""
    os.nice(10)
    turn = 0
    while not stop.wait(0.02):
        if not is_beside(time.monotonic() - began_s, phase_s)[1]:
            continue
        name = list(ATTACKS)[turn % len(ATTACKS)]
        attackers = [
            threading.Thread(
                target=ATTACKS[name],
                args=(
                    port,
                    "pit",
                    TOKEN,
                    lambda: is_beside(time.monotonic() - began_s, phase_s)[1],
                    f"127.0.1.{1 + (ATTACKERS * turn + number) % 200}",
                ),
            )
            for number in range(ATTACKERS)
        ]
        for attacker in attackers:
            attacker.start()
        for attacker in attackers:
            attacker.join()
        turn += 1
        done.value = turn


async def watch(
    service: ServiceProcess,
    period_s: float,
    samples: list[dict[str, Any]],
    out: Path | None,
    findings: Findings,
) -> None:
    """Sample the service's memory until cancelled; append each sample to a file at once."""
    began_s = time.monotonic()
    while True:
        sample: dict[str, Any] = {"t_s": round(time.monotonic() - began_s, 3)}
        sample |= service.memory().as_dict() | {"cpu_s": service.cpu_s()}
        sample |= {"landings": findings.landings, "wrong": len(findings.wrong)}
        samples.append(sample)
        if out is not None:
            with out.open("a", encoding="ascii") as file:
                file.write(json.dumps(sample) + "\n")
        if not service.alive:
            findings.say("the service is dead")
            return
        await asyncio.sleep(period_s)


def slope(samples: list[dict[str, Any]], name: str, warm_up: float) -> dict[str, float]:
    """Theil-Sen slope per hour after the warm-up, in MB, with its 95 % interval (Kendall's)."""
    times = np.array([sample["t_s"] for sample in samples]) / 3600.0
    values = np.array([sample[name] for sample in samples]) / 1e6
    late = times >= warm_up * times[-1]
    times, values = times[late], values[late]
    i, j = np.triu_indices(len(times), 1)
    slopes = np.sort((values[j] - values[i]) / (times[j] - times[i]))
    n = len(times)
    spread = 1.96 * np.sqrt(n * (n - 1) * (2 * n + 5) / 18.0)
    low = int(np.clip((len(slopes) - spread) / 2, 0, len(slopes) - 1))
    high = int(np.clip((len(slopes) + spread) / 2, 0, len(slopes) - 1))
    return {
        "mb_per_h": round(float(np.median(slopes)), 3),
        "low": round(float(slopes[low]), 3),
        "high": round(float(slopes[high]), 3),
        "first_mb": round(float(values[0]), 2),
        "last_mb": round(float(values[-1]), 2),
        "peak_mb": round(float(values.max()), 2),
    }


def log_errors(log: Path) -> list[str]:
    """Lines of the service's log that tell of a failure."""
    return [
        line
        for line in log.read_text(encoding="utf-8", errors="replace").splitlines()
        if " error " in line or "Traceback" in line
    ]


def percentiles_ms(seconds: list[float]) -> dict[str, float]:
    """Median and 99th percentile."""
    if not seconds:
        return {}
    values = 1e3 * np.array(seconds)
    return {f"p{share}": round(float(np.percentile(values, share)), 2) for share in (50, 99)}


def by_phase(
    ready: list[ReadyLanding], began_s: float, phase_s: float, warm_up_s: float
) -> dict[str, dict[str, float]]:
    """Land to ready in phases without attackers, in theirs, and while one of them was at work."""
    took_s: dict[str, list[float]] = {"without": [], "with": [], "during": []}
    for landing in ready:
        since_s = landing.began_s - began_s
        if since_s < warm_up_s:
            continue
        has_phase, is_attacked = is_beside(since_s, phase_s)
        took_s["with" if has_phase else "without"].append(landing.took_s)
        if is_attacked:
            took_s["during"].append(landing.took_s)
    return {name: {"count": len(took), **percentiles_ms(took)} for name, took in took_s.items()}


async def trial(arguments: argparse.Namespace, mix: Mix, folder: Path) -> dict[str, Any]:
    seconds = 60.0 * arguments.minutes
    log = folder / "service.log"
    settings: dict[str, Any] = {"max_sessions_per_ip": 2 * mix.clients, "token": TOKEN}
    # Nobody is a proxy: who comes from where counts.
    settings |= {"forwarded_allow_ips": ""}
    settings |= dict(entry.split("=", 1) for entry in arguments.set)
    # All clients for so long, while the service's memory is written down.
    with (
        ServiceProcess(folder / "scenes", log=log, **settings) as service,
        Scene.open(folder / "scenes" / "pit") as scene,
    ):
        run = Trial(f"{service.url}/scenes/pit", scene.index, mix, arguments.seed)
        samples: list[dict[str, Any]] = []
        watching = asyncio.create_task(
            watch(service, max(0.5, seconds / 360.0), samples, arguments.out, run.findings)
        )
        context = multiprocessing.get_context("spawn")
        stop, attacks = context.Event(), context.Value("q", 0)
        own_s, began_s = time.process_time(), time.monotonic()
        phase_s = min(PHASE_S, seconds / 4)
        attacker = context.Process(
            target=attack, args=(service.port, began_s, phase_s, stop, attacks), daemon=True
        )
        if arguments.attacks:
            attacker.start()
        await run.run(seconds)
        took_s = time.monotonic() - began_s
        watching.cancel()
        stop.set()
        if arguments.attacks:
            attacker.join(60)
        # Growth is fitted after the warm-up; the service must stop by itself in the end.
        result = {
            "machine": f"{platform.machine()}, Python {platform.python_version()}",
            "took_s": round(took_s, 1),
            "attacks": attacks.value,
            "landings_ready": run.findings.landings + run.sdk["landings"],
            "superseded": run.findings.superseded + run.sdk["aborted"],
            "cuts": run.findings.cuts,
            "connections": run.findings.connections,
            "sdk": run.sdk,
            "plans": run.findings.plans,
            "plans_checked": run.findings.plans_checked,
            "segments": run.findings.segments,
            "payload_mb": round(run.findings.payload_bytes / 1e6, 1),
            "lost": run.findings.lost,
            "repeated": run.findings.repeated,
            "wrong": run.findings.wrong[:20],
            "wrong_count": len(run.findings.wrong),
            "first_byte_ms": percentiles_ms(run.findings.first_s),
            "ready_ms": percentiles_ms([landing.took_s for landing in run.findings.ready]),
            "ready_by_phase_ms": by_phase(
                run.findings.ready, began_s, phase_s, arguments.warm_up * seconds
            ),
            "cpu_share_service": round((service.cpu_s() - samples[0]["cpu_s"]) / took_s, 3),
            "cpu_share_clients": round((time.process_time() - own_s) / took_s, 3),
            "rss": slope(samples, "rss", arguments.warm_up),
            "anon": slope(samples, "anon", arguments.warm_up),
            "descriptors": [samples[0]["descriptors"], samples[-1]["descriptors"]],
            "threads": [samples[0]["threads"], samples[-1]["threads"]],
        }
        result["exit_status"] = service.stop()
    result["log_errors"] = log_errors(log)[:20]
    return result


def main() -> int:
    form = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--clients", type=int, default=50)
    parser.add_argument("--sdk-clients", type=int, default=5, help="of them: the real SDK")
    parser.add_argument("--period", type=float, default=5.0, help="seconds between landings")
    parser.add_argument("--attacks", action="store_true", help="with attackers beside the clients")
    parser.add_argument("--warm-up", type=float, default=0.2, help="share of the time")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], help="NAME=VALUE of a setting")
    parser.add_argument("--out", type=Path, help="append samples to this file, one JSON a line")
    parser.add_argument("--smoke", action="store_true", help="20 s, to see that it works")
    arguments = parser.parse_args()
    if arguments.smoke:
        arguments.minutes, arguments.period = 1 / 3, 2.0
    mix = Mix(arguments.clients, arguments.sdk_clients, arguments.period, 0.10, 0.05, 0.02)
    with tempfile.TemporaryDirectory(prefix="soak-") as name:
        folder = Path(name)
        (folder / "scenes").mkdir()
        write_random_scene(folder / "scenes" / "pit", side=SIDE, segment_bytes=SEGMENT_BYTES)
        result = asyncio.run(trial(arguments, mix, folder))
    print(json.dumps(result, indent=1))
    good = not (result["wrong"] or result["lost"] or result["repeated"] or result["log_errors"])
    slow_growth = result["rss"]["mb_per_h"] < SLOPE_BAR_MB_PER_H or arguments.minutes < 30
    return 0 if good and slow_growth else 1


if __name__ == "__main__":
    sys.exit(main())
