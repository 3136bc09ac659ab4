"""Times of a landing, as ``ready`` tells them; the rest of a transfer is tested by its session."""

from __future__ import annotations

from server.session_model import Client, land, make_client

from terraport_wire import Credit, ErrorCode, Plan, Ready, Timings


def landed(client: Client, generation: int, at_s: float, *, radius_m: float = 25.0) -> None:
    """Land, and have the plan leave 1 ms later."""
    client.now_s = at_s
    client.tell(land(generation, radius_m=radius_m))
    (plan,) = client.run(most=1)
    assert isinstance(plan, Plan)
    client.session.plan_sent(generation, at_s + 0.001)


def timings(client: Client) -> Timings:
    ready = client.messages[-1]
    assert isinstance(ready, Ready)
    assert ready.timings is not None
    return ready.timings


def test_times_count_from_land_and_credit_is_told_apart() -> None:
    client = make_client(greet=False)
    client.greet(credit_bytes=1000, timings=True)
    landed(client, 1, 10.0)
    client.now_s = 10.004
    client.run()  # the first segment; then there is no credit
    client.now_s = 10.504
    client.tell(Credit(bytes=10_000))
    client.credit += 10_000
    client.now_s = 10.510
    client.run()
    times = timings(client)
    assert (times.plan_us, times.first_byte_us) == (1000, 4000)
    assert (times.last_byte_us, times.ready_us) == (510_000, 510_000)
    assert times.credit_wait_us == 500_000


def test_nobody_who_did_not_ask_is_told() -> None:
    for requested in (None, False):
        client = make_client(greet=False)
        client.greet(timings=requested)
        landed(client, 1, 0.0)
        client.run()
        ready = client.messages[-1]
        assert isinstance(ready, Ready)
        assert ready.timings is None


def test_a_landing_without_payload_has_no_bytes_times() -> None:
    client = make_client(greet=False)
    client.greet(timings=True)
    landed(client, 1, 0.0)
    client.run()
    client.now_s = 5.0
    client.tell(land(2))
    client.run()
    times = timings(client)
    assert (times.plan_us, times.first_byte_us, times.last_byte_us) == (None, None, None)
    assert (times.ready_us, times.credit_wait_us) == (0, 0)


def test_a_stall_of_the_landing_before_does_not_count() -> None:
    client = make_client(greet=False)
    client.greet(credit_bytes=1000, timings=True)
    landed(client, 1, 0.0)
    client.run()  # out of credit at once
    client.now_s = 7.0
    client.tell(land(2))
    client.run()
    client.now_s = 7.25
    client.tell(Credit(bytes=10_000))
    client.credit += 10_000
    client.run()
    assert timings(client).credit_wait_us == 250_000


def test_access_withdrawn_ends_the_session_as_unauthorised() -> None:
    client = make_client()
    client.tell(land(1))
    client.session.withdraw("the token has expired, expected a connection with a newer one")
    client.session.withdraw("twice")
    client.run()
    error = client.messages[-1]
    assert (error.code, error.fatal) == (ErrorCode.UNAUTHORISED, True)  # type: ignore[attr-defined]
    assert client.close is not None
    assert int(client.close.code) == 4401
