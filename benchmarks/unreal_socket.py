"""What the pace of Unreal's socket thread costs a landing, emulated over a real socket.

    python benchmarks/unreal_socket.py [--radius 25] [--buffer-kib 4 32 64 128] [--smoke]

The scene actor runs on the stubs against a live service on loopback. Its network gives the socket a
round as often as the engine's thread would, and takes a buffer in each: at the engine's own 33.3 ms
(something has loaded the WebSockets module before the plugin), and as the plugin sets it. A scene
of 10 MB, GLB without compression. Time is frames of 5 ms from the call to ready, and not this
machine's. Prints a row for each buffer.

Needs what tests/engines needs (g++, cmake, libwebsockets-dev, doctest-dev).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from engines import cores
from engines.programs import socket_pace
from faults.service import Service
from server.grid_scene import write_grid_scene

FRAME_S = 0.005
"""Of the visit's game."""


def main() -> int:
    parser = argparse.ArgumentParser(description="landings at the pace of Unreal's socket thread")
    parser.add_argument("--radius", type=float, default=25.0, help="metres")
    parser.add_argument("--buffer-kib", type=int, nargs="+", default=[4, 32, 64, 128])
    parser.add_argument("--smoke", action="store_true", help="small and quick")
    options = parser.parse_args()
    radius_m, buffers_kib = (8.0, [32]) if options.smoke else (options.radius, options.buffer_kib)
    missing = cores.missing_for("cpp")
    if missing is not None:
        print(f"left out ({missing})")
        return 0
    core = cores.cpp()
    print(
        "| buffer | MB | the bytes alone, s | at 33.3 ms: rounds, s | ratio | as set: rounds, s |"
    )
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        write_grid_scene(Path(folder) / "big", cells=80, name="big")
        with Service(Path(folder)) as service:
            url = f"{service.url}/scenes/big"
            for kib in buffers_kib:
                late = socket_pace(core, url, radius_m, late=True, buffer_bytes=kib * 1024)
                early = socket_pace(core, url, radius_m, buffer_bytes=kib * 1024)
                needed_s = late["payload_bytes"] / (kib * 1024) * late["frame_time_s"]
                late_s, early_s = (pace["frames"] * FRAME_S for pace in (late, early))
                print(
                    f"| {kib} KiB | {late['payload_bytes'] / 1e6:.2f} | {needed_s:.2f} "
                    f"| {late['rounds']}, {late_s:.2f} | {late_s / needed_s:.3f} "
                    f"| {early['rounds']}, {early_s:.2f} |",
                    flush=True,
                )
    return 0


if __name__ == "__main__":
    sys.exit(main())
