"""Why nobody was reached, as real sockets and both libraries say it."""

from __future__ import annotations

import asyncio
import errno
import socket
import ssl

import httpx
import pytest
from websockets.asyncio.client import connect

from terraport.unreached import why_unreached

NOBODY = "nothing listens there; is the service running, and is this its port?"


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
