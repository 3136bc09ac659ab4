"""A delivery of 64 LAZ files of which one is damaged: which, where, and going on without it.

Damage: cut short, a header of noise, a flipped bit in the compressed points, no bytes, a picture
under the file's name, another coordinate reference system. The build of each must end before a
point is worked on, with the file's name, the place in it where there is one, and what to do; and
publish nothing. Then all six at once: `--skip-damaged` goes on, says which files and what share of
them it left out, and publishes what the delivery without them gives.

LAZ has no checksums: `--flips` looks how many flipped bits are found at all.

    python benchmarks/damaged_delivery.py --flips 80    about a minute
    python benchmarks/damaged_delivery.py --points 1M
    python benchmarks/damaged_delivery.py --smoke       20 k points
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Final

import laspy
import numpy as np
from parts.deliveries import quarry_of, write_delivery
from parts.killed_command import check_scene, scene_bytes
from pyproj import CRS

from terraport_payload.types import Float64
from terraport_pipeline.engines.readers.read_las import open_las
from terraport_pipeline.errors import ReadError
from terraport_pipeline.option import parse_count

SIDE: Final = 8
"""Files along each side of the site."""

MAIN: Final = "import sys; from terraport.cli import main; sys.exit(main())"


def cut_short(path: Path) -> None:
    """Keep the first 60 % of the bytes."""
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 6 // 10])


def noise_in_header(path: Path) -> None:
    """Put noise behind the header's first fields."""
    data = bytearray(path.read_bytes())
    data[90:200] = np.random.default_rng(1).bytes(110)
    path.write_bytes(data)


def flipped_bit(path: Path) -> None:
    """Flip a bit of the compressed coordinates: they come first, colours after them."""
    data = bytearray(path.read_bytes())
    with laspy.open(path) as reader:
        start = reader.header.offset_to_point_data
    data[start + (len(data) - start) // 5] ^= 0x40
    path.write_bytes(data)


def no_bytes(path: Path) -> None:
    """Leave nothing."""
    path.write_bytes(b"")


def picture(path: Path) -> None:
    """Put a picture's first bytes there."""
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + np.random.default_rng(2).bytes(4000))


def other_crs(path: Path) -> None:
    """State another zone."""
    las = laspy.read(path)
    las.header.vlrs = [vlr for vlr in las.header.vlrs if vlr.user_id != "LASF_Projection"]
    las.header.add_crs(CRS.from_epsg(32633))
    las.write(path)


DAMAGE: Final[tuple[tuple[Callable[[Path], None], str, str], ...]] = (
    (cut_short, "tile-0-3.laz", "at byte"),
    (noise_in_header, "tile-2-5.laz", "header"),
    (flipped_bit, "tile-3-3.laz", "at point"),
    (no_bytes, "tile-4-1.laz", "0 bytes"),
    (picture, "tile-5-6.laz", "at byte 0"),
    (other_crs, "tile-6-2.laz", "UTM zone 33N in tile-6-2.laz"),
)
"""What is done to which file, and what must be said of it beside its name."""


def build(survey: Path, scene: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Run the command."""
    command = ["build", str(survey), "-o", str(scene), "--no-report", "--quiet", *options]
    return subprocess.run(
        [sys.executable, "-c", MAIN, *command], capture_output=True, text=True, check=False
    )


def refused(delivery: Path, folder: Path) -> list[str]:
    """Damage one file at a time; return what is wrong."""
    wrong = []
    for number, (damage, name, wanted) in enumerate(DAMAGE):
        damaged, scene = folder / f"one-{number}", folder / f"scene-{number}"
        shutil.copytree(delivery, damaged)
        damage(damaged / name)
        ended = build(damaged, scene)
        said = ended.stderr.replace(str(damaged) + "/", "")
        print(f"{damage.__name__}: {said.strip()}", flush=True)
        words = (name, wanted, "--skip-damaged")
        wrong += [f"{damage.__name__}: does not say {word!r}" for word in words if word not in said]
        if ended.returncode != 1 or scene.exists():
            wrong.append(
                f"{damage.__name__}: ended with {ended.returncode}, scene {scene.exists()}"
            )
        shutil.rmtree(damaged)
    return wrong


def skipped(delivery: Path, folder: Path) -> list[str]:
    """Damage six files, build without them; return what is wrong."""
    damaged, whole = folder / "six", folder / "without"
    for copy in (damaged, whole):
        shutil.copytree(delivery, copy)
    for damage, name, _ in DAMAGE:
        damage(damaged / name)
        (whole / name).unlink()
    first = build(damaged, folder / "scene")
    print(f"six at once: {first.stderr.replace(str(damaged) + '/', '').strip()}")
    wrong = [] if first.returncode == 1 and not (folder / "scene").exists() else ["six: built"]
    for survey, scene, options in ((damaged, "scene", ["--skip-damaged"]), (whole, "whole", [])):
        ended = build(survey, folder / scene, *options)
        if ended.returncode:
            return [*wrong, f"{scene}: {ended.stderr}"]
    record = json.loads((folder / "scene" / "build.json").read_bytes())
    left_out = {file["name"] for file in record["left_out"] if file["damaged"]}
    manifest = json.loads((folder / "scene" / "scene.json").read_bytes())
    warning = next((w for w in manifest["build"]["warnings"] if w.startswith("Left out")), "")
    print(f"--skip-damaged: {warning}")
    if left_out != {name for _, name, _ in DAMAGE} or "9.4% of the files" not in warning:
        wrong.append(f"left out: {left_out}, {warning}")
    if check_scene(folder / "scene")[1]:
        wrong.append("the scene is damaged")
    # The manifests differ by the warning.
    files, expected = (
        sorted(digest for name, digest in scene_bytes(folder / scene).items() if "/" in name)
        for scene in ("scene", "whole")
    )
    print(f"{len(files)} published files, {'the same' if files == expected else 'OTHER'} bytes")
    return wrong if files == expected else [*wrong, "other bytes than without the files"]


def read_points(path: Path) -> Float64:
    """Read all points of a file, its colours and attributes with them."""
    with open_las(path) as stream:
        return np.concatenate([chunk.points for chunk in stream.chunks()])


def count_found(path: Path, flips: int) -> str:
    """Flip bits of a LAZ file's points, one at a time; say what became of them."""
    whole, counts = path.read_bytes(), Counter[str]()
    rng = np.random.default_rng(1)
    with laspy.open(path) as reader:
        start = reader.header.offset_to_point_data + 8
    truth = read_points(path)
    for _ in range(flips):
        data = bytearray(whole)
        data[int(rng.integers(start, len(data)))] ^= 1 << int(rng.integers(8))
        path.write_bytes(data)
        try:
            points = read_points(path)
        except ReadError:
            counts["found"] += 1
            continue
        same = np.array_equal(points, truth)
        counts["other colours or attributes" if same else "other coordinates"] += 1
    path.write_bytes(whole)
    return f"{flips} flipped bits: {', '.join(f'{n} {what}' for what, n in counts.items())}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--points", type=lambda text: parse_count(text, "--points"), default=100_000
    )
    parser.add_argument("--flips", type=int, default=0)
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="damaged-delivery-"))
    try:
        quarry = quarry_of(20_000 if arguments.smoke else arguments.points)
        delivery = write_delivery(quarry, SIDE, folder / "delivery")
        wrong = refused(delivery, folder)
        if arguments.flips:
            print(count_found(delivery / "tile-3-3.laz", arguments.flips))
        wrong += skipped(delivery, folder)
        print("\n".join(wrong) or "all as it should be")
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
