"""How a build grows with its survey: time, CPU, peak memory, disk and holes, a folder of LAZ tiles.

The quarry grows with its points, so that their spacing stays: 1 M on 360 m, 100 M on 3.6 km. Each
is written by `synth`, cut into a grid of files as a delivery is, and built by the command with a
limit of memory. The exponent says how CPU seconds grow from one survey to the next (1: linear);
CPU seconds, because other work on the machine lengthens the wall's. "Alone" is what the wall time
and the share of busy cores would be without that work (`parts/core_demand.py`).

    python benchmarks/growth.py                              1 M and 5 M, about 8 minutes
    python benchmarks/growth.py --points 1M 5M 25M 100M --max-memory 6G
    python benchmarks/growth.py --points 5M --max-memory 8G --rays 10000
    python benchmarks/growth.py --smoke                      20 k and 40 k
"""

from __future__ import annotations

import argparse
import itertools
import math
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from parts.deliveries import Measured, measure, quarry_of, write_delivery

from terraport_pipeline.option import parse_count


def print_table(rows: list[Measured]) -> None:
    """Print one line a build, and the exponents between them."""
    print(
        "| points | files | wall s | of it stages s | CPU s | busy | alone, wall s | alone, busy "
        "| peak MiB | disk GiB |"
    )
    print("| -- | -- | -- | -- | -- | -- | -- | -- | -- | -- |")
    cores = os.cpu_count() or 1
    for row in rows:
        print(
            f"| {row.points:,} | {row.files} | {row.wall_s:.0f} | {row.stages_s:.0f} "
            f"| {row.cpu_s:.0f} | {row.cpu_s / row.wall_s / cores:.0%} | {row.quiet_s:.0f} "
            f"| {row.busy:.0%} | {row.peak_bytes / 2**20:,.0f} "
            f"| {row.disk_bytes / 2**30:.2f} |"
        )
    for less, more in itertools.pairwise(rows):
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
            delivery = write_delivery(quarry_of(count), side, folder / f"delivery-{count}")
            scene = folder / f"scene-{count}"
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
