"""What the state machine reports, carried out: landings are filled, picks answered, the disk fed.

The receiving half of :class:`terraport.Session`, which gives the commands. Nothing here waits:
every event is carried out whole, in the call in which the connection or the disk brought it, so
who waits for a landing never sees half of one.

PURE: no I/O, no clock of its own, no task.
"""

from __future__ import annotations

from collections.abc import Callable

from terraport.cache import CachedSegment, SegmentFacts
from terraport.disk_worker import DiskWorker
from terraport.errors import LandingSupersededError, ServerError, TerraportError
from terraport.events import (
    Degraded,
    Dropped,
    Event,
    FetchNeeded,
    FetchStopped,
    LandingSent,
    Noticed,
    Opened,
    PayloadBegan,
    PickAnswered,
    PickRefused,
    Planned,
    Ready,
    Refused,
    RestoreNeeded,
    SegmentArrived,
    SegmentRejected,
    Superseded,
)
from terraport.group import GroupEvent, GroupRecord
from terraport.payloads import Scales
from terraport.session import ClientSession
from terraport.waiting import Waiting

__all__ = ["EventIntake"]


class EventIntake:
    """Carries out the events of one session. Lives on the session's event loop.

    Parameters
    ----------
    state : ClientSession
        Told what the disk has done.
    pump : callable
        Sends what `state` has to say after that.
    on_opened : callable
        Called at every welcome of the server, once :attr:`opened` has it.
    """

    def __init__(
        self, state: ClientSession, pump: Callable[[], None], on_opened: Callable[[], None]
    ) -> None:
        self._state = state
        self._pump = pump
        self._on_opened = on_opened
        self.waiting = Waiting()
        self.opened: Opened | None = None
        """The newest connection's welcome."""
        self.scales: Scales = {}
        """Of the served version's attributes; the session sets it before any plan is read."""
        self.on_fetch: Callable[[FetchNeeded | FetchStopped], None] | None = None
        """Set once by the session, where it may pull."""
        self.worker: DiskWorker | None = None
        """Set once by the session, where it has a disk cache."""
        self.group: GroupRecord | None = None
        """The seat that was taken last."""
        self.newest_version: str | None = None
        self.payload_bytes = self.rejected = 0

    def take(self, event: Event) -> None:
        """Carry out one event of the state machine."""
        if isinstance(event, SegmentArrived):
            self._arrived(event)
        elif isinstance(event, Opened):
            self.opened = event
            self._on_opened()
        elif isinstance(event, PickAnswered | PickRefused):
            self.waiting.answer_pick(event)
        elif isinstance(event, SegmentRejected):
            self._rejected(event)
        elif isinstance(event, FetchNeeded | FetchStopped):
            assert self.on_fetch is not None  # only then is it asked for
            self.on_fetch(event)
        elif isinstance(event, RestoreNeeded):
            self._restore(event)
        elif isinstance(event, Dropped) and self.worker is not None:
            self.worker.remove(dict(event.on_disk))
        elif isinstance(event, Noticed) and event.kind == "scene_published":
            self.newest_version = event.version
        elif self.group is not None and isinstance(event, GroupEvent):
            self.group.take(event)
        else:
            self._landing_changed(event)

    def fail(self, error: TerraportError) -> None:
        """Give everyone who waits the error."""
        self.waiting.fail(error)
        if self.group is not None:
            self.group.end(error)

    # ---- news of the disk worker

    def restored(self, entry: CachedSegment) -> None:
        """Hand on a segment that the state machine asked the disk for."""
        self._state.restored(entry)
        self._pump()

    def lost(self, segment: int) -> None:
        """Note that the disk cannot give it: the state machine asks the server."""
        self._state.lost(segment)
        self._pump()

    def stored(self, facts: SegmentFacts) -> None:
        """Note that a segment is on disk: memory may let it go, and it stays held."""
        self._state.stored_on_disk(facts)

    def removed(self, segments: list[int]) -> None:
        """Note what was deleted to make room."""
        self._state.removed_from_disk(segments)

    # ---- events

    def _landing_changed(self, event: Event) -> None:
        """Move a landing's record on; other events change nothing here.

        A landing that has ended has a blank record: what crossed with its end is lost there.
        """
        if isinstance(event, Planned):
            record = self.waiting.landing(event.landing)
            record.planned(event.plan, event.kept, self.scales)
            # A plan of a reconnect is of another server session, perhaps of another server.
            assert self.opened is not None  # no plan comes before the welcome
            record.trace.server_session = self.opened.session
        elif isinstance(event, Ready):
            record = self.waiting.end_landing(event.landing)
            record.trace.server = event.timings
            record.ready(event.shown, event.missing)
        elif isinstance(event, LandingSent):
            record = self.waiting.landing(event.landing)
            record.trace.sent_s = record.clock()
        elif isinstance(event, PayloadBegan):
            record = self.waiting.landing(event.landing)
            record.trace.first_byte_s = record.clock()
        elif isinstance(event, Degraded):
            self.waiting.landing(event.landing).degrade(event.segments)
        elif isinstance(event, Superseded):
            error = LandingSupersededError(event.landing, event.by)
            self.waiting.end_landing(event.landing).fail(error)
        elif isinstance(event, Refused) and event.landing is not None:
            self.waiting.end_landing(event.landing).fail(ServerError(event.code, event.message))

    def _arrived(self, event: SegmentArrived) -> None:
        entry = event.entry
        if not event.restored:
            self.payload_bytes += len(entry.payload)
            if self.worker is not None and not self._state.holdings.on_disk(entry.facts.segment):
                self.worker.store(entry)
        if event.landing is not None:
            source = "disk" if event.restored else "stream"
            self.waiting.landing(event.landing).arrive(entry, source)

    def _rejected(self, event: SegmentRejected) -> None:
        self.rejected += 1
        if event.landing is not None:
            self.waiting.landing(event.landing).rejected += 1
        # Wrong from the wire or from the file: no file of it is to be believed by the next run.
        if self.worker is not None:
            self.worker.remove({event.segment: event.expected})

    def _restore(self, event: RestoreNeeded) -> None:
        assert self.worker is not None  # only its catalogue knows such segments
        for segment in event.segments:
            xxh3 = self._state.holdings.hash_of(segment)
            assert xxh3 is not None
            self.worker.restore(segment, xxh3)
