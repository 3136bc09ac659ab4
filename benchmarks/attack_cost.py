"""What attacks cost an honest client: land to ready beside each of them.

::

    python benchmarks/attack_cost.py                       # about three minutes
    python benchmarks/attack_cost.py --only upgrades --seconds 20
    python benchmarks/attack_cost.py --only steps          # single messages alone
    python benchmarks/attack_cost.py --loop --only upgrades  # CPU of a step of the loop instead
    python benchmarks/attack_cost.py --bar                  # the worst, against the bar: 6 minutes
    python benchmarks/attack_cost.py --smoke               # a twelfth, another with each commit

``terraport serve`` with default settings and a token, as a process of its own, serves a scene of
99,856 segments, with strokes and labels. An honest client lands at places where it has not been yet
(radius 24 m: some 28 segments of 16 KiB), 50 times a second at most; beside "upgrades" it connects
anew for each landing.
The attackers of ``fuzz/attacks`` live in processes of their own; each comes from an address of its
own. Everything stays on 127.0.0.0/8 and ends with its time.

First, in this process: what the costliest messages that are known take to decode, and a landing
with a release factor of 4 to be planned, radius 24 and 500 m, by the share of the scene that is
held.

Then a line per attack: milliseconds of the honest client, land to ready and land to plan, landings
that failed or waited more than 20 s, how often the attackers did what they do, the service's share
of a core, by how much its memory grew (MB), and the bytes of its log. "never read": eight
connections that land and do not read.

``own_``: the same milliseconds without those in which the service's loop, or the client, could have
gone on and had no core (the longer of the two, landing by landing). Attackers and client take cores
that they would not take on machines of their own; what is left is the service's doing at most.

``--bar``: the attacks of ``AGAINST_BAR`` from ten addresses, and after them a line for each that is
beyond the bar: own p99 of land to ready more than twice that of nobody, or of plans more than
20 ms. With ``--only``: of them these.

``--control``: after each attack the same honest client once more, beside the same attackers who
now attack another service, a process of its own with the same scene: ``control_`` in its row. What
the client waits there more than beside nobody is the machine's doing, whose cores, caches and
network all share, and no service's alone. With ``--bar`` of those that are beyond it, and what they
are said to be beyond has it beside.

``--loop`` serves in this process and has no honest client: it measures how much CPU one step of the
event loop takes beside each attack. A landing is some five of them, so it says the same on a
machine that is busy with other work.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

sys.path.append(str(Path(__file__).resolve().parents[1] / "fuzz"))

from attacks.holders import HOLDER_ATTACKS
from attacks.load import ATTACKS
from attacks.requests import REQUEST_ATTACKS
from attacks.seats import SEAT_ATTACKS
from attacks.strangers import STRANGER_ATTACKS
from attacks.table import TABLE_ATTACKS, TABLE_STRANGER_ATTACKS
from parts.furnished_scene import furnish
from parts.honest_client import SCENE, TOKEN, Honest
from parts.loop_steps import LoopSteps
from parts.service_process import ServiceProcess
from parts.sparse_scene import write_sparse_scene
from parts.step_costs import landing_costs, message_costs

from terraport_server import BackgroundServer

SEGMENT_BYTES: Final = 16 << 10
MANY: Final = 10
SMOKE_SHARE: Final = 12
PROCESSES: Final = 2
"""Of the attackers: the machine has as many cores."""

STEPS: Final = "steps"
NOBODY: Final = "nobody"
ANEW: Final = "nobody, connecting anew"
JOINING: Final = "nobody, connecting anew and joining a group"
COMES_ANEW: Final = {
    ANEW, "upgrades", "all seats", *STRANGER_ATTACKS, *REQUEST_ATTACKS, *TABLE_STRANGER_ATTACKS
}  # fmt: skip
"""Beside these the honest client connects for each landing: what is attacked is the way in."""
JOINS: Final = {JOINING, *SEAT_ATTACKS}

TRIALS: Final[list[tuple[str | None, int]]] = [
    (NOBODY, 0),
    (ANEW, 0),
    (JOINING, 0),
    ("unknown type", 1),
    ("unknown type", MANY),
    ("unknown type, last", MANY),
    ("known type", MANY),
    ("empty frames", 1),
    ("empty frames", MANY),
    ("upgrades", 1),
    ("upgrades", MANY),
    ("landings at factor 4", 1),
    ("landings at factor 4", MANY),
    ("aims at factor 4", 1),
    ("landings never read", 1),
    ("landings, and never read", 1),
    *((name, MANY) for name in STRANGER_ATTACKS),
    ("requests", 1),
    *((name, MANY) for name in REQUEST_ATTACKS),
    *((name, MANY) for name in TABLE_ATTACKS),
    *((name, MANY) for name in HOLDER_ATTACKS),
    ("left seats", 1),
    *((name, MANY) for name in SEAT_ATTACKS if name != "left seats"),
    (NOBODY, 0),
]
"""Attack and how many attackers; nobody first and last."""


AGAINST_BAR: Final = (
    "unknown type", "empty frames", "upgrades", "aims at factor 4", "silent connections",
    "slow headers", "silent upgrades", "pings first", "pieces first", "half messages",
    "no upgrades", "requests", "odd requests", "short requests", "pipelined bodies",
    "chunks of a byte", "hellos of 400 KB", "guessed tokens", "a thousand ranges",
    "credit by the byte", "picks", "held again and again", "held out of order", "long picks",
    "comes and goes", "comes with all it holds", "deep messages", "closes first",
    "other protocols",
)  # fmt: skip
TIMES_IDLE: Final = 2.0
PLAN_BAR_MS: Final = 20.0
BAR_S: Final = 4.0


def attack(
    name: str,
    addresses: list[str],
    port: int,
    nice: int,
    begun: Any,
    stop: Any,
    ended: Any,
    cpu: Any,
) -> None:
    """Child process: attackers. On a machine of their own they would take the service no core."""
    os.nice(nice)
    begun.release()
    began_s, began_cpu_s = time.perf_counter(), time.process_time()
    with ThreadPoolExecutor(len(addresses)) as pool:
        counts = pool.map(
            lambda address: ATTACKS[name](port, SCENE, TOKEN, lambda: not stop.is_set(), address),
            addresses,
        )
    with ended.get_lock():
        ended.value += sum(counts)
    with cpu.get_lock():
        cpu.value += (time.process_time() - began_cpu_s) / (time.perf_counter() - began_s)


def start_attackers(
    name: str, attackers: int, port: int, nice: int
) -> tuple[list[Any], Any, Any, Any]:
    """Start so many attackers of one kind; return processes, event that ends them, count, cores."""
    context = multiprocessing.get_context("spawn")
    begun, stop, ended = context.Semaphore(0), context.Event(), context.Value("q", 0)
    cpu = context.Value("d", 0.0)
    addresses = addresses_of(attackers)
    shares = [addresses[number::PROCESSES] for number in range(PROCESSES)]
    others = [
        context.Process(
            target=attack, args=(name, share, port, nice, begun, stop, ended, cpu), daemon=True
        )
        for share in shares
        if share
    ]
    for other in others:
        other.start()
    for _ in others:
        begun.acquire(timeout=60)
    return others, stop, ended, cpu


def end_attackers(others: list[Any], stop: Any) -> None:
    """Let them stop, and make sure of it."""
    stop.set()
    for other in others:
        other.join(30)
        if other.is_alive():
            other.kill()


def measure_loop(scenes: Path, name: str, attackers: int, seconds: float) -> dict[str, Any]:
    """Measure the steps of the loop beside an attack for so many seconds of the loop's CPU.

    Attackers are threads here: the loop's clock counts its own thread alone.
    """
    stop = threading.Event()
    with (
        BackgroundServer(
            scenes, tokens_file=scenes.parent / "tokens", forwarded_allow_ips=""
        ) as server,
        ThreadPoolExecutor(max(1, attackers)) as pool,
    ):
        attacks = [
            pool.submit(
                ATTACKS[name], server.port, SCENE, TOKEN, lambda: not stop.is_set(), address
            )
            for address in addresses_of(attackers)
        ]
        loop = server._server._loop  # noqa: SLF001 - the one on which everything happens
        assert loop is not None
        steps = LoopSteps(loop)
        until_s = time.monotonic() + (60 if attackers else 2) * seconds
        while steps.cpu_s < seconds and time.monotonic() < until_s:
            time.sleep(0.05)
        row = steps.stop()
        stop.set()
        count = sum(attack.result() for attack in attacks)
        alive = server.service.ready
    return {"attack": name, "attackers": attackers, **row, "attacks": count, "alive": alive}


def addresses_of(attackers: int) -> list[str]:
    """Return where so many attackers come from."""
    return [f"127.0.0.{2 + number}" for number in range(attackers)]


def measure(
    service: ServiceProcess,
    side: int,
    name: str,
    attackers: int,
    seconds: float,
    nice: int,
    attacked: ServiceProcess | None = None,
) -> dict[str, Any]:
    """Land beside so many attackers of one kind, who attack this service or another one."""
    before_bytes = service.memory().anon
    port = service.port if attacked is None else attacked.port
    others, stop, ended, cpu = start_attackers(name, attackers, port, nice)
    # Until the service is in the middle of it, and has read labels and strokes: it answers before.
    time.sleep(min(3.0, seconds))
    honest = Honest(service.port, service.pid, side, anew=name in COMES_ANEW, joins=name in JOINS)
    began_s, cpu_s = time.perf_counter(), service.cpu_s()
    honest.land_until(began_s + seconds)
    took_s = time.perf_counter() - began_s
    cores = (service.cpu_s() - cpu_s) / took_s
    grown_bytes = service.memory().anon - before_bytes
    honest.close()
    end_attackers(others, stop)
    return {
        "attack": name,
        "attackers": attackers,
        **honest.row(),
        "grown_mb": round(grown_bytes / 1e6, 1),
        "attacks": ended.value,
        "attackers_cores": round(cpu.value, 2),
        "service_cores": round(cores, 2),
        "alive": service.alive,
    }


def measure_control(
    scenes: Path, side: int, name: str, attackers: int, seconds: float, nice: int
) -> dict[str, Any]:
    """Land at a service of one's own beside attackers of another one."""
    tokens = scenes.parent / "tokens"
    with (
        ServiceProcess(scenes, tokens_file=tokens, forwarded_allow_ips="") as service,
        ServiceProcess(scenes, tokens_file=tokens, forwarded_allow_ips="") as attacked,
    ):
        row = measure(service, side, name, attackers, seconds, nice, attacked)
    named = {f"control_{key}": value for key, value in row.items() if key.endswith("_ms")}
    return {"attack": name, "landings": row["landings"], "attacks": row["attacks"], **named}


def beyond_bar(rows: list[dict[str, Any]]) -> list[tuple[dict[str, Any], float]]:
    """Return rows of attacks beyond the bar, and ready's p99 over the best of those at rest."""
    idle = {
        anew: min(row["own_p99_ms"] for row in rows if row["attack"] == name)
        for anew, name in ((False, NOBODY), (True, ANEW))
    }
    beyond = []
    for row in rows:
        times = row["own_p99_ms"] / idle[row["attack"] in COMES_ANEW]
        if row["attackers"] and (times > TIMES_IDLE or row["own_plan_p99_ms"] > PLAN_BAR_MS):
            beyond.append((row, times))
    return beyond


def said_of(row: dict[str, Any], times: float, control: dict[str, Any]) -> str:
    """Say by how much an attack is beyond the bar, and what the client waits beside another's."""
    ready = f"own p99 {row['own_p99_ms']} ms, {times:.1f} times idle"
    plan = f"own plan p99 {row['own_plan_p99_ms']} ms"
    beside = f"{control['control_own_p99_ms']} and {control['control_own_plan_p99_ms']}"
    return f"{row['attack']}: {ready}; {plan}; while another is attacked {beside}"


def _commit_number() -> int:
    command = ["git", "rev-parse", "HEAD"]
    root = Path(__file__).resolve().parents[1]
    commit = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False).stdout
    return int(commit[:8] or "0", 16)


def main() -> int:
    form = argparse.RawTextHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each trial")
    parser.add_argument("--only", choices=[*ATTACKS, STEPS], action="append", help="repeatable")
    parser.add_argument("--bar", action="store_true", help="the worst, against the bar")
    parser.add_argument("--control", action="store_true", help="and while another is attacked")
    parser.add_argument("--loop", action="store_true")
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    seconds = 0.6 if arguments.smoke else arguments.seconds
    nice = (
        0 if arguments.smoke else 19
    )  # beside a whole CI run such a one takes half a minute to end
    segments = 10_000 if arguments.smoke or arguments.bar else 100_000
    if not arguments.bar and (not arguments.only or STEPS in arguments.only):
        rounds, side = (2, 100) if arguments.smoke else (15, 316)
        for row in (*message_costs(rounds), *landing_costs(side, rounds)):
            print(json.dumps(row), flush=True)
    if arguments.only == [STEPS]:
        return 0
    trials = [
        (name, count)
        for name, count in TRIALS
        if (not count or not arguments.only or name in arguments.only)
        and not (arguments.smoke and count == MANY and (name, 1) in TRIALS)
        and (count or name == NOBODY or not arguments.loop)
    ]
    if arguments.smoke:  # each begins a service of its own: four seconds
        trials = [trials[0], *trials[1 + _commit_number() % SMOKE_SHARE :: SMOKE_SHARE]]
    if arguments.bar:
        seconds = BAR_S
        wanted = [name for name in AGAINST_BAR if name in (arguments.only or AGAINST_BAR)]
        trials = [(NOBODY, 0), (ANEW, 0), *((name, MANY) for name in wanted)]
        trials += [(ANEW, 0), (NOBODY, 0)]
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="attacks-") as folder:
        scenes = Path(folder) / "scenes"
        scenes.mkdir()
        manifest = write_sparse_scene(
            scenes / SCENE, pack_bytes=segments * SEGMENT_BYTES, segment_bytes=SEGMENT_BYTES
        )
        furnish(scenes / SCENE)
        (Path(folder) / "tokens").write_text(f"all {TOKEN} +land +guide +teach +metrics\n")
        side = math.isqrt(manifest.counts.segments)
        right = True
        for name, count in trials:
            if arguments.loop:
                row = measure_loop(scenes, name, count, seconds)
                print(json.dumps(row), flush=True)
                right &= row["alive"]
                continue
            # A service of its own for each: what one attack leaves behind is not the next one's.
            log = Path(folder) / "log"
            log.unlink(missing_ok=True)
            with ServiceProcess(
                scenes, tokens_file=scenes.parent / "tokens", log=log, forwarded_allow_ips=""
            ) as service:
                row = measure(service, side, name, count, seconds, nice)
            row["log_bytes"] = log.stat().st_size
            print(json.dumps(row), flush=True)
            rows.append(row)
            right &= row["alive"] and row["landings"] > 0
            if arguments.control and count and not arguments.bar:
                print(json.dumps(measure_control(scenes, side, name, count, seconds, nice)))
        if arguments.bar and not arguments.loop:
            beyond = beyond_bar(rows)
            for row, times in beyond:
                control = measure_control(scenes, side, row["attack"], MANY, seconds, nice)
                print(said_of(row, times, control), flush=True)
            if not beyond:
                print("nothing is beyond the bar")
            right &= not beyond
    return 0 if right else 1


if __name__ == "__main__":
    sys.exit(main())
