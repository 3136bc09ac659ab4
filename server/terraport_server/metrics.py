"""What the service counts, for Prometheus. All names begin with ``terraport_``."""

from __future__ import annotations

import asyncio

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

__all__ = ["CONTENT_TYPE", "Metrics"]

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"

_LAG_PERIOD_S = 0.25

_SECONDS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30)
"""Half a millisecond (idle loopback) to half a minute (a large landing on a slow link)."""


class Metrics:
    """The counters of one service, in a registry of their own (a process may run several)."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        name = "terraport_"
        self.sessions = Gauge(
            f"{name}sessions_active", "Sessions open now", ["scene"], registry=self.registry
        )
        self.landings = Counter(
            f"{name}landings", "Landings planned", ["scene"], registry=self.registry
        )
        self.first_byte_s = Histogram(
            f"{name}landing_first_byte_seconds",
            "Land received to first payload byte handed to the socket",
            registry=self.registry,
            buckets=_SECONDS,
        )
        self.ready_s = Histogram(
            f"{name}landing_ready_seconds",
            "Land received to ready",
            registry=self.registry,
            buckets=_SECONDS,
        )
        self.payload_bytes = Counter(
            f"{name}payload_bytes", "Payload bytes sent", ["kind"], registry=self.registry
        )
        # Counted once per chunk: looked up once here, not each time.
        self.land_bytes = self.payload_bytes.labels("land")
        self.aim_bytes = self.payload_bytes.labels("aim")
        self.superseded = Counter(
            f"{name}superseded", "Generations ended unfinished", ["kind"], registry=self.registry
        )
        self.superseded_bytes = Counter(
            f"{name}superseded_bytes",
            "Payload bytes planned and not sent for it",
            ["kind"],
            registry=self.registry,
        )
        self.errors = Counter(
            f"{name}errors", "Errors told to clients", ["code"], registry=self.registry
        )
        self.corrupt_segments = Counter(
            f"{name}corrupt_segments",
            "Payloads that failed their hash or could not be read",
            ["scene"],
            registry=self.registry,
        )
        self.rejected_segments = Counter(
            f"{name}rejected_segments", "Segments that clients rejected", registry=self.registry
        )
        self.picks = Counter(
            f"{name}picks", "Picks by outcome", ["outcome"], registry=self.registry
        )
        self.loop_lag_s = Histogram(
            f"{name}event_loop_lag_seconds",
            "How late a timer of the event loop fires",
            registry=self.registry,
            buckets=_SECONDS,
        )

    def render(self) -> bytes:
        """Return all values in Prometheus' text format."""
        return generate_latest(self.registry)

    async def watch_loop(self) -> None:
        """Measure the event loop's lag until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            due_s = loop.time() + _LAG_PERIOD_S
            await asyncio.sleep(_LAG_PERIOD_S)
            self.loop_lag_s.observe(max(0.0, loop.time() - due_s))
