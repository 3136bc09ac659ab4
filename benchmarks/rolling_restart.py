"""What a rolling restart costs the clients that land all the time, and a publication under it.

::

    python benchmarks/rolling_restart.py            # five rolls and three publications, two minutes
    python benchmarks/rolling_restart.py --smoke    # one of each

``terraport serve --workers 2`` over real sockets; clients of the Python SDK land at random places
without a pause and compare every byte. Reported: landings, connections, time from land to ready
while nothing happens and while workers are replaced, and what the service's memory is before and
after. Meanwhile the base mesh is fetched on one connection and ``/readyz`` on new ones. Fails (exit
status 1) where a landing or a request failed, or a segment was lost or sent twice.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import platform
import random
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import httpx
import numpy as np

import terraport

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from server.grid_scene import write_grid_scene
from server.supervised import Supervised

CELLS = 60
"""About 170 KB a segment, 6 MB a scene."""


class Trial:
    """One service and the clients that land in it."""

    def __init__(self, folder: Path, clients: int) -> None:
        self.scene = folder / "scenes" / "pit"
        self.versions: dict[str, list[bytes]] = {}
        self.publish(0)
        self.clients = clients
        self.over = asyncio.Event()
        self.ready_s: list[tuple[float, float]] = []
        """(when it began, how long it took) of every landing."""
        self.connections = 0
        self.repeated_bytes = 0

    def publish(self, seed: int) -> str:
        """Write a new version in the place of the old one, whose files are deleted."""
        grid = write_grid_scene(self.scene, seed=seed, cells=CELLS, compress=False)
        self.versions[grid.manifest.version] = grid.payloads
        return grid.manifest.version

    async def land(self, url: str, number: int) -> None:
        """Land until it is over; every third client comes back when it hears of a new version."""
        chance = random.Random(number)
        while not self.over.is_set():
            async with terraport.connect(f"{url}/scenes/pit", credit_bytes=500_000) as session:
                while not self.over.is_set():
                    began_s = time.monotonic()
                    position = (chance.uniform(0, 60), 1.0, chance.uniform(0, 60))
                    landing = await session.land(position, radius_m=chance.uniform(5, 25))
                    segments = await landing.ready(30)
                    self.ready_s.append((began_s, time.monotonic() - began_s))
                    payloads = self.versions[session.scene.version]
                    for segment in segments:
                        if segment.payload != payloads[segment.id]:
                            raise AssertionError(f"segment {segment.id} is not what was published")
                    await asyncio.sleep(0.1)
                    if number % 3 == 0 and session.newest_version is not None:
                        break
                self.connections += session.stats.connections
                self.repeated_bytes += session.stats.repeated_bytes


async def ask(url: str, over: asyncio.Event, *, keep: bool) -> tuple[int, int]:
    """Ask over HTTP all the time, on one connection or on a new one each time.

    Returns answers, and how many came at the second attempt: a connection that was idle for long
    may be closed in the moment of asking, and HTTP clients ask again. Any other failure is raised:
    a proxy's health check must not see a roll.
    """
    answers = again = 0
    async with httpx.AsyncClient() as kept:
        while not over.is_set():
            if keep:
                try:
                    answer = await kept.get(f"{url}/scenes/pit/base.glb")
                except httpx.RemoteProtocolError:
                    again += 1
                    answer = await kept.get(f"{url}/scenes/pit/base.glb")
            else:
                async with httpx.AsyncClient() as fresh:
                    answer = await fresh.get(f"{url}/readyz")
            answer.raise_for_status()
            answers += 1
            await asyncio.sleep(0.05)
    return answers, again


def resident_bytes(pids: list[int]) -> int:
    """Memory of processes together, what they share counted once for each."""
    pages = sum(int(Path(f"/proc/{pid}/statm").read_text().split()[1]) for pid in pids)
    return pages * os.sysconf("SC_PAGE_SIZE")


async def measure(folder: Path, rolls: int, publications: int, clients: int) -> dict[str, Any]:
    """Restart and publish under clients that land all the time; fail where one of them does."""
    trial = Trial(folder, clients)
    with Supervised(folder / "scenes", scene_poll_s="0.2", max_messages_per_s="1000") as service:
        tasks = [asyncio.create_task(trial.land(service.url, n)) for n in range(clients)]
        asking = [
            asyncio.create_task(ask(service.url, trial.over, keep=keep)) for keep in (True, False)
        ]

        async def story() -> dict[str, Any]:
            # Quiet, then restarts, then publications: landings are told apart by when they began.
            await asyncio.sleep(3.0)
            quiet_until_s = time.monotonic()
            memory = [resident_bytes(service.worker_pids()[-2:])]
            await asyncio.to_thread(service.roll, rolls)
            rolled_until_s = time.monotonic()
            for seed in range(1, publications + 1):
                await asyncio.to_thread(trial.publish, seed)
                await asyncio.sleep(1.5)
                memory.append(resident_bytes(service.worker_pids()[-2:]))
            # A roll moves every session to the newest version: the old ones go.
            await asyncio.to_thread(service.roll, 1)
            await asyncio.sleep(1.5)
            memory.append(resident_bytes(service.worker_pids()[-2:]))
            metrics = await asyncio.to_thread(service.metrics)
            return {
                "quiet_until_s": quiet_until_s,
                "rolled_until_s": rolled_until_s,
                "resident_mb": [round(value / 1e6, 1) for value in memory],
                "rolls": metrics["terraport_rolling_restarts_total{}"],
                "workers_died": metrics["terraport_worker_restarts_total{}"],
            }

        telling = asyncio.create_task(story())
        # Clients go on to the end, so the one that is done first is the story or a failure.
        done, _ = await asyncio.wait(
            [telling, *tasks, *asking], return_when=asyncio.FIRST_COMPLETED
        )
        for task in done:
            task.result()  # a client that failed says why
        timeline = await telling
        trial.over.set()
        await asyncio.gather(*tasks)
        http_answers = await asyncio.gather(*asking)
        if "Traceback" in service.log:
            raise AssertionError(service.log)
    # Landings before and during the restarts.
    quiet = [took for began, took in trial.ready_s if began < timeline["quiet_until_s"]]
    rolled = [
        took
        for began, took in trial.ready_s
        if timeline["quiet_until_s"] <= began < timeline["rolled_until_s"]
    ]
    return {
        "clients": clients,
        "rolls": timeline["rolls"],
        "publications": publications,
        "workers_died": timeline["workers_died"],
        "landings": len(trial.ready_s),
        "landings_failed": 0,
        "http_answers": {"one_connection": http_answers[0][0], "new_ones": http_answers[1][0]},
        "http_asked_again": http_answers[0][1],
        "connections": trial.connections,
        "repeated_bytes": trial.repeated_bytes,
        "ready_ms": {"quiet": _spread(quiet), "while_rolled": _spread(rolled)},
        "resident_mb_of_two_workers": timeline["resident_mb"],
    }


def _spread(seconds: list[float]) -> dict[str, float]:
    milliseconds = np.asarray(seconds) * 1000.0
    return {
        "landings": len(seconds),
        "p50": round(statistics.median(milliseconds), 1),
        "p99": round(float(np.percentile(milliseconds, 99)), 1),
        "max": round(float(milliseconds.max()), 1),
    }


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--smoke", action="store_true", help="one roll, one publication")
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="terraport-roll-"))
    try:
        rolls, publications, clients = (1, 1, 4) if options.smoke else (5, 3, 12)
        result = asyncio.run(
            asyncio.wait_for(measure(folder, rolls, publications, clients), timeout=280)
        )
    finally:
        shutil.rmtree(folder)
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    print(json.dumps({"machine": machine} | result, indent=2))
    return 0 if result["repeated_bytes"] == 0 and result["workers_died"] == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
