"""Metrics: the page that lists them, bounded labels, and values of real sessions."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from eventually import eventually
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.parser import text_string_to_metric_families
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient

from terraport_server import BackgroundServer, Settings
from terraport_server.metrics import MAX_SCENE_LABELS, Metrics, ObjectMetrics
from terraport_server.service import METRIC_PAGES_PER_S, Service
from terraport_server.session.rate_limit import RateLimit
from terraport_store.object_files import ObjectStorage
from terraport_wire import Bye, Credit, Plan, Ready

PAGE = Path(__file__).resolve().parents[2] / "docs" / "topics" / "metrics.md"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BackgroundServer]:
    folder = tmp_path_factory.mktemp("metrics")
    write_grid_scene(folder / "pit")
    with BackgroundServer(folder, max_sessions_per_ip=3) as running:
        yield running


def value(server: BackgroundServer, name: str, **labels: str) -> float:
    """Return a sample's value; 0 where there is none yet."""
    for family in text_string_to_metric_families(httpx.get(f"{server.url}/metrics").text):
        for sample in family.samples:
            if sample.name == name and sample.labels == labels:
                return float(sample.value)
    return 0.0


def test_the_page_lists_every_metric_with_its_type_and_labels() -> None:
    page = PAGE.read_text().split("Only with object storage")[0]
    listed = {}
    for name, kind, labels in re.findall(r"^\| `(\w+)` \| (\w+) \|([^|]*)\|", page, re.M):
        listed[name] = (kind, sorted(re.findall(r"(?:^ |; )`(\w+)`", labels)))
    metrics = {}
    for family in Metrics().registry._collector_to_names:
        described = list(getattr(family, "describe", list)())
        for metric in described:
            suffix = "_total" if metric.type == "counter" else ""
            metrics[metric.name + suffix] = (metric.type, sorted(family._labelnames))
    assert listed == {name: row for name, row in metrics.items() if name.startswith("terraport_")}


def test_asked_again_and_again_few_pages_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each took 2 ms of the event loop, of every process, as often as anybody asked."""

    async def story() -> list[bytes]:
        pages = [service.render_metrics() for _ in range(300)]
        clock_s[0] += 1.0
        return [*pages, service.render_metrics()]

    service, clock_s, written = Service(Settings(scenes_dir=tmp_path)), [1e6], list[int]()
    service._metric_pages = RateLimit(METRIC_PAGES_PER_S, now_s=clock_s[0])
    monkeypatch.setattr("terraport_server.service.time.monotonic", lambda: clock_s[0])

    def write() -> bytes:
        written.append(0)
        return b"page %d" % len(written)

    monkeypatch.setattr(service.metrics, "render", write)
    pages = asyncio.run(story())
    assert len(written) == 101
    assert pages[99:] == [b"page 100"] * 201 + [b"page 101"]


def test_scene_labels_are_bounded() -> None:
    metrics = Metrics()
    labels = {metrics.scene_label(f"scene{number}") for number in range(MAX_SCENE_LABELS + 50)}
    assert len(labels) == MAX_SCENE_LABELS + 1
    assert "other" in labels
    assert metrics.scene_label("scene0") == "scene0"


def test_a_session_is_counted_from_opening_to_bye(server: BackgroundServer) -> None:
    before = value(server, "terraport_landings_total", scene="pit")
    plans = value(server, "terraport_landing_plan_seconds_count")
    byes = value(server, "terraport_sessions_closed_total", reason="bye")
    with PlainClient(server.scene_url("pit")) as client:
        client.hello()
        assert value(server, "terraport_sessions_active", scene="pit") == 1
        client.land(1, (30.0, 0.0, 30.0), 20.0)
        client.until(Ready)
        client.send(Bye())
        client.closed()
    eventually(lambda: value(server, "terraport_sessions_active", scene="pit") == 0)
    assert value(server, "terraport_landings_total", scene="pit") == before + 1
    assert value(server, "terraport_landing_plan_seconds_count") == plans + 1
    assert value(server, "terraport_payload_bytes_total", kind="land") >= client.taken_bytes > 0
    assert value(server, "terraport_sessions_closed_total", reason="bye") == byes + 1
    assert value(server, "terraport_http_requests_total", status="2xx") > 0
    assert value(server, "process_resident_memory_bytes") > 1 << 20


def test_a_client_without_credit_is_stalled_until_it_grants_or_goes(
    server: BackgroundServer,
) -> None:
    with PlainClient(server.scene_url("pit")) as client:
        client.hello(credit_bytes=1000)
        client.land(1, (30.0, 0.0, 30.0), 20.0)
        client.expect(Plan)
        eventually(lambda: value(server, "terraport_sessions_stalled") == 1)
        client.send(Credit(bytes=1 << 30))
        client.until(Ready)
        assert value(server, "terraport_sessions_stalled") == 0
        client.land(2, (0.0, 0.0, 0.0), 1.0)
        client.until(Ready)
    lost = value(server, "terraport_sessions_closed_total", reason="lost")
    with PlainClient(server.scene_url("pit")) as client:
        client.hello(credit_bytes=1000)
        client.land(1, (30.0, 0.0, 30.0), 20.0)
        eventually(lambda: value(server, "terraport_sessions_stalled") == 1)
        client.socket.socket.close()
    eventually(lambda: value(server, "terraport_sessions_stalled") == 0)
    assert value(server, "terraport_sessions_closed_total", reason="lost") == lost + 1


def test_refusals_are_counted_by_reason(server: BackgroundServer) -> None:
    url = server.scene_url("pit")
    with PlainClient(url) as one, PlainClient(url) as two, PlainClient(url) as three:
        for client in (one, two, three):
            client.hello()
        with PlainClient(url) as fourth:
            fourth.refused()
    assert value(server, "terraport_refused_total", reason="sessions_per_ip") == 1
    with PlainClient(server.scene_url("atlantis")) as client:
        client.refused()
    assert value(server, "terraport_refused_total", reason="unknown_scene") == 1
    with PlainClient(url, origin="http://evil.example") as client:
        client.refused()
    assert value(server, "terraport_refused_total", reason="origin") == 1


def test_object_storage_has_metrics_of_its_own() -> None:
    page = PAGE.read_text().split("Only with object storage")[1]
    listed = {
        name: (kind, re.findall(r"(?:^ |; )`(\w+)`", labels))
        for name, kind, labels in re.findall(r"^\| `(\w+)` \| (\w+) \|([^|]*)\|", page, re.M)
    }
    registry = CollectorRegistry()
    with ObjectStorage() as storage:
        metrics = {}
        for family in ObjectMetrics(storage, registry).collect():
            suffix = "_total" if family.type == "counter" else ""
            labels = sorted({label for sample in family.samples for label in sample.labels})
            metrics[family.name + suffix] = (family.type, labels)
        storage.counts.add(requests=3, bytes=500, payloads_from_disk=2)
        text = generate_latest(registry).decode()
    assert listed == metrics
    assert "terraport_object_requests_total 3.0" in text
    assert 'terraport_object_payloads_total{origin="disk"} 2.0' in text
