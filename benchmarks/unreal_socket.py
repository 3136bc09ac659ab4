"""What the pace of Unreal's socket thread costs a landing, emulated over a real socket.

    python benchmarks/unreal_socket.py [--radius 8 25] [--smoke]

The scene actor runs on the stubs against a live service on loopback. Its network gives the socket a
round as often as the engine's thread would, and takes 32 KiB in each: at the engine's own 33.3 ms
(something has loaded the WebSockets module before the plugin), and as the plugin sets it. A scene
of 10 MB, GLB without compression, frames of 5 ms. Prints a row for each radius.

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


def main() -> int:
    parser = argparse.ArgumentParser(description="landings at the pace of Unreal's socket thread")
    parser.add_argument("--radius", type=float, nargs="+", default=[8, 25], help="metres")
    parser.add_argument("--smoke", action="store_true", help="small and quick")
    options = parser.parse_args()
    missing = cores.missing_for("cpp")
    if missing is not None:
        print(f"left out ({missing})")
        return 0
    core = cores.cpp()
    print("| radius | MB | rounds | before: frames, ms | after: frames, ms |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        write_grid_scene(Path(folder) / "big", cells=80, compress=False, name="big")
        with Service(Path(folder)) as service:
            for radius_m in [8.0] if options.smoke else options.radius:
                url = f"{service.url}/scenes/big"
                late = socket_pace(core, url, radius_m, late=True)
                early = socket_pace(core, url, radius_m)
                print(
                    f"| {radius_m:g} m | {late['payload_bytes'] / 1e6:.2f} | {late['rounds']} "
                    f"| {late['frames']}, {late['ms']:,} | {early['frames']}, {early['ms']:,} |",
                    flush=True,
                )
    return 0


if __name__ == "__main__":
    sys.exit(main())
