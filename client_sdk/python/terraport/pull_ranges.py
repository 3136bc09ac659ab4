"""Which ranges of a pack a client that pulls asks for (wire protocol, section 17).

Payloads lie in the pack along a curve, so those of one landing lie in few runs. A run is asked for
at once, with the gaps in it where they cost less than another request.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

__all__ = ["Fetch", "PackAddress", "PackRange", "merge_ranges", "part_of_content_range"]

GAP_BYTES: Final = 64 << 10
"""Bytes between two payloads that are fetched along rather than left out by another request: what
a link of 50 Mbit/s carries in 10 ms."""

RANGE_BYTES: Final = 2 << 20
"""Where a range ends when it has so many bytes, so that several are under way, the nearest first,
and what a newer landing ends is soon ended."""


@dataclass(frozen=True, slots=True)
class PackAddress:
    """Where the pack of one scene version is fetched."""

    url: str
    total: int
    """Length of the pack, bytes."""
    is_ours: bool
    """Whether it is the scene's own server, which alone is shown the token."""


@dataclass(frozen=True, slots=True)
class Fetch:
    """One payload in the pack."""

    segment: int
    offset: int
    length: int


@dataclass(frozen=True, slots=True)
class PackRange:
    """Bytes that one request asks for: those from `start` to before `end`."""

    start: int
    end: int
    fetches: tuple[Fetch, ...]
    """What is in them, by ascending offset, without overlap."""


def merge_ranges(
    fetches: Sequence[Fetch], *, gap_bytes: int = GAP_BYTES, range_bytes: int = RANGE_BYTES
) -> list[PackRange]:
    """Return the ranges that bring these payloads, the one with the most urgent payload first.

    Parameters
    ----------
    fetches
        The most urgent first; they do not overlap.
    gap_bytes
        Largest gap that is fetched along.
    range_bytes
        A range takes no further payload where it has so many bytes.

    Examples
    --------
    >>> near, far, beside = Fetch(7, 1000, 10), Fetch(2, 0, 64), Fetch(3, 64, 30)
    >>> [(r.start, r.end) for r in merge_ranges([near, far, beside], gap_bytes=100)]
    [(1000, 1010), (0, 94)]
    """
    urgency = {fetch.segment: rank for rank, fetch in enumerate(fetches)}
    runs: list[list[Fetch]] = []
    for fetch in sorted(fetches, key=lambda fetch: fetch.offset):
        last = runs[-1][-1] if runs else None
        if (
            last is not None
            and fetch.offset - (last.offset + last.length) <= gap_bytes
            and last.offset + last.length - runs[-1][0].offset < range_bytes
        ):
            runs[-1].append(fetch)
        else:
            runs.append([fetch])
    runs.sort(key=lambda run: min(urgency[fetch.segment] for fetch in run))
    return [PackRange(run[0].offset, run[-1].offset + run[-1].length, tuple(run)) for run in runs]


def part_of_content_range(text: str) -> tuple[int, int, int] | None:
    """Read a header ``Content-Range``: first byte, byte behind the last, total; None if it is none.

    Examples
    --------
    >>> part_of_content_range("bytes 2-4/10"), part_of_content_range("bytes */10")
    ((2, 5, 10), None)
    """
    unit, _, rest = text.strip().partition(" ")
    span, _, total = rest.partition("/")
    first, _, last = span.partition("-")
    numbers = (first, last, total)
    if unit.lower() != "bytes" or not all(n.isascii() and n.isdecimal() for n in numbers):
        return None
    return int(first), int(last) + 1, int(total)
