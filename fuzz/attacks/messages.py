"""Messages that are nearly right: the conformance corpus, taken apart, edited, put together again.

New messages of the protocol come in by themselves, with their cases.
"""

from __future__ import annotations

import base64
import json
import math
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import msgpack
import numpy as np
from attacks.mutation import mutate

from terraport_wire import KEY_DTYPE, Budgets, Bye, Credit, Hello, Land, Message, Pick, Prefetch

__all__ = ["Corpus", "corpus_messages", "sensible", "sensible_hello"]

CORPUS: Final = Path(__file__).resolve().parents[2] / "tests" / "conformance" / "messages"

EDGES: Final[tuple[Any, ...]] = (
    None, True, False, 0, 1, -1, 127, 128, 255, 256, 65_535, 65_536, 2**31 - 1, 2**31, 2**32 - 1,
    2**32, 2**53 - 1, 2**53, 2**63 - 1, -(2**63), 0.0, -0.0, 1e-320, 1e7, 1.0000001e7, 1e308,
    math.inf, -math.inf, math.nan, "", "a", "\0", "x" * 4097, "\U0001f5ff" * 20, [], [[]], {},
    [0] * 3, [1e9, 0.0, 0.0], [math.nan] * 3, b"", b"\0" * 4, b"\xff" * 12, b"\0" * 48, b"\0" * 7,
)  # fmt: skip


def corpus_messages() -> list[tuple[dict[str, Any], bytes]]:
    """Return every case of the corpus with its bytes, without padding."""
    lines = [
        json.loads(line)
        for path in sorted(CORPUS.glob("*.jsonl"))
        for line in path.read_text(encoding="utf-8").splitlines()
    ]
    return [(line, base64.b64decode(line["bytes"])) for line in lines]


class Corpus:
    """The cases of the corpus, as bytes and as plain values."""

    def __init__(self) -> None:
        self.raw: list[bytes] = []
        self.plain: list[dict[str, Any]] = []
        self.good: list[bytes] = []
        """Of these: valid messages of both directions; every truncation of each is tried."""
        for case, data in corpus_messages():
            self.raw.append(data)
            if "message" in case:
                self.good.append(data)
                self.plain.append(msgpack.unpackb(data, strict_map_key=False))

    def truncations(self) -> Iterator[bytes]:
        """Every proper prefix of every valid message."""
        for data in self.good:
            for length in range(len(data)):
                yield data[:length]

    def edited(self, draw: random.Random) -> bytes:
        """Return a message with one to three fields changed, dropped, added or of another type."""
        plain = dict(draw.choice(self.plain))
        for _ in range(draw.randint(1, 3)):
            names = list(plain) or ["type"]
            name, way = draw.choice(names), draw.randrange(6)
            if way == 0:
                plain.pop(name, None)
            elif way == 1:
                plain[draw.choice(["", "x", "type", "Type", "generation", "\0"])] = draw.choice(
                    EDGES
                )
            elif way == 2:
                other = draw.choice(self.plain)
                plain[name] = other.get(name, draw.choice(list(other.values())))
            elif way == 3:
                plain[name] = _nested(draw.choice(EDGES), draw.randint(1, 40))
            else:
                plain[name] = draw.choice(EDGES)
        return _dumps(plain)

    def broken(self, draw: random.Random) -> bytes:
        """Return a message with random edits of its bytes."""
        return mutate(draw.choice(self.raw), self.raw, draw)


def sensible(draw: random.Random, generation: int, *, segments: int, edge_m: float) -> Message:
    """Return a valid message that leads somewhere: states that random bytes never reach."""
    position = (draw.uniform(-10, edge_m + 10), draw.uniform(-5, 5), draw.uniform(-10, edge_m + 10))
    place: dict[str, Any] = {
        "generation": generation,
        "position": position,
        "have": np.arange(draw.randint(0, segments), dtype=KEY_DTYPE),
        "without": draw.choice([None, None, np.arange(3, dtype=KEY_DTYPE)]),
        "taken_bytes": draw.choice([0, 1000, 2**53 - 1]),
    }
    match draw.randrange(10):
        case 0 | 1 | 2:
            return Land(
                radius_m=draw.choice([5.0, 20.0, 60.0, 1e6]),
                inner_radius_m=draw.choice([None, 1.0, 5.0]),
                **place,
            )
        case 3 | 4:
            return Prefetch(radius_m=draw.choice([5.0, 30.0]), **place)
        case 5 | 6:
            return Credit(bytes=draw.choice([1, 1000, 1 << 20, 2**53 - 1]))
        case 7 | 8:
            direction = draw.choice([None, (0.0, -1.0, 0.0), (1e-9, 0.0, 1.0)])
            return Pick(request=draw.randrange(100), origin=position, direction=direction)
        case _:
            if draw.random() < 0.8:  # most sessions should go on
                return Credit(bytes=1)
            return Bye() if draw.random() < 0.5 else sensible_hello(draw)


def sensible_hello(draw: random.Random) -> Hello:
    """Return a hello that is accepted."""
    return Hello(
        client="fuzz",
        budgets=Budgets(
            max_segments=draw.choice([None, 0, 5]), max_bytes=draw.choice([None, 9999])
        ),
        credit_bytes=draw.choice([0, 1000, 1 << 20, 2**53 - 1]),
    )


def _nested(value: Any, depth: int) -> Any:
    for _ in range(depth):
        value = [value]
    return value


def _dumps(plain: dict[str, Any]) -> bytes:
    try:
        packed = msgpack.packb(plain)
    except OverflowError:
        packed = msgpack.packb({"type": "credit", "bytes": 2**64 - 1})
    assert isinstance(packed, bytes)
    return packed
