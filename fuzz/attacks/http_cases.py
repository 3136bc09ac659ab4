"""HTTP requests: the service's own paths with hostile edges, and bytes that are no HTTP."""

from __future__ import annotations

import random
from typing import Final

from attacks.mutation import mutate

__all__ = ["STATUSES", "hostile_request", "judge"]

STATUSES: Final = frozenset(
    {
        101,
        200,
        206,
        304,
        307,
        400,
        401,
        403,
        404,
        405,
        408,
        413,
        414,
        416,
        421,
        422,
        426,
        429,
        431,
        503,
    }
)
"""What an HTTP client may be told; 500 is a fault of ours."""

CANARY: Final = "a-secret-beside-the-scenes"
"""Contents of a file next to the served folder: no answer may have it."""

_LEAKS: Final = ("Traceback", "site-packages", "/terraport_server/", "uvicorn", "starlette")
"""Words that tell of our inside."""

_PATHS: Final = (
    "/", "/healthz", "/readyz", "/metrics", "/docs", "/openapi.json", "/scenes", "/scenes/pit",
    "/scenes/pit/base.tsg", "/scenes/pit/base.glb",
    "/scenes/pit/regions.json",
    "/scenes/pit/labels.json", "/scenes/pit/segments/0.glb", "/scenes/pit/segments/99999.glb",
    "/scenes/pit/segments/-1.glb", "/scenes/pit/segments/1e9.glb", "/scenes/pit/report",
    "/scenes/pit/stream", "/scenes/../canary", "/scenes/%2e%2e/canary", "/scenes/..%2fcanary",
    "/scenes/pit/../../canary", "/scenes/pit/segments/..%2f..%2fscene.json", "//canary",
    "/\\canary",
    "/scenes/%00", "/scenes/%ff%fe", "/scenes/\u00e9", "/scenes/" + "x" * 3000, "*", "http://evil/scenes",
    "/scenes/pit/base.tsg?v=%00", "/scenes?" + "a=b&" * 500, "",
)  # fmt: skip
_METHODS: Final = (
    "GET",
    "GET",
    "GET",
    "HEAD",
    "POST",
    "PUT",
    "OPTIONS",
    "TRACE",
    "CONNECT",
    "get",
    "X" * 99,
)
_HEADERS: Final = (
    "Range: bytes=0-10", "Range: bytes=-5", "Range: bytes=5-", "Range: bytes=10-5",
    "Range: bytes=99999999999999999999-", "Range: bytes=0-1,5-6,2-3", "Range: lines=1-2",
    "Range: bytes=" + "0-1," * 300, "If-None-Match: *", 'If-None-Match: "x"', "If-Range: 0",
    "If-Modified-Since: yesterday", "Authorization: Bearer " + "x" * 5000,
    "Authorization: Basic !!",
    "Authorization: Bearer \u00ff", "Origin: http://evil", "Origin: null", "Host: a", "Host: b",
    "Content-Length: 5", "Content-Length: -1", "Content-Length: 99999999999999999999",
    "Content-Length: 5\r\nContent-Length: 6", "Transfer-Encoding: chunked",
    "Transfer-Encoding: chunked\r\nContent-Length: 5", "Transfer-Encoding: gzip, chunked",
    "Expect: 100-continue", "Connection: close", "Connection: Upgrade", "Upgrade: websocket",
    "Upgrade: h2c", "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", "Sec-WebSocket-Key: short",
    "Sec-WebSocket-Version: 13", "Sec-WebSocket-Version: 99",
    "Sec-WebSocket-Protocol: terraport.v2.msgpack", "Sec-WebSocket-Protocol: , ,",
    "Sec-WebSocket-Protocol: terraport.token.!!!, terraport.v2.msgpack",
    "Sec-WebSocket-Extensions: permessage-deflate", "X-Forwarded-For: 1.2.3.4, \u00e9, ::1",
    "X-Forwarded-Proto: \0", "X: " + "y" * 20_000, "Accept: " + "*/*," * 100, " folded: x",
    "no colon",
    "A: b\nC: d", ": empty name", "X\u00e9: 1", "Cookie: " + "a=b; " * 200,
)  # fmt: skip


def hostile_request(draw: random.Random) -> bytes:
    """Return one request, or two on one connection, or nonsense."""
    version = draw.choice(["HTTP/1.1"] * 40 + ["HTTP/1.0", "HTTP/2.0", "HTTP/9", "FTP/1.1", ""])
    lines = [f"{draw.choice(_METHODS)} {draw.choice(_PATHS)} {version}"]
    if draw.random() < 0.9:
        lines.append("Host: localhost")
    lines += draw.choices(_HEADERS, k=draw.choice([0, 0, 1, 1, 2]))
    if draw.random() < 0.02:
        lines += [f"X-{number}: y" for number in range(3000)]
    request = ("\r\n".join(lines) + "\r\n\r\n").encode("latin-1", "replace")
    request += draw.choice(
        [b"", b"", b"hello", b"5\r\nhello\r\n0\r\n\r\n", b"zz\r\n", b"\0" * 5000]
    )
    match draw.randrange(8):
        case 0:
            return mutate(request, [request], draw)
        case 1:
            return request + b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n"
        case 2 if draw.random() < 0.2:
            return draw.randbytes(draw.randint(1, 4000))
        case _:
            return request


def judge(answer: bytes) -> list[str]:
    """Say what is wrong with everything that one connection answered."""
    leaks = [leak for leak in _LEAKS if leak.encode() in answer]
    wrong = [f"{leak} in an answer" for leak in leaks]
    if CANARY.encode() in answer:
        wrong.append("a file beside the scenes was served")
    answer = answer.removeprefix(b"HTTP/1.1 100 Continue\r\n\r\n")  # to who announces a body
    if answer.startswith(b"HTTP/1."):
        status = int(answer.split(None, 2)[1])
        if status not in STATUSES:
            wrong.append(f"status {status}")
    elif answer:
        wrong.append(f"an answer that is no HTTP: {answer[:40]!r}")
    return wrong
