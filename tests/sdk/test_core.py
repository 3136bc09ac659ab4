"""The session core against the server's own session: any history, and single rules."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Any

import pytest
from sdk.pairing import CENTRE, COUNT, Pair, ToyScene

import terraport_wire
from terraport.core import SessionCore
from terraport.errors import ProtocolViolationError, UsageError
from terraport.events import (
    InnerWhole,
    LandingSent,
    Opened,
    PickAnswered,
    PickRefused,
    Planned,
    Refused,
    SegmentRejected,
    Shown,
    Superseded,
)
from terraport_wire import Direction, Error, Land, Notice, Plan, Ready, decode, encode, frame_header

EVERYWHERE_M = 300.0


def lands(pair: Pair) -> list[Land]:
    """The ``land`` messages that were sent."""
    messages = [decode(data, Direction.CLIENT_TO_SERVER) for data in pair.messages]
    return [message for message in messages if isinstance(message, Land)]


def flipped(frame: bytes, chance: random.Random) -> bytes:
    """One bit of the payload is wrong."""
    at = chance.randrange(24, len(frame))
    return frame[:at] + bytes([frame[at] ^ 1 << chance.randrange(8)]) + frame[at + 1 :]


def check_shown(pair: Pair, wanted: dict[str, Any]) -> None:
    """Compare what is shown with a loop over the scene."""
    keys, hidden = pair.scene.expected(**wanted, missing=pair.broken, budgets=pair.budgets)
    assert pair.core.shown_keys == keys
    assert pair.core.shown.hidden == hidden


@pytest.mark.parametrize("seed", range(150))
def test_any_history_ends_with_what_the_last_landing_shows(seed: int) -> None:
    """With cuts, flipped bits, lost files, small caches, stray aims and late messages."""
    chance = random.Random(seed)
    levels = chance.choice([1, 2])
    scenes = [ToyScene(seed, levels=levels, version=version) for version in (1, 2)]
    pair = Pair(
        scenes[0],
        cache_bytes=chance.choice([0, 600, 1 << 20]),
        credit_bytes=chance.choice([50, 400, 1 << 20]),
        disk=chance.choice([None, {}]),
        max_segments=chance.choice([None, None, 6]),
    )
    pair.broken = set(chance.sample(range(COUNT * levels), chance.choice([0, 0, 3])))
    wanted: dict[str, Any] = {}
    refused: set[int] = set()
    flips = chance.choice([0.0, 0.0, 0.02])
    pair.spoil = lambda frame: flipped(frame, chance) if chance.random() < flips else frame
    pair.connect()
    for _ in range(120):
        step = chance.random()
        position = tuple(chance.uniform(0, 100) for _ in range(3))
        if step < 0.1:
            radius_m = chance.uniform(1, 60)
            wanted = {"position": position, "radius_m": radius_m}
            if chance.random() < 0.4:
                wanted["coarse_radius_m"] = radius_m + chance.uniform(0, 40)
            inner_m = radius_m / 2 if chance.random() < 0.5 else None
            number = pair.core.land(**wanted, inner_radius_m=inner_m)
        elif step < 0.12 and wanted:
            refused.add(pair.core.land(position, 501.0))  # beyond the limit
            if pair.core.is_open:
                pair.speak()
                before = wanted
                while any([pair.serve(), pair.hear()]):
                    pass
                wanted = before
        elif step < 0.2:
            pair.core.aim(position, chance.uniform(1, 60))
            pair.core.flush_aim()
        elif step < 0.25 and wanted:
            pair.core.hurry(number)
        elif step < 0.3 and pair.disk:
            del pair.disk[chance.choice(list(pair.disk))]
        elif step < 0.33:
            if pair.server is not None:
                pair.disconnect()
            pair.scene = chance.choice(scenes)
            pair.connect()
        else:
            for _ in range(chance.randrange(8)):
                chance.choice([pair.speak, pair.serve, pair.serve, pair.hear, pair.hear,
                               pair.restore])()  # fmt: skip
        pair.collect()
    flips = 0.0
    if pair.server is None:
        pair.connect()
    number = pair.core.land(CENTRE, 40.0)
    pair.settle()
    check_shown(pair, {"position": CENTRE, "radius_m": 40.0})
    assert pair.core.repeated_bytes == 0
    assert {event.landing for event in pair.of(Refused)} <= {*refused, None}
    # Every landing is sent, and comes to one end.
    ends = [*pair.of(Shown), *pair.of(Superseded), *pair.of(Refused)]
    assert sorted(event.landing for event in ends) == list(range(1, number + 1))
    # The same again takes no payload, if memory or disk keep it.
    if pair.disk is not None or not pair.core._cache.is_full:
        received = len(pair.received)
        pair.disconnect()
        pair.connect()
        pair.core.land(CENTRE, 40.0)
        pair.settle()
        check_shown(pair, {"position": CENTRE, "radius_m": 40.0})
        assert len(pair.received) == received


def test_what_a_landing_lists_as_held_stays_until_its_plan() -> None:
    """Payload that arrives between ``land`` and ``plan`` evicts none of it (4, rule 4)."""
    scene = ToyScene(1)
    places = [tuple(scene.table.bounds[row, :3].tolist()) for row in range(COUNT)]
    keys = [scene.expected(place, 12.0)[0] for place in places]
    lengths = dict(zip(scene.table.hashes.tolist(), scene.table.lengths.tolist(), strict=True))
    home, away, ahead = next(
        (a, b, c)
        for a in range(COUNT)
        for b in range(COUNT)
        for c in range(COUNT)
        if not (keys[a] & keys[b] or keys[a] & keys[c] or keys[b] & keys[c])
    )
    cache_bytes = sum(lengths[key] for key in keys[home] | keys[away])
    pair = Pair(scene, cache_bytes=cache_bytes)
    pair.connect()
    for place in (home, away):
        pair.core.land(places[place], 12.0)
        pair.settle()
    pair.core.aim(places[ahead], 12.0)
    pair.core.flush_aim()
    pair.speak()
    while pair.serve():
        pass
    pair.core.land(places[home], 12.0)
    pair.speak()
    assert set(lands(pair)[-1].have.tolist()) >= keys[home]
    while pair.hear():  # the payload of the aim fills the memory
        pass
    assert len(pair.received) == sum(len(keys[place]) for place in (home, away, ahead))
    pair.settle()
    check_shown(pair, {"position": places[home], "radius_m": 12.0})
    assert len(lands(pair)) == 3
    assert len(pair.received) == len(set(pair.received))


def test_a_landing_from_the_welcome_to_the_swap(pair: Pair) -> None:
    (opened,) = pair.of(Opened)
    assert (opened.scene.segment_count, opened.version_changed) == (COUNT, False)
    pair.core.land(CENTRE, EVERYWHERE_M)
    assert pair.core.shown.ids == ()
    pair.settle()
    (planned,) = pair.of(Planned)
    assert planned.here == ()
    assert pair.received == planned.plan.show["key"].tolist()
    assert pair.of(Shown)[-1].ids == tuple(range(COUNT))
    assert len(pair.of(LandingSent)) == 1
    check_shown(pair, {"position": CENTRE, "radius_m": EVERYWHERE_M})


def test_what_stays_is_named_and_comes_once(pair: Pair) -> None:
    for radius_m in (20.0, 60.0, 30.0):
        pair.core.land(CENTRE, radius_m)
        pair.settle()
        check_shown(pair, {"position": CENTRE, "radius_m": radius_m})
    assert len(pair.received) == len(set(pair.received))
    far = lands(pair)[-1]
    assert set(far.have.tolist()) >= set(pair.core.shown_keys)


def test_one_land_leaves_however_often_the_user_lands(pair: Pair) -> None:
    for x in range(5):
        pair.core.land((float(x), 0.0, 0.0), 5.0)
    pair.settle()
    assert [land.position[0] for land in lands(pair)] == [4.0]
    assert [(event.landing, event.by) for event in pair.of(Superseded)] == [
        (1, 2), (2, 3), (3, 4), (4, 5)
    ]  # fmt: skip


def test_a_newer_landing_ends_the_older_when_its_plan_comes(pair: Pair) -> None:
    pair.core.land(CENTRE, EVERYWHERE_M)
    pair.speak()
    while not pair.received:
        pair.serve()
        pair.hear()
    pair.core.land(CENTRE, 20.0)
    pair.speak()
    assert pair.of(Superseded) == []
    pair.settle()
    assert pair.of(Superseded) == [Superseded(1, 2)]
    assert [shown.landing for shown in pair.of(Shown)] == [2]
    assert len(pair.received) == len(set(pair.received))


def test_a_refused_landing_lets_the_older_go_on(pair: Pair) -> None:
    """Even where all of the older came meanwhile."""
    pair.core.land(CENTRE, 20.0)
    pair.speak()
    while pair.serve():
        pass
    pair.core.land(CENTRE, 501.0)
    pair.speak()
    while pair.hear():
        pass
    assert pair.of(Shown) == [], "the newest landing alone may be shown"
    pair.settle()
    assert [(event.code, event.landing) for event in pair.of(Refused)] == [("radius_too_large", 2)]
    assert [shown.landing for shown in pair.of(Shown)] == [1]


def test_the_inner_set_is_shown_when_patience_is_over_and_it_is_whole() -> None:
    pair = Pair(ToyScene(), credit_bytes=100)
    pair.connect()
    pair.core.land(CENTRE, EVERYWHERE_M, inner_radius_m=20.0)
    pair.core.hurry(1)
    while not pair.of(InnerWhole):
        assert any([pair.speak(), pair.serve(), pair.hear()])
    keys, hidden = pair.scene.expected(CENTRE, 20.0)
    (inner,) = pair.of(InnerWhole)
    assert len(inner.ids) == len(keys) < COUNT
    assert inner.hidden == hidden
    assert pair.of(Shown) == []
    pair.settle()
    assert len(pair.of(InnerWhole)) == 1
    check_shown(pair, {"position": CENTRE, "radius_m": EVERYWHERE_M})


@pytest.mark.parametrize("times", [1, 2, 5])
def test_a_damaged_segment_is_asked_for_twice_and_then_left_out(pair: Pair, times: int) -> None:
    victim, seen = int(pair.scene.table.hashes[3]), []

    def spoil(frame: bytes) -> bytes:
        if int.from_bytes(frame[8:16], "little") == victim:
            seen.append(frame)
            if len(seen) <= times:
                return frame[:-1] + bytes([frame[-1] ^ 1])
        return frame

    pair.spoil = spoil
    pair.core.land(CENTRE, EVERYWHERE_M)
    pair.settle()
    assert len(seen) == 2
    assert [event.key for event in pair.of(SegmentRejected)] == [victim] * min(times, 2)
    (shown,) = pair.of(Shown)
    assert shown.missing == (() if times == 1 else (3,))
    assert [land.without is None for land in lands(pair)] == [True] * 2 + [False] * (times > 1)
    keys, hidden = pair.scene.expected(CENTRE, EVERYWHERE_M, missing={3} if times > 1 else set())
    assert (pair.core.shown_keys, shown.hidden) == (keys, hidden)
    # Elsewhere it has another chance.
    pair.spoil = None
    pair.core.land(CENTRE, EVERYWHERE_M)
    pair.settle()
    check_shown(pair, {"position": CENTRE, "radius_m": EVERYWHERE_M})


def test_a_landing_is_given_up_where_too_many_segments_are_damaged(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More than a message can leave out: they would come again without end."""
    monkeypatch.setattr(terraport_wire, "MAX_WITHOUT", 8)  # the scene has fewer than 64
    pair.spoil = lambda frame: frame[:-1] + bytes([frame[-1] ^ 1])
    pair.core.land(CENTRE, EVERYWHERE_M)
    pair.settle()
    (refused,) = pair.of(Refused)
    assert (refused.code, refused.fatal, refused.landing) == ("damaged", False, 1)
    assert pair.of(Shown) == []
    assert len(lands(pair)) == 2


def test_what_the_server_cannot_deliver_is_missing_and_its_base_stays(pair: Pair) -> None:
    pair.broken = {0, 7}
    pair.core.land(CENTRE, EVERYWHERE_M)
    pair.settle()
    assert pair.of(Shown)[-1].missing == (0, 7)
    check_shown(pair, {"position": CENTRE, "radius_m": EVERYWHERE_M})


def test_nothing_that_was_named_leaves_memory_before_the_swap() -> None:
    pair = Pair(ToyScene(), cache_bytes=0)
    pair.connect()
    pair.core.land(CENTRE, 30.0)
    pair.settle()
    shown = pair.core.shown_keys
    pair.core.land(CENTRE, EVERYWHERE_M)
    pair.speak()
    assert pair.core.needed >= shown
    pair.core.aim((0.0, 0.0, 0.0), 5.0)
    pair.settle()
    assert len(pair.received) == COUNT, "nothing came twice"
    pair.core.land((500.0, 0.0, 500.0), 1.0)
    pair.settle()
    assert (pair.core.shown_keys, pair.core.cache_bytes) == (frozenset(), 0)


def test_files_of_an_earlier_run_are_named_and_read() -> None:
    first = Pair(ToyScene(), disk={})
    first.connect()
    first.core.land(CENTRE, EVERYWHERE_M)
    first.settle()
    disk = dict(first.disk or {})
    gone, damaged, *_ = disk
    second = Pair(ToyScene(), disk=disk)
    disk[damaged] = disk[damaged][:-1]
    del disk[gone]
    second.connect()
    second.core.land(CENTRE, EVERYWHERE_M)
    second.settle()
    assert sorted(second.received) == sorted([gone, damaged])
    assert {event.key for event in second.of(SegmentRejected)} == {gone, damaged}
    check_shown(second, {"position": CENTRE, "radius_m": EVERYWHERE_M})


def test_a_cut_loses_nothing_whole(pair: Pair) -> None:
    pair.core.land(CENTRE, EVERYWHERE_M)
    pair.core.pick(CENTRE)
    for _ in range(6):
        for _ in range(12):
            pair.speak()
            pair.serve()
            pair.hear()
        pair.disconnect()
        pair.connect()
    pair.settle()
    assert sorted(pair.received) == sorted(pair.scene.table.hashes.tolist())
    assert len(pair.of(PickAnswered)) == 1
    assert len(pair.of(Planned)) > 1
    check_shown(pair, {"position": CENTRE, "radius_m": EVERYWHERE_M})


def test_another_version_shows_nothing_before_it_is_landed_in(pair: Pair) -> None:
    pair.core.land(CENTRE, EVERYWHERE_M)
    pair.settle()
    received = len(pair.received)
    pair.disconnect()
    assert pair.core.shown.ids
    pair.scene = ToyScene(version=2)
    pair.connect()
    pair.settle()
    assert (pair.core.shown.ids, pair.of(Opened)[-1].version_changed) == ((), True)
    pair.core.land(CENTRE, EVERYWHERE_M)
    pair.settle()
    check_shown(pair, {"position": CENTRE, "radius_m": EVERYWHERE_M})
    changed = set(pair.scene.table.hashes.tolist()) - set(ToyScene().table.hashes.tolist())
    assert set(pair.received[received:]) == changed


def test_an_aim_brings_ahead_what_a_landing_needs(pair: Pair) -> None:
    pair.core.aim(CENTRE, 10.0)
    pair.core.aim(CENTRE, EVERYWHERE_M)
    assert pair.core.has_aim
    pair.core.flush_aim()
    pair.settle()
    assert pair.core.prefetched_bytes == sum(map(len, pair.scene.payloads))
    pair.core.land(CENTRE, EVERYWHERE_M)
    pair.settle()
    assert len(pair.of(Planned)[-1].here) == COUNT == len(pair.received)
    # A landing takes the place of an aim that was not sent.
    pair.core.aim(CENTRE, 10.0)
    pair.core.land(CENTRE, 10.0)
    assert not pair.core.has_aim


def test_bad_numbers_change_nothing(pair: Pair) -> None:
    for call in (
        lambda: pair.core.land((1, 2), 5.0),
        lambda: pair.core.land(("a", 2, 3), 5.0),
        lambda: pair.core.land(CENTRE, -1.0),
        lambda: pair.core.land(CENTRE, 5.0, inner_radius_m=6.0),
        lambda: pair.core.land(CENTRE, 5.0, coarse_radius_m=4.0),
        lambda: pair.core.aim(CENTRE, float("nan")),
        lambda: pair.core.pick(CENTRE, (0, 0, 0)),
    ):
        with pytest.raises(UsageError):
            call()
    pair.core.flush_aim()
    assert pair.core.data_to_send() == []
    assert pair.core.land(CENTRE, 5.0) == 1
    ring = pair.core.land(CENTRE, 5.0, coarse_radius_m=9_000.0)
    pair.settle()
    assert lands(pair)[-1].coarse_radius_m == 500.0, "cut to what the server allows"
    assert pair.of(Shown)[-1].landing == ring


def test_picks_are_answered_refused_and_dropped(pair: Pair) -> None:
    core = pair.core
    first, second, third = (core.pick(CENTRE) for _ in range(3))
    core.drop_pick(third)
    core.receive(encode(Error(code="too_many", message="m", fatal=False, request=second)))
    pair.settle()
    assert pair.of(PickRefused) == [PickRefused(second, "too_many", "m")]
    assert pair.of(PickAnswered) == [PickAnswered(first, None)]
    core.receive(encode(Notice(kind="scene_published", version="v")))
    pair.collect()
    assert [notice.version for notice in pair.of(Notice)] == ["v"]


def frame(key: int, offset: int, total: int, data: bytes) -> bytes:
    return frame_header(generation=0, key=key, offset=offset, total=total) + data


@pytest.mark.parametrize(
    ("junk", "text"),
    [
        ([b"\xc1"], "msgpack|value"),
        (["{}"], "text message"),
        ([frame(1, 0, 4, b"ab")[:10]], "header"),
        ([frame(1, 2, 4, b"ab")], "got byte 2 .* expected no segment"),
        ([frame(1, 0, 4, b"ab"), frame(2, 2, 4, b"ab")], "expected byte 2 of 0+1"),
        ([frame(1, 0, 5000, b"a" * 4096), frame(1, 4096, 5000, b"b")], "expected at most 4096"),
        ([encode(Ready(generation=9))], "ready of generation 9, expected at most 0"),
    ],
)
def test_junk_is_a_violation(junk: list[Any], text: str) -> None:
    pair = Pair(ToyScene(), credit_bytes=4096)
    pair.connect()
    with pytest.raises(ProtocolViolationError, match="first"):
        pair.core.receive(frame(1, 0, 4, b"ab"))
    pair.settle()
    pair.core._credit_step = 1 << 30  # no grant in between
    for data in junk[:-1]:
        pair.core.receive(data)
    with pytest.raises(ProtocolViolationError, match=text):
        pair.core.receive(junk[-1])


def test_hidden_faces_that_are_no_bits_of_the_base_are_a_violation(pair: Pair) -> None:
    pair.core.land(CENTRE, 5.0)
    pair.speak()
    while not (pair.down and b"plan" in pair.down[-1]):
        pair.serve()
    plan = decode(pair.down[-1], Direction.SERVER_TO_CLIENT)
    assert isinstance(plan, Plan)
    for wrong in (b"", b"junk", plan.hidden[:-9] if plan.hidden else b""):
        core: SessionCore = pair.core
        with pytest.raises(ProtocolViolationError, match="hidden faces"):
            core.receive(encode(replace(plan, hidden=wrong)))
