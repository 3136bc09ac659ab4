"""Traces: the document, and landings that failed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from terraport.trace import LandingTrace, SegmentMark, trace_document, write_trace


def whole() -> LandingTrace:
    return LandingTrace(
        number=1,
        started_s=100.0,
        server_session="abc",
        generation=7,
        position=(1.0, 2.0, 3.0),
        radius_m=60.0,
        sent_s=100.001,
        plan_s=100.025,
        first_byte_s=100.030,
        ready_s=100.090,
        swapped_s=100.101,
        segments=[
            SegmentMark(3, 100.025, 50, "memory"),
            SegmentMark(1, 100.040, 1000, "stream"),
            SegmentMark(2, 100.080, 2000, "stream"),
        ],
    )


def by_name(document: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {event["name"]: event for event in document["traceEvents"] if event["ph"] != "M"}


def test_spans_of_the_client() -> None:
    events = by_name(trace_document([whole()]))
    spans = {
        name: (event["ts"], event["dur"]) for name, event in events.items() if event["ph"] == "X"
    }
    assert spans["landing"] == (0.0, 90_000.0)
    assert spans["send"] == (0.0, 1000.0)
    assert spans["wait for plan"] == (1000.0, 24_000.0)
    assert spans["wait for first byte"] == (25_000.0, 5000.0)
    assert spans["stream"] == (30_000.0, 50_000.0)
    assert spans["swap"] == (90_000.0, 11_000.0)
    assert spans["segment 1"] == (30_000.0, 10_000.0)
    assert spans["segment 2"] == (40_000.0, 40_000.0)
    assert events["segment 3"]["ph"] == "i"
    assert events["landing"]["args"]["streamed_bytes"] == 3000
    assert events["landing"]["args"]["server_landing"] == "abc-7"


def test_a_landing_that_failed_and_one_that_only_began() -> None:
    failed = LandingTrace(2, 5.0, sent_s=5.1, ended_by="LandingSupersededError", ended_s=6.0)
    began = LandingTrace(3, 5.5)
    document = trace_document([failed, began])
    names = [(event["pid"], event["name"]) for event in document["traceEvents"]]
    assert (2, "landing") in names
    assert (3, "landing") not in names
    events = by_name(document)
    assert events["landing"]["args"]["ended_by"] == "LandingSupersededError"
    assert events["landing"]["dur"] == 1_000_000.0
    assert trace_document([])["traceEvents"] == []


def test_the_file_is_what_viewers_read(tmp_path: Path) -> None:
    path = tmp_path / "landing.json"
    assert write_trace(path, [whole()]) == path.stat().st_size
    document = json.loads(path.read_text())
    assert document["displayTimeUnit"] == "ms"
    for event in document["traceEvents"]:
        assert {"name", "ph", "pid", "tid"} <= set(event)
        assert event["ph"] in {"M", "X", "i"}
        if event["ph"] == "X":
            assert event["ts"] >= 0
            assert event["dur"] >= 0
    tracks = {e["args"]["name"] for e in document["traceEvents"] if e["name"] == "thread_name"}
    assert tracks == {"landing", "segments"}
