"""How a build grows with its survey: time, CPU, peak memory, disk and holes, a folder of LAZ tiles.

The quarry grows with its points, so that their spacing stays: 1 M on 360 m, 100 M on 3.6 km. Each
is written by `synth`, cut into a grid of files as a delivery is, and built by the command with a
limit of memory. The exponent says how CPU seconds grow from one survey to the next (1: linear);
CPU seconds, because other work on the machine lengthens the wall's.

    python benchmarks/growth.py                              1 M and 5 M, about 8 minutes
    python benchmarks/growth.py --points 1M 5M 25M 100M --max-memory 6G
    python benchmarks/growth.py --smoke                      20 k and 40 k
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
import psutil

from terraport_pipeline.option import parse_count
from terraport_pipeline.synth.files import write_quarry
from terraport_pipeline.synth.options import QuarryOptions

_SIDE_M = 360.0
"""East-west side of the quarry of 1 M points."""

_ROWS_AT_ONCE = 2_000_000


@dataclass(frozen=True)
class Measured:
    """One build."""

    points: int
    files: int
    wall_s: float
    cpu_s: float
    peak_bytes: int
    """Resident memory of the command and its children, at most, looked at twice a second."""
    disk_bytes: int
    """Of scene and work directory at the end."""
    report: dict[str, object]
    """``build.json``."""


def write_delivery(points: int, side: int, folder: Path) -> Path:
    """Write a quarry of so many points as side * side LAZ files; files that are there stay."""
    delivery = folder / f"delivery-{points}"
    if delivery.exists():
        return delivery
    whole, beside = folder / f"quarry-{points}.laz", folder / f".delivery-{points}.part"
    size_m = _SIDE_M * math.sqrt(points / 1e6)
    write_quarry(QuarryOptions(points=points, size_m=max(20.0, size_m)), whole, overwrite=True)
    beside.mkdir(parents=True, exist_ok=True)
    with laspy.open(whole) as reader:
        low, high = reader.header.mins[:2], reader.header.maxs[:2]
        writers = {
            (i, j): laspy.open(beside / f"tile-{i}-{j}.laz", mode="w", header=reader.header)
            for i in range(side)
            for j in range(side)
        }
        for rows in reader.chunk_iterator(_ROWS_AT_ONCE):
            share = (np.stack([rows.x, rows.y], axis=1) - low) / (high - low)
            column, row = np.minimum((share * side).astype(int), side - 1).T
            for (i, j), writer in writers.items():
                inside = (column == i) & (row == j)
                if inside.any():
                    writer.write_points(rows[inside])
        for writer in writers.values():
            writer.close()
    whole.unlink()
    whole.with_suffix(".truth.npz").unlink()
    beside.rename(delivery)
    return delivery


def measure(command: list[str], scene: Path, points: int, files: int) -> Measured:
    """Run a build and watch its memory."""
    began, before = time.monotonic(), os.times()
    child = psutil.Popen(command)
    peak = 0
    ended = threading.Event()

    def watch() -> None:
        nonlocal peak
        while not ended.wait(0.5):
            total = 0
            for process in [child, *_children(child)]:
                try:
                    total += process.memory_info().rss
                except psutil.Error:
                    continue
            peak = max(peak, total)

    watcher = threading.Thread(target=watch)
    watcher.start()
    code = child.wait()
    ended.set()
    watcher.join()
    if code:
        raise SystemExit(f"{' '.join(command)} ended with {code}")
    after = os.times()
    cpu_s = after.children_user + after.children_system
    cpu_s -= before.children_user + before.children_system
    work = scene.with_name(f".{scene.name}.work")
    return Measured(
        points, files, time.monotonic() - began, cpu_s, peak,
        _bytes_in(scene) + _bytes_in(work), json.loads((scene / "build.json").read_bytes()),
    )  # fmt: skip


def _children(process: psutil.Process) -> list[psutil.Process]:
    try:
        children: list[psutil.Process] = process.children(recursive=True)
    except psutil.Error:
        return []
    return children


def _bytes_in(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def print_table(rows: list[Measured]) -> None:
    """Print one line a build, and the exponents between them."""
    print("| points | files | wall s | CPU s | busy | peak MiB | disk GiB |")
    print("| -- | -- | -- | -- | -- | -- | -- |")
    cores = os.cpu_count() or 1
    for row in rows:
        print(
            f"| {row.points:,} | {row.files} | {row.wall_s:.0f} | {row.cpu_s:.0f} "
            f"| {row.cpu_s / row.wall_s / cores:.0%} | {row.peak_bytes / 2**20:,.0f} "
            f"| {row.disk_bytes / 2**30:.2f} |"
        )
    for less, more in zip(rows, rows[1:], strict=False):
        grown = math.log(more.points / less.points)
        print(
            f"{less.points:,} to {more.points:,}: exponent of CPU time "
            f"{math.log(more.cpu_s / less.cpu_s) / grown:.2f}"
        )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--points",
        nargs="+",
        type=lambda text: parse_count(text, "--points"),
        default=[1_000_000, 5_000_000],
    )
    parser.add_argument("--side", type=int, default=8, help="files along each side of the site")
    parser.add_argument("--max-memory", default="6G")
    parser.add_argument("--rays", type=int, default=1_000_000, help="to look for holes with")
    parser.add_argument("--keep", type=Path, help="folder for deliveries and scenes")
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    points = [20_000, 40_000] if arguments.smoke else sorted(arguments.points)
    side, rays = (2, 10_000) if arguments.smoke else (arguments.side, arguments.rays)
    folder = arguments.keep or Path(tempfile.mkdtemp(prefix="benchmark-growth-"))
    folder.mkdir(parents=True, exist_ok=True)
    terraport = [str(Path(sys.executable).with_name("terraport"))]
    rows = []
    try:
        for count in points:
            delivery, scene = write_delivery(count, side, folder), folder / f"scene-{count}"
            build = [*terraport, "build", str(delivery), "-o", str(scene), "--no-resume"]
            rows.append(
                measure(
                    [*build, "--max-memory", arguments.max_memory, "--quiet"],
                    scene, count, len(list(delivery.iterdir())),
                )
            )  # fmt: skip
            print_table(rows)
            subprocess.run([*terraport, "validate", str(scene), "--rays", str(rays)], check=True)
    finally:
        if arguments.keep is None:
            shutil.rmtree(folder, ignore_errors=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
