"""Which bytes of an answer a request is given: conditions and ranges of RFC 9110, 13 and 14.

For bytes that never change under their address, with a strong entity tag. One range is answered;
of several a server may give the whole, and this does.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from http import HTTPStatus
from typing import Final, NamedTuple

__all__ = ["Part", "choose_part", "is_match"]

_ONE_RANGE: Final = re.compile(r"bytes[ \t]*=[ \t]*([0-9]{0,19})[ \t]*-[ \t]*([0-9]{0,19})[ \t]*")


class Part(NamedTuple):
    """What of a file is sent.

    Examples
    --------
    >>> Part(HTTPStatus.PARTIAL_CONTENT, 2, 3, 10).content_range
    'bytes 2-4/10'
    """

    status: HTTPStatus
    offset: int
    length: int
    """Bytes of the body; 0 where there is none."""
    total: int
    """Bytes of the whole."""

    @property
    def content_range(self) -> str | None:
        """The header of that name, where the answer has one."""
        if self.status is HTTPStatus.PARTIAL_CONTENT:
            return f"bytes {self.offset}-{self.offset + self.length - 1}/{self.total}"
        if self.status is HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE:
            return f"bytes */{self.total}"
        return None


def choose_part(method: str, headers: Iterable[tuple[bytes, bytes]], etag: str, total: int) -> Part:
    """Decide on one request.

    Parameters
    ----------
    method
        ``GET`` or ``HEAD``.
    headers
        Of the request: lower-case names.
    etag
        Strong entity tag of the file, quotes included.
    total
        Its length, bytes; at least 1.

    Returns
    -------
    Part
        200 with the whole, 206 with one range, 304, or 416.

    Examples
    --------
    >>> choose_part("GET", [(b"range", b"bytes=-3")], '"a"', 10).content_range
    'bytes 7-9/10'
    >>> choose_part("GET", [(b"range", b"bytes=10-")], '"a"', 10).status.value
    416
    >>> choose_part("GET", [(b"range", b"bytes=0-1,4-5")], '"a"', 10).status.value
    200
    """
    ranges: list[str] = []
    if_range: str | None = None
    for name, value in headers:
        if name == b"if-none-match":
            if is_match(value.decode("latin-1"), etag):
                return Part(HTTPStatus.NOT_MODIFIED, 0, 0, total)
        elif name == b"range":
            ranges.append(value.decode("latin-1"))
        elif name == b"if-range":
            if_range = value.decode("latin-1").strip()
    whole = Part(HTTPStatus.OK, 0, total, total)
    # A range is of a GET alone (14.2), and of the very bytes that If-Range names (13.1.5): a date
    # or a weak tag names none.
    if method != "GET" or len(ranges) != 1 or if_range not in {None, etag}:
        return whole
    asked = _ONE_RANGE.fullmatch(ranges[0])
    if asked is None or not any(asked.groups()):
        return whole
    first, last = asked.groups()
    if first and last and int(last) < int(first):
        return whole  # no valid range: as if it were not there (14.1.1)
    start = int(first) if first else max(0, total - int(last))
    if start >= total:
        return Part(HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE, 0, 0, total)
    end = min(int(last) + 1, total) if first and last else total
    return Part(HTTPStatus.PARTIAL_CONTENT, start, end - start, total)


def is_match(if_none_match: str, etag: str) -> bool:
    """Whether a header ``If-None-Match`` names an entity tag, weakly compared (13.1.2).

    Examples
    --------
    >>> is_match('"x", W/"a"', '"a"'), is_match("*", '"a"'), is_match("", '"a"')
    (True, True, False)
    """
    return if_none_match.strip() == "*" or etag in {
        entry.strip().removeprefix("W/") for entry in if_none_match.split(",")
    }
