"""Random and mutated bytes on real sockets: refused as documented, never a fault of ours."""

from __future__ import annotations

import contextlib
import logging
import random

import numpy as np
import pytest
from server.plain_client import PlainClient, make_hello, make_land
from websockets.exceptions import ConnectionClosed

from terraport_server import BackgroundServer
from terraport_wire import KEY_DTYPE, Credit, Error, Pick, Prefetch, Ready, encode

MESSAGES = [
    make_hello(),
    make_land(1, (30.0, 0.0, 30.0), 15.0, inner_radius_m=5.0),
    Prefetch(
        generation=2,
        position=(30.0, 0.0, 30.0),
        radius_m=15.0,
        have=np.arange(5, dtype=KEY_DTYPE),
        taken_bytes=0,
    ),
    Credit(bytes=1000),
    Pick(request=1, origin=(15.0, 9.0, 15.0), direction=(0.0, -1.0, 0.1)),
]
LAST = Pick(request=4_000_000_000, origin=(0.0, 0.0, 0.0))
ALLOWED = {4400, 4401, 4409, 4413}


def mutated(data: bytes, rng: random.Random) -> bytes:
    """One to four random edits."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(out)) if out else 0
        match rng.randrange(4):
            case 0 if out:
                out[at] ^= 1 << rng.randrange(8)
            case 1:
                out[at:at] = rng.randbytes(rng.randint(1, 5))
            case 2:
                del out[at : at + rng.randint(1, 5)]
            case _:
                out[at : at + 1] = bytes([rng.choice([0, 0x7F, 0x80, 0xC1, 0xDF, 0xFF])])
    return bytes(out)


def test_mutated_messages(server: BackgroundServer, caplog: pytest.LogCaptureFixture) -> None:
    rng = random.Random(11)
    refused = 0
    with caplog.at_level(logging.ERROR, logger="terraport.server"):
        for _ in range(60):
            with PlainClient(server.scene_url("grid")) as client:
                client.hello(credit_bytes=100_000)
                with contextlib.suppress(ConnectionClosed):
                    for _ in range(6):
                        data = encode(rng.choice(MESSAGES))
                        client.socket.send(mutated(data, rng))
                    client.send(LAST)  # its answer says that everything before it was answered
                    while True:
                        got = client.receive()
                        if getattr(got, "request", None) == LAST.request:
                            break
                        if isinstance(got, Error) and got.fatal:
                            assert client.closed() in ALLOWED
                            break
                        refused += isinstance(got, Error)
                        assert not isinstance(got, Error) or got.code != "internal"
                if client.socket.close_code is not None:
                    # By the close, not by its error: that is lost where more was sent meanwhile.
                    refused += 1
                    assert client.socket.close_code in ALLOWED | {1006}
    assert refused > 40, "most of what was mutated is refused"
    assert caplog.records == [], "nothing failed on our side"
    with PlainClient(server.scene_url("grid")) as client:
        client.hello()
        client.send(MESSAGES[1])
        client.until(Ready)
