"""What a history of the session corpus consists of, done to the Python client and told.

One step is a command given to a client's state machine, bytes that it receives, or the taking of
what it wants sent; what is told of it are the events, the bytes, and what the client shows and
holds then. ``README.md`` in ``session/`` has the form.
"""

from __future__ import annotations

import base64
import json
from dataclasses import replace
from math import floor
from pathlib import Path
from typing import Any, Final

from terraport import events as told
from terraport.cache import SegmentCache
from terraport.errors import ProtocolViolationError, UsageError
from terraport.session import ClientSession, SessionOptions
from terraport_wire import DecodeError, Direction, Hello, decode, encode

__all__ = ["PAYLOADS", "Step", "ToldSession", "difference", "read_histories"]

PAYLOADS: Final = 72
"""Ids of the corpus' scenes: 36 segments at up to two levels."""

Step = dict[str, Any]


class ToldSession:
    """The Python client's state machine, step by step.

    Parameters
    ----------
    options : dict
        Of the history.
    """

    def __init__(self, options: dict[str, Any]) -> None:
        own = dict(options)
        self.session = ClientSession(
            SessionOptions(client="corpus", **{k: own[k] for k in own if k != "cache_bytes"}),
            SegmentCache(own["cache_bytes"]),
        )
        self.steps: list[Step] = []
        self.events: list[told.Event] = []
        """Of the newest step."""
        self._before: dict[str, Any] = {
            "visible": [],
            "held": [],
            "unfinished": None,
            "aims": [0, 0, 0, 0],
        }

    def perform(self, do: list[Any]) -> Step:
        """Do one step; return it with what came of it."""
        step: Step = {"do": do}
        try:
            out = self._call(do[0], do[1:])
            if out:
                step["out"] = [base64.b64encode(data).decode() for data in out]
        except UsageError:
            step["refused"] = True
        except ProtocolViolationError:
            step["violation"] = True
        self.events = self.session.events()
        rows = [row for row in map(event_row, self.events) if row is not None]
        if rows:
            step["events"] = rows
        after = self._state()
        step |= {name: value for name, value in after.items() if value != self._before[name]}
        self._before = after
        self.steps.append(step)
        return step

    def _call(self, name: str, given: list[Any]) -> list[bytes]:
        session = self.session
        if name == "take":
            return [without_timings(data) for data in session.data_to_send()]
        if name == "receive":
            session.receive(base64.b64decode(given[0]))
        elif name == "text":
            session.receive(given[0])
        elif name == "connected":
            session.connected(offer_held=given[0])
        elif name == "lost":
            session.connection_lost()
        elif name in ("land", "gather"):
            names = ("inner_radius_m", "deadline_ms", "coarse_radius_m")
            own = dict(zip(names, given[2:], strict=False))
            command = session.land if name == "land" else session.group.gather
            command(numbers(given[0]), float(given[1]), **own)
        elif name == "aim":
            session.aim(numbers(given[0]), *map(float, given[1:]))
        elif name == "flush":
            session.flush_aim()
        elif name == "pick":
            session.pick(numbers(given[0]), None if given[1] is None else numbers(given[1]))
        elif name == "bye":
            session.bye()
        elif name == "join":
            session.group.join(*given)
        elif name == "leave":
            session.group.leave()
        elif name == "arrived":
            session.group.arrived(*given)
        else:
            raise ValueError(f"got the step {name!r}, expected one of the README's")
        return []

    def _state(self) -> dict[str, Any]:
        session, aims = self.session, self.session.aims
        held = [segment for segment in range(PAYLOADS) if segment in session.holdings]
        return {
            "visible": list(session.visible),
            "held": held,
            "unfinished": session.unfinished,
            "aims": [aims.landings, aims.hits, aims.prefetched_bytes, aims.used_bytes],
        }


def numbers(values: list[Any]) -> list[float]:
    """Return numbers; JSON has no word for NaN and infinity, a text has."""
    return [float(value) for value in values]


def without_timings(data: bytes) -> bytes:
    """A client may ask for the server's times; histories are of one that does not."""
    try:
        message = decode(data, Direction.CLIENT_TO_SERVER)
    except DecodeError:
        return data
    return encode(replace(message, timings=None)) if isinstance(message, Hello) else data


def event_row(event: told.Event) -> list[Any] | None:
    """One event as the corpus tells it; None for those that clients name in their own ways."""
    match event:
        case told.Opened():
            return ["opened", event.version_changed, event.held_count]
        case told.Planned():
            plan = event.plan
            load, keep = plan.load["id"].tolist(), plan.keep.tolist()
            return ["planned", event.landing, load, keep, plan.nearby.tolist()]
        case told.SegmentArrived():
            return ["arrived", event.landing, event.entry.facts.segment]
        case told.Degraded():
            return ["degraded", event.landing, list(event.segments)]
        case told.Ready():
            return ["ready", event.landing, list(event.shown), list(event.missing)]
        case told.Superseded():
            return ["superseded", event.landing, event.by]
        case told.Prefetched():
            return ["prefetched", event.segments, event.payload_bytes]
        case told.PickAnswered():
            return ["picked", event.request, None if event.hit is None else event.hit.segment]
        case told.PickRefused():
            return ["pick refused", event.request, event.code]
        case told.Refused():
            return ["refused", event.landing, event.code, event.fatal]
        case told.Noticed():
            return ["notice", event.kind]
        case told.GroupJoined():
            return ["joined", event.group, event.member, event.role]
        case told.GroupRoster():
            members = [
                [one.member, one.name, one.role, one.present, _millimetres(one.position)]
                for one in event.members
            ]
            return ["roster", members]
        case told.GroupCalled():
            called = event.gathering
            return ["called", called.gathering, called.guide, called.left_ms is not None]
        case told.GroupGathered():
            ready, degraded, missing = map(list, (event.ready, event.degraded, event.missing))
            return ["gathered", event.gathering, ready, degraded, missing]
        case told.GroupRefused():
            return ["group refused", event.request, event.code]
        case _:
            return None


def read_histories(path: Path) -> list[dict[str, Any]]:
    """Return the histories of a file, each message in its place."""
    first, *rest = map(json.loads, path.read_text(encoding="utf-8").splitlines())
    messages: list[str] = first["messages"]
    histories: list[dict[str, Any]] = []
    for line in rest:
        if "history" in line:
            histories.append(line | {"steps": []})
            continue
        do, told_then = line["do"], line["told"]
        if do[0] == "receive":
            do[1] = messages[do[1]]
        if "out" in told_then:
            told_then["out"] = [messages[number] for number in told_then["out"]]
        histories[-1]["steps"].append({"do": do} | told_then)
    return histories


def difference(history: dict[str, Any]) -> str | None:
    """Run a history; what the client does otherwise, or None."""
    client = ToldSession(history["options"])
    for number, expected in enumerate(history["steps"]):
        actual = client.perform(expected["do"])
        if actual != expected:
            return f"step {number}: got {actual}, expected {expected}"
    return None


def _millimetres(position: tuple[float, float, float] | None) -> list[int] | None:
    """A place in whole numbers: every language writes those alike."""
    return None if position is None else [floor(1000.0 * side + 0.5) for side in position]
