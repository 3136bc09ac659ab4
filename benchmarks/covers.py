"""Bytes of base.cover in several forms: ``python benchmarks/covers.py SCENE...``.

One row per form, one column per scene. The forms that were compared; only ``steps`` is in use.
``range coder`` is what an adaptive binary coder would make of the steps, from its probabilities (11
bits, shift 4, as LZMA's), without the few bytes that it ends with.
"""

from __future__ import annotations

import argparse
import gzip
import math
import shutil
import subprocess
import time
from collections import defaultdict
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import meshopt
import numpy as np
from rich.console import Console
from rich.table import Table

from terraport_payload import Cover
from terraport_payload.flatfile import encode_flat
from terraport_payload.types import UInt32
from terraport_store import Scene

CORPUS = Path(__file__).resolve().parents[1] / "tests" / "conformance" / "scene"
HEADER_BYTES = 32


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", type=Path)
    parser.add_argument("--smoke", action="store_true", help="scenes of the corpus")
    options = parser.parse_args()
    scenes = [CORPUS / name for name in ("tiny", "axes")] if options.smoke else options.scenes
    if not scenes:
        parser.error("got no scene, expected one or more")
    columns: dict[str, dict[str, str]] = {}
    for path in scenes:
        with Scene.open(path) as scene:
            columns[path.name] = facts(scene.cover, scene.manifest.files["base.tsg"].bytes)
    table = Table("", *columns)
    for name in next(iter(columns.values())):
        table.add_row(name, *(column[name] for column in columns.values()))
    Console(width=200).print(table)


def facts(cover: Cover, base_bytes: int) -> dict[str, str]:
    """Return sizes in every form, and the time of the one in use, as text."""
    arrays = encode_flat(b"TPCOVER1", cover.base_faces, {"o": cover.offsets, "s": cover.segments})
    counts = np.diff(cover.offsets)
    ahead = np.diff(cover.segments.astype(np.int64), prepend=0)
    zigzag = np.where(ahead < 0, -2 * ahead - 1, 2 * ahead).astype(np.uint32)
    numbers = b"".join(number(value) for value in [*counts.tolist(), *zigzag.tolist()])
    steps, write_ms = timed(cover.to_bytes)
    _, read_ms = timed(lambda: Cover.from_bytes(steps, cover.base_faces))
    body = steps[HEADER_BYTES:]
    # Forms without a container of their own would have the same header.
    bodies = {
        "counts and differences, bytes": len(numbers),
        "counts and differences, gzip 9": len(gzip.compress(numbers, 9)),
        "meshopt: counts, segments": vertex_codec(counts) + vertex_codec(cover.segments),
        "meshopt: rows named by number": meshopt_rows(cover),
        "rows named by age, bytes": len(rows_by_age(cover)),
        "steps": len(body),
        "steps, gzip 9": len(gzip.compress(body, 9)),
        "steps, range coder": range_coder_bytes(body),
    }
    sizes = {
        "arrays (as it was)": len(arrays),
        "arrays, gzip 9": len(gzip.compress(arrays, 9)),
        "arrays, zstd 19": zstd(arrays),
        **{name: HEADER_BYTES + size for name, size in bodies.items()},
    }
    return {
        "base faces": f"{cover.base_faces:,}",
        "entries": f"{len(cover.segments):,}",
        "base.tsg, bytes": f"{base_bytes:,}",
        **{name: f"{size:,}" for name, size in sizes.items()},
        "steps: write, read (Python), ms": f"{write_ms:.1f}, {read_ms:.1f}",
    }


def timed(work) -> tuple[bytes, float]:
    """Return a result and the best of five times, ms."""
    best = math.inf
    for _ in range(5):
        start = time.perf_counter()
        result = work()
        best = min(best, time.perf_counter() - start)
    return result, best * 1e3


def number(value: int) -> bytes:
    """Seven bits a byte, lowest first."""
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def zstd(data: bytes) -> int:
    """Bytes that the command makes of it; 0 where it is not installed."""
    if shutil.which("zstd") is None:
        return 0
    command = ["zstd", "-19", "-c", "-q"]
    return len(subprocess.run(command, input=data, capture_output=True, check=True).stdout)


def vertex_codec(values: UInt32) -> int:
    """Bytes of whole numbers in meshoptimizer's vertex codec, four to a vertex's stride."""
    if len(values) == 0:
        return 0
    return len(meshopt.encode_vertex_buffer(values.astype("<u4").view(np.uint8).reshape(-1, 4)))


def rows_of(cover: Cover) -> Iterator[tuple[int, ...]]:
    """Yield each face's row."""
    for start, end in pairwise(cover.offsets.tolist()):
        yield tuple(cover.segments[start:end].tolist())


def meshopt_rows(cover: Cover) -> int:
    """Different rows once, and each face the number of its row: three columns."""
    numbers: dict[tuple[int, ...], int] = {}
    faces = [numbers.setdefault(row, len(numbers)) for row in rows_of(cover)]
    lengths = [len(row) for row in numbers]
    entries = [segment for row in numbers for segment in row]
    return sum(vertex_codec(np.array(values, np.uint32)) for values in (faces, lengths, entries))


def rows_by_age(cover: Cover) -> bytes:
    """Write a byte a run: half for which of the last 15 rows it has, half for its length."""
    out, recent = bytearray(), list[tuple[int, ...]]()
    rows, at, first = list(rows_of(cover)), 0, 0
    while at < len(rows):
        row, start = rows[at], at
        while at < len(rows) and rows[at] == row:
            at += 1
        run = at - start - 1
        rank = recent.index(row) if row in recent else 15
        out.append(rank << 4 | min(run, 15))
        if run >= 15:
            out += number(run - 15)
        if rank < 15:
            recent.pop(rank)
        else:
            out += number(len(row))
            for place, segment in enumerate(row):
                ahead = segment - (first if place == 0 else row[place - 1])
                out += number(-2 * ahead - 1 if ahead < 0 else 2 * ahead)
            first = row[0] if row else first
        recent.insert(0, row)
        del recent[15:]
    return bytes(out)


def range_coder_bytes(body: bytes) -> int:
    """Each byte of the steps in eight binary decisions, a table for each kind of byte before it."""
    chances: dict[tuple[int, int], int] = defaultdict(lambda: 1024)
    bits, before = 0.0, 0
    for byte in body:
        node = 1
        for shift in range(7, -1, -1):
            bit = byte >> shift & 1
            chance = chances[before, node]
            bits -= math.log2((2048 - chance if bit else chance) / 2048)
            chances[before, node] += -(chance >> 4) if bit else (2048 - chance) >> 4
            node = 2 * node + bit
        before = (byte >> 4 == 0) + 2 * (byte & 15 == 15)
    return math.ceil(bits / 8)


if __name__ == "__main__":
    main()
