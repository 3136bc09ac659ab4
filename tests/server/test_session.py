"""The session state machine: greeting, order, errors, time, news, any history against a model.

What the files of the session's tests share stands in ``session_model.py``: small scenes, a client
that keeps the rules, and short words for messages. Landings are in ``test_session_landings.py``;
aims, picks and what is held in ``test_session_held.py``.
"""

from __future__ import annotations

from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from server.plain_client import make_hello
from server.session_model import (
    Client,
    aim,
    assert_fatal,
    ids,
    kinds,
    land,
    last_error,
    make_client,
    make_scene,
)

from terraport_payload import box_distances_m
from terraport_server.session.interface import Close, Observer, SessionLimits
from terraport_server.session.session import INTERNAL_TEXT, Session
from terraport_wire import (
    HELD_DTYPE,
    Budgets,
    Bye,
    CloseCode,
    Credit,
    Direction,
    ErrorCode,
    Evict,
    FieldError,
    MalformedError,
    Notice,
    Plan,
    Ready,
    Reject,
    Superseded,
    Unknown,
    Welcome,
    decode,
)

# Greeting, order, errors.


def test_hello_comes_first() -> None:
    client = make_client(greet=False)
    client.tell(land(1))
    error = assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)
    assert error.message == "got land first, expected hello"


def test_an_unknown_type_is_no_hello() -> None:
    """Else a stranger could send as many as it likes before it says who it is."""
    client = make_client(greet=False)
    client.session.receive(Unknown("wave"), 0.0)
    error = assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)
    assert error.message == "got an unknown type first, expected hello"


def test_hello_comes_once() -> None:
    client = make_client()
    client.tell(make_hello())
    assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)


def test_another_major_version_is_refused_with_the_versions_offered() -> None:
    client = make_client(greet=False)
    client.tell(make_hello(protocol=(2, 0)))
    error = assert_fatal(client, ErrorCode.UNSUPPORTED_VERSION, CloseCode.VERSION)
    assert error.protocols == ((1, 0),)


def test_a_newer_minor_version_is_spoken_as_ours() -> None:
    assert make_client(greet=False).greet(protocol=(1, 7)).protocol == (1, 0)


def test_an_encoding_that_the_scene_lacks() -> None:
    client = make_client(make_scene(encoding="later"), greet=False)
    client.tell(make_hello())
    error = assert_fatal(client, ErrorCode.UNSUPPORTED_ENCODING, CloseCode.VERSION)
    assert error.message == "got encoding glb, expected one of: later"


def test_too_many_held_segments() -> None:
    client = make_client(greet=False, max_held_segments=1)
    client.tell(make_hello(held=np.array([(0, 7000), (1, 7001)], dtype=HELD_DTYPE)))
    assert_fatal(client, ErrorCode.TOO_LARGE, CloseCode.TOO_LARGE)


@pytest.mark.parametrize("code", [ErrorCode.UNAUTHORISED, ErrorCode.FORBIDDEN])
def test_the_token_decides(code: ErrorCode) -> None:
    def authorise(token: str | None) -> tuple[ErrorCode, str] | None:
        return None if token == "right" else (code, "why not")

    client = make_client(greet=False, authorise=authorise)
    client.tell(make_hello(token="wrong"))
    assert_fatal(client, code, {"unauthorised": 4401, "forbidden": 4403}[code])  # type: ignore[arg-type]
    client = make_client(greet=False, authorise=authorise)
    assert isinstance(client.greet(token="right"), Welcome)


@pytest.mark.parametrize("second", [4, 3, 0])
def test_generations_increase_over_aims_and_landings(second: int) -> None:
    client = make_client()
    client.tell(aim(4))
    client.tell(land(second))
    error = assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)
    assert error.generation == second
    assert error.message == f"got generation {second}, expected one above 4"


def test_the_first_generation_may_be_zero() -> None:
    client = make_client()
    client.tell(land(0, radius_m=5.0))
    assert kinds(client.run()) == ["Plan", "SendChunk", "Ready"]


def test_a_radius_too_large_is_refused_and_the_open_landing_goes_on() -> None:
    client = make_client()
    client.tell(land(1))
    client.run(most=2)
    client.tell(land(2, radius_m=500.5))
    error, *rest = client.run()
    assert (error.code, error.generation, error.fatal) == ("radius_too_large", 2, False)
    assert kinds(rest) == ["SendChunk", "SendChunk", "Ready"]
    client.tell(land(2))
    assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)


def test_a_bad_landing_is_refused_and_its_generation_is_used() -> None:
    client = make_client()
    bad = {"type": "land", "generation": 3, "position": [0, 0, 0], "radius_m": -1}
    with pytest.raises(FieldError) as caught:
        decode(msgpack.packb(bad), Direction.CLIENT_TO_SERVER)
    client.session.refuse(caught.value, 0.0)
    error = last_error(client)
    assert (error.code, error.generation, error.fatal) == ("invalid_field", 3, False)
    client.tell(land(3))
    assert_fatal(client, ErrorCode.OUT_OF_ORDER, CloseCode.MALFORMED)


def test_what_is_no_message_is_fatal() -> None:
    client = make_client()
    client.session.refuse(MalformedError("got rubbish", offset=3), 0.0)
    assert_fatal(client, ErrorCode.MALFORMED, CloseCode.MALFORMED)


def test_a_bad_message_before_hello_is_fatal_whatever_it_is() -> None:
    client = make_client(greet=False)
    client.session.refuse(FieldError("land", "radius_m", "got -1", generation=1), 0.0)
    assert_fatal(client, ErrorCode.INVALID_FIELD, CloseCode.MALFORMED)


def test_unknown_messages_are_skipped() -> None:
    client = make_client()
    client.session.receive(Unknown("teleport_party"), 0.0)
    assert client.run() == []


def test_bye_ends_it_and_nothing_more_is_sent() -> None:
    client = make_client()
    client.tell(land(1))
    client.tell(Bye())
    assert client.run() == [Close(CloseCode.NORMAL, "bye")]
    assert client.run() == []


def test_a_failure_of_ours_tells_nothing() -> None:
    client = make_client()
    client.session.fail()
    error = assert_fatal(client, ErrorCode.INTERNAL, CloseCode.INTERNAL)
    assert error.message == INTERNAL_TEXT


# Time.


def test_no_hello_in_time() -> None:
    client = make_client(greet=False, handshake_timeout_s=3.0)
    assert client.session.wake_at_s() == 3.0
    client.session.tick(2.9)
    assert client.run() == []
    client.session.tick(3.0)
    assert_fatal(client, ErrorCode.TIMEOUT, CloseCode.TIMEOUT)


def test_silence_ends_the_session_and_a_pong_is_no_silence() -> None:
    client = make_client(idle_timeout_s=5.0)
    client.session.heard(4.0)
    client.session.tick(6.0)
    assert client.run() == []
    assert client.session.wake_at_s() == 9.0
    client.session.tick(9.0)
    assert_fatal(client, ErrorCode.TIMEOUT, CloseCode.TIMEOUT)


def test_too_many_messages() -> None:
    client = make_client(max_messages_per_s=2.0)  # 20 at once; hello took one
    for _ in range(19):
        client.tell(Credit(bytes=1))
    assert client.run() == []
    client.now_s = 0.5
    client.tell(Credit(bytes=1))
    assert client.run() == []
    client.tell(Credit(bytes=1))
    assert_fatal(client, ErrorCode.TOO_MANY, CloseCode.TOO_MANY)


# News.


def test_draining_finishes_the_open_landing_first() -> None:
    client = make_client(reconnect_after_ms=700)
    client.tell(land(1))
    client.tell(aim(2, 100.0))
    client.run(most=2)
    client.session.drain(0.0, 10.0)
    notice, *rest = client.run()
    assert notice == Notice(kind="draining", reconnect_after_ms=700)
    assert kinds(rest) == ["SendChunk", "SendChunk", "Ready", "Close"]
    assert client.close == Close(CloseCode.DRAINING, "draining")


def test_draining_is_bounded() -> None:
    client = make_client(greet=False)
    client.greet(credit_bytes=0)
    client.tell(land(1))
    client.session.drain(0.0, 2.0)
    assert kinds(client.run()) == ["Notice", "Plan"]
    assert client.session.wake_at_s() == 2.0
    client.session.tick(2.0)
    assert client.run() == [Close(CloseCode.DRAINING, "draining")]


def test_draining_takes_no_landing() -> None:
    client = make_client(greet=False)
    client.greet(credit_bytes=0)
    client.tell(land(1))
    client.session.drain(0.0, 2.0)
    client.tell(land(2))
    assert_fatal(client, ErrorCode.DRAINING, CloseCode.DRAINING)


def test_draining_an_idle_session_ends_it() -> None:
    client = make_client()
    client.session.drain(0.0, 2.0)
    assert kinds(client.run()) == ["Notice", "Close"]
    stranger = make_client(greet=False)
    stranger.session.drain(0.0, 2.0)
    assert kinds(stranger.run()) == ["Close"]


def test_a_new_version_is_told_and_changes_nothing() -> None:
    client = make_client()
    client.session.scene_published("v2")
    assert client.run() == [Notice(kind="scene_published", version="v2")]
    client.tell(land(1))
    assert kinds(client.run())[-1] == "Ready"


def test_news_before_hello_wait_for_the_welcome() -> None:
    client = make_client(greet=False)
    client.session.scene_published("v2")
    assert client.run() == []
    client.greet()
    assert client.run() == [Notice(kind="scene_published", version="v2")]


def test_the_observer_hears_of_times_and_bytes() -> None:
    heard: list[Any] = []

    class Ear(Observer):
        def planned(self, generation: int, plan: Plan) -> None:
            heard.append(("planned", generation, plan.load_bytes))

        def first_byte(self, seconds: float) -> None:
            heard.append(("first byte", seconds))

        def ready(self, message: Ready, seconds: float) -> None:
            heard.append(("ready", message.generation, seconds))

        def superseded(self, message: Superseded, *, landing: bool) -> None:
            heard.append(("superseded", message.unsent_bytes, landing))

    scene = make_scene()
    session = Session(scene, SessionLimits(), session_id="s", now_s=0.0, observer=Ear())
    client = Client(session, scene)
    client.greet()
    client.tell(land(1))
    client.now_s = 0.25
    client.run(most=2)
    client.tell(land(2, radius_m=5.0))
    client.tell(land(3, radius_m=5.0))
    client.now_s = 0.5
    client.run()
    assert heard == [
        ("planned", 1, 3003),
        ("first byte", 0.25),
        ("superseded", 2003, True),
        ("superseded", 0, True),
        ("planned", 3, 0),
        ("ready", 3, 0.25),
    ]


# Everything at once, against the model.


operations = st.one_of(
    st.tuples(st.just("land"), st.integers(-20, 130), st.integers(1, 60)),
    st.tuples(st.just("aim"), st.integers(-20, 130), st.integers(1, 60)),
    st.tuples(st.just("run"), st.integers(1, 8), st.just(0)),
    st.tuples(st.just("credit"), st.integers(1, 3000), st.just(0)),
    st.tuples(st.just("evict"), st.integers(0, 11), st.integers(0, 11)),
    st.tuples(st.just("reject"), st.integers(0, 11), st.just(0)),
    st.tuples(st.just("corrupt"), st.integers(0, 11), st.just(0)),
)


@settings(max_examples=400)
@given(
    script=st.lists(operations, max_size=25),
    credit=st.integers(0, 5000),
    budgets=st.builds(
        Budgets,
        max_bytes=st.none() | st.integers(0, 6000),
        max_segments=st.none() | st.integers(0, 8),
    ),
    in_runs=st.booleans(),
)
@example(
    script=[("land", 0, 1), ("evict", 0, 0), ("aim", 0, 1), ("reject", 0, 0)],
    credit=0,
    budgets=Budgets(),
    in_runs=True,
)
def test_any_history_keeps_the_rules(
    script: list[tuple[str, int, int]], credit: int, budgets: Budgets, in_runs: bool
) -> None:
    scene = make_scene()
    client = make_client(scene, greet=False)
    client.in_runs = in_runs
    client.greet(credit_bytes=credit, budgets=budgets)
    generation = 0
    for kind, first, second in script:
        if kind in {"land", "aim"}:
            generation += 1
            client.run(until=lambda: client.session.pending == 0)
            make = land if kind == "land" else aim
            client.tell(make(generation, float(first), float(second)))
            if kind == "land":
                _check_plan(client, generation, float(first), float(second), budgets)
        elif kind == "run":
            client.run(most=first)
        elif kind == "credit":
            client.credit += first
            client.tell(Credit(bytes=first))
        elif kind == "corrupt":
            client.corrupt ^= {first}
        else:
            # A client never evicts or rejects what it may not; the model waits for quiet first.
            client.corrupt.clear()
            client.credit += 1 << 20
            client.tell(Credit(bytes=1 << 20))
            client.run()
            if kind == "evict":
                client.held -= {first, second}
                for announced in client.load.values():
                    announced[:] = [s for s in announced if s not in {first, second}]
                client.tell(Evict(segments=ids(*{first, second})))
            elif first in client.held:
                client.held -= {first}
                # 6.4, rule 4: what is in the newest landing's plan comes once more in its
                # generation, also where it was evicted after `ready` and came back with an aim.
                newest = next((m for m in reversed(client.messages) if isinstance(m, Plan)), None)
                if newest is not None and first in {*newest.load["id"].tolist(), *newest.keep}:
                    client.load[newest.generation].append(first)
                client.tell(Reject(generation=generation, segment=first, reason="x"))
        assert client.session.transfers is not None
        if client.session.pending == 0:
            server_held = client.session.transfers.held.array().tolist()
            assert server_held == sorted(client.held)
    client.credit += 1 << 20
    client.tell(Credit(bytes=1 << 20))
    client.run()
    assert client.close is None
    landings = [m.generation for m in client.messages if isinstance(m, Plan)]
    for landing in landings:
        ends = set(client.ends[landing])
        assert len(ends) == 1 or landing == landings[-1] or ends == {"ready", "superseded"}
    if landings:
        assert client.ends[landings[-1]][-1] == "ready", "the newest landing always ends ready"


def _check_plan(
    client: Client, generation: int, x: float, radius_m: float, budgets: Budgets
) -> None:
    held_ids = set(client.held)
    client.run(until=lambda: generation in client.load)
    plan = next(m for m in reversed(client.messages) if isinstance(m, Plan))
    assert plan.generation == generation
    distances = box_distances_m(client.table.bounds, (x, 0.0, 0.0))
    by_distance = sorted(
        (float(distances[s]), s)
        for s in range(len(client.table))
        if distances[s] <= radius_m or (s in held_ids and distances[s] <= radius_m * 1.25)
    )
    fitting: list[int] = []
    for _, segment in by_distance:
        size = sum(int(client.table.lengths[s]) for s in [*fitting, segment])
        if budgets.max_bytes is not None and size > budgets.max_bytes:
            break
        if budgets.max_segments is not None and len(fitting) >= budgets.max_segments:
            break
        fitting.append(segment)
    expected = [s for s in fitting if distances[s] <= radius_m]
    assert plan.load["id"].tolist() == [s for s in expected if s not in held_ids]
    assert plan.keep.tolist() == sorted(s for s in expected if s in held_ids)
    assert plan.nearby.tolist() == sorted(set(fitting) - set(expected))
