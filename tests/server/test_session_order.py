"""What a session may still send after a newer wish, in which order, and within which credit.

Properties over any history of landings, aims, credit, rejects and evictions.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from hypothesis import given, settings
from hypothesis import strategies as st
from server.session_model import Client, aim, ids, land, make_client, make_scene

from terraport_payload import box_distances_m
from terraport_payload.types import UInt64
from terraport_server.session.interface import SendChunk, SendMessage
from terraport_wire import HELD_DTYPE, Credit, Evict, Plan, Prefetch, Ready, Reject, Superseded

COUNT = 12
LENGTH = 200_000
"""Two chunks each."""

wishes = st.tuples(st.sampled_from(["land", "aim"]), st.integers(-20, 130), st.integers(1, 60))
steps = st.one_of(
    wishes,
    st.tuples(st.just("chunks"), st.integers(1, 5), st.just(0)),
    st.tuples(st.just("credit"), st.integers(1, 300_000), st.just(0)),
    st.tuples(st.just("reject"), st.integers(0, COUNT - 1), st.just(0)),
    st.tuples(st.just("evict"), st.integers(0, COUNT - 1), st.just(0)),
)


@settings(max_examples=150)
@given(script=st.lists(steps, max_size=25), credit=st.integers(0, 500_000))
def test_no_chunk_of_an_older_generation_and_never_beyond_the_credit(
    script: list[tuple[str, int, int]], credit: int
) -> None:
    """The core sends nothing old after a newer land; the shell may have one chunk in its hands."""
    client = make_client(make_scene(COUNT, length=LENGTH), greet=False)
    client.greet(credit_bytes=credit)
    session, granted, generation, oldest = client.session, credit, 0, 0
    for kind, first, second in script:
        if kind in {"land", "aim"}:
            generation += 1
            begun = len(client.chunks)
            client.tell((land if kind == "land" else aim)(generation, float(first), float(second)))
            oldest = generation if kind == "land" else oldest
            assert len(client.chunks) == begun
        elif kind == "credit":
            granted += first
            client.credit += first
            client.tell(Credit(bytes=first))
        elif kind == "chunks":
            sent = len(client.chunks)
            client.run(until=lambda sent=sent, most=first: len(client.chunks) >= sent + most)
            for chunk in client.chunks[sent:]:
                assert chunk.generation >= oldest
        elif kind == "reject" and session.transfers is not None:
            _reject(client, first)
        elif kind == "evict":
            _evict(client, first)
        assert session.transfers is not None
        assert session.transfers.credit_bytes == granted - sum(c.length for c in client.chunks)
    client.credit += 1 << 24
    client.tell(Credit(bytes=1 << 24))
    sent = len(client.chunks)
    client.run()
    assert all(chunk.generation >= oldest for chunk in client.chunks[sent:])
    assert session.next_action() is None


def _reject(client: Client, segment: int) -> None:
    """Reject what is held; the newest plan that has it sends it again."""
    _until_told(client)
    if segment in client.held:
        client.held.discard(segment)
        newest = next((m for m in reversed(client.messages) if isinstance(m, Plan)), None)
        if newest is not None and segment in {*newest.load["id"].tolist(), *newest.keep.tolist()}:
            client.load[newest.generation].append(segment)
        client.tell(Reject(generation=0, segment=segment, reason="x"))


def _until_told(client: Client) -> None:
    """Take every message and plan, and no payload."""
    transfers = client.session.transfers
    assert transfers is not None
    client.run(until=lambda: client.session.pending == 0 and not transfers.plan_is_due)


def _evict(client: Client, segment: int) -> None:
    _until_told(client)
    transfers = client.session.transfers
    assert transfers is not None
    newest = next((m for m in reversed(client.messages) if isinstance(m, Plan)), None)
    plan = [] if newest is None else [*newest.load["id"].tolist(), *newest.keep.tolist()]
    if not (transfers.landing_open and segment in plan):
        client.held.discard(segment)
        client.tell(Evict(segments=ids(segment)))


@settings(max_examples=200)
@given(
    x=st.integers(-10, 120),
    radius=st.integers(5, 80),
    kept=st.sets(st.integers(0, COUNT - 1)),
    rejects=st.lists(st.tuples(st.integers(1, 6), st.integers(0, COUNT - 1)), max_size=6),
)
def test_the_nearest_that_is_due_goes_next_also_after_rejects_and_resume(
    x: int, radius: int, kept: set[int], rejects: list[tuple[int, int]]
) -> None:
    # A landing of a client that offers what it kept.
    scene = make_scene(COUNT, length=LENGTH)
    client = make_client(scene, greet=False)
    hashes = scene.encodings["glb"].hashes
    client.greet(held=_offer(kept, hashes))  # what a reconnect would offer
    client.tell(land(1, float(x), float(radius), inner_radius_m=min(5.0, radius)))
    (plan,) = client.run(most=1)
    # The model: what is due goes by distance, then by id, and what has begun goes on first.
    distances = box_distances_m(scene.encodings["glb"].bounds, (float(x), 0.0, 0.0))
    rank: Callable[[int], tuple[float, int]] = lambda s: (float(distances[s]), s)  # noqa: E731
    due = set(plan.load["id"].tolist())
    in_plan = due | set(plan.keep.tolist())
    assert plan.load["id"].tolist() == sorted(due, key=rank)
    resent: set[int] = set()
    partly: int | None = None
    script = list(rejects)
    left = script[0][0] if script else -1
    # Chunk by chunk; between them the client rejects as the script says.
    while (action := client.session.next_action()) is not None:
        if isinstance(action, SendMessage):
            assert isinstance(action.message, Ready | Superseded | Prefetch)
            if not script:
                continue
        else:
            assert isinstance(action, SendChunk)
            expected = min(due, key=rank) if partly is None else partly
            assert action.segment == expected
            client.session.chunks_sent([action], 0.0)
            client.credit -= action.length
            partly = action.segment
            if action.offset + action.length == action.total:
                partly = None
                due.discard(action.segment)
                client.held.add(action.segment)
            left -= 1
        if script and (left <= 0 or isinstance(action, SendMessage)):
            segment = script.pop(0)[1]
            left = script[0][0] if script else -1
            # A segment of the plan comes once more, and only once.
            if segment in client.held:
                client.held.discard(segment)
                if segment in in_plan and segment not in resent:
                    due.add(segment)
                    resent.add(segment)
                client.tell(Reject(generation=1, segment=segment, reason="x"))
    assert not due


def _offer(kept: set[int], hashes: UInt64) -> npt.NDArray[np.void]:
    rows = [(segment, int(hashes[segment])) for segment in sorted(kept)]
    return np.array(rows, dtype=HELD_DTYPE)
