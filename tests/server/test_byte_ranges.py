"""Which bytes of an answer a request is given."""

from __future__ import annotations

import pytest

from terraport_server.http.byte_ranges import choose_part

ETAG = '"0123456789abcdef"'


def chosen(*headers: tuple[str, str], method: str = "GET") -> tuple[int, int, int, str | None]:
    raw = [(name.encode(), value.encode("latin-1")) for name, value in headers]
    part = choose_part(method, raw, ETAG, 100)
    return int(part.status), part.offset, part.length, part.content_range


WHOLE = (200, 0, 100, None)


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ("bytes=0-0", (206, 0, 1, "bytes 0-0/100")),
        ("bytes=10-19", (206, 10, 10, "bytes 10-19/100")),
        ("bytes=10-", (206, 10, 90, "bytes 10-99/100")),
        ("bytes=99-1000", (206, 99, 1, "bytes 99-99/100")),
        ("bytes=-7", (206, 93, 7, "bytes 93-99/100")),
        ("bytes=-1000", (206, 0, 100, "bytes 0-99/100")),
        ("bytes=100-", (416, 0, 0, "bytes */100")),
        ("bytes=-0", (416, 0, 0, "bytes */100")),
        ("bytes=5-2", WHOLE),
        ("bytes=-", WHOLE),
        ("bytes=1-2,4-5", WHOLE),
        ("lines=1-2", WHOLE),
        ("bytes=a-b", WHOLE),
        ("bytes=" + "9" * 400 + "-", WHOLE),
    ],
)
def test_one_range(asked: str, expected: tuple[int, int, int, str | None]) -> None:
    assert chosen(("range", asked)) == expected


def test_a_range_holds_for_the_bytes_that_it_was_meant_for() -> None:
    part = (206, 0, 10, "bytes 0-9/100")
    asked = ("range", "bytes=0-9")
    assert chosen(asked, ("if-range", ETAG)) == part
    for other in ('"other"', f"W/{ETAG}", "Mon, 23 Nov 2026 00:00:00 GMT"):
        assert chosen(asked, ("if-range", other)) == WHOLE


def test_what_is_no_range_of_a_get() -> None:
    assert chosen(("range", "bytes=0-9"), method="HEAD") == WHOLE
    assert chosen(("range", "bytes=0-9"), ("range", "bytes=20-29")) == WHOLE


def test_what_is_unchanged_comes_before_any_range() -> None:
    for tags in (ETAG, f'"x", W/{ETAG}', "*"):
        assert chosen(("range", "bytes=0-9"), ("if-none-match", tags))[0] == 304
    assert chosen(("if-none-match", '"x"')) == WHOLE
