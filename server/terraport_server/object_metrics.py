"""What is asked of object storage, for Prometheus; only where scenes lie there.

docs/topics/metrics.md lists every one; a test compares.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from prometheus_client import CollectorRegistry
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

if TYPE_CHECKING:
    from terraport_store.object_files import ObjectStorage

__all__ = ["ObjectMetrics"]

_COUNTERS: Final = {
    "requests": "Requests to object storage, repeated ones included",
    "retries": "Requests that were repeated",
    "failures": "Reads that were given up",
    "bytes": "Bytes received from object storage",
    "wrong": "Payloads that failed their hash, from storage or cache",
    "uncached": "Payloads that the cache on disk did not take",
}
"""Name, as in ObjectCounts, and meaning."""


class ObjectMetrics(Collector):
    """Reads the counts when it is asked; registers itself.

    Parameters
    ----------
    storage
        Where they are counted.
    registry
        Where they are shown.
    """

    def __init__(self, storage: ObjectStorage, registry: CollectorRegistry) -> None:
        self._storage = storage
        registry.register(self)

    def collect(self) -> Iterator[Metric]:
        """Yield every metric with its value now."""
        counts = self._storage.counts
        for name, meaning in _COUNTERS.items():
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
