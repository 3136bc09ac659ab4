"""What the next survey over a scene costs: a folder of LAZ files of which a tile's ground changed.

::

    python benchmarks/next_survey.py                      1 M points, 65 tiles, about 15 minutes
    python benchmarks/next_survey.py --points 25M --tile-depth 10 --max-memory 6G
    python benchmarks/next_survey.py --smoke              60 k points

Three builds by the command, each over the one before:

1. ``first``: the quarry as a folder of files;
2. ``pit``: the same folder with a pit in the core of one tile;
3. ``flown again``: another sample of all of it, the pit included, with 3 cm of noise and 3 % more
   red.

For each: time and CPU seconds with the report, tiles computed again, payload bytes
and segments that changed, ids kept, and what a Python client with a cache on disk loads of a
landing that reaches the whole scene. Fails (exit status 1) where an unchanged tile's payload
changed, a hole opened, or the client loaded what it held.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from parts.deliveries import Measured, measure, quarry_of, write_delivery
from parts.service_process import ServiceProcess, free_port

import terraport
from terraport_pipeline.geometry.tiles.tile_plan import Lattice, TilePlan, tile_shape
from terraport_pipeline.option import parse_count
from terraport_store import Scene

_NOISE_M = 0.03
_REDDER = 1.03
_PIT_SHARE = 0.25
"""Radius of the pit, of a core's width."""


@dataclass(frozen=True)
class Version:
    """What a build published."""

    hashes: dict[int, int]
    """By id of the segment."""
    bytes_of: dict[int, int]
    regions: frozenset[int]
    tiles: dict[str, str]
    """Digest of every tile's payloads."""


@dataclass(frozen=True)
class Pit:
    """A bowl dug into one tile's core."""

    tile: int
    x: float
    y: float
    radius_m: float
    low_z: float
    high_z: float

    def deepened(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Heights with the pit."""
        reach = np.hypot(x - self.x, y - self.y) / self.radius_m
        inside = (reach < 1) & (z > self.low_z) & (z < self.high_z)
        return z - np.where(inside, self.radius_m / 3 * (1 - reach**2), 0.0)


def version_of(scene: Path) -> Version:
    """Open what stands published."""
    with Scene.open(scene) as opened:
        return Version(
            dict(enumerate(opened.index.xxh3.tolist())),
            dict(enumerate(opened.index.length.tolist())),
            frozenset(row["stable_id"] for row in opened.regions["regions"]),
            {
                path.parent.name: json.loads(path.read_bytes())["digest"]
                for path in sorted(_work(scene).glob("pack-tile-*/stage.json"))
            },
        )


def _work(scene: Path) -> Path:
    return scene.with_name(f".{scene.name}.work")


def _values(scene: Path, stage: str) -> dict[str, Any]:
    record = json.loads((_work(scene) / stage / "stage.json").read_bytes())
    values: dict[str, Any] = record["values"]
    return values


def plan_pit(scene: Path) -> Pit:
    """Choose the tile with the most samples, and the middle of its core."""
    plan, frame = _values(scene, "plan"), _values(scene, "frame")
    lattice = Lattice(tuple(frame["anchor_m"]), frame["cell_m"])
    indices, shape = np.array(plan["tiles"]), tile_shape(plan["depth"])
    tile = int(np.argmax(_values(scene, "partition")["samples"]))
    core = TilePlan(
        lattice, shape, tuple(plan["offset"]), indices, np.zeros(len(indices), np.int64)
    ).core(tile)
    low, high = (np.array(lattice.anchor_m) + corner * lattice.cell_m for corner in core)
    x, height, z = (low + high) / 2 + [0, frame["origin"][2], 0]
    return Pit(
        tile, frame["origin"][0] + x, frame["origin"][1] - z,
        _PIT_SHARE * shape.core * lattice.cell_m,
        height - (high - low)[1] / 2, height + (high - low)[1] / 2,
    )  # fmt: skip


def dig(delivery: Path, pit: Pit, target: Path, *, noise: bool) -> int:
    """Write a delivery with the pit, and noise; unchanged files are linked. Return points moved."""
    target.mkdir()
    rng, moved = np.random.default_rng(5), 0
    for file in sorted(delivery.glob("*.laz")):
        las = laspy.read(file)
        heights = np.array(las.z)
        deeper = pit.deepened(np.array(las.x), np.array(las.y), heights)
        moved += int((deeper != heights).sum())
        if not noise and (deeper == heights).all():
            (target / file.name).hardlink_to(file)
            continue
        las.z = deeper
        if noise:
            las.xyz = np.array(las.xyz) + rng.normal(0.0, _NOISE_M, (len(las), 3))
            las.red = np.minimum(np.array(las.red) * _REDDER, 65535).astype(np.uint16)
        las.write(target / file.name)
    return moved


async def _land(url: str, cache: Path, reach_m: float) -> terraport.LandingStats:
    # The whole scene came within seconds: leaving waits until the disk has it.
    async with terraport.connect(
        url,
        cache_dir=cache,
        cache_bytes=2**33,
        disk_bytes=2**34,
        timeouts=terraport.Timeouts(close_s=600.0),
    ) as session:
        landing = await session.land((0.0, 0.0, 0.0), reach_m)
        await landing.ready(600)
        return landing.stats


def client_loads(scene: Path, cache: Path, port: int) -> terraport.LandingStats:
    """Land so that the whole scene is within the radius, with what is on disk."""
    with Scene.open(scene) as opened:
        reach_m = 1.0 + 2 * float(np.abs(opened.index.bounds).max())
    with ServiceProcess(scene, port=port, max_radius_m=reach_m + 1) as service:
        return asyncio.run(_land(f"{service.url}/scenes/{scene.name}", cache, reach_m))


def report(name: str, build: Measured, before: Version, now: Version, loaded: int) -> str:
    """Write a line of the table."""
    kept = before.hashes.items() & now.hashes.items()
    total = sum(now.bytes_of.values())
    changed = total - sum(now.bytes_of[number] for number, _ in kept)
    tiles = sum(now.tiles.get(tile) != digest for tile, digest in before.tiles.items())
    regions = len(before.regions & now.regions) / max(1, len(before.regions))
    return (
        f"| {name} | {build.wall_s:.0f} | {build.cpu_s:.0f} "
        f"| {tiles} of {len(now.tiles)} | {len(kept)} of {len(now.hashes)} | {changed:,} "
        f"| {changed / total:.2%} | {loaded:,} | {regions:.0%} |"
    )


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--points", type=lambda text: parse_count(text, "--points"), default=10**6)
    parser.add_argument("--side", type=int, default=8, help="files along each side of the site")
    parser.add_argument("--tile-depth", type=int, default=8)
    parser.add_argument("--max-memory", default="6G")
    parser.add_argument("--rays", type=int, default=1_000_000, help="to look for holes with")
    parser.add_argument("--keep", type=Path, help="folder for deliveries and scenes")
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    if arguments.smoke:
        arguments.points, arguments.side, arguments.rays = 20_000, 2, 10_000
    folder = arguments.keep or Path(tempfile.mkdtemp(prefix="benchmark-next-survey-"))
    folder.mkdir(parents=True, exist_ok=True)
    try:
        return 0 if _run(arguments, folder) else 1
    finally:
        if arguments.keep is None:
            shutil.rmtree(folder, ignore_errors=True)


def _run(arguments: argparse.Namespace, folder: Path) -> bool:
    # (1) The first survey, and where to dig.
    scene, port, fine = folder / "scene", free_port(), True
    terraport_command = str(Path(sys.executable).with_name("terraport"))
    first = write_delivery(quarry_of(arguments.points), arguments.side, folder / "first")
    cache = folder / "cache"
    before: Version | None = None
    print(
        "| survey | wall s | CPU s | tiles anew | segments kept | bytes changed "
        "| share | client loads | regions kept |"
    )
    print("| -- | -- | -- | -- | -- | -- | -- | -- | -- |")
    # (2) Each survey over the one before. Invariant: the cache holds what the last version had.
    for name, delivery in _deliveries(arguments, folder, first, scene):
        build = measure(
            [
                terraport_command, "build", str(delivery), "-o", str(scene), "--quiet",
                "--tile-depth", str(arguments.tile_depth), "--max-memory", arguments.max_memory,
                "--no-report" if arguments.smoke else "--report",
            ],
            scene,
        )  # fmt: skip
        now = version_of(scene)
        loaded = client_loads(scene, cache, port).streamed_bytes
        print(report(name, build, before or now, now, loaded), flush=True)
        if before is not None:
            kept = before.hashes.items() & now.hashes.items()
            anew = sum(now.bytes_of.values()) - sum(now.bytes_of[number] for number, _ in kept)
            fine &= loaded <= anew
        before = now
        subprocess.run(
            [terraport_command, "validate", str(scene), "--rays", str(arguments.rays)],
            check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
    return fine


def _deliveries(
    arguments: argparse.Namespace, folder: Path, first: Path, scene: Path
) -> Iterator[tuple[str, Path]]:
    yield "first", first
    pit = plan_pit(scene)
    with Scene.open(scene) as opened:
        sizes = opened.index.length.astype(np.int64)
    share = _bytes_of_tile(scene, pit.tile) / int(sizes.sum())
    print(f"(the tile with the pit has {share:.2%} of the payload bytes)", flush=True)
    dug = folder / "pit"
    shutil.rmtree(dug, ignore_errors=True)
    dig(first, pit, dug, noise=False)
    yield "pit", dug
    if arguments.smoke:
        return
    again = write_delivery(
        quarry_of(arguments.points, sample_seed=9), arguments.side, folder / "sample"
    )
    noisy = folder / "again"
    shutil.rmtree(noisy, ignore_errors=True)
    dig(again, pit, noisy, noise=True)
    yield "flown again", noisy


def _bytes_of_tile(scene: Path, tile: int) -> int:
    return sum(
        path.stat().st_size for path in (_work(scene) / f"pack-tile-{tile:05d}").glob("payload.npy")
    )


if __name__ == "__main__":
    sys.exit(main())
