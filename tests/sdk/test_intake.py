"""What the session does with each event: a real state machine, a noted disk, no connection."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
import pytest
from store.tiny_scene import SCALES, STEP_M, lattice_mesh

from terraport.cache import CachedSegment, SegmentCache, SegmentFacts
from terraport.disk_worker import DiskWorker
from terraport.errors import HttpError, LandingSupersededError, ServerError, SessionClosedError
from terraport.events import (
    Degraded,
    Dropped,
    Event,
    Noticed,
    PayloadBegan,
    Ready,
    Refused,
    RestoreNeeded,
    SegmentArrived,
    SegmentRejected,
    Superseded,
)
from terraport.intake import EventIntake
from terraport.landing import LandingRecord
from terraport.segment import Segment
from terraport.session import ClientSession, SessionOptions
from terraport_payload import AttributeScale, encode_segment
from terraport_wire import Plan

ENTRY = CachedSegment(SegmentFacts(7, 3, 99, 1, 3, (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)), b"abc")
PLAN = Plan(
    generation=1,
    position=(0.0, 0.0, 0.0),
    radius_m=60.0,
    release_radius_m=75.0,
    effective_radius_m=60.0,
    inner_count=0,
    load=[],
    keep=[7],
    nearby=[],
    load_bytes=0,
    load_triangles=0,
    total_bytes=0,
    total_triangles=0,
    omitted_segments=0,
)


@dataclass
class NotedWorker:
    """In place of the disk worker: what it was told, in order."""

    calls: list[tuple[object, ...]] = field(default_factory=list)

    def restore(self, segment: int, xxh3: int) -> None:
        """Note a segment that is to be read."""
        self.calls.append(("restore", segment, xxh3))

    def store(self, entry: CachedSegment) -> None:
        """Note a segment that is to be written."""
        self.calls.append(("store", entry.facts.segment))

    def remove(self, segments: dict[int, int]) -> None:
        """Note segments that are to be deleted."""
        self.calls.append(("remove", segments))


@dataclass
class Desk:
    """An intake with what it drives."""

    intake: EventIntake
    worker: NotedWorker
    pumped: list[None]


@pytest.fixture
def desk() -> Desk:
    """Return an intake whose disk holds segment 3."""
    pumped: list[None] = []
    state = ClientSession(SessionOptions("test"), SegmentCache(1 << 20), {3: 33})
    intake = EventIntake(state, pump=lambda: pumped.append(None), on_opened=lambda: None)
    worker = NotedWorker()
    intake.worker = cast("DiskWorker", worker)
    return Desk(intake, worker, pumped)


def test_a_streamed_segment_is_counted_stored_and_given_to_its_landing(desk: Desk) -> None:
    """A restored one was paid for before, and is on disk already."""
    record = desk.intake.waiting.begin_landing(1)
    desk.intake.take(SegmentArrived(1, ENTRY))
    desk.intake.take(SegmentArrived(1, ENTRY, restored=True))
    assert desk.intake.payload_bytes == len(ENTRY.payload)
    assert desk.worker.calls == [("store", 7)]
    assert [segment.source for segment in record.arrived] == ["stream", "disk"]


def test_a_segment_of_an_aim_belongs_to_no_landing(desk: Desk) -> None:
    """It is counted and stored; no record changes."""
    record = desk.intake.waiting.begin_landing(1)
    desk.intake.take(SegmentArrived(None, ENTRY))
    assert desk.worker.calls == [("store", 7)]
    assert record.arrived == []


def test_the_disk_loses_what_is_rejected_or_dropped(desk: Desk) -> None:
    """And gives what the state machine asks for."""
    record = desk.intake.waiting.begin_landing(1)
    desk.intake.take(SegmentRejected(1, 7, 1, 99))
    desk.intake.take(Dropped((3, 5), ((3, 33),)))
    desk.intake.take(RestoreNeeded(1, (3,)))
    assert desk.worker.calls == [("remove", {7: 99}), ("remove", {3: 33}), ("restore", 3, 33)]
    assert (desk.intake.rejected, record.rejected) == (1, 1)


def test_news_of_the_disk_is_told_and_sent(desk: Desk) -> None:
    """What is lost must be asked of the server: at once, not at the next command."""
    desk.intake.stored(ENTRY.facts)
    assert not desk.pumped
    desk.intake.removed([7])
    desk.intake.restored(ENTRY)
    desk.intake.lost(3)
    assert len(desk.pumped) == 2


@pytest.mark.parametrize(
    ("event", "error"),
    [
        (Superseded(1, 2), LandingSupersededError),
        (Refused("bad_request", "no", False, 1), ServerError),
    ],
)
def test_a_landing_ends_once(desk: Desk, event: Event, error: type[Exception]) -> None:
    """What crosses with its end changes nothing, and the other landings go on."""
    record, other = (desk.intake.waiting.begin_landing(number) for number in (1, 2))
    desk.intake.take(event)
    desk.intake.take(Ready(1, (7,), ()))
    assert isinstance(record.error, error)
    assert record.shown is None
    assert other.error is None


def test_a_landing_goes_on_to_ready(desk: Desk) -> None:
    """The first byte, the inner set, all of it."""
    record = desk.intake.waiting.begin_landing(1)
    desk.intake.take(PayloadBegan(1))
    desk.intake.take(Degraded(1, (7,)))
    assert record.trace.first_byte_s is not None
    assert (record.degraded, record.is_over) == ((7,), False)
    desk.intake.take(Ready(1, (7, 8), (9,)))
    assert (record.shown, record.missing, record.is_over) == ((7, 8), (9,), True)


def test_what_was_held_is_decoded_by_the_scales_of_the_newest_plan(desk: Desk) -> None:
    """The same bytes may mean other values in another version of the scene."""
    before = {"grade": SCALES["grade"]}
    after = {"grade": AttributeScale(1.0, SCALES["grade"].step)}
    payload = encode_segment(lattice_mesh(0, 0, 2), step_m=STEP_M, scales=before)
    entry = CachedSegment(replace(ENTRY.facts, length=len(payload)), payload)
    record = LandingRecord(1, lambda: 0.0, 0.0)
    record.planned(PLAN, (), before)
    record.arrive(entry, "stream")
    (old,) = record.segments.values()
    record.planned(PLAN, (entry,), after)
    (new,) = record.segments.values()
    assert new.source == "stream"
    rise = new.arrays().attributes["grade"] - old.arrays().attributes["grade"]
    assert np.nanmin(rise) == pytest.approx(1.0, abs=1e-6)
    assert np.nanmax(rise) == pytest.approx(1.0, abs=1e-6)


def test_without_the_manifest_a_segment_says_why_it_is_not_decoded() -> None:
    error = HttpError("http://h/scenes/a", 0, "no answer")
    with pytest.raises(HttpError) as caught:
        Segment(ENTRY, "stream", error).arrays()
    assert caught.value is error


def test_only_a_publication_names_a_newer_version(desk: Desk) -> None:
    """Another notice may carry one, and says nothing of the scene."""
    desk.intake.take(Noticed("draining", "v2", 100))
    assert desk.intake.newest_version is None
    desk.intake.take(Noticed("scene_published", "v2", None))
    assert desk.intake.newest_version == "v2"


def test_everybody_who_waits_gets_the_end_of_the_session(desk: Desk) -> None:
    """But for a landing that was ready."""
    ready, open_landing = (desk.intake.waiting.begin_landing(number) for number in (1, 2))
    desk.intake.take(Ready(1, (), ()))
    error = SessionClosedError("it was closed here")
    desk.intake.fail(error)
    assert (ready.error, open_landing.error) == (None, error)
