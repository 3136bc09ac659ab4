"""Resume after cuts: everything held is offered, however much, and nothing comes twice.

Pure pairs of the two state machines; the same over real sockets is in
``tests/socket/test_sdk_reconnect.py``.
"""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from sdk.pairing import GRID, MIDDLE, Pair, ToyScene, expected
from server.session_model import make_scene

from terraport.cache import SegmentCache
from terraport.events import Dropped, Opened, Planned, Prefetched, Ready, Refused
from terraport.session import ClientSession, SessionOptions
from terraport_server.session.interface import MakePlan, SendMessage, SessionLimits
from terraport_server.session.session import Session as ServerSession
from terraport_wire import (
    Direction,
    Held,
    HeldChecked,
    Hello,
    decode,
    encode,
)

PLACES = st.tuples(st.floats(-1, 2 * GRID), st.just(0.0), st.floats(-1, 2 * GRID))

STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("land"), PLACES, st.floats(0.5, 8.0)),
        st.tuples(st.just("aim"), PLACES, st.floats(0.5, 8.0)),
        st.tuples(st.just("run"), st.integers(0, 40)),
        st.tuples(st.just("cut")),
    ),
    max_size=25,
)


def flush(pair: Pair) -> None:
    """What the link does when it may send an aim."""
    if pair.client.has_aim:
        pair.client.flush_aim()


@settings(max_examples=80)
@given(
    steps=STEPS,
    credit_bytes=st.sampled_from([300, 3000, 1 << 20]),
    lag=st.sampled_from([0, 3, 20]),
    rows=st.sampled_from([1, 5, 1000]),
)
def test_any_cuts_at_all_and_no_whole_segment_comes_twice(
    steps: list[tuple], credit_bytes: int, lag: int, rows: int
) -> None:
    """The offer goes in messages of so many rows: most of it behind the welcome."""
    toy = ToyScene()
    limits = SessionLimits(max_messages_per_s=1e6, max_held_segments=rows)
    pair = Pair(toy, credit_bytes=credit_bytes, lag=lag, limits=limits)
    pair.offer_held = False
    pair.connect()
    for step in [*steps, ("cut",), ("land", MIDDLE, 3.3)]:
        assert pair.closed is None, pair.of(Refused)
        match step:
            case ("land", position, radius_m):
                pair.client.land(position, radius_m)
            case ("aim", position, radius_m):
                pair.client.aim(position, radius_m)
            case ("run", count):
                for _ in range(count):
                    flush(pair)
                    pair.step()
            case ("cut",):
                pair.disconnect()
                pair.connect()
    pair.settle()
    want = expected(toy, MIDDLE, 3.3)
    assert pair.client.visible == want
    assert len(set(pair.received)) == len(pair.received), "each came whole once at most"
    assert pair.client.repeated_bytes == 0
    assert set(want) <= set(pair.received)
    plan = pair.of(Planned)[-1].plan
    assert sorted([*plan.load["id"].tolist(), *plan.keep.tolist()]) == list(want)


def test_more_than_one_table_takes() -> None:
    """50,000 segments on disk: hello takes 32,768 rows, held the rest, and a landing is free."""
    count = 50_000
    scene = make_scene(count)
    hashes = scene.encodings["segment-2"].hashes.tolist()
    on_disk = dict(enumerate(hashes))
    on_disk[7] += 1  # one that is not of this version
    on_disk[49_999] += 1
    client = ClientSession(SessionOptions(client="t"), SegmentCache(1 << 20), on_disk)
    server = ServerSession(scene, SessionLimits(), session_id="s", now_s=0.0)
    client.connected()
    client.land((10.0 * 49_000, 0.0, 0.0), 95.0)
    messages: list[object] = []
    heard: list[object] = []
    for _ in range(4):
        for data in client.data_to_send():
            messages.append(message := decode(data, Direction.CLIENT_TO_SERVER))
            server.receive(message, 0.0)
        while (action := server.next_action()) is not None:
            if isinstance(action, MakePlan):
                server.make_plan(0.0)
                continue
            assert isinstance(action, SendMessage)
            heard.append(action.message)
            client.receive(encode(action.message))
    assert [len(m.held) for m in messages if isinstance(m, Hello)] == [32_768]
    offers = [m for m in messages if isinstance(m, Held)]
    assert sum(len(m.segments) for m in offers) == count - 32_768
    for message in offers:
        assert len(encode(message)) <= SessionLimits().max_message_bytes
    checked = [m for m in heard if isinstance(m, HeldChecked)]
    assert checked[-1].held_count == count - 2
    events = client.events()
    assert [d.segments for d in events if isinstance(d, Dropped)] == [(7,), (49_999,)]
    (planned,) = [event for event in events if isinstance(event, Planned)]
    sizes = [len(ids) for ids in (planned.plan.load, planned.plan.keep, planned.plan.nearby)]
    assert sizes == [0, 19, 4], "two radii"


def test_a_server_that_takes_no_table_gets_no_held() -> None:
    client = ClientSession(
        SessionOptions(client="t"), SegmentCache(1 << 20), dict.fromkeys(range(40_000), 5)
    )
    client.connected()
    client.data_to_send()
    limits = SessionLimits(max_held_segments=0)
    server = ServerSession(make_scene(4), limits, session_id="s", now_s=0.0)
    server.receive(client.options.hello(np.zeros(0, dtype=[("id", "<u4"), ("xxh3", "<u8")])), 0.0)
    action = server.next_action()
    assert isinstance(action, SendMessage)
    client.receive(encode(action.message))
    opened, dropped = client.events()
    assert isinstance(opened, Opened)
    # What the server does not know of is not held.
    assert isinstance(dropped, Dropped)
    assert (len(dropped.segments), dropped.on_disk) == (40_000 - 32_768, ())
    assert 39_999 not in client.holdings
    assert client.data_to_send() == []


def test_an_aim_that_a_cut_ended_is_sent_anew(toy: ToyScene) -> None:
    pair = Pair(toy, credit_bytes=300)
    pair.connect()
    pair.settle()
    pair.client.aim(MIDDLE, 3.0)
    pair.client.flush_aim()
    while len(pair.received) < 2:
        pair.step()
    pair.disconnect()
    pair.connect()
    while pair.step():
        flush(pair)
    want = expected(toy, MIDDLE, 3.0)
    assert sorted(pair.received) == list(want)
    assert len(pair.of(Prefetched)) == 1
    pair.client.land(MIDDLE, 3.0)
    pair.settle()
    assert pair.of(Planned)[-1].plan.load_bytes == 0
    aims = pair.client.aims
    assert (aims.landings, aims.hits) == (1, 1)
    assert aims.used_bytes == aims.prefetched_bytes == pair.of(Planned)[-1].plan.total_bytes


def test_an_aim_is_not_sent_anew_once_all_has_come_or_the_user_has_landed(toy: ToyScene) -> None:
    pair = Pair(toy)
    pair.connect()
    pair.settle()
    pair.client.aim(MIDDLE, 3.0)
    pair.client.flush_aim()
    pair.settle()
    pair.disconnect()
    assert not pair.client.has_aim
    pair.connect()
    pair.settle()
    assert not pair.client.has_aim
    pair.client.aim((0, 0, 0), 3.0)
    pair.client.flush_aim()
    pair.client.land(MIDDLE, 3.0)
    pair.disconnect()
    pair.connect()
    pair.settle()
    assert not pair.client.has_aim
    assert pair.of(Ready)[-1].shown == expected(toy, MIDDLE, 3.0)


def test_an_aim_after_an_unfinished_landing_comes_behind_it_again(toy: ToyScene) -> None:
    pair = Pair(toy, credit_bytes=300)
    pair.connect()
    pair.settle()
    number = pair.client.land(MIDDLE, 3.0)
    pair.client.aim((0, 0, 0), 2.0)
    pair.client.flush_aim()
    while not pair.received:
        pair.step()
    pair.disconnect()
    pair.connect()
    while pair.step():
        flush(pair)
    kinds = [event for event in pair.events if isinstance(event, Ready | Prefetched)]
    assert [type(event) for event in kinds] == [Ready, Prefetched]
    assert kinds[0].landing == number
    assert len(set(pair.received)) == len(pair.received)


def test_a_miss_is_counted(toy: ToyScene) -> None:
    pair = Pair(toy)
    pair.connect()
    pair.settle()
    pair.client.aim((0, 0, 0), 1.0)
    pair.client.flush_aim()
    pair.settle()
    pair.client.land(MIDDLE, 2.0)
    pair.settle()
    aims = pair.client.aims
    assert (aims.landings, aims.hits, aims.used_bytes) == (1, 0, 0)
    assert aims.prefetched_bytes > 0
