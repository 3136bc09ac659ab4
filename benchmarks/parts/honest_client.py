"""A client that lands where it has not been, beside attackers, and what it waits for.

Of each landing: milliseconds to plan and ready, and the same without those in which the service's
loop or the client waited for a core (:mod:`parts.core_waits`).
"""

from __future__ import annotations

import math
import os
import secrets
import statistics
import time
from collections.abc import Iterator
from typing import Final

from parts.core_waits import CoreWaits
from parts.drain_client import DrainClient
from parts.random_scene import TILE_M

from terraport_wire import Join, Joined, Leave

__all__ = ["SCENE", "TOKEN", "Honest"]

TOKEN: Final = "a-token-of-enough-characters"
SCENE: Final = "pit"
RADIUS_M: Final = 24.0
PAUSE_S: Final = 0.02
GRANT_BYTES: Final = 16 << 20
SLOWEST_S: Final = 20.0
HONEST: Final = "127.0.1.1"
"""Where it comes from: it is counted like everybody else."""


class Honest:
    """A client that lands where it has not been, and is measured.

    Parameters
    ----------
    port, pid : int
        Of the service.
    side : int
        Segments along each edge of the scene.
    anew : bool
        Whether to connect for each landing; that counts, too.
    joins : bool
        Whether to join a group of its own, connecting anew, before each landing.
    """

    def __init__(self, port: int, pid: int, side: int, *, anew: bool, joins: bool = False) -> None:
        self._port = port
        self._waits = CoreWaits(pid, os.getpid())
        self._places = self._all_places(side)
        self._anew = anew or joins
        self._joins = joins
        self._client: DrainClient | None = None
        self._taken_bytes = 0
        self.ready_ms: list[float] = []
        self.plan_ms: list[float] = []
        self.own_ready_ms: list[float] = []
        self.own_plan_ms: list[float] = []
        self.failed = 0

    def land_until(self, end_s: float) -> None:
        """Land again and again until `end_s` of the performance counter, and count failures."""
        while time.perf_counter() < end_s:
            began_s = time.perf_counter()
            self._waits.longest_ms()
            try:
                plan_wait_ms = self._land()
            except (OSError, AssertionError, ValueError):  # cut off, refused, or no handshake
                self.failed += 1
                self.close()
            else:
                self.ready_ms.append(1e3 * (time.perf_counter() - began_s))
                wait_ms = plan_wait_ms + self._waits.longest_ms()
                self.own_ready_ms.append(self.ready_ms[-1] - wait_ms)
            time.sleep(PAUSE_S)

    def row(self) -> dict[str, float]:
        """Return counts and percentiles of what was measured."""
        return {
            "landings": len(self.ready_ms),
            "failed": self.failed,
            **_percentiles("", self.ready_ms),
            **_percentiles("own_", self.own_ready_ms),
            **_percentiles("plan_", self.plan_ms),
            **_percentiles("own_plan_", self.own_plan_ms),
        }

    def close(self) -> None:
        """Drop the connection."""
        if self._client is not None:
            self._client.close()
            self._client = None

    def _land(self) -> float:
        """Land; return how long of it, up to the plan, was waiting for a core."""
        if self._client is None:
            self._taken_bytes = 0
            self._client = DrainClient("127.0.0.1", self._port, SCENE, address=HONEST)
            self._client.socket.settimeout(SLOWEST_S)
            self._client.hello(token=TOKEN)
            if self._joins:
                self._client.send(Join(request=1, group=secrets.token_hex(8), role="guide"))
                answer = self._client.message()
                assert isinstance(answer, Joined), answer
        began_s = time.perf_counter()
        before_ms = self._waits.longest_ms()
        plan = self._client.begin(next(self._places), RADIUS_M)
        self.plan_ms.append(1e3 * (time.perf_counter() - began_s))
        wait_ms = self._waits.longest_ms()
        self.own_plan_ms.append(self.plan_ms[-1] - wait_ms)
        got = self._client.drain()
        assert got == plan.load_bytes, f"{got} bytes, expected {plan.load_bytes}"
        self._taken_bytes += got
        if self._anew:
            if self._joins:
                self._client.send(Leave())
            self.close()
        elif self._taken_bytes > GRANT_BYTES:
            self._client.grant(self._taken_bytes)
            self._taken_bytes = 0
        return before_ms + wait_ms

    @staticmethod
    def _all_places(side: int) -> Iterator[tuple[float, float, float]]:
        step = 2 * RADIUS_M + 2 * TILE_M
        count = int(side * TILE_M / step) - 1
        while True:
            for number in range(count * count):
                yield (step * (1 + number % count), 0.5, step * (1 + number // count))


def _percentiles(prefix: str, ms: list[float]) -> dict[str, float]:
    """Return median, 99th percentile and longest."""
    if not ms:
        return {f"{prefix}{name}": math.inf for name in ("p50_ms", "p99_ms", "max_ms")}
    ordered = sorted(ms)
    p99 = ordered[min(len(ordered) - 1, int(0.99 * len(ordered)))]
    named = {"p50_ms": statistics.median(ms), "p99_ms": p99, "max_ms": ordered[-1]}
    return {f"{prefix}{name}": round(value, 1) for name, value in named.items()}
