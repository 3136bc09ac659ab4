"""How fast the engine clients' cores decode, beside the Python SDK, on the same payloads.

    python benchmarks/engine_decoders.py [SCENE ...] [--segments 200] [--seconds 3] [--smoke]

Each scene's payloads, evenly spread over it, one thread, into buffers that are used again. Prints
one row per decoder. Without SCENE the payloads are made from a formula. Allocations: of C++ by
every call of `operator new`, of C# by `GC.GetAllocatedBytesForCurrentThread`; the first two rounds,
in which buffers grow, do not count. Python's figures are of `decode_glb`, which makes new arrays
each time.

Needs what tests/engines needs (mono-mcs, g++, cmake); says so where they are missing.
"""

from __future__ import annotations

import argparse
import json
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from engines import cores
from engines.programs import Client
from server.grid_scene import SCALES, tile_mesh

from terraport_payload import decode_glb, encode_glb
from terraport_store import Scene

SEED: Final = 20261122
LANGUAGES: Final = ("csharp", "cpp")


def main() -> int:
    parser = argparse.ArgumentParser(description="decode speed of the engine clients")
    parser.add_argument("scenes", nargs="*", type=Path)
    parser.add_argument("--segments", type=int, default=200, help="payloads of each scene")
    parser.add_argument("--seconds", type=float, default=3.0, help="of each measurement")
    parser.add_argument("--smoke", action="store_true", help="small and quick")
    options = parser.parse_args()
    clients = []
    for language in LANGUAGES:
        missing = cores.missing_for(language)
        if missing is not None:
            print(f"{language}: left out ({missing})")
            continue
        core = cores.csharp() if language == "csharp" else cores.cpp()
        clients.append(Client(language, core))
    seconds = 0.2 if options.smoke else options.seconds
    sources = [(path.name, scene_payloads(path, options.segments)) for path in options.scenes]
    for name, glbs in sources or [("formula", formula_payloads(6 if options.smoke else 40))]:
        measure(name, glbs, clients, seconds)
    return 0


def scene_payloads(path: Path, count: int) -> list[bytes]:
    """Return payloads of segments spread evenly over a scene."""
    with Scene.open(path) as scene:
        chosen = np.unique(np.linspace(0, len(scene.index) - 1, count).astype(int))
        return [bytes(scene.payload(int(segment))) for segment in chosen]


def formula_payloads(count: int) -> list[bytes]:
    """Return wavy squares of 5,000 triangles with noise of a centimetre."""
    draw = np.random.default_rng(SEED)
    payloads = []
    for number in range(count):
        mesh = tile_mesh(number // 6, number % 6, 50, seed=number)
        noise = draw.normal(scale=0.01, size=mesh.positions.shape).astype(np.float32)
        mesh.positions[:] = np.round((mesh.positions + noise) * 512) / 512
        payloads.append(encode_glb(mesh, step_m=2.0**-9, attribute_scales=SCALES))
    return payloads


def measure(name: str, glbs: Sequence[bytes], clients: Sequence[Client], seconds: float) -> None:
    """Print the rows of one source."""
    faces = sum(len(decode_glb(glb).faces) for glb in glbs) / len(glbs)
    print(f"\n{name}: {len(glbs)} payloads, {faces:,.0f} triangles each on average")
    print(
        f"{'':22}{'KB':>8}{'segments/s':>12}{'MB/s':>9}{'Mtri/s':>8}{'bytes allocated/segment':>25}"
    )
    size_kb = sum(map(len, glbs)) / len(glbs) / 1000
    for client in clients:
        row(client.language, size_kb, by_tool(client, glbs, seconds))
    row("python", size_kb, by_python(glbs, seconds))


def by_tool(client: Client, payloads: Sequence[bytes], seconds: float) -> dict[str, Any]:
    """Let a core's own program decode; returns what it printed."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "payloads.glb"
        path.write_bytes(b"".join(struct.pack("<I", len(data)) + data for data in payloads))
        done = client.run("decode", path, "--seconds", seconds, timeout_s=60 + 4 * seconds)
    if done.returncode != 0:
        raise subprocess.SubprocessError(done.stdout[-2000:])
    told: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return told


def by_python(payloads: Sequence[bytes], seconds: float) -> dict[str, Any]:
    """Decode with the Python SDK's own functions."""
    faces = sum(len(decode_glb(payload).faces) for payload in payloads)
    start, rounds = time.perf_counter(), 0
    while True:
        for payload in payloads:
            decode_glb(payload)
        rounds += 1
        elapsed = time.perf_counter() - start
        if elapsed >= seconds:
            break
    return {
        "segments_per_s": rounds * len(payloads) / elapsed,
        "payload_mb_per_s": rounds * sum(map(len, payloads)) / 1e6 / elapsed,
        "mtriangles_per_s": rounds * faces / 1e6 / elapsed,
    }


def row(name: str, size_kb: float, told: dict[str, Any]) -> None:
    allocated = told.get("allocated_bytes_per_segment")
    shown = "" if allocated is None else f"{allocated:,.2f}"
    print(
        f"{name:22}{size_kb:>8.1f}{told['segments_per_s']:>12,.0f}{told['payload_mb_per_s']:>9,.0f}"
        f"{told['mtriangles_per_s']:>8.1f}{shown:>25}"
    )


if __name__ == "__main__":
    sys.exit(main())
