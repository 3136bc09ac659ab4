"""What happened when in a landing, on both sides, as a file that people can open.

The client's times are its own clock's. The server's (``ready.timings``) count from its
receipt of ``land``, which the client cannot see; it lies between the moment when ``land`` was sent
and the plan's arrival less the time until the plan was sent. The middle is taken, and the file says
by how much that may be wrong.

Format: Chrome's trace events, which https://ui.perfetto.dev and ``chrome://tracing`` show.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from terraport_wire import Timings

__all__ = ["LandingTrace", "SegmentMark", "trace_document", "write_trace"]

_LANDING, _SEGMENTS, _SERVER = 1, 2, 3
_TRACKS: Final = {_LANDING: "landing", _SEGMENTS: "segments", _SERVER: "server"}


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
    server: Timings | None = None

    @property
    def server_began_s(self) -> tuple[float, float] | None:
        """When the server received ``land``, and by how much that may be wrong."""
        timings = self.server
        if timings is None or self.sent_s is None or self.plan_s is None:
            return None
        latest_s = self.plan_s - (timings.plan_us or 0) / 1e6
        half_s = max(0.0, (latest_s - self.sent_s) / 2)
        return self.sent_s + half_s, half_s


def trace_document(traces: Iterable[LandingTrace]) -> dict[str, Any]:
    """Return landings as one document of Chrome's trace-event format.

    Each landing is a process of three tracks: what its user waits for, its segments, its server.

    Parameters
    ----------
    traces : iterable of LandingTrace
        Of one clock; the first call of ``land`` is time 0.
    """
    listed = list(traces)
    origin_s = min((trace.started_s for trace in listed), default=0.0)
    events: list[dict[str, Any]] = []
    for trace in listed:
        events += _names(trace)
        events += _client_events(trace, origin_s)
        events += _server_events(trace, origin_s)
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


def _names(trace: LandingTrace) -> list[dict[str, Any]]:
    named = [("process_name", 0, f"landing {trace.number}")]
    named += [("thread_name", track, name) for track, name in _TRACKS.items()]
    return [
        {"name": kind, "ph": "M", "pid": trace.number, "tid": track, "args": {"name": name}}
        for kind, track, name in named
    ]


def _client_events(trace: LandingTrace, origin_s: float) -> list[dict[str, Any]]:
    def span(name: str, from_s: float | None, to_s: float | None, **facts: Any) -> dict[str, Any]:
        return _span(trace.number, _LANDING, name, from_s, to_s, origin_s, facts)

    facts = {
        "server_landing": f"{trace.server_session}-{trace.generation}",
        "position": trace.position,
        "radius_m": trace.radius_m,
        "segments": len(trace.segments),
        "streamed_bytes": sum(m.payload_bytes for m in trace.segments if m.source == "stream"),
        "ended_by": trace.ended_by,
    }
    streamed_s = [mark.at_s for mark in trace.segments if mark.source == "stream"]
    events = [
        span("landing", trace.started_s, trace.ready_s or trace.ended_s, **facts),
        span("send", trace.started_s, trace.sent_s),
        span("wait for plan", trace.sent_s, trace.plan_s),
        span("wait for first byte", trace.plan_s, trace.first_byte_s),
        span("stream", trace.first_byte_s, max(streamed_s, default=None)),
        span("swap", trace.ready_s, trace.swapped_s),
    ]
    for name, at_s in (("degraded", trace.degraded_s), ("ready", trace.ready_s)):
        if at_s is not None:
            events.append(_moment(trace.number, _LANDING, name, at_s, origin_s))
    before_s = trace.first_byte_s
    for mark in trace.segments:
        about = {"bytes": mark.payload_bytes, "source": mark.source}
        name = f"segment {mark.segment}"
        if mark.source == "stream" and before_s is not None:
            at = (trace.number, _SEGMENTS)
            events.append(_span(*at, name, before_s, mark.at_s, origin_s, about))
            before_s = mark.at_s
        else:
            events.append(_moment(trace.number, _SEGMENTS, name, mark.at_s, origin_s, about))
    return [event for event in events if event]


def _server_events(trace: LandingTrace, origin_s: float) -> list[dict[str, Any]]:
    began, timings = trace.server_began_s, trace.server
    if began is None or timings is None:
        return []
    received_s, wrong_s = began

    def at(microseconds: int | None) -> float | None:
        return None if microseconds is None else received_s + microseconds / 1e6

    def span(name: str, from_us: int | None, to_us: int | None, **facts: Any) -> dict[str, Any]:
        facts["clock_may_be_wrong_by_ms"] = round(wrong_s * 1e3, 3)
        return _span(trace.number, _SERVER, name, at(from_us), at(to_us), origin_s, facts)

    events = [
        span("server: landing", 0, timings.ready_us, credit_wait_ms=timings.credit_wait_us / 1e3),
        span("server: plan", 0, timings.plan_us),
        span("server: to first byte", timings.plan_us or 0, timings.first_byte_us),
        span("server: payload", timings.first_byte_us, timings.last_byte_us),
    ]
    return [event for event in events if event]


def _span(
    process: int,
    track: int,
    name: str,
    from_s: float | None,
    to_s: float | None,
    origin_s: float,
    facts: dict[str, Any],
) -> dict[str, Any]:
    """Return a span; nothing where its end or beginning is not known."""
    if from_s is None or to_s is None:
        return {}
    return {
        "name": name,
        "cat": _TRACKS[track],
        "ph": "X",
        "pid": process,
        "tid": track,
        "ts": _microseconds(from_s - origin_s),
        "dur": _microseconds(max(0.0, to_s - from_s)),
        "args": {key: value for key, value in facts.items() if value is not None},
    }


def _moment(
    process: int,
    track: int,
    name: str,
    at_s: float,
    origin_s: float,
    facts: dict[str, Any] | None = None,
) -> dict[str, Any]:
    return {
        "name": name,
        "cat": _TRACKS[track],
        "ph": "i",
        "s": "t",
        "pid": process,
        "tid": track,
        "ts": _microseconds(at_s - origin_s),
        "args": facts or {},
    }


def _microseconds(seconds: float) -> float:
    return round(seconds * 1e6, 1)
