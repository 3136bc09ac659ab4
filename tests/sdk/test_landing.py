"""The record of a landing, over plans of several versions of a scene."""

from __future__ import annotations

import numpy as np
import pytest
from store.tiny_scene import SCALES, STEP_M, lattice_mesh

from terraport.cache import CachedSegment
from terraport.errors import HttpError
from terraport.events import Planned, SegmentArrived
from terraport.landing import LandingRecord, Segment
from terraport_payload import AttributeScale, encode_segment
from terraport_wire import SEGMENT_DTYPE, Land, Plan

PAYLOAD = encode_segment(lattice_mesh(0, 0, 2), step_m=STEP_M, scales=SCALES)
ENTRY = CachedSegment(99, (0.0, 0.0, 0.0, 1.0, 1.0, 1.0), PAYLOAD)
LAND = Land(generation=1, position=(0.0, 0.0, 0.0), radius_m=60.0, have=[], taken_bytes=0)


def planned(segment: int, *here: CachedSegment) -> Planned:
    show = np.array([(99, segment, len(PAYLOAD), 8, 9, 1)], SEGMENT_DTYPE)
    plan = Plan(generation=1, show=show, hidden=b"", effective_radius_m=60.0, omitted=0)
    return Planned(1, LAND, plan, here, frozenset())


def test_what_came_before_a_reconnect_is_of_the_newest_version() -> None:
    """The same bytes may be another segment there, and mean other values; they come once."""
    before = {"grade": SCALES["grade"]}
    after = {"grade": AttributeScale(1.0, SCALES["grade"].step)}
    record = LandingRecord(1, 0.0)
    record.planned(planned(7), before, 8)
    record.arrive(SegmentArrived(1, ENTRY))
    (old,) = record.segments.values()
    record.planned(planned(5, ENTRY), after, 8)
    (new,) = record.segments.values()
    assert (old.id, new.id, new.source) == (7, 5, "stream")
    assert record.arrived == [old]
    rise = new.arrays().attributes["grade"] - old.arrays().attributes["grade"]
    assert np.nanmin(rise) == pytest.approx(1.0, abs=1e-6)
    assert np.nanmax(rise) == pytest.approx(1.0, abs=1e-6)


def test_without_the_manifest_a_segment_says_why_it_is_not_decoded() -> None:
    error = HttpError("http://h/scenes/a", 0, "no answer")
    with pytest.raises(HttpError) as caught:
        Segment(7, 8, 9, ENTRY, "stream", error).arrays()
    assert caught.value is error
