"""When to connect again, how fast to speak, and why nobody was reached."""

from __future__ import annotations

import asyncio
import errno
import random
import socket
import ssl

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.asyncio.client import connect

from terraport.backoff import Pacer, is_temporary, wait_s, why_unreached
from terraport_server.session.rate_limit import RateLimit

NOBODY = "nothing listens there; is the service running, and is this its port?"


@pytest.mark.parametrize("attempt", [0, 1, 3, 5, 6, 60, 10**6])
def test_waits_stay_between_half_and_all_of_the_doubling(attempt: int) -> None:
    """0.5 s, doubled each time, never above 30 s."""
    most = min(30.0, 0.5 * 2.0 ** min(attempt, 30))
    chance = random.Random(1)
    waits = [wait_s(attempt, chance.random) for _ in range(200)]
    assert all(most / 2 <= wait <= most for wait in waits)
    assert max(waits) - min(waits) > 0.3 * most  # they do spread


@pytest.mark.parametrize(
    ("code", "again"),
    [
        *((code, True) for code in (1001, 1006, 1011, 1012, 4408, 4429, 4500, 4503)),
        *((code, False) for code in (1000, 4400, 4401, 4403, 4404, 4409, 4413)),
    ],
)
def test_close_codes_as_the_protocol_lists_them(code: int, again: bool) -> None:
    assert is_temporary(code) is again


@given(
    pauses=st.lists(st.floats(0, 3), min_size=1, max_size=300),
    per_s=st.floats(0.5, 200),
)
def test_the_server_never_finds_it_too_fast(pauses: list[float], per_s: float) -> None:
    """Sent when the pacer says so, every message is admitted by the server's bucket."""
    now_s = 100.0
    pacer, limit = Pacer(per_s, now_s=now_s), RateLimit(per_s, now_s=now_s)
    for pause_s in pauses:
        now_s += pause_s
        now_s += pacer.take(now_s)
        assert limit.take(now_s)


@pytest.fixture
def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_nobody_listens(free_port: int, host: str) -> None:
    async def attempt() -> None:
        await connect(f"ws://{host}:{free_port}")

    with pytest.raises(OSError, match="failed") as raised:
        asyncio.run(attempt())
    assert why_unreached(raised.value) == NOBODY
    with pytest.raises(httpx.ConnectError) as refused:
        httpx.get(f"http://{host}:{free_port}")
    assert why_unreached(refused.value) == NOBODY


def test_several_addresses_that_refuse_are_one_answer() -> None:
    texts = [f"[Errno {errno.ECONNREFUSED}] Connect call failed ('{a}', 1)" for a in ("::1", "0")]
    assert why_unreached(OSError(f"Multiple exceptions: {', '.join(texts)}")) == NOBODY
    mixed = OSError(f"Multiple exceptions: {texts[0]}, [Errno 101] Network is unreachable")
    assert why_unreached(mixed) == str(mixed)


def test_names_times_and_tls() -> None:
    assert why_unreached(socket.gaierror(-2, "Name or service not known")) == (
        "no machine has that name"
    )
    assert why_unreached(TimeoutError()) == "no answer in time"
    plain = ssl.SSLError(1, "[SSL: WRONG_VERSION_NUMBER] wrong version number")
    assert why_unreached(plain) == "what listens there speaks no TLS; expected http:// for it"
    unknown = ssl.SSLCertVerificationError(1, "self-signed certificate")
    assert "self-signed certificate" in why_unreached(unknown)


def test_what_is_none_of_these_keeps_its_words() -> None:
    assert why_unreached(OSError("out of luck")) == "out of luck"
    assert why_unreached(EOFError()) == "EOFError"
