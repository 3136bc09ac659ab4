from __future__ import annotations

import re
from pathlib import Path

from prometheus_client import CollectorRegistry, generate_latest

from terraport_server.object_metrics import ObjectMetrics
from terraport_store.object_files import ObjectStorage

PAGE = Path(__file__).resolve().parents[2] / "docs" / "topics" / "metrics.md"


def test_the_page_lists_every_metric_with_its_type_and_labels() -> None:
    page = PAGE.read_text().split("Only with object storage")[1]
    listed = {
        name: (kind, re.findall(r"(?:^ |; )`(\w+)`", labels))
        for name, kind, labels in re.findall(r"^\| `(\w+)` \| (\w+) \|([^|]*)\|", page, re.M)
    }
    with ObjectStorage() as storage:
        metrics = {}
        for family in ObjectMetrics(storage, CollectorRegistry()).collect():
            suffix = "_total" if family.type == "counter" else ""
            labels = sorted({label for sample in family.samples for label in sample.labels})
            metrics[family.name + suffix] = (family.type, labels)
    assert listed == metrics


def test_values_are_those_of_now() -> None:
    registry = CollectorRegistry()
    with ObjectStorage() as storage:
        ObjectMetrics(storage, registry)
        storage.counts.add(requests=3, bytes=500, payloads_from_disk=2)
        text = generate_latest(registry).decode()
    assert "terraport_object_requests_total 3.0" in text
    assert "terraport_object_bytes_total 500.0" in text
    assert 'terraport_object_payloads_total{origin="disk"} 2.0' in text
