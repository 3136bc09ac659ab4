"""Time and bytes of a 1,000-segment plan on the wire: ``python benchmarks/wire.py [--smoke]``.

Fixed data.  Prints one JSON object: the bytes of the plan and the best of several
rounds of encoding and decoding; the same for a ``land`` and for payload frames.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from terraport_wire import (
    KEY_DTYPE,
    MAX_CHUNK_BYTES,
    SEGMENT_DTYPE,
    Land,
    Message,
    Plan,
    decode,
    decode_frame,
    encode,
    frame_header,
)

SEED = 20261121


def make_plan(segments: int) -> Plan:
    """Return a plan of `segments` rows of plausible sizes."""
    draw = np.random.default_rng(SEED)
    show = np.zeros(segments, dtype=SEGMENT_DTYPE)
    show["key"] = draw.integers(0, 2**64 - 1, segments, dtype=np.uint64)
    show["id"] = draw.permutation(100_000)[:segments]
    show["faces"] = draw.integers(2_000, 20_000, segments)
    show["vertices"] = show["faces"] // 2 + 50
    show["bytes"] = show["faces"] * 4
    return Plan(
        generation=7,
        show=show,
        hidden=draw.bytes(400),
        inner_count=segments // 8,
        inner_hidden=draw.bytes(200),
        effective_radius_m=60.0,
        omitted=0,
    )


def best_us(work: Callable[[], object], rounds: int) -> float:
    """Return the fastest of `rounds` runs in microseconds: the others measure the machine."""
    work()
    times = []
    for _ in range(rounds):
        start = time.perf_counter_ns()
        work()
        times.append(time.perf_counter_ns() - start)
    return min(times) / 1000


def measure(message: Message, rounds: int) -> dict[str, float]:
    """Return bytes and times of a message; the round trip must hold."""
    wire = encode(message)
    assert decode(wire, message.DIRECTION) == message
    return {
        "bytes": len(wire),
        "encode_us": round(best_us(partial(encode, message), rounds), 1),
        "decode_us": round(best_us(partial(decode, wire, message.DIRECTION), rounds), 1),
    }


def measure_frames(rounds: int) -> dict[str, float]:
    """Return the times of one full frame: header alone (what the server writes), and decoding."""
    numbers = {"generation": 1, "key": 2, "offset": 0, "total": 2**20}
    data = frame_header(**numbers) + bytes(MAX_CHUNK_BYTES)
    assert decode_frame(data) is not None
    return {
        "bytes": len(data),
        "header_us": round(best_us(lambda: frame_header(**numbers), rounds), 2),
        "decode_us": round(best_us(lambda: decode_frame(data), rounds), 2),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--smoke", action="store_true", help="few segments, few rounds: runs it once"
    )
    options = parser.parse_args()
    segments, rounds = (10, 2) if options.smoke else (1_000, 200)
    land = Land(
        generation=7,
        position=(12.25, -3.5, 100.125),
        radius_m=60.0,
        have=np.arange(segments, dtype=KEY_DTYPE),
        taken_bytes=0,
    )
    results = {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "segments": segments,
        "plan": measure(make_plan(segments), rounds),
        "land": measure(land, rounds),
        "frame": measure_frames(rounds),
    }
    print(json.dumps(results, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
