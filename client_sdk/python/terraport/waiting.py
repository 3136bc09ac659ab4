"""Who waits for what in a session: landings for their segments, picks for their answers."""

from __future__ import annotations

import asyncio
import time

from terraport.errors import ServerError, TerraportError
from terraport.events import PickAnswered, PickRefused
from terraport.landing import LandingRecord
from terraport_wire import Hit

__all__ = ["Waiting"]


class Waiting:
    """The open landings and picks of one session. Lives on one event loop."""

    def __init__(self) -> None:
        self._landings: dict[int, LandingRecord] = {}
        self._picks: dict[int, asyncio.Future[Hit | None]] = {}

    def begin_landing(self, number: int) -> LandingRecord:
        """Keep the record of a landing from now until it ends."""
        record = LandingRecord(number, time.monotonic, started_s=time.monotonic())
        self._landings[number] = record
        return record

    def landing(self, number: int) -> LandingRecord:
        """Return the record of an open landing; a blank one for a landing that is over."""
        return self._landings.get(number) or LandingRecord(number, time.monotonic, 0.0)

    def end_landing(self, number: int) -> LandingRecord:
        """Return the record of a landing that ends now."""
        record = self.landing(number)
        self._landings.pop(number, None)
        return record

    def begin_pick(self, request: int) -> asyncio.Future[Hit | None]:
        """Return what a pick's answer, or why there is none, will be set on."""
        answer: asyncio.Future[Hit | None] = asyncio.get_running_loop().create_future()
        self._picks[request] = answer
        return answer

    def end_pick(self, request: int) -> None:
        """Forget a pick, answered or not."""
        self._picks.pop(request, None)

    def answer_pick(self, event: PickAnswered | PickRefused) -> None:
        """Hand a pick's answer to who waits for it, if anybody still does."""
        answer = self._picks.get(event.request)
        if answer is None or answer.done():
            return
        if isinstance(event, PickAnswered):
            answer.set_result(event.hit)
        else:
            answer.set_exception(ServerError(event.code, event.message))

    def fail(self, error: TerraportError) -> None:
        """Give everyone who waits the error."""
        for record in self._landings.values():
            record.fail(error)
        self._landings.clear()
        for answer in self._picks.values():
            if not answer.done():
                answer.set_exception(error)
        self._picks.clear()
