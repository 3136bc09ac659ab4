"""The client's state machine against the server's, in memory: picks, news, violations, anything.

What the files share stands in ``conftest.py`` and ``pairing.py``, both state machines side by side.
Landings are in ``test_session_landings.py``, the cache in ``test_session_cache.py``.
"""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sdk.pairing import GRID, MIDDLE, FakeDisk, Pair, ToyScene, expected

from terraport.errors import ProtocolViolationError, UsageError
from terraport.events import (
    Noticed,
    PickAnswered,
    PickRefused,
    Refused,
    SegmentRejected,
)
from terraport_server.session.interface import SessionLimits
from terraport_wire import (
    Direction,
    Hello,
    Hit,
    PayloadFrame,
    Plan,
    decode,
    encode,
    encode_frame,
)
from terraport_wire import Superseded as SupersededMessage


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
    hello = decode(data, Direction.CLIENT_TO_SERVER)
    assert isinstance(hello, Hello)
    assert dict(hello.held.tolist()) == {s: int(pair.scene.hashes[s]) for s in pair.client.visible}
    pair.client.connected(offer_held=False)
    (data,) = pair.client.data_to_send()
    assert len(decode(data, Direction.CLIENT_TO_SERVER).held) == 0


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
        nearby=[],
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
        (encode(_plan(9)), "plan of generation 9, expected none"),
        (
            encode(SupersededMessage(generation=1, by=2, unsent_bytes=0)),
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
        pair.client.receive(encode(_plan(1)))
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
        pair.client.receive(encode(_plan(1)))


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


@settings(max_examples=200)
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
            case ("land", position, radius_m):
                pair.client.land(position, radius_m)
            case ("aim", position, radius_m):
                pair.client.aim(position, radius_m)
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
    assert pair.client.holdings.cache_bytes <= max(cache_bytes, pinned)
    for segment in want:
        assert pair.client.holdings.peek(segment).payload == toy.payloads[segment]
    assert pair.client.repeated_bytes == 0
    # What the server believes held is here, or will be named by the next evict.
    pair.client.land(MIDDLE, 3.3)
    pair.settle()
    assert pair.server is not None
    believed = set(pair.server.transfers.held.array().tolist())
    assert {segment for segment in believed if segment not in pair.client.holdings} == set()
