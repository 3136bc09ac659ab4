"""A client of protocol 2 from its specification: messages and frames in, what is shown out.

No I/O: tests of the session and of sockets feed it.
"""

from __future__ import annotations

import gzip
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from terraport_wire import COARSER, Frame, Land, Message, Plan, Prefetch, Ready


@dataclass
class LandingClient:
    """What one client has and shows; ``have`` outlives a connection."""

    have: dict[int, bytes] = field(default_factory=dict)
    """Payload by key."""
    shown: set[tuple[int, bool]] = field(default_factory=set)
    """Segment and whether it is of the coarser level."""
    hidden: bytes = b""
    """Bits of the base faces that are hidden."""
    shown_generation: int = -1
    taken_bytes: int = 0
    arrived: list[int] = field(default_factory=list)
    """Keys of the segments that came whole, in order."""
    plan: Plan | None = None
    ready: Ready | None = None
    _generation: int = 0
    _landing: int = 0
    """Generation of the newest landing: answers to older ones are skipped."""
    _key: int | None = None
    _part: bytearray = field(default_factory=bytearray)

    @property
    def is_landing(self) -> bool:
        """Whether the newest landing is not shown yet: nothing may be dropped until it is."""
        return self._landing > 0 and self.shown_generation != self._landing

    def connected(self) -> None:
        """Begin a new connection."""
        self.taken_bytes = self._generation = 0
        self.plan = self.ready = self._key = None
        self._landing = 0
        self.shown_generation = -1

    def land(self, position: Any, radius_m: float, **fields: Any) -> Land:
        """Return the landing to send."""
        self._generation += 1
        self._landing = self._generation
        self.plan = self.ready = None
        return Land(**self._place(position, radius_m), **fields)

    def refused(self, before: int) -> None:
        """Go on with an earlier landing: the newest one was refused."""
        self._landing = before

    def prefetch(self, position: Any, radius_m: float, **fields: Any) -> Prefetch:
        """Return the prefetch to send."""
        self._generation += 1
        return Prefetch(**self._place(position, radius_m), **fields)

    def _place(self, position: Any, radius_m: float) -> dict[str, Any]:
        have = np.array(list(self.have), "<u8")
        return {
            "generation": self._generation,
            "position": position,
            "radius_m": radius_m,
            "have": have,
            "taken_bytes": self.taken_bytes,
        }

    def take_frame(self, frame: Frame) -> None:
        """Take a piece of payload."""
        self.taken_bytes += len(frame.data)
        if frame.offset == 0:
            self._key, self._part = frame.key, bytearray()
        assert (frame.key, frame.offset) == (self._key, len(self._part)), frame
        self._part += frame.data
        if len(self._part) == frame.total:
            self.have[frame.key] = bytes(self._part)
            self.arrived.append(frame.key)
            self._key = None
        self._swap()

    def take_message(self, message: Message) -> None:
        """Take a plan or a ready."""
        if isinstance(message, Plan | Ready) and message.generation != self._landing:
            return
        if isinstance(message, Plan):
            self.plan = message
        elif isinstance(message, Ready):
            self.ready = message
        self._swap()

    def _swap(self) -> None:
        """Show the landing if all of it is here or missing."""
        plan = self.plan
        if plan is None:
            return
        missing = set[int]()
        hidden = plan.hidden
        if self.ready is not None and self.ready.missing is not None:
            missing = set(self.ready.missing.tolist())
            hidden = self.ready.hidden
        rows = [row for row in plan.show.tolist() if row[0] not in missing]
        if all(row[0] in self.have for row in rows):
            assert hidden is not None
            self.shown = {(row[1], bool(row[5] & COARSER)) for row in rows}
            self.hidden = gzip.decompress(hidden)
            self.shown_generation = plan.generation
            self.plan = None
