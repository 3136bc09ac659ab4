"""The client's state machine against the server's, in memory: landings, resuming, aims.

What the files share stands in ``conftest.py`` and ``pairing.py``, both state machines side by side.
"""

from __future__ import annotations

import pytest
from sdk.pairing import GRID, MIDDLE, Pair, ToyScene, expected

from terraport.events import (
    Degraded,
    Planned,
    Prefetched,
    Ready,
    Refused,
    SegmentRejected,
    Superseded,
)
from terraport_server.session.interface import SessionLimits
from terraport_wire import (
    encode_frame,
)


def test_a_landing_shows_exactly_what_brute_force_finds() -> None:
    """And exactly its bytes."""
    toy = ToyScene()
    pair = Pair(toy)
    pair.connect()
    number = pair.client.land(MIDDLE, 4.0)
    pair.settle()
    want = expected(toy, MIDDLE, 4.0)
    assert pair.of(Ready) == [Ready(number, want, ())]
    assert pair.client.visible == want
    assert pair.chunk_bytes == sum(len(toy.payloads[segment]) for segment in want)
    for segment in want:
        entry = pair.client.holdings.peek(segment)
        assert entry is not None
        assert entry.payload == toy.payloads[segment]
        assert entry.facts.bounds == tuple(toy.bounds[segment].tolist())


def test_a_ring_is_cut_to_what_the_server_allows() -> None:
    """A landing with less coarse ground is better than none; so is an aim, and both are alike."""
    toy = ToyScene(levels=2)
    pair = Pair(toy, limits=SessionLimits(max_radius_m=5.0, max_messages_per_s=1e6))
    pair.client.land(MIDDLE, 1.5, coarse_radius_m=50.0)  # nobody knows yet how far it may go
    pair.connect()
    pair.settle()
    near, all_of_it = expected(toy, MIDDLE, 1.5), expected(toy, MIDDLE, 5.0)
    ring = tuple(GRID * GRID + segment for segment in all_of_it if segment not in near)
    assert pair.client.visible == near + ring
    assert pair.of(Refused) == []
    (planned,) = pair.of(Planned)
    assert planned.plan.effective_radius_m == 5.0
    pair.client.aim(MIDDLE, 1.5, 50.0)
    pair.client.flush_aim()
    pair.settle()
    (prefetched,) = pair.of(Prefetched)
    assert (prefetched.segments, pair.of(Refused)) == (0, []), "the landing had all of it"


def test_a_ring_beside_a_radius_that_is_too_large_is_refused_by_its_radius() -> None:
    pair = Pair(ToyScene(levels=2), limits=SessionLimits(max_radius_m=5.0, max_messages_per_s=1e6))
    pair.connect()
    pair.client.land(MIDDLE, 6.0, coarse_radius_m=50.0)
    pair.settle()
    (refused,) = pair.of(Refused)
    assert refused.code == "radius_too_large"


def test_a_second_visit_costs_no_bytes(pair: Pair) -> None:
    """What is held is kept, not sent."""
    for _ in range(2):
        pair.client.land(MIDDLE, 4.0)
        pair.settle()
    first, second = (event.plan for event in pair.of(Planned))
    assert second.load_bytes == 0
    assert len(second.keep) == len(first.load)
    assert sorted(pair.received) == sorted(set(pair.received))


def test_what_lies_a_little_beyond_the_radius_is_kept_and_not_shown(toy: ToyScene) -> None:
    """Not even a cache of nothing lets it go, until a plan does (6.6)."""
    pair = Pair(toy, cache_bytes=0, release_factor=1.5)
    pair.connect()
    for radius_m in (6.0, 4.5, 6.0):
        pair.client.land(MIDDLE, radius_m)
        pair.settle()
        assert pair.client.visible == expected(toy, MIDDLE, radius_m)
    _, less, again = (event.plan for event in pair.of(Planned))
    rim = set(expected(toy, MIDDLE, 6.0)) - set(expected(toy, MIDDLE, 4.5))
    assert less.nearby.tolist() == sorted(rim) != []
    assert again.load_bytes == 0
    pair.client.land(MIDDLE, 1.0)
    pair.settle()
    held_ids = [segment for segment in range(len(toy.payloads)) if segment in pair.client.holdings]
    assert tuple(held_ids) == expected(toy, MIDDLE, 1.5)


def test_whole_is_not_ready_before_the_server_says_so(toy: ToyScene) -> None:
    """The last byte is here, ``ready`` is not: nothing is shown (6.4, rule 5)."""
    pair = Pair(toy)
    pair.connect()
    pair.client.land(MIDDLE, 4.0)
    while len(pair.received) < len(expected(toy, MIDDLE, 4.0)):
        pair.step()
    assert pair.of(Ready) == []
    assert pair.client.visible == ()
    pair.settle()
    assert len(pair.of(Ready)) == 1


def test_credit_of_one_byte_still_delivers_everything(toy: ToyScene) -> None:
    """However small the credit, it is granted back."""
    pair = Pair(toy, credit_bytes=1)
    pair.connect()
    pair.client.land((0, 0, 0), 0.5)
    pair.settle()
    assert pair.client.visible == (0,)


def test_a_newer_landing_supersedes_and_its_parts_go_on(toy: ToyScene) -> None:
    """A segment that is half here is not begun again."""
    pair = Pair(ToyScene(cells=8), credit_bytes=100)
    pair.connect()
    first = pair.client.land((0, 0, 0), 1.0)
    while pair.chunk_bytes < 300:
        pair.step()
    second = pair.client.land((0, 0, 0), 2.0)
    pair.settle()
    assert pair.of(Superseded) == [Superseded(first, second)]
    assert [event.landing for event in pair.of(Ready)] == [second]
    want = expected(pair.scene, (0, 0, 0), 2.0)
    assert pair.chunk_bytes == sum(len(pair.scene.payloads[segment]) for segment in want)


def test_a_landing_that_a_newer_one_ends_before_its_plan_never_gets_one(toy: ToyScene) -> None:
    """The server says `superseded` and nothing else of it (6.3)."""
    pair = Pair(toy)
    pair.connect()
    pair.settle()
    landings = [pair.client.land(MIDDLE, 4.0)]
    pair.deliver()  # and the server has no time to plan
    landings.append(pair.client.land(MIDDLE, 2.0))
    pair.deliver()
    pair.settle()
    assert pair.of(Superseded) == [Superseded(*landings)]
    assert [event.landing for event in pair.of(Planned)] == [landings[1]]
    assert [event.landing for event in pair.of(Ready)] == [landings[1]]
    assert pair.client.visible == expected(toy, MIDDLE, 2.0)


def test_a_refused_landing_leaves_the_older_one_going(pair: Pair) -> None:
    """A radius beyond the server's limit changes nothing."""
    good = pair.client.land(MIDDLE, 4.0)
    for _ in range(3):
        pair.step()
    bad = pair.client.land(MIDDLE, 501.0)
    pair.settle()
    (refused,) = pair.of(Refused)
    assert (refused.landing, refused.code, refused.fatal) == (bad, "radius_too_large", False)
    assert [event.landing for event in pair.of(Ready)] == [good]
    assert pair.of(Superseded) == []


def test_before_the_connection_only_the_newest_landing_waits(toy: ToyScene) -> None:
    pair = Pair(toy)
    first = pair.client.land((0, 0, 0), 1.0)
    second = pair.client.land(MIDDLE, 1.0)
    pair.connect()
    pair.settle()
    assert pair.of(Superseded) == [Superseded(first, second)]
    assert [event.landing for event in pair.of(Ready)] == [second]


@pytest.mark.parametrize("after_chunks", range(0, 40, 3))
def test_a_cut_connection_resumes_and_no_segment_comes_twice(
    toy: ToyScene, after_chunks: int
) -> None:
    """Wherever it is cut: whole segments are offered, and not sent again."""
    pair = Pair(toy, credit_bytes=300)
    pair.connect()
    number = pair.client.land(MIDDLE, 4.0)
    for _ in range(after_chunks):
        pair.step()
    pair.disconnect()
    assert pair.client.unfinished == number or pair.of(Ready)
    pair.connect()
    pair.settle()
    want = expected(toy, MIDDLE, 4.0)
    assert pair.of(Ready)[-1] == Ready(number, want, ())
    assert sorted(pair.received) == list(want)
    assert pair.client.repeated_bytes == 0


def test_an_aim_is_held_for_the_landing_that_follows(pair: Pair) -> None:
    pair.settle()
    pair.client.aim(MIDDLE, 3.0)
    assert pair.client.has_aim
    pair.client.flush_aim()
    pair.settle()
    (prefetched,) = pair.of(Prefetched)
    assert prefetched.segments == len(expected(pair.scene, MIDDLE, 3.0))
    assert pair.client.visible == ()
    pair.client.land(MIDDLE, 3.0)
    pair.settle()
    assert pair.of(Planned)[-1].plan.load_bytes == 0
    assert pair.client.visible == expected(pair.scene, MIDDLE, 3.0)


def test_an_aim_that_comes_wrong_twice_is_given_up(pair: Pair) -> None:
    pair.settle()
    pair.spoil = lambda frame: encode_frame(frame)[:-1] + b"?"
    pair.client.aim((0, 0, 0), 0.5)
    pair.client.flush_aim()
    pair.settle()
    assert [event.segment for event in pair.of(SegmentRejected)] == [0, 0]
    assert len(pair.of(Prefetched)) == 1
    assert 0 not in pair.client.holdings


def test_only_the_newest_aim_is_sent_and_a_landing_drops_it(pair: Pair) -> None:
    pair.settle()
    for step in range(5):
        pair.client.aim((step, 0, 0), 1.0)
    pair.client.flush_aim()
    assert len(pair.client.data_to_send()) == 1
    pair.client.aim((0, 0, 0), 1.0)
    pair.client.land(MIDDLE, 1.0)
    assert not pair.client.has_aim


def test_a_deadline_declares_the_inner_set(toy: ToyScene) -> None:
    pair = Pair(toy, credit_bytes=2000)
    pair.connect()
    pair.settle()
    pair.client.land(MIDDLE, 5.0, inner_radius_m=1.5, deadline_ms=100)
    inner = expected(toy, MIDDLE, 1.5)
    while len(pair.received) < len(inner):
        pair.step()
    pair.now_s = 0.2
    pair.server.tick(pair.now_s)
    pair.settle()
    assert [event.segments for event in pair.of(Degraded)] == [inner]
    assert pair.client.visible == expected(toy, MIDDLE, 5.0)
