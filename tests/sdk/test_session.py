"""The client's state machine against the server's, in memory."""

from __future__ import annotations

import math

import numpy as np
import pytest
import xxhash
from hypothesis import given, settings
from hypothesis import strategies as st
from sdk.pairing import GRID, FakeDisk, Pair, ToyScene
from store.tiny_scene import SCALES, STEP_M, lattice_mesh

from terraport.errors import ProtocolViolationError, UsageError
from terraport.events import (
    Degraded,
    Dropped,
    Noticed,
    Opened,
    PickAnswered,
    PickRefused,
    Planned,
    Prefetched,
    Ready,
    Refused,
    SegmentRejected,
    Superseded,
)
from terraport_payload import encode_glb
from terraport_server.actions import SessionLimits
from terraport_wire import (
    Direction,
    Evict,
    Hello,
    Hit,
    Land,
    PayloadFrame,
    Plan,
    Subprotocol,
    decode,
    encode,
    encode_frame,
)
from terraport_wire import Superseded as SupersededMessage

MIDDLE = (GRID, 0.0, GRID)


def expected(scene: ToyScene, position: tuple[float, float, float], radius_m: float) -> tuple:
    return tuple(scene.within(position, radius_m).tolist())


@pytest.mark.parametrize("subprotocol", list(Subprotocol))
def test_a_landing_shows_exactly_what_brute_force_finds(subprotocol: Subprotocol) -> None:
    """Both subprotocols give the same visible set, and exactly its bytes."""
    toy = ToyScene()
    pair = Pair(toy, subprotocol=subprotocol)
    pair.connect()
    number = pair.client.land(MIDDLE, 4.0)
    pair.settle()
    want = expected(toy, MIDDLE, 4.0)
    assert pair.of(Ready) == [Ready(number, want, ())]
    assert pair.client.visible == want
    assert pair.chunk_bytes == sum(len(toy.payloads[segment]) for segment in want)
    for segment in want:
        entry = pair.client.held.peek(segment)
        assert entry is not None
        assert entry.payload == toy.payloads[segment]
        assert entry.facts.bounds == tuple(toy.bounds[segment].tolist())


def test_a_second_visit_costs_no_bytes(pair: Pair) -> None:
    """What is held is kept, not sent."""
    for _ in range(2):
        pair.client.land(MIDDLE, 4.0)
        pair.settle()
    first, second = (event.plan for event in pair.of(Planned))
    assert second.load_bytes == 0
    assert len(second.keep) == len(first.load)
    assert sorted(pair.received) == sorted(set(pair.received))


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


def test_evictions_are_told_before_the_next_landing(toy: ToyScene) -> None:
    """A cache of nothing keeps only what is visible, and the server knows it."""
    pair = Pair(toy, cache_bytes=0)
    pair.connect()
    pair.client.land((0, 0, 0), 2.0)
    pair.settle()
    pair.client.land((10, 0, 10), 2.0)
    pair.settle()
    pair.client.land((0, 0, 0), 2.0)
    pair.settle()
    plans = [event.plan for event in pair.of(Planned)]
    assert plans[2].load_bytes == plans[0].load_bytes > 0
    assert pair.server is not None
    held = pair.server.deliveries.held
    # What the server counts as held beyond the visible is what the next evict will name.
    pair.client.land((0, 0, 0), 2.0)
    messages = [
        decode(data, pair.subprotocol, Direction.CLIENT_TO_SERVER)
        for data in pair.client.data_to_send()
    ]
    assert [type(message) for message in messages] == [Evict, Land]
    assert set(messages[0].segments.tolist()) == set(np.flatnonzero(held)) - set(
        pair.client.visible
    )


def test_nothing_is_evicted_between_land_and_plan(toy: ToyScene) -> None:
    """The server may keep what it believes held: the client must still have it."""
    pair = Pair(toy, cache_bytes=0)
    pair.connect()
    pair.client.land((0, 0, 0), 2.0)
    pair.settle()
    pair.client.land((10, 0, 10), 2.0)
    pair.settle()  # the first place is evicted here, and the server not told
    pair.client.land((0, 0, 0), 2.0)
    pair.client.land((10, 0, 10), 2.0)
    pair.settle()
    assert pair.client.visible == expected(toy, (10, 0, 10), 2.0)
    assert pair.closed is None


def test_a_wrong_byte_is_rejected_and_sent_again(pair: Pair) -> None:
    """One flipped bit: asked for again, arrives, landing is whole."""
    spoilt: list[int] = []

    def spoil(frame: PayloadFrame) -> bytes:
        data = bytearray(encode_frame(frame))
        if frame.segment == 14 and not spoilt:
            spoilt.append(1)
            data[-1] ^= 1
        return bytes(data)

    pair.spoil = spoil
    pair.client.land(MIDDLE, 4.0)
    pair.settle()
    (rejected,) = pair.of(SegmentRejected)
    assert (rejected.segment, rejected.expected) == (14, int(pair.scene.hashes[14]))
    assert rejected.actual != rejected.expected
    assert pair.of(Ready)[-1].missing == ()
    assert pair.client.held.peek(14).payload == pair.scene.payloads[14]


def test_a_reject_that_crosses_the_next_landing_is_sent_again_in_that_one(toy: ToyScene) -> None:
    """The new plan keeps what was found wrong meanwhile; it is not rejected a second time."""
    pair = Pair(toy, lag=5)
    pair.connect()
    spoilt: list[int] = []

    def spoil(frame: PayloadFrame) -> bytes:
        spoilt.append(frame.segment)
        return encode_frame(frame)[:-1] + (b"?" if len(spoilt) == 1 else b"")

    pair.spoil = spoil
    pair.client.land((0, 0, 0), 1.0)
    while not spoilt:
        pair.step()
    pair.client.land((0, 0, 0), 1.0)  # the spoilt chunk is still on its way
    toy_payload, pair.spoil = toy.payloads[0], None
    pair.settle()
    assert len(pair.of(SegmentRejected)) == 1
    assert pair.of(Planned)[-1].plan.keep.tolist() == [0]
    assert pair.of(Ready)[-1].missing == ()
    assert pair.client.held.peek(0).payload == toy_payload


def test_a_segment_that_stays_wrong_is_missing(pair: Pair) -> None:
    """Twice wrong: the landing is ready without it, and says so; it is not held."""

    def spoil(frame: PayloadFrame) -> bytes:
        data = bytearray(encode_frame(frame))
        if frame.segment == 14:
            data[-1] ^= 1
        return bytes(data)

    pair.spoil = spoil
    pair.client.land(MIDDLE, 4.0)
    pair.settle()
    assert len(pair.of(SegmentRejected)) == 2
    (ready,) = pair.of(Ready)
    assert ready.missing == (14,)
    assert ready.shown == tuple(s for s in expected(pair.scene, MIDDLE, 4.0) if s != 14)
    assert 14 not in pair.client.held
    pair.spoil = None
    pair.client.land(MIDDLE, 4.0)  # a missing segment is tried again
    pair.settle()
    assert pair.client.visible == expected(pair.scene, MIDDLE, 4.0)


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
    assert 0 not in pair.client.held


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


def test_picks_are_answered_and_survive_a_reconnect(pair: Pair) -> None:
    pair.hit = Hit(
        position=(0, 0, 0), normal=(0, 1, 0), segment=3, region=1, height_m=9.0, attributes={}
    )
    first = pair.client.pick((0, 1, 0))
    pair.disconnect()
    second = pair.client.pick((0, 1, 0), (0, -1, 0))
    dropped = pair.client.pick((5, 1, 0))
    pair.client.drop_pick(dropped)
    pair.connect()
    pair.settle()
    assert pair.of(PickAnswered) == [PickAnswered(first, pair.hit), PickAnswered(second, pair.hit)]


def test_a_refused_pick_is_told(toy: ToyScene) -> None:
    pair = Pair(toy, limits=SessionLimits(max_picks=0))
    pair.connect()
    request = pair.client.pick((0, 0, 0))
    pair.settle()
    (refused,) = pair.of(PickRefused)
    assert (refused.request, refused.code) == (request, "too_many")


def test_the_disk_answers_for_what_memory_has_lost(toy: ToyScene) -> None:
    """Kept by the plan, read from disk, no byte sent."""
    disk = FakeDisk()
    pair = Pair(toy, cache_bytes=0, disk=disk)
    pair.connect()
    for place in ((0, 0, 0), (10, 0, 10), (0, 0, 0)):
        pair.client.land(place, 2.0)
        pair.settle()
    assert pair.of(Planned)[-1].plan.load_bytes == 0
    assert pair.client.visible == expected(toy, (0, 0, 0), 2.0)


def test_what_the_disk_has_lost_is_sent_again_in_the_same_landing(toy: ToyScene) -> None:
    """Facts of a segment that is asked for by hash alone come from its payload."""
    disk = FakeDisk()
    glb = encode_glb(lattice_mesh(0, 0), step_m=STEP_M, attribute_scales=SCALES)
    toy.payloads[0] = glb
    toy.lengths[0] = len(glb)
    toy.hashes[0] = xxhash.xxh3_64_intdigest(glb)
    first = Pair(toy, disk=disk)
    first.connect()
    first.client.land((0, 0, 0), 0.5)
    first.settle()
    again = Pair(toy, disk=disk)
    disk.entries.clear()  # the catalogue was read before the files were deleted
    again.connect()
    again.client.land((0, 0, 0), 0.5)
    again.settle()
    assert len(again.of(SegmentRejected)) == 1
    assert again.received == [0]
    assert again.client.visible == (0,)
    assert again.client.held.peek(0).facts.faces == len(lattice_mesh(0, 0).faces)


def test_a_newer_version_drops_what_changed_and_keeps_the_rest(toy: ToyScene) -> None:
    pair = Pair(toy)
    pair.connect()
    pair.client.land(MIDDLE, 4.0)
    pair.settle()
    before = set(pair.client.visible)
    pair.disconnect()
    newer = ToyScene(version="v2")
    changed = sorted(before)[:3]
    for segment in changed:
        newer.payloads[segment] = b"new" * 100
        newer.lengths[segment] = 300
        newer.hashes[segment] = xxhash.xxh3_64_intdigest(newer.payloads[segment])
    pair.scene = newer
    pair.received.clear()
    pair.connect()
    pair.settle()
    assert pair.of(Opened)[-1].version_changed
    (dropped,) = pair.of(Dropped)
    assert isinstance(dropped, Dropped)
    assert sorted(dropped.segments) == changed
    assert pair.client.visible == ()
    pair.client.land(MIDDLE, 4.0)
    pair.settle()
    assert sorted(pair.received) == changed
    assert set(pair.client.visible) == before


def test_news_are_passed_on(pair: Pair) -> None:
    pair.settle()
    pair.server.scene_published("v9")
    pair.server.drain(0.0, 5.0)
    pair.settle()
    assert [(e.kind, e.version, e.reconnect_after_ms) for e in pair.of(Noticed)] == [
        ("scene_published", "v9", None),
        ("draining", None, 1000),
    ]


def test_hello_offers_what_is_held_newest_first(pair: Pair) -> None:
    pair.client.land(MIDDLE, 4.0)
    pair.settle()
    pair.disconnect()
    pair.client.connected()
    (data,) = pair.client.data_to_send()
    hello = decode(data, Subprotocol.MSGPACK, Direction.CLIENT_TO_SERVER)
    assert isinstance(hello, Hello)
    assert dict(hello.held.tolist()) == {s: int(pair.scene.hashes[s]) for s in pair.client.visible}
    pair.client.connected(offer_held=False)
    (data,) = pair.client.data_to_send()
    assert len(decode(data, Subprotocol.MSGPACK, Direction.CLIENT_TO_SERVER).held) == 0


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda c: c.land((0, 0, 0), 0.0), "radius_m"),
        (lambda c: c.land((0, 0, 0), -1.0), "radius_m"),
        (lambda c: c.land((0, 0, 0), math.nan), "radius_m"),
        (lambda c: c.land((math.inf, 0, 0), 1.0), "position"),
        (lambda c: c.land((0, 0), 1.0), "three numbers"),
        (lambda c: c.land((0, 0, 0), 1.0, deadline_ms=5), "deadline"),
        (lambda c: c.land((0, 0, 0), 1.0, inner_radius_m=2.0), "inner_radius_m"),
        (lambda c: c.aim((0, 0, 0), 0.0), "radius_m"),
        (lambda c: c.pick((0, 0, 0), (0, 0, 0)), "direction"),
    ],
)
def test_numbers_that_cannot_be_are_refused_here(pair: Pair, call, text: str) -> None:
    """Nothing is sent, nothing changes."""
    pair.settle()
    with pytest.raises(UsageError, match=text):
        call(pair.client)
    assert pair.client.data_to_send() == []
    assert pair.client.unfinished is None


def _plan(generation: int) -> Plan:
    return Plan(
        generation=generation,
        position=(0, 0, 0),
        radius_m=1.0,
        release_radius_m=1.0,
        effective_radius_m=1.0,
        inner_count=0,
        load=[],
        keep=[7],
        release=[],
        load_bytes=0,
        load_triangles=0,
        total_bytes=0,
        total_triangles=0,
        omitted_segments=0,
    )


def _frame(generation: int, segment: int, offset: int = 0, total: int = 4) -> bytes:
    return encode_frame(PayloadFrame(generation, segment, offset, total, memoryview(b"\0")))


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"", "end of the message"),
        (b"\xc1", "msgpack"),
        ("{}", "text message"),
        (_frame(5, 1), "generation 5"),
        (encode(_plan(9), Subprotocol.MSGPACK), "plan of generation 9, expected none"),
        (
            encode(SupersededMessage(generation=1, by=2, unsent_bytes=0), Subprotocol.MSGPACK),
            None,
        ),
    ],
)
def test_what_the_protocol_forbids_is_a_violation(pair: Pair, data, text: str | None) -> None:
    pair.settle()
    if text is None:
        pair.client.receive(data)  # of a generation that is over: skipped
        return
    with pytest.raises(ProtocolViolationError, match=text):
        pair.client.receive(data)


def test_messages_before_welcome_and_a_second_welcome_are_violations(toy: ToyScene) -> None:
    pair = Pair(toy)
    pair.client.connected()
    with pytest.raises(ProtocolViolationError, match="plan first"):
        pair.client.receive(encode(_plan(1), Subprotocol.MSGPACK))
    pair.connect()
    welcome: list[bytes] = []
    receive = pair.client.receive
    pair.client.receive = lambda data: (welcome.append(data), receive(data))
    pair.settle()
    with pytest.raises(ProtocolViolationError, match="second welcome"):
        receive(welcome[0])


def test_a_plan_that_keeps_what_was_never_held_is_a_violation(pair: Pair) -> None:
    pair.settle()
    pair.client.land((0, 0, 0), 1.0)
    pair.client.data_to_send()
    with pytest.raises(ProtocolViolationError, match="keeps segment 7, which was never held"):
        pair.client.receive(encode(_plan(1), Subprotocol.MSGPACK))


@pytest.mark.parametrize(
    ("frame", "text"),
    [
        (lambda f: _frame(f.generation, f.segment, 0, f.total + 1), "announces"),
        (lambda f: _frame(f.generation, f.segment, 1, f.total), "continues at byte 1, expected 0"),
        (lambda f: _frame(f.generation, 35, 0, 4), "does not load"),
    ],
)
def test_frames_that_do_not_fit_are_violations(pair: Pair, frame, text: str) -> None:
    pair.spoil = frame
    pair.client.land((0, 0, 0), 1.0)
    with pytest.raises(ProtocolViolationError, match=text):
        pair.settle()


PLACES = st.tuples(st.integers(-2, 14), st.just(0), st.integers(-2, 14))
STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("land"), PLACES, st.floats(0.5, 8.0)),
        st.tuples(st.just("aim"), PLACES, st.floats(0.5, 8.0)),
        st.tuples(st.just("run"), st.integers(0, 60)),
        st.tuples(st.just("cut")),
        st.tuples(st.just("spoil")),
        st.tuples(st.just("lose"), st.integers(0, GRID * GRID - 1)),
        st.tuples(st.just("disk")),
    ),
    max_size=25,
)


@settings(max_examples=200, deadline=None)
@given(
    steps=STEPS,
    cache_bytes=st.sampled_from([0, 5000, 30_000, 1 << 20]),
    credit_bytes=st.sampled_from([200, 2000, 1 << 20]),
    with_disk=st.booleans(),
    lag=st.sampled_from([0, 1, 5, 30]),
)
def test_whatever_happens_the_last_landing_alone_decides_what_is_visible(
    steps: list[tuple], cache_bytes: int, credit_bytes: int, with_disk: bool, lag: int
) -> None:
    """Random landings, aims, cuts, flipped bits and lost files end in what brute force finds."""
    toy = ToyScene()
    disk = FakeDisk() if with_disk else None
    pair = Pair(toy, cache_bytes=cache_bytes, credit_bytes=credit_bytes, disk=disk, lag=lag)
    pair.connect()
    spoil_next, lost = [0], False

    def spoil(frame: PayloadFrame) -> bytes:
        data = bytearray(encode_frame(frame))
        if spoil_next[0]:
            spoil_next[0] -= 1
            data[-1] ^= 1
        return bytes(data)

    pair.spoil = spoil
    for step in steps:
        assert pair.closed is None, pair.of(Refused)
        match step:
            case ("land", place, radius_m):
                pair.client.land(place, radius_m)
            case ("aim", place, radius_m):
                pair.client.aim(place, radius_m)
                pair.client.flush_aim()
            case ("run", count):
                for _ in range(count):
                    pair.step()
            case ("cut",):
                pair.disconnect()
                pair.connect()
            case ("spoil",):
                spoil_next[0] = 1
            case ("lose", segment) if disk is not None:
                if disk.entries.pop(segment, None):
                    lost = True
                    pair.client.removed_from_disk([segment])
            case ("disk",):
                pair.restore_one()
    spoil_next[0] = 0
    pair.client.land(MIDDLE, 3.3)
    pair.settle()
    want = expected(toy, MIDDLE, 3.3)
    assert pair.closed is None, pair.of(Refused)
    assert pair.client.visible == want
    assert pair.client.unfinished is None
    if not lost and ("spoil",) not in steps:
        assert pair.of(SegmentRejected) == []
    pinned = sum(len(toy.payloads[segment]) for segment in want)
    assert pair.client.held.cache_bytes <= max(cache_bytes, pinned)
    for segment in want:
        assert pair.client.held.peek(segment).payload == toy.payloads[segment]
    assert pair.client.repeated_bytes == 0
    # What the server believes held is here, or will be named by the next evict.
    pair.client.land(MIDDLE, 3.3)
    pair.settle()
    assert pair.server is not None
    believed = set(np.flatnonzero(pair.server.deliveries.held).tolist())
    assert {segment for segment in believed if segment not in pair.client.held} == set()
