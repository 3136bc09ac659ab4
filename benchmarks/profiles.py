"""What a landing takes in scenes of each profile: payload, vertices, textures.

::

    terraport build quarry.laz --photos photos --profile headset -o headset
    python benchmarks/profiles.py headset=headset
    python benchmarks/profiles.py --smoke            # a scene of the corpus

Lands at the middles of segments, with the radius and the bounds of such a device
(docs/topics/profiles.md), each as the first one, by the service's own selection. Told are the
payload's bytes and what the landing takes on a GPU (spec/protocol.md, section 4), beside the
share that a client leaves for one: the device's, less an eighth, less the base, and half of that.

Fails (exit status 1) where a landing takes more than its bounds, or its share.
"""

from __future__ import annotations

import argparse
import random
import statistics
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from terraport_server.scenes.served_scene import ServedScene
from terraport_server.session.interface import SegmentTable
from terraport_server.session.plan import Budgets, choose, gpu_bytes

CORPUS: Final = Path(__file__).resolve().parents[1] / "tests" / "conformance" / "scene"
SEED: Final = 23
MIB: Final = 1024 * 1024
MEGABYTE: Final = 1e6


@dataclass(frozen=True)
class Device:
    """The bounds of a class of devices; client_sdk/web/src/core/budgets.ts has the same."""

    radius_m: float
    triangles: int
    segments: int
    gpu_bytes: int
    texel_bits: int
    """Of the base's texture on the GPU."""


DEVICES: Final = {
    "desktop": Device(60, 6_000_000, 4096, 1024 * MIB, 32),
    "headset": Device(40, 900_000, 512, 512 * MIB, 4),
    "phone": Device(40, 1_500_000, 1024, 256 * MIB, 4),
}


def main() -> int:
    """Print a table; returns the exit status."""
    parser = argparse.ArgumentParser(description="Landings in scenes of each profile.")
    parser.add_argument("scenes", nargs="*", metavar="PROFILE=SCENE", help=", ".join(DEVICES))
    parser.add_argument("--landings", type=int, default=20)
    parser.add_argument("--smoke", action="store_true", help="a scene of the corpus")
    options = parser.parse_args()
    named: list[str] = options.scenes or ([f"phone={CORPUS / 'tiny'}"] if options.smoke else [])
    if not named:
        parser.error("got no scene, expected PROFILE=SCENE")
    missed = False
    for one in named:
        profile, _, path = one.partition("=")
        if profile not in DEVICES or not path:
            parser.error(f"got {one!r}, expected PROFILE=SCENE with {', '.join(DEVICES)}")
        served = ServedScene(Path(path).name, Path(path))
        print(f"== {one}", flush=True)
        missed |= not fits(served, DEVICES[profile], options.landings)
    return 1 if missed else 0


def fits(served: ServedScene, device: Device, landings: int) -> bool:
    """Land, print, and tell whether everything stays within the device's bounds."""
    table = served.view.table
    rows = np.arange(table.segment_count)
    share = landing_share(served, device)
    # Bounded by nothing: told is what the ground takes there, not what a bound left of it.
    free = Budgets()
    buffers = gpu_bytes(table, rows, free) - table.texture_bytes[rows].astype(np.int64)
    print(f"   whole: {row(table, rows, buffers)}")
    chance = random.Random(SEED)
    found = []
    for segment in chance.choices(range(table.segment_count), k=landings):
        low, high = table.bounds[segment, :3], table.bounds[segment, 3:]
        centre = [float(value) for value in (low.astype(float) + high) / 2]
        ids = choose(served.view, centre, device.radius_m, budgets=free).rows
        textures = int(table.texture_bytes[ids].sum())
        payload, triangles = int(table.lengths[ids].sum()), int(table.faces[ids].sum())
        found.append((len(ids), triangles, payload, int(buffers[ids].sum()), textures))
    names = ("segments", "triangles", "payload, MB", "vertices and indices, MB", "textures, MB")
    for at, name in enumerate(names):
        values = [float(one[at]) / (MEGABYTE if at > 1 else 1) for one in found]
        form = ".2f" if at > 1 else ",.0f"
        print(f"   {name}: median {statistics.median(values):{form}}, most {max(values):{form}}")
    most = max(one[3] + one[4] for one in found)
    print(f"   on a GPU: most {most / MEGABYTE:.2f} MB of a share of {share / MEGABYTE:.2f} MB")
    within = (
        most <= share
        and max(one[0] for one in found) <= device.segments
        and max(one[1] for one in found) <= device.triangles
    )
    if not within:
        print("MISSED: a landing takes more than its device has")
    return within


def landing_share(served: ServedScene, device: Device) -> int:
    """Bytes of the device's GPU that one of two landings may take, as clients divide it."""
    counts, texture = served.scene.manifest.counts, served.scene.manifest.textures
    side = 0 if texture is None else texture.base_side
    face_bytes = 6 if counts.base_vertices < 65535 else 12
    # A mip chain adds a third; the base's faces are listed three times.
    base = counts.base_vertices * 24 + 3 * counts.base_faces * face_bytes
    base += side * side * device.texel_bits // 8 * 4 // 3
    return (device.gpu_bytes - device.gpu_bytes // 8 - base) // 2


def row(table: SegmentTable, rows: np.ndarray, buffers: np.ndarray) -> str:
    """Say what the whole scene has."""
    payload, textures = int(table.lengths[rows].sum()), int(table.texture_bytes[rows].sum())
    return (
        f"{len(rows)} segments, {int(table.faces[rows].sum()):,} triangles,"
        f" {payload / MEGABYTE:.2f} MB payload, {buffers.sum() / MEGABYTE:.2f} MB vertices and"
        f" indices, {textures / MEGABYTE:.2f} MB textures"
    )


if __name__ == "__main__":
    sys.exit(main())
