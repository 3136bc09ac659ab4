"""The session state machine with a client that fetches payload by itself (specification, 17)."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from server.session_model import (
    Client,
    assert_fatal,
    kinds,
    land,
    last_error,
    make_client,
    make_scene,
)

from terraport_server.session.interface import PullView, SceneView, SendChunk
from terraport_server.session.rate_limit import HELD_ROWS_PER_MESSAGE, RATE_WINDOW_S
from terraport_wire import (
    BLOCK_BYTES,
    HELD_DTYPE,
    CloseCode,
    Degraded,
    ErrorCode,
    Held,
    HeldChecked,
    Plan,
    PullInfo,
    Ready,
    Reject,
)

COUNT = 12


def pull_scene() -> SceneView:
    """Payloads of 1,000 bytes and some, each at a multiple of 1,024."""
    info = PullInfo(base="scenes/row/", pack="v-1/segments.pack", pack_bytes=1 << 20)
    offsets = 64 + 1024 * np.arange(COUNT, dtype=np.uint64)
    return dataclasses.replace(make_scene(COUNT), pull=PullView(info, offsets))


def make_puller(**limits: float) -> Client:
    client = make_client(pull_scene(), greet=False, **limits)
    welcome = client.greet(delivery="pull")
    assert welcome.pull is not None
    assert welcome.pull.pack == "v-1/segments.pack"
    return client


def fetched(client: Client, *segments: int) -> list[Any]:
    """Say that these are whole, and return what comes of it."""
    client.held |= set(segments)
    client.tell(Held(segments=np.array([(s, 7000 + s) for s in segments], dtype=HELD_DTYPE)))
    return client.run()


def test_a_plan_says_where_and_nothing_is_sent() -> None:
    client = make_puller()
    client.tell(land(1))
    (plan,) = client.run()
    assert isinstance(plan, Plan)
    assert plan.load["id"].tolist() == [0, 1, 2]
    assert (plan.blocks * BLOCK_BYTES).tolist() == [64, 64 + 1024, 64 + 2048]
    assert client.session.upcoming(10) == []


def test_who_does_not_ask_is_sent_frames() -> None:
    for scene, fields in ((pull_scene(), {}), (make_scene(), {"delivery": "pull"})):
        client = make_client(scene, greet=False)
        assert client.greet(**fields).pull is None
        client.tell(land(1))
        plan, *rest = client.run()
        assert plan.blocks is None
        assert kinds(rest) == ["SendChunk"] * 3 + ["Ready"]


def test_ready_follows_what_the_client_tells() -> None:
    client = make_puller()
    client.tell(land(1))
    client.run()
    (checked,) = fetched(client, 0, 2)
    assert isinstance(checked, HeldChecked)
    assert checked.held_count == 2
    ready, checked = sorted(fetched(client, 1), key=lambda message: message.TYPE, reverse=True)
    assert isinstance(ready, Ready)
    assert (ready.delivered, ready.payload_bytes, ready.missing.tolist()) == (3, 0, [])
    client.tell(land(2))
    plan, ready = client.run()
    assert (plan.keep.tolist(), len(plan.load)) == ([0, 1, 2], 0)
    assert isinstance(ready, Ready)


def test_what_is_rejected_comes_in_frames_and_is_then_given_up() -> None:
    client = make_puller()
    client.tell(land(1))
    client.run()
    fetched(client, 0, 2)
    client.tell(Reject(generation=1, segment=1, reason="hash_mismatch"))
    chunk, ready = client.run()
    assert isinstance(chunk, SendChunk)
    assert (chunk.segment, chunk.total) == (1, 1001)
    assert (ready.delivered, ready.payload_bytes) == (3, 1001)
    client.held.discard(1)
    client.tell(Reject(generation=1, segment=1, reason="hash_mismatch"))
    (ready,) = client.run()
    assert ready.missing.tolist() == [1]


def test_what_is_being_sent_again_is_not_held_by_word() -> None:
    """A segment is in one of two states: else its frames would come to a client that has it."""
    client = make_client(pull_scene(), greet=False)
    client.greet(delivery="pull", credit_bytes=0)
    client.tell(land(1))
    client.run()
    client.tell(Reject(generation=1, segment=1, reason="hash_mismatch"))
    checked = fetched(client, 0, 1, 2)[0]
    assert checked.held_count == 2
    client.held.discard(1)
    assert client.session.transfers is not None
    assert client.session.transfers.landing_open


def test_the_deadline_goes_by_what_was_told() -> None:
    client = make_puller()
    client.tell(land(1, inner_radius_m=5.0, stall_ms=1000))
    client.run()
    client.now_s = 0.9
    fetched(client, 2)
    client.now_s = 1.8
    client.session.tick(client.now_s)
    assert not client.run()
    client.now_s = 2.0
    degraded = [m for m in fetched(client, 0) if isinstance(m, Degraded)]
    assert [m.segments.tolist() for m in degraded] == [[0]]


def test_held_stays_out_of_order_where_frames_are_sent() -> None:
    client = make_client(pull_scene())
    client.tell(land(1))
    client.run()
    client.tell(Held(segments=np.array([(0, 7000)], dtype=HELD_DTYPE)))
    client.run()
    assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)


def held_rows(count: int) -> Any:
    rows = np.zeros(count, dtype=HELD_DTYPE)
    rows["id"] = np.arange(count)
    return rows


def test_held_is_charged_by_its_rows() -> None:
    """Sixty messages a second may each have 32,768 rows; so many cost the service seconds."""
    client = make_puller(max_messages_per_s=4.0)
    client.tell(land(1))
    client.run()
    rows = held_rows(4 * HELD_ROWS_PER_MESSAGE)
    tokens = int(RATE_WINDOW_S * 4.0)
    told = 0
    while not client.session.closing:
        client.tell(Held(segments=rows))
        client.run()
        told += 1
        assert told < tokens / 4
    assert last_error(client).code == ErrorCode.TOO_MANY
    # Five each: one for the message, four for its rows; hello and land took one each.
    assert told == (tokens - 2) // 5 + 1


def test_what_is_fetched_does_not_count_as_unsent() -> None:
    client = make_puller()
    client.tell(land(1))
    client.run()
    fetched(client, 0)
    client.tell(land(2, x=100.0))
    superseded, _ = client.run()
    assert superseded.unsent_bytes == 1001 + 1002
