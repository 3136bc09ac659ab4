"""The picks of one client that are under way: a task each."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from terraport_server.metrics import Metrics
from terraport_server.session.interface import RunPick
from terraport_server.session.session import Session
from terraport_wire import Hit

__all__ = ["PickTasks"]


class PickTasks:
    """Runs picks and tells the session what came of them.

    Parameters
    ----------
    session
        The client's; it bounds how many there are.
    metrics
        Counters.
    run
        Answers a pick.
    answered
        Called when the session was told something.
    tell_failure
        Takes why a pick could not be answered, for the operator.
    """

    def __init__(
        self,
        session: Session,
        metrics: Metrics,
        run: Callable[[RunPick], Awaitable[Hit | None]],
        answered: Callable[[], None],
        tell_failure: Callable[[Exception], None],
    ) -> None:
        self._session = session
        self._metrics = metrics
        self._run = run
        self._answered = answered
        self._tell_failure = tell_failure
        self.tasks: set[asyncio.Task[None]] = set()
        """Under way; the owner cancels them and waits for them when it ends."""

    def start(self, action: RunPick) -> None:
        """Run a pick beside everything else."""
        task = asyncio.create_task(self._answer(action))
        self.tasks.add(task)
        task.add_done_callback(self.tasks.discard)

    async def _answer(self, action: RunPick) -> None:
        try:
            hit = await self._run(action)
        except Exception as error:  # noqa: BLE001 - told to the operator; the session goes on
            self._metrics.picks.labels("failed").inc()
            self._tell_failure(error)
            self._session.pick_failed(action.request)
        else:
            self._metrics.picks.labels("miss" if hit is None else "hit").inc()
            self._session.picked(action.request, hit)
        self._answered()
