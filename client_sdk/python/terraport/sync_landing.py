"""A landing without asyncio; see :mod:`terraport.sync`."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Iterator
from typing import Any

from terraport.landing import Landing as AsyncLanding
from terraport.landing import LandingStats
from terraport.segment import Segment
from terraport.trace import LandingTrace
from terraport_wire import Plan

__all__ = ["Landing"]


class Landing:
    """A :class:`terraport.Landing` whose methods block."""

    def __init__(
        self, landing: AsyncLanding, wait: Callable[[Coroutine[Any, Any, Any]], Any]
    ) -> None:
        self._landing = landing
        self._wait = wait

    @property
    def number(self) -> int:
        """1 for the session's first landing, and so on."""
        return self._landing.number

    @property
    def plan(self) -> Plan:
        """The server's plan."""
        return self._landing.plan

    @property
    def outside_m(self) -> float | None:
        """How far outside the scene it is; see :attr:`terraport.Landing.outside_m`."""
        return self._landing.outside_m

    @property
    def is_ready(self) -> bool:
        """Whether it is whole (but for :attr:`missing`)."""
        return self._landing.is_ready

    @property
    def missing(self) -> tuple[int, ...]:
        """Ids of the plan that could not be delivered; empty until ready."""
        return self._landing.missing

    @property
    def segments(self) -> tuple[Segment, ...]:
        """What of the plan is here, ascending id."""
        return self._landing.segments

    @property
    def stats(self) -> LandingStats:
        """Times, counts and bytes so far."""
        return self._landing.stats

    @property
    def trace(self) -> LandingTrace:
        """What happened when; see :attr:`terraport.Landing.trace`."""
        return self._landing.trace

    def swapped(self) -> None:
        """Note that the application shows this landing; see :meth:`terraport.Landing.swapped`."""
        self._landing.swapped()

    def ready(
        self, timeout_s: float | None = None, *, allow_missing: bool = False
    ) -> tuple[Segment, ...]:
        """Wait until every segment is here; see :meth:`terraport.Landing.ready`."""
        segments: tuple[Segment, ...] = self._wait(
            self._landing.ready(timeout_s, allow_missing=allow_missing)
        )
        return segments

    def presentable(self, timeout_s: float | None = None) -> tuple[Segment, ...]:
        """Wait until something whole can be shown; see :meth:`terraport.Landing.presentable`."""
        segments: tuple[Segment, ...] = self._wait(self._landing.presentable(timeout_s))
        return segments

    def __iter__(self) -> Iterator[Segment]:
        """Iterate over the segments as they arrive."""
        arriving = self._landing.__aiter__()

        async def following() -> Segment | None:
            return await anext(arriving, None)

        while (segment := self._wait(following())) is not None:
            yield segment

    def __repr__(self) -> str:
        return repr(self._landing)
