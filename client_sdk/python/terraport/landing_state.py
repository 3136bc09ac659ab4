"""What the session knows of one landing or prefetch that is on its way.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from terraport.cache import SegmentFacts
from terraport_payload.types import AnyArray
from terraport_wire import Land, Plan, Prefetch, Timings

__all__ = ["LandingState", "PrefetchState", "facts_of_table", "ring_of"]


@dataclass(slots=True)
class LandingState:
    """One landing that the caller asked for, over as many generations as reconnecting takes."""

    number: int
    """The session's own number, the same over reconnects."""
    position: tuple[float, float, float]
    radius_m: float
    inner_radius_m: float | None
    deadline_ms: int | None
    stall_ms: int | None = None
    coarse_radius_m: float | None = None
    generation: int = -1
    """Generation on the present connection; -1 before it was sent there."""
    plan: Plan | None = None
    facts: dict[int, SegmentFacts] = field(default_factory=dict)
    """Of the load table, by id."""
    relost: dict[int, int] = field(default_factory=dict)
    """xxh3 of segments of ``keep`` that were lost here and asked for again, by id."""
    crossed: dict[int, tuple[SegmentFacts | None, int]] = field(default_factory=dict)
    """Facts (None when unknown) and xxh3 of segments rejected after this landing was asked for and
    before its plan came, by id: the plan may still keep them, and the server sends them again."""
    wanted: frozenset[int] = frozenset()
    """Ids of load and keep."""
    waiting: set[int] = field(default_factory=set)
    """Wanted ids whose payload is not in memory yet."""
    restoring: set[int] = field(default_factory=set)
    """Those of ``waiting`` that the disk is being asked for."""
    missing: set[int] = field(default_factory=set)
    """Ids of the latest ``ready.missing``."""
    inner: tuple[int, ...] | None = None
    """The declared inner set, until it has been reported."""
    ready_seen: bool = False
    timings: Timings | None = None
    """Of the newest ``ready``."""
    began: bool = False
    """Whether a chunk of it has come, in any of its generations."""
    pulled: bool = False
    """Whether its payload is fetched here, so that ``ready`` is not waited for (17)."""
    done: bool = False
    """Whether it became ready for the client."""

    def message(self, generation: int, max_radius_m: float = math.inf) -> Land:
        """Return the message that asks for it, of a server that allows so large a radius."""
        return Land(
            generation=generation,
            position=self.position,
            radius_m=self.radius_m,
            inner_radius_m=self.inner_radius_m,
            deadline_ms=self.deadline_ms,
            stall_ms=self.stall_ms,
            coarse_radius_m=ring_of(self.radius_m, self.coarse_radius_m, max_radius_m),
        )

    def begin(self, plan: Plan) -> None:
        """Take the plan of a generation, in place of any before."""
        self.plan = plan
        self.facts = facts_of_table(plan.load)
        self.relost = {}
        self.wanted = frozenset(self.facts) | {int(segment) for segment in plan.keep}
        self.waiting = set(self.facts)
        self.restoring = set()
        self.missing = set()
        self.inner = None
        self.ready_seen = False

    def expect_again(self, segment: int, facts: SegmentFacts | None, xxh3: int) -> None:
        """Wait for a segment of ``keep`` that is not here after all."""
        self.waiting.add(segment)
        if facts is None:
            self.relost[segment] = xxh3
        else:
            self.facts[segment] = facts

    @property
    def complete(self) -> bool:
        """Whether it is ready for the client (wire protocol, section 6.4, rule 5, and 17)."""
        return (self.ready_seen or self.pulled) and not self.waiting - self.missing

    @property
    def shown(self) -> tuple[int, ...]:
        """What it shows once complete: all that is wanted and whole, ascending id."""
        return tuple(sorted(self.wanted - self.waiting))


@dataclass(slots=True)
class PrefetchState:
    """What an aim brings."""

    generation: int
    facts: dict[int, SegmentFacts]
    waiting: set[int]
    payload_bytes: int

    @classmethod
    def of(cls, prefetch: Prefetch) -> PrefetchState:
        """Begin one."""
        facts = facts_of_table(prefetch.segments)
        return cls(prefetch.generation, facts, set(facts), prefetch.bytes)


def ring_of(radius_m: float, coarse_radius_m: float | None, max_radius_m: float) -> float | None:
    """Cut the ring to what the server allows: less coarse ground is better than no landing."""
    # One below the radius stays: it is a mistake, and is to be told.
    if coarse_radius_m is None or coarse_radius_m < radius_m:
        return coarse_radius_m
    return max(radius_m, min(coarse_radius_m, max_radius_m))


def facts_of_table(table: AnyArray) -> dict[int, SegmentFacts]:
    """Return the rows of a load table by id, in its order."""
    rows: Iterable[tuple[Any, ...]] = table.tolist()
    return {
        segment: SegmentFacts(segment, length, xxh3, faces, vertices, tuple(bounds.tolist()))
        for segment, length, xxh3, faces, vertices, bounds in rows
    }
