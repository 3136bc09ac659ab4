"""Fuzz the wire decoders: ``python fuzz/wire.py [--seconds N] [--seed N]``.

Starts from the conformance corpus and mutates: flips, cuts, splices, number edges.  The decoders
may return a value or raise `DecodeError`; a returned message must encode and decode to itself.
Anything else, or an input that takes beyond a second, ends the run with the input in hexadecimal.
"""

from __future__ import annotations

import argparse
import random
import sys
import time

from attacks.messages import corpus_messages
from attacks.mutation import mutate

from terraport_wire import (
    DecodeError,
    Direction,
    Unknown,
    decode,
    decode_frame,
    encode,
    frame_header,
)

SLOWEST_S = 1.0


def check(data: bytes) -> int:
    """Decode `data` in every way; return how many ways gave a value."""
    values = 0
    for direction in Direction:
        values += _check_message(data, direction)
    try:
        frame = decode_frame(data)
    except DecodeError:
        return values
    if frame is not None:
        numbers = {"generation": frame.generation, "key": frame.key}
        header = frame_header(**numbers, offset=frame.offset, total=frame.total)
        assert decode_frame(header + bytes(frame.data)) == frame
    return values + 1


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    draw = random.Random(options.seed)
    seeds = [data for _, data in corpus_messages()]
    inputs = values = 0
    end = time.monotonic() + options.seconds
    while time.monotonic() < end:
        data = mutate(draw.choice(seeds), seeds, draw)
        start = time.monotonic()
        try:
            values += check(data)
        except Exception:
            print(f"input {inputs} of seed {options.seed}: {data.hex()}", file=sys.stderr)
            raise
        if time.monotonic() - start > SLOWEST_S:
            print(f"slow input {inputs} of seed {options.seed}: {data.hex()}", file=sys.stderr)
            return 1
        inputs += 1
    print(f"{inputs} inputs, {values} decoded to a value, the rest to a documented error")
    return 0


def _check_message(data: bytes, direction: Direction) -> int:
    try:
        message = decode(data, direction)
    except DecodeError:
        return 0
    if not isinstance(message, Unknown):
        assert decode(encode(message), direction) == message
    return 1


if __name__ == "__main__":
    sys.exit(main())
