"""The client's state machine against the server's: what is evicted, rejected, kept on disk.

What the files share stands in ``conftest.py`` and ``pairing.py``, both state machines side by side.
"""

from __future__ import annotations

import xxhash
from sdk.pairing import MIDDLE, FakeDisk, Pair, ToyScene, expected
from store.tiny_scene import SCALES, STEP_M, lattice_mesh

from terraport.events import (
    Dropped,
    Opened,
    Planned,
    Ready,
    SegmentRejected,
)
from terraport_payload import encode_segment
from terraport_wire import (
    Direction,
    Evict,
    Land,
    PayloadFrame,
    decode,
    encode_frame,
)


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
    held_ids = pair.server.transfers.held
    # What the server counts as held beyond the visible is what the next evict will name.
    pair.client.land((0, 0, 0), 2.0)
    messages = [decode(data, Direction.CLIENT_TO_SERVER) for data in pair.client.data_to_send()]
    assert [type(message) for message in messages] == [Evict, Land]
    assert set(messages[0].segments.tolist()) == set(held_ids.array().tolist()) - set(
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
    assert pair.client.holdings.peek(14).payload == pair.scene.payloads[14]


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
    assert pair.client.holdings.peek(0).payload == toy_payload


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
    assert 14 not in pair.client.holdings
    pair.spoil = None
    pair.client.land(MIDDLE, 4.0)  # a missing segment is tried again
    pair.settle()
    assert pair.client.visible == expected(pair.scene, MIDDLE, 4.0)


def test_the_disk_answers_for_what_memory_has_lost(toy: ToyScene) -> None:
    """Kept by the plan, read from disk, no byte sent."""
    disk = FakeDisk()
    pair = Pair(toy, cache_bytes=0, disk=disk)
    pair.connect()
    for position in ((0, 0, 0), (10, 0, 10), (0, 0, 0)):
        pair.client.land(position, 2.0)
        pair.settle()
    assert pair.of(Planned)[-1].plan.load_bytes == 0
    assert pair.client.visible == expected(toy, (0, 0, 0), 2.0)


def test_what_the_disk_has_lost_is_sent_again_in_the_same_landing(toy: ToyScene) -> None:
    """Facts of a segment that is asked for by hash alone come from its payload."""
    disk = FakeDisk()
    payload = encode_segment(lattice_mesh(0, 0), step_m=STEP_M, scales=SCALES)
    toy.payloads[0] = payload
    toy.lengths[0] = len(payload)
    toy.hashes[0] = xxhash.xxh3_64_intdigest(payload)
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
    assert again.client.holdings.peek(0).facts.faces == len(lattice_mesh(0, 0).faces)


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
