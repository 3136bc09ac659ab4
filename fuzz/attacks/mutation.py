"""Random edits of bytes: flips, cuts, splices, number edges."""

from __future__ import annotations

import random

__all__ = ["EDGES", "mutate"]

EDGES = (b"\x00", b"\xff", b"\x80", b"\x7f", b"\xff\xff\xff\xff", b"\xc1", b"\xdd\xff\xff\xff\xff")
EDGES += (
    b"\xcb\x7f\xf8" + bytes(6),
    b"NaN",
    b"1e999",
    b"null",
    b"[",
    b"}",
    b'"',
    b"\\ud800",
    b"-0",
)


def mutate(data: bytes, seeds: list[bytes], draw: random.Random) -> bytes:
    """Return `data` with one to four random changes."""
    changed = bytearray(data)
    for _ in range(draw.randint(1, 4)):
        offset = draw.randrange(len(changed) + 1)
        way = draw.randrange(6)
        if way == 0 and offset < len(changed):
            changed[offset] ^= 1 << draw.randrange(8)
        elif way == 1:
            del changed[offset:]
        elif way == 2:
            changed[offset:offset] = draw.choice(EDGES)
        elif way == 3:
            edge = draw.choice(EDGES)
            changed[offset : offset + len(edge)] = edge
        elif way == 4:
            other = draw.choice(seeds)
            start = draw.randrange(len(other) + 1)
            changed[offset:] = other[start:]
        else:
            del changed[offset : offset + draw.randint(1, 8)]
    return bytes(changed)
