"""Pages of several workers as one: sums, extremes, and what ended workers had counted."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.parser import text_string_to_metric_families

from terraport_server.merged_metrics import EndedWorkers, merge_pages


def page(landings: int, sessions: int, seconds: list[float], started: float = 7.0) -> str:
    """What a worker says, by the library that it says it with."""
    registry = CollectorRegistry()
    counter = Counter("landings", "L", ["scene"], registry=registry)
    counter.labels('pit "a"').inc(landings)
    Gauge("sessions", "S", registry=registry).set(sessions)
    Gauge("build_info", "B", ["version"], registry=registry).labels("1").set(1)
    Gauge("process_start_time_seconds", "P", registry=registry).set(started)
    Gauge("scene_changed_timestamp_seconds", "T", registry=registry).set(started)
    histogram = Histogram("ready_seconds", "R", registry=registry, buckets=(1, 2))
    for value in seconds:
        histogram.observe(value)
    return generate_latest(registry).decode()


def values(text: str) -> dict[str, float]:
    """Value by name and labels, as Prometheus' own parser reads it; `_created` left out."""
    return {
        f"{sample.name}{sorted(sample.labels.items())}": sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if not sample.name.endswith("_created")
    }


def test_two_pages_add_up() -> None:
    merged = values(merge_pages([page(2, 5, [0.5, 1.5], 9.0), page(40, 1, [3.0], 8.0)]))
    assert merged == {
        "landings_total[('scene', 'pit \"a\"')]": 42.0,
        "sessions[]": 6.0,
        "build_info[('version', '1')]": 1.0,
        "process_start_time_seconds[]": 9.0,
        "scene_changed_timestamp_seconds[]": 9.0,
        "ready_seconds_bucket[('le', '1.0')]": 1.0,
        "ready_seconds_bucket[('le', '2.0')]": 2.0,
        "ready_seconds_bucket[('le', '+Inf')]": 3.0,
        "ready_seconds_count[]": 3.0,
        "ready_seconds_sum[]": 5.0,
    }


def test_one_page_stays_as_it_is() -> None:
    alone = page(3, 2, [0.1])
    assert values(merge_pages([alone])) == values(alone)
    assert [line for line in merge_pages([alone]).splitlines() if line.startswith("#")] == [
        line for line in alone.splitlines() if line.startswith("#")
    ]


def test_counters_never_fall_when_a_worker_ends() -> None:
    ended = EndedWorkers()
    for _ in range(3):
        ended.add(page(10, 4, [1.5]))
    merged = values(ended.merged_with([page(1, 2, [])]))
    assert merged["landings_total[('scene', 'pit \"a\"')]"] == 31.0
    assert merged["ready_seconds_count[]"] == 3.0
    assert merged["sessions[]"] == 2.0  # gauges of who is gone are gone
    assert merged == values(ended.merged_with([page(1, 2, [])]))  # asking changes nothing


def test_a_worker_that_never_spoke_adds_nothing() -> None:
    ended = EndedWorkers()
    ended.add("")
    assert ended.merged_with(["", ""]) == ""
