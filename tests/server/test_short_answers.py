"""Which requests may be answered the short way; everything else is uvicorn's to read."""

from __future__ import annotations

import pytest

from terraport_server.short_answers import read_request

LINE = b"GET /scenes/pit/segments/7.glb HTTP/1.1\r\n"
HOST = b"Host: localhost\r\n"


def test_a_segment() -> None:
    asked = read_request(LINE + HOST + b"Range:  bytes=1-2 \r\n\r\nGET /next", None)
    assert asked is not None
    assert (asked.scene_id, asked.segment, asked.pack, asked.query) == ("pit", "7", None, b"")
    assert asked.headers == [(b"host", b"localhost"), (b"range", b"bytes=1-2")]
    assert asked.size == len(LINE) + len(HOST) + 20 + 2


def test_a_pack_of_a_version() -> None:
    data = b"GET /scenes/pit/v-0a/segments.pack?v=0a&x=1 HTTP/1.1\r\n" + HOST + b"\r\n"
    asked = read_request(data, None)
    assert asked is not None
    assert (asked.segment, asked.pack, asked.query) == (None, "v-0a/segments.pack", b"v=0a&x=1")


def test_the_same_headers_are_read_once() -> None:
    first = read_request(LINE + HOST + b"\r\n", None)
    again = read_request(LINE.replace(b"7", b"8") + HOST + b"\r\n", first)
    other = read_request(LINE + b"Host: elsewhere\r\n\r\n", again)
    assert first is not None
    assert again is not None
    assert other is not None
    assert again.headers is first.headers
    assert (again.segment, other.headers) == ("8", [(b"host", b"elsewhere")])


@pytest.mark.parametrize(
    "data",
    [
        LINE + HOST,  # not whole
        LINE + HOST + b"\r",
        LINE.replace(b"GET", b"HEAD") + HOST + b"\r\n",
        LINE.replace(b"GET", b"get") + HOST + b"\r\n",
        LINE.replace(b"1.1", b"1.0") + HOST + b"\r\n",
        LINE.replace(b"\r\n", b"\n") + HOST + b"\r\n",
        LINE.replace(b" HTTP", b"  HTTP") + HOST + b"\r\n",
        LINE.replace(b"/7", b"/%37") + HOST + b"\r\n",
        LINE.replace(b"/7", b"/-7") + HOST + b"\r\n",
        LINE.replace(b".glb", b".glb/") + HOST + b"\r\n",
        LINE.replace(b"/scenes", b"//scenes") + HOST + b"\r\n",
        LINE.replace(b"/scenes", b"http://localhost/scenes") + HOST + b"\r\n",
        b"GET /scenes/pit/base.glb HTTP/1.1\r\n" + HOST + b"\r\n",
        b"GET /scenes/pit/../segments.pack HTTP/1.1\r\n" + HOST + b"%\r\n",
        b"\r\n" + LINE + HOST + b"\r\n",
        LINE + b" folded\r\n" + HOST + b"\r\n",
        LINE + HOST + b"X: a\x00b\r\n\r\n",
        LINE + HOST + b"X: a\xe4\r\n\r\n",
        LINE + HOST + b"X: a\n\r\n\r\n",
        LINE + HOST + b"X y: a\r\n\r\n",
        LINE + HOST + b"X : a\r\n\r\n",
        LINE + HOST + b"no colon\r\n\r\n",
        LINE + HOST + b"Content-Length: 5\r\n\r\nhello",
        LINE + HOST + b"content-length: 0\r\n\r\n",
        LINE + HOST + b"Transfer-Encoding: chunked\r\n\r\n",
        LINE + HOST + b"Connection: close\r\n\r\n",
        LINE + HOST + b"Connection: keep-alive, Upgrade\r\nUpgrade: websocket\r\n\r\n",
        LINE + HOST + b"Expect: 100-continue\r\n\r\n",
        LINE + HOST + b"Origin: https://viewer.example\r\n\r\n",
    ],
)  # fmt: skip
def test_what_goes_the_long_way(data: bytes) -> None:
    assert read_request(data, None) is None
