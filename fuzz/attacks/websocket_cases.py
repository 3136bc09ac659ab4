"""WebSocket frames: right ones in unusual shapes, and every kind of wrong one (RFC 6455)."""

from __future__ import annotations

import random
from collections.abc import Iterator

from attacks.peers import BINARY, CLOSE, CONT, PING, PONG, TEXT, frame

__all__ = ["hostile_frames", "random_frames"]


def hostile_frames(message: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield name and bytes of each case; `message` is a valid one, to go on with."""
    good = frame(BINARY, message)
    # RFC 6455, 5.2: masks, reserved bits, opcodes.
    yield "nothing", b""
    yield "unmasked", frame(BINARY, message, mask=False)
    for rsv in range(1, 8):
        yield f"reserved bits {rsv}", frame(BINARY, message, rsv=rsv)
    for opcode in (3, 4, 5, 6, 7, 11, 12, 13, 14, 15):
        yield f"opcode {opcode}", frame(opcode, message)
    # 5.5: control frames have 125 bytes at most and no fragments.
    for opcode in (CLOSE, PING, PONG):
        yield f"control {opcode} of 126", frame(opcode, bytes(126))
        yield f"control {opcode} of 70000", frame(opcode, bytes(70_000))
        yield f"control {opcode} in fragments", frame(opcode, b"ab", fin=False) + good
        yield f"control {opcode} empty", frame(opcode, b"") + good
        yield f"control {opcode} of 125", frame(opcode, bytes([3, 232]) + b"x" * 123) + good
    # 5.2: lengths that are announced and never come, or not written in the shortest way.
    for length in (1 << 16, 1 << 22, (1 << 22) + 1, 1 << 31, 1 << 32, 1 << 40, (1 << 63) - 1):
        yield f"declared {length}", frame(BINARY, b"abc", declared=length)
    yield "declared 2^63", frame(BINARY, b"abc", declared=1 << 63)
    yield "declared 2^64 - 1", frame(BINARY, b"abc", declared=(1 << 64) - 1)
    yield "length not the shortest, 2", frame(BINARY, message, width=2) + good
    yield "length not the shortest, 8", frame(BINARY, message, width=8) + good
    # 5.4: fragments in a wrong order, allowed ones, and very many.
    yield "continuation of nothing", frame(CONT, message)
    yield "message inside of a message", frame(BINARY, b"\x81", fin=False) + good
    yield "text inside of a message", frame(BINARY, b"\x81", fin=False) + frame(TEXT, b"{}")
    middle = len(message) // 2
    halves = frame(BINARY, message[:middle], fin=False), frame(CONT, message[middle:])
    yield "two fragments", halves[0] + halves[1]
    yield "ping between fragments", halves[0] + frame(PING, b"?") + halves[1]
    yield (
        "one byte each",
        b"".join(
            frame(CONT if number else BINARY, message[number : number + 1], fin=False)
            for number in range(len(message))
        )
        + frame(CONT, b""),
    )
    empty = frame(CONT, b"", fin=False)
    yield "10,000 empty fragments", frame(BINARY, b"", fin=False) + empty * 10_000
    yield (
        "fragments beyond the limit",
        frame(BINARY, b"", fin=False) + frame(CONT, bytes(1 << 20), fin=False) * 5,
    )
    # Beyond the limit of a message; text, good and bad.
    yield "message of 1 MiB + 1", frame(BINARY, b"\x81" + bytes(1 << 20))
    yield "message of 4 MiB + 1", frame(BINARY, b"\x81" + bytes(1 << 22))
    yield "text of bad UTF-8", frame(TEXT, b"\xff\xfe{}")
    yield "text of half a character", frame(TEXT, b'{"type":"\xc3"}')
    yield "text of a lone surrogate", frame(TEXT, b'{"type":"\xed\xa0\x80"}')
    yield "a message as text", frame(TEXT, b'{"type":"bye"}')
    yield "empty binary", frame(BINARY, b"")
    yield "empty text", frame(TEXT, b"")
    # 7.4: closing codes and reasons.
    yield "close, one byte", frame(CLOSE, b"\x03")
    for code in (0, 999, 1000, 1001, 1004, 1005, 1006, 1012, 1015, 1100, 2999, 3000, 4400, 5000):
        yield f"close {code}", frame(CLOSE, code.to_bytes(2, "big") + b"why")
    yield "close with bad UTF-8", frame(CLOSE, b"\x03\xe8\xff\xff")
    yield "after the close", frame(CLOSE, b"\x03\xe8") + good * 3
    # Floods, and streams that end or turn into something else.
    yield "pongs nobody asked for", frame(PONG, b"x" * 20) * 1000 + good
    yield "pings", frame(PING, b"x" * 125) * 1000 + good
    yield "half a header", good[:1]
    yield "half a frame", good[: len(good) // 2]
    yield "HTTP in the middle", good + b"GET / HTTP/1.1\r\n\r\n"


def random_frames(message: bytes, draw: random.Random) -> bytes:
    """Return a few frames with random headers."""
    out = b""
    for _ in range(draw.randint(1, 6)):
        data = draw.choice([message, b"", draw.randbytes(draw.choice([1, 2, 125, 126, 300]))])
        out += frame(
            draw.choice([BINARY, BINARY, TEXT, CONT, CLOSE, PING, PONG, draw.randrange(16)]),
            data,
            fin=draw.random() < 0.7,
            mask=draw.random() < 0.95,
            rsv=draw.choice([0, 0, 0, 0, draw.randrange(8)]),
            declared=draw.choice([None, None, None, None, len(data) + 1, 1 << 20, 1 << 63]),
        )
    return out
