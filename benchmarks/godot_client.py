"""The Godot client in Godot 3 on the real service: pictures, background in the ground, frames.

::

    python benchmarks/godot_client.py                # all of it, on a small scene
    python benchmarks/godot_client.py --scenes FOLDER --scene sample --only frames
    python benchmarks/godot_client.py --keep FOLDER  # pictures side by side
    python benchmarks/godot_client.py --only pictures --from 5 --count 5      # a part of them
    python benchmarks/godot_client.py --smoke                            # once, briefly

The engine draws by the CPU (llvmpipe), so a frame takes what it takes there; told is our own work.
Skips, and says so, where Godot is missing.

- *pictures*: twenty landings, from two eyes each, beside the viewer's in Chromium.
- *background*: a hundred landings from three eyes each; a pixel counts where neither the base alone
  nor the whole detail shows background there or beside it.
- *frames*: milliseconds of each `update` of the client while landings stream in.

Fails (exit status 1) where a picture is too far apart, or background shows.
"""

from __future__ import annotations

import argparse
import random
import shutil
import statistics
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

try:
    from browser.conftest import FLAGS, PROGRAMS
    from browser.driven_viewer import DrivenViewer
    from browser.small_scenes import SMALL, small_scenes
    from faults.service import Service
    from godot import engine
    from godot.pictures import (
        SIZE,
        apart,
        background_in_ground,
        from_godot,
        from_viewer,
        poses_around,
        read_godot,
        visit,
    )
    from playwright.sync_api import sync_playwright
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(0)

import numpy as np
from PIL import Image

import terraport.sync

SEED: Final = 23
MEAN, FAR_SHARE, UNCOVERED = 2.0, 0.01, 0.001
"""Tolerated of a picture: see `godot.pictures.Apart`."""
BATCH: Final = 20
"""Landings of one run of the engine."""


def main() -> int:
    """Measure and print; returns the exit status."""
    parser = argparse.ArgumentParser(description="The Godot client, measured in Godot 3.")
    parser.add_argument("--smoke", action="store_true", help="once, briefly")
    parser.add_argument("--scenes", type=Path, help="folder of scenes instead of the small one")
    parser.add_argument("--scene", default=SMALL)
    parser.add_argument("--radius-m", type=float, default=60.0)
    parser.add_argument("--keep", type=Path, help="folder for pictures side by side")
    parser.add_argument("--from", dest="first", type=int, default=0, help="first landing")
    parser.add_argument("--count", type=int, help="landings; without it all of them")
    parser.add_argument("--only", default="pictures,background,frames")
    options = parser.parse_args()
    reason = engine.missing()
    if reason is not None:
        print(f"skipped: {reason}")
        return 0
    with tempfile.TemporaryDirectory() as folder:
        scenes = options.scenes or small_scenes(Path(folder))
        (Path(folder) / "served").mkdir()
        served = Path(folder) / "served" / "scenes"
        served.symlink_to(scenes.resolve())
        with Service(served, max_sessions_per_ip=100) as service:
            bench = Bench(engine.build(), f"{service.url}", options)
            for name in options.only.split(","):
                print(f"== {name}", flush=True)
                getattr(bench, name)()
    for line in bench.missed:
        print(f"MISSED: {line}")
    return 1 if bench.missed else 0


class Bench:
    """What is measured, by name."""

    def __init__(self, godot: engine.Engine, url: str, options: argparse.Namespace) -> None:
        self.godot = godot
        self.server_url = url
        self.scene: str = options.scene
        self.url = f"{url}/scenes/{options.scene}"
        self.radius_m: float = options.radius_m
        self.smoke: bool = options.smoke
        self.keep: Path | None = options.keep
        self.first: int = options.first
        self.count: int | None = options.count
        self.missed: list[str] = []

    def landings(self, count: int) -> list[tuple[float, float, float, float]]:
        """Choose places on the base's ground, and 0.4 to 1 of the radius."""
        chance = random.Random(SEED)
        with terraport.sync.connect(self.url) as session:
            mesh = session.base().mesh
        centres = mesh.positions[mesh.faces].astype(float).mean(axis=1)
        inner = np.abs(centres - centres.mean(0)) < 0.42 * np.ptp(centres, axis=0) + 1e-9
        ground = centres[inner[:, 0] & inner[:, 2]]
        return [
            (
                *map(float, ground[chance.randrange(len(ground))]),
                self.radius_m * chance.uniform(0.4, 1),
            )
            for _ in range(count)
        ]

    def part(self, count: int) -> range:
        """Return the landings of this run, of so many."""
        most = count if self.count is None else min(count, self.first + self.count)
        if not 0 <= self.first < most:
            raise SystemExit(f"--from is {self.first}, expected 0 to {count - 1}")
        return range(self.first, most)

    def pictures(self) -> None:
        """Each landing in both, from the same eyes."""
        program = next(filter(None, map(shutil.which, PROGRAMS)), None)
        if program is None:
            print("skipped: no Chromium")
            return
        places = self.landings(1 if self.smoke else 20)
        chance = random.Random(SEED)
        # Of all, so that a part is the same in a part: chance goes from landing to landing.
        poses = [poses_around(place[:3], chance, place[3], 2) for place in places]
        part = self.part(len(places))
        with tempfile.TemporaryDirectory() as name, sync_playwright() as driver:
            folder = Path(name)
            steps: list[list[Any]] = []
            for number in part:
                steps.append(["land", *places[number]])
                steps += from_godot(poses[number], folder, str(number))
            done = visit(self.godot, self.url, *steps)
            assert done.failure == "", done.failure
            browser = driver.chromium.launch(executable_path=program, args=list(FLAGS))
            context = browser.new_context(
                viewport={"width": 2 * SIZE[0], "height": 2 * SIZE[1]},
                device_scale_factor=0.5,
                reduced_motion="reduce",
            )
            viewer = DrivenViewer(context.new_page(), self.server_url, self.scene)
            viewer.open("&mode=colour")
            found = []
            for at_step, number in enumerate(part):
                x, y, z, radius_m = places[number]
                landed = viewer.land((x, y, z), radius_m)
                there = done.results[3 * at_step]["digest"].rpartition(":")[0]
                if landed["digest"].rpartition(":")[0] != there:
                    self.missed.append(f"landing {number}: another set is drawn")
                for at, pose in enumerate(poses[number]):
                    drawn, seen = (
                        read_godot(folder / f"{number}-{at}.png"),
                        from_viewer(viewer, pose),
                    )
                    difference = apart(drawn, seen)
                    found.append(difference)
                    is_alike = (
                        difference.mean <= MEAN
                        and difference.far <= FAR_SHARE
                        and difference.uncovered <= UNCOVERED
                    )
                    if not is_alike:
                        self.missed.append(f"landing {number}, eye {at}: {difference}")
                    self._keep(f"pictures-{number}-{at}.png", drawn[0], seen[0])
            browser.close()
        print(f"landings {part[0]} to {part[-1]}, {len(found)} pictures of {SIZE[0]} x {SIZE[1]}")
        for one in found:
            print(f"  {one.mean:.5f} {one.far:.5f} {one.uncovered:.5f}")
        for name in ("mean", "far", "uncovered"):
            values = [getattr(one, name) for one in found]
            print(f"  {name}: median {statistics.median(values):.5f}, most {max(values):.5f}")

    def background(self) -> None:
        """Pixels of the background where base and detail both cover."""
        places = self.landings(2 if self.smoke else 100)
        chance = random.Random(SEED)
        poses = [poses_around(place[:3], chance, place[3], 3) for place in places]
        pixels = covered = holes = 0
        part = self.part(len(places))
        for first in range(part[0], part[-1] + 1, BATCH):
            with tempfile.TemporaryDirectory() as name:
                folder = Path(name)
                some = range(first, min(first + BATCH, part[-1] + 1))
                steps: list[list[Any]] = [["land", *places[first][:3], 499.0]]
                for number in some:
                    steps += from_godot(poses[number], folder, f"detail-{number}")
                steps.append(["land", 1e5, 0, 0, 1])
                for number in some:
                    steps += from_godot(poses[number], folder, f"base-{number}")
                for number in some:
                    steps.append(["land", *places[number]])
                    steps += from_godot(poses[number], folder, f"mixed-{number}")
                done = visit(self.godot, self.url, *steps)
                assert done.failure == "", done.failure
                for number in some:
                    for at in range(len(poses[number])):
                        mixed, base, detail = (
                            read_godot(folder / f"{kind}-{number}-{at}.png")[1]
                            for kind in ("mixed", "base", "detail")
                        )
                        pixels += mixed.size
                        covered += int((base & detail).sum())
                        holes += background_in_ground(mixed, base, detail)
        print(
            f"landings {part[0]} to {part[-1]} x 3 eyes: {pixels:,} pixels,"
            f" {covered:,} covered by both"
        )
        print(f"BACKGROUND {holes}")
        if holes:
            self.missed.append(f"{holes} pixels of background in the ground")

    def frames(self) -> None:
        """Milliseconds of our own in each frame of a landing."""
        places = self.landings(3 if self.smoke else 20)
        done = visit(self.godot, self.url, *(["land", *place] for place in places))
        assert done.failure == "", done.failure
        updates = sorted(ms for landed in done.results for ms in landed["updates_ms"])
        stats = done.results[-1]["stats"]
        moved = sum(landed["status"]["payload_bytes"] for landed in done.results)
        print(f"{len(places)} landings, {moved:,} payload bytes, {len(updates)} frames;")
        print(f"  at the end {stats['visible_triangles']:,} triangles drawn")
        print(
            f"  update, ms: median {statistics.median(updates):.2f},"
            f" 99 % {updates[int(0.99 * (len(updates) - 1))]:.2f}, longest {updates[-1]:.2f}"
        )

    def _keep(self, name: str, *pictures: Any) -> None:
        if self.keep is not None:
            self.keep.mkdir(parents=True, exist_ok=True)
            Image.fromarray(np.concatenate(pictures, axis=1)).save(self.keep / name)


if __name__ == "__main__":
    sys.exit(main())
