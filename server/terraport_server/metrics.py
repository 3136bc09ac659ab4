"""Metrics of the service for Prometheus. All names begin with ``terraport_``.

docs/topics/metrics.md lists every one; a test compares. Labels are bounded: each takes its values
from a fixed set, but ``scene``, of which the first ``MAX_SCENE_LABELS`` have a name of their own.

With several workers prometheus_client adds up their values through files in
``PROMETHEUS_MULTIPROC_DIR``, which :func:`terraport_server.serving.run` sets before this is
imported.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Final

from prometheus_client import (
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    ProcessCollector,
    generate_latest,
)
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.multiprocess import MultiProcessCollector, mark_process_dead
from prometheus_client.registry import Collector

if TYPE_CHECKING:
    from terraport_store.object_files import ObjectStorage

__all__ = ["CONTENT_TYPE", "MAX_SCENE_LABELS", "Metrics", "ObjectMetrics"]

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"

MAX_SCENE_LABELS: Final = 100
"""Scenes with a label of their own; the others share ``other``. A folder may hold thousands."""

_LAG_PERIOD_S = 0.25

_SECONDS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30)
"""Half a millisecond (idle loopback) to half a minute (a large landing on a slow link)."""

_STATUS_CLASSES: Final = ("1xx", "2xx", "3xx", "4xx", "5xx")


class Metrics:
    """The counters of one service, in a registry of their own (a process may run several)."""

    def __init__(self) -> None:
        # Invariant: no label has more values than MAX_SCENE_LABELS, or a closed set, allows: what
        # a client sends never becomes one.
        self.registry = CollectorRegistry()
        self._scenes: set[str] = set()
        ProcessCollector(registry=self.registry)

        # Sessions
        self.sessions = self._gauge("sessions_active", "Sessions open now", ["scene"])
        self.stalled = self._gauge(
            "sessions_stalled", "Sessions that have payload to send and no credit from the client"
        )
        self.sessions_closed = self._counter(
            "sessions_closed",
            "Sessions that ended, by how: bye, lost, draining or an error code",
            ["reason"],
        )
        self.refused = self._counter(
            "refused", "Refused connections and requests, by reason", ["reason"]
        )
        self.errors = self._counter("errors", "Errors sent to clients", ["code"])

        # Landings
        self.landings = self._counter("landings", "Landings planned", ["scene"])
        self.plan_s = self._histogram(
            "landing_plan_seconds", "Land received to plan handed to the socket"
        )
        self.first_byte_s = self._histogram(
            "landing_first_byte_seconds",
            "Land received to first payload byte handed to the socket",
        )
        self.ready_s = self._histogram("landing_ready_seconds", "Land received to ready")
        self.payload_bytes = self._counter("payload_bytes", "Payload bytes sent", ["kind"])
        # Counted once per chunk: looked up once here, not each time.
        self.land_bytes = self.payload_bytes.labels("land")
        self.prefetch_bytes = self.payload_bytes.labels("prefetch")
        self.superseded = self._counter("superseded", "Generations ended unfinished", ["kind"])
        self.superseded_bytes = self._counter(
            "superseded_bytes", "Payload bytes planned and not sent for it", ["kind"]
        )
        self.picks = self._counter("picks", "Picks by outcome", ["outcome"])

        # Groups
        self.group_events = self._counter("group_events", "What happened in groups", ["event"])
        self.groups = self._gauge("groups_active", "Groups that have members now")
        self.group_members = self._gauge("group_members", "Sessions in a group now")

        # Payload
        self.payload_reads = self._counter(
            "payload_reads", "Segments or parts that a thread read before they could be sent"
        )
        self.corrupt_segments = self._counter(
            "corrupt_segments", "Payloads that failed their hash or could not be read", ["scene"]
        )
        self.rejected_segments = self._counter(
            "rejected_segments", "Segments that clients rejected"
        )

        # Access
        self.withdrawn = self._counter(
            "access_withdrawn", "Sessions closed because their token ran out or went", ["reason"]
        )
        self.key_reloads = self._counter(
            "key_reloads", "Files of tokens, keys and certificates read again", ["file", "outcome"]
        )

        # Process
        self.http_requests = self._counter(
            "http_requests", "HTTP requests answered, by class of status", ["status"]
        )
        self._http = {name: self.http_requests.labels(name) for name in _STATUS_CLASSES}
        self.loop_lag_s = self._histogram(
            "event_loop_lag_seconds", "How late a timer of the event loop fires"
        )

    def scene_label(self, scene_id: str) -> str:
        """Return the scene's label: its id, or ``other`` beyond the first hundred."""
        if scene_id in self._scenes:
            return scene_id
        if len(self._scenes) >= MAX_SCENE_LABELS:
            return "other"
        self._scenes.add(scene_id)
        return scene_id

    def answered(self, status: int) -> None:
        """Count one HTTP answer."""
        counter = self._http.get(f"{status // 100}xx")
        if counter is not None:
            counter.inc()

    def render(self) -> bytes:
        """Return all values in Prometheus' text format, of all workers where there are several."""
        folder = os.environ.get("PROMETHEUS_MULTIPROC_DIR")
        if folder is None:
            return generate_latest(self.registry)
        for path in Path(folder).glob("gauge_live*.db"):
            pid = path.stem.rpartition("_")[2]
            if not _is_running(int(pid)):
                mark_process_dead(pid)  # type: ignore[no-untyped-call]
        merged = CollectorRegistry()
        MultiProcessCollector(merged)  # type: ignore[no-untyped-call]
        return generate_latest(merged)

    async def watch_loop(self) -> None:
        """Measure the event loop's lag until cancelled."""
        while True:
            due_s = monotonic() + _LAG_PERIOD_S  # the loop's own time would hide its last step
            await asyncio.sleep(_LAG_PERIOD_S)
            self.loop_lag_s.observe(max(0.0, monotonic() - due_s))

    def _counter(self, name: str, meaning: str, labels: Sequence[str] = ()) -> Counter:
        return Counter(f"terraport_{name}", meaning, labels, registry=self.registry)

    def _gauge(self, name: str, meaning: str, labels: Sequence[str] = ()) -> Gauge:
        return Gauge(
            f"terraport_{name}",
            meaning,
            labels,
            registry=self.registry,
            multiprocess_mode="livesum",
        )

    def _histogram(self, name: str, meaning: str) -> Histogram:
        return Histogram(f"terraport_{name}", meaning, registry=self.registry, buckets=_SECONDS)


_OBJECT_COUNTERS: Final = {
    "requests": "Requests to object storage, repeated ones included",
    "retries": "Requests that were repeated",
    "failures": "Reads that were given up",
    "bytes": "Bytes received from object storage",
    "wrong": "Payloads that failed their hash, from storage or cache",
    "uncached": "Payloads that the cache on disk did not take",
}
"""Name, as in ObjectCounts, and meaning."""


class ObjectMetrics(Collector):
    """Metrics of object storage; registers itself.

    Parameters
    ----------
    storage
        Whose counts are shown.
    registry
        Where they are shown.
    """

    def __init__(self, storage: ObjectStorage, registry: CollectorRegistry) -> None:
        self._storage = storage
        registry.register(self)

    def collect(self) -> Iterator[Metric]:
        """Yield every metric with its value now."""
        counts = self._storage.counts
        for name, meaning in _OBJECT_COUNTERS.items():
            yield CounterMetricFamily(
                f"terraport_object_{name}", meaning, value=getattr(counts, name)
            )
        payloads = CounterMetricFamily(
            "terraport_object_payloads",
            "Payloads brought to hand, by where they came from",
            labels=["origin"],
        )
        payloads.add_metric(["storage"], counts.payloads_fetched)
        payloads.add_metric(["disk"], counts.payloads_from_disk)
        yield payloads
        yield GaugeMetricFamily(
            "terraport_object_memory_bytes",
            "Payloads kept in memory because the disk takes none",
            value=self._storage.shelf.memory_bytes,
        )


def _is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
