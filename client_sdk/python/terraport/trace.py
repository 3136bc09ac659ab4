"""Traces of landings, as a file that people can open. Times are the client's own.

Format: Chrome's trace events, which https://ui.perfetto.dev and ``chrome://tracing`` show.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

__all__ = ["LandingTrace", "SegmentMark", "trace_document", "write_trace"]

_TRACKS: Final = {1: "landing", 2: "segments"}


@dataclass(frozen=True, slots=True)
class SegmentMark:
    """One segment that became whole."""

    segment: int
    at_s: float
    payload_bytes: int
    source: str
    """``"stream"``, ``"memory"`` or ``"disk"``."""


@dataclass(slots=True)
class LandingTrace:
    """Times of one landing. Seconds of one monotonic clock; None for what has not happened."""

    number: int
    started_s: float
    """When ``land`` was called."""
    server_session: str = ""
    generation: int | None = None
    """With the session, the landing's id in the server's log: SESSION-GENERATION."""
    position: tuple[float, float, float] | None = None
    radius_m: float | None = None
    sent_s: float | None = None
    plan_s: float | None = None
    first_byte_s: float | None = None
    degraded_s: float | None = None
    ready_s: float | None = None
    swapped_s: float | None = None
    """When the application showed it, where it says so (:meth:`Landing.swapped`)."""
    ended_by: str | None = None
    """Error that ended it before it was ready."""
    ended_s: float | None = None
    segments: list[SegmentMark] = field(default_factory=list)


def trace_document(traces: Iterable[LandingTrace]) -> dict[str, Any]:
    """Return landings as one document of Chrome's trace-event format.

    Each landing is a process of two tracks: what its user waits for, and its segments.

    Parameters
    ----------
    traces : iterable of LandingTrace
        Of one clock; the first call of ``land`` is time 0.
    """
    listed = list(traces)
    origin_s = min((trace.started_s for trace in listed), default=0.0)
    events = [event for trace in listed for event in _events(trace, origin_s)]
    return {"displayTimeUnit": "ms", "traceEvents": events}


def write_trace(path: str | Path, traces: Iterable[LandingTrace]) -> int:
    """Write landings as a file for https://ui.perfetto.dev; return its size in bytes.

    Parameters
    ----------
    path : Path
        ``.json``.
    traces : iterable of LandingTrace
        As :attr:`terraport.Landing.trace` gives them.
    """
    data = json.dumps(trace_document(traces), indent=0).encode()
    Path(path).write_bytes(data)
    return len(data)


def _events(trace: LandingTrace, origin_s: float) -> list[dict[str, Any]]:
    events: list[dict[str, Any]] = []

    def named(kind: str, track: int, name: str) -> None:
        about = {"name": kind, "ph": "M", "pid": trace.number, "tid": track}
        events.append(about | {"args": {"name": name}})

    def event(
        track: int, name: str, from_s: float | None, to_s: float | None, **facts: Any
    ) -> None:
        """Add a span, or a moment where both ends are the same; nothing where one is not known."""
        if from_s is None or to_s is None:
            return
        shape: dict[str, Any] = {"ph": "i", "s": "t"}
        if from_s is not to_s:
            shape = {"ph": "X", "dur": _microseconds(max(0.0, to_s - from_s))}
        about = {"name": name, "cat": _TRACKS[track], "pid": trace.number, "tid": track}
        about |= {"ts": _microseconds(from_s - origin_s)} | shape
        known = {key: value for key, value in facts.items() if value is not None}
        events.append(about | {"args": known})

    named("process_name", 0, f"landing {trace.number}")
    for track, name in _TRACKS.items():
        named("thread_name", track, name)
    streamed = [mark for mark in trace.segments if mark.source == "stream"]
    event(
        1,
        "landing",
        trace.started_s,
        trace.ready_s or trace.ended_s,
        server_landing=f"{trace.server_session}-{trace.generation}",
        position=trace.position,
        radius_m=trace.radius_m,
        segments=len(trace.segments),
        streamed_bytes=sum(mark.payload_bytes for mark in streamed),
        ended_by=trace.ended_by,
    )
    event(1, "send", trace.started_s, trace.sent_s)
    event(1, "wait for plan", trace.sent_s, trace.plan_s)
    event(1, "wait for first byte", trace.plan_s, trace.first_byte_s)
    last_s = max((mark.at_s for mark in streamed), default=None)
    event(1, "stream", trace.first_byte_s, last_s)
    event(1, "swap", trace.ready_s, trace.swapped_s)
    event(1, "degraded", trace.degraded_s, trace.degraded_s)
    event(1, "ready", trace.ready_s, trace.ready_s)
    before_s = trace.first_byte_s
    for mark in trace.segments:
        began_s = mark.at_s
        if mark.source == "stream" and before_s is not None:
            began_s, before_s = before_s, mark.at_s
        name, about = f"segment {mark.segment}", {"bytes": mark.payload_bytes}
        event(2, name, began_s, mark.at_s, **about, source=mark.source)
    return events


def _microseconds(seconds: float) -> float:
    return round(seconds * 1e6, 1)
