"""The viewer in Chromium on the real service: holes, comfort, frames, memory, size, land to ready.

::

    python benchmarks/viewer.py                                   # all of it, on a small scene
    python benchmarks/viewer.py --scenes FOLDER --scene sample --only frames,ready
    python benchmarks/viewer.py --smoke                           # once, briefly

WebGL is drawn by the CPU (SwiftShader), so a frame takes what it takes there; what is told of our
own work is told apart. Skips, and says so, where there is no Chromium or no built page.

- *holes*: at each landing, poses at eye height and above, within the scene; a pixel is a hole where
  the mixed model leaves any of its samples to the background while the whole base and the whole
  detail both cover all of them, and neither shows background next to it; where one does, the pixel
  is counted apart, as at an outline. So is one that only one of the two covers. Lines drawn on the
  ground are left out. Then harm is done on purpose, to show that it is found.
- *comfort*: changes of the visible set over random head poses between landings.
- *frames*: main-thread milliseconds of each frame and of `Stage.update` while a landing streams in.
- *memory*: heap and GPU bytes after many landings, at the place where it began.
- *ready*: land to ready and to shown in the page beside the Python SDK, the same places in turn.

Fails (exit status 1) where there is a hole, a change, or memory 5 % over its start.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

try:
    from browser.conftest import BUILT_PAGE, FLAGS, PROGRAMS
    from browser.driven_viewer import DrivenViewer
    from browser.small_scenes import SMALL, small_scenes
    from faults.service import Service
    from parts.heap_types import object_bytes
    from parts.viewer_holes import SIZE, count_holes
    from parts.viewer_places import corners, random_place
    from playwright.sync_api import Browser, sync_playwright
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(0)

import terraport.sync

POSES: Final = Path(__file__).with_name("parts") / "viewer_poses.js"
BATCH: Final = 50
"""Poses of one call into the page."""
DRAWN_EVERY: Final = 10
"""Of the head poses; the digest is asked at each."""
SEED: Final = 6
WARM_UP_ROUNDS: Final = 5
"""Of the memory's landings, before its start is read."""
PAGE: Final = Path(os.environ.get("TERRAPORT_VIEWER_DIR", BUILT_PAGE))
"""The built page that is measured: the one that the service would serve."""


def main() -> int:
    """Measure and print; returns the exit status."""
    parser = argparse.ArgumentParser(description="The viewer, measured in Chromium.")
    parser.add_argument("--smoke", action="store_true", help="once, briefly")
    parser.add_argument("--scenes", type=Path, help="folder of scenes instead of the small one")
    parser.add_argument("--scene", default=SMALL)
    parser.add_argument("--radius-m", type=float, default=60.0)
    parser.add_argument("--landings", type=int, default=20, help="of the holes")
    parser.add_argument("--poses", type=int, default=200, help="at each landing")
    parser.add_argument("--only", default="size,holes,comfort,frames,memory,ready")
    options = parser.parse_args()
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None or not (PAGE / "index.html").is_file():
        print("skipped: no Chromium, or the viewer is not built")
        return 0
    with tempfile.TemporaryDirectory() as folder:
        scenes = options.scenes or small_scenes(Path(folder))
        # Beside the scenes the service writes its log.
        (Path(folder) / "served").mkdir()
        served = Path(folder) / "served" / "scenes"
        served.symlink_to(scenes.resolve())
        with Service(served) as service, sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=program, args=list(FLAGS))
            bench = Bench(browser, service.url, options)
            for name in options.only.split(","):
                began_s = time.monotonic()
                print(f"== {name}", flush=True)
                getattr(bench, name)()
                print(f"({time.monotonic() - began_s:.0f} s)", flush=True)
            browser.close()
    for line in bench.missed:
        print(f"MISSED: {line}")
    return 1 if bench.missed else 0


class Bench:
    """What is measured, by name."""

    def __init__(self, browser: Browser, url: str, options: argparse.Namespace) -> None:
        self.browser = browser
        self.url = url
        self.scene: str = options.scene
        self.radius_m: float = options.radius_m
        self.smoke: bool = options.smoke
        self.landings: int = 2 if options.smoke else options.landings
        self.poses: int = 6 if options.smoke else options.poses
        self.missed: list[str] = []

    @contextmanager
    def viewer(self, width: int, height: int) -> Iterator[DrivenViewer]:
        """Open the scene in a page of its own, with a canvas of that size.

        The window is never small: in one of 96 x 54 Chromium gives a page one frame a second.
        """
        scale = min(1.0, width / 640)
        size = {"width": round(width / scale), "height": round(height / scale)}
        context = self.browser.new_context(viewport=size, device_scale_factor=scale)
        try:
            viewer = DrivenViewer(context.new_page(), self.url, self.scene)
            viewer.page.add_init_script(path=POSES)
            viewer.open()
            viewer.until("glWatch.ground().length > 0")
            yield viewer
        finally:
            context.close()

    def bar(self, is_met: bool, what: str) -> None:
        """Hold a result against its bar; what misses it is reported in the end."""
        if not is_met:
            self.missed.append(what)

    # --- size -----------------------------------------------------------------------------------

    def size(self) -> None:
        """Files of the page: as they are, gzip, brotli; and what a first visit loads of them."""
        print(f"{'file':34} {'raw':>8} {'gzip':>8} {'brotli':>8}")
        totals = [0, 0, 0]
        for file in sorted(PAGE.rglob("*")):
            if file.suffix not in {".js", ".css", ".html", ".svg"}:
                continue
            twins = [file, *(file.with_name(file.name + end) for end in (".gz", ".br"))]
            # Too small to gain by it: served as it is.
            sizes = [(twin if twin.is_file() else file).stat().st_size for twin in twins]
            totals = [a + b for a, b in zip(totals, sizes, strict=True)]
            print(f"{file.name:34} " + " ".join(f"{size:8,}" for size in sizes))
        print(f"{'all':34} " + " ".join(f"{total:8,}" for total in totals))
        context = self.browser.new_context(viewport={"width": 640, "height": 360})
        page = context.new_page()
        loaded: list[tuple[str, int]] = []

        def finished(request: Any) -> None:
            sizes = request.sizes()
            loaded.append((request.url, sizes["responseBodySize"] + sizes["responseHeadersSize"]))

        context.on("requestfinished", finished)
        page.goto(f"{self.url}/#scene={self.scene}")
        viewer = DrivenViewer(page, self.url, self.scene)
        viewer.until("window.terraport?.state.link?.state === 'open'")
        page.wait_for_timeout(1000)
        ours = [size for url, size in loaded if "/scenes" not in url]
        scene = [size for url, size in loaded if "/scenes" in url]
        print(f"first visit: page {len(ours)} files, {sum(ours):,} bytes with headers;")
        print(f"  scene {len(scene)} files, {sum(scene):,} bytes")
        context.close()

    # --- holes ----------------------------------------------------------------------------------

    def holes(self) -> None:
        """Pixels of the background within the ground."""
        with self.viewer(*SIZE) as viewer:
            self.missed += count_holes(
                viewer, landings=self.landings, poses_each=self.poses, radius_m=self.radius_m
            )

    # --- comfort --------------------------------------------------------------------------------

    def comfort(self) -> None:
        """Count changes of the visible set over random head poses."""
        count = 50 if self.smoke else 10_000
        landings = 2 if self.smoke else 5
        with self.viewer(96, 54) as viewer:
            chance = random.Random(SEED)
            changes = stray = drawn = 0
            for _ in range(landings):
                position = random_place(viewer, chance)
                shown = viewer.land(position, self.radius_m)
                low, high = corners(viewer)
                for at in range(0, count // landings, BATCH):
                    some = min(BATCH, count // landings - at)
                    poses = [self._head(chance, low, high, position[1]) for _ in range(some)]
                    result = viewer.run(
                        "([poses, every]) => viewerPoses.changes(poses, every)",
                        [poses, DRAWN_EVERY],
                    )
                    changes += result["changes"]
                    stray = result["stray"]
                    drawn += result["drawn"]
                    assert viewer.digest == shown["digest"]
            print(f"{count} poses, {drawn} of them drawn, at {landings} landings:")
            print(f"{changes} changes of the visible set; counted by the page itself: {stray}")
            self.bar(changes == 0 and stray == 0, f"{changes} changes of the visible set")

    @staticmethod
    def _head(
        chance: random.Random, low: tuple[float, ...], high: tuple[float, ...], ground_m: float
    ) -> dict[str, Any]:
        eye = [
            chance.uniform(low[0], high[0]),
            ground_m + chance.uniform(-3, 60),
            chance.uniform(low[2], high[2]),
        ]
        return {"eye": eye, "yawDeg": chance.uniform(0, 360), "pitchDeg": chance.uniform(-90, 90)}

    # --- frames ---------------------------------------------------------------------------------

    def frames(self) -> None:
        """Frames while landings stream in, at two sizes of the canvas."""
        rounds = 1 if self.smoke else 6
        for width, height in ((64, 36), (640, 360)):
            with self.viewer(width, height) as viewer:
                chance = random.Random(SEED)
                viewer.page.wait_for_timeout(1000)
                frame_ms: list[float] = []
                gap_ms: list[float] = []
                tasks: list[list[float]] = []
                updates: list[float] = []
                medians: list[float] = []
                moved = 0
                for _ in range(rounds):
                    position = random_place(viewer, chance)
                    viewer.run(
                        "() => { glWatch.frameMs.length = glWatch.gapMs.length = 0;"
                        " glWatch.longTasks.length = 0; }"
                    )
                    moved += viewer.land(position, self.radius_m)["payloadBytes"]
                    frame_ms += viewer.run("glWatch.frameMs")
                    gap_ms += viewer.run("glWatch.gapMs")
                    tasks += viewer.run("glWatch.longTasks")
                    updates.append(viewer.run("terraport.stats.updateMaxMs"))
                    medians.append(viewer.run("terraport.stats.updateMedianMs"))
                print(f"canvas {width} x {height}, {rounds} landings, {moved:,} payload bytes")
                print(f"  frame callback, ms: {histogram(frame_ms)}")
                print(f"  between frames, ms: {histogram(gap_ms)}")
                print(
                    f"  Stage.update: longest {max(updates):.1f} ms, median {max(medians):.2f} ms"
                )
                print(f"  tasks over 50 ms: {len(tasks)} {[round(task[1]) for task in tasks]}")

    # --- memory ---------------------------------------------------------------------------------

    def memory(self) -> None:
        """Heap and GPU after many landings, at the place where it began."""
        count = 4 if self.smoke else 200
        with self.viewer(64, 36) as viewer:
            chance = random.Random(SEED)
            cdp = viewer.page.context.new_cdp_session(viewer.page)
            cdp.send("HeapProfiler.enable")
            places = [random_place(viewer, chance) for _ in range(20)]
            home = places[0]
            # All places, for the cache; and again, until the engine has compiled what landings run:
            # of 350 kB more after 100 landings 300 kB were its code, and none of it more after 200.
            for position in (*places[1:] * (0 if self.smoke else WARM_UP_ROUNDS), home):
                viewer.land(position, self.radius_m)
            start = self._memory(viewer, cdp)
            for number in range(count - 1):
                viewer.land(places[1 + number % (len(places) - 1)], self.radius_m)
            viewer.land(home, self.radius_m)
            end = self._memory(viewer, cdp)
            print(f"{'':26} {'start':>14} {'after ' + str(count):>14} {'ratio':>7}")
            for name, value in start.items():
                ratio = end[name] / value if value else float(end[name] == value)
                print(f"{name:26} {value:14,} {end[name]:14,} {ratio:7.3f}")
                if "created" not in name and not self.smoke:
                    self.bar(ratio <= 1.05, f"{name} is {ratio:.3f} of its start")

    @staticmethod
    def _memory(viewer: DrivenViewer, cdp: Any) -> dict[str, int]:
        viewer.page.wait_for_timeout(1500)
        viewer.run(
            "() => { for (const name of ['frameMs', 'gapMs', 'longTasks', 'uploads'])"
            " glWatch[name].length = 0;"
            # The browser's own list, up to 250 entries: it asks for the icon at each landing.
            " performance.clearResourceTimings(); }"
        )
        for _ in range(3):
            cdp.send("HeapProfiler.collectGarbage")
        usage = cdp.send("Runtime.getHeapUsage")
        stats = viewer.run("terraport.stats")
        three = viewer.run("terraport.diagnostics()")["three"]
        gpu = stats["gpu"]
        return {
            "heap used": int(usage["usedSize"]),
            "heap: scripts' objects": object_bytes(cdp),
            "array buffers": int(usage.get("backingStorageSize", 0)),
            "stage: buffers": gpu["bufferBytes"],
            "stage: textures": gpu["textureBytes"],
            "stage: created": gpu["createdBytes"],
            "stage: created - freed": gpu["createdBytes"] - gpu["freedBytes"],
            "WebGL: buffers": viewer.run("glWatch.bufferBytes"),
            "WebGL: textures": viewer.run("glWatch.textureBytes"),
            "stage: picking": stats["pickingBytes"],
            "three: geometries": three["geometries"],
            "three: textures": three["textures"],
        }

    # --- land to ready --------------------------------------------------------------------------

    def ready(self) -> None:
        """Land to ready and to shown, page and SDK in turn."""
        rounds = 1 if self.smoke else 3
        count = 3 if self.smoke else 12
        samples: dict[tuple[str, str], list[float]] = {}
        moved: list[tuple[int, int]] = []

        def note(cache: str, what: str, value: float) -> None:
            samples.setdefault((cache, what), []).append(value)

        for number in range(rounds):
            chance = random.Random(SEED + number)
            url = f"{self.url}/scenes/{self.scene}"
            with self.viewer(64, 36) as viewer, terraport.sync.connect(url) as session:
                places = [random_place(viewer, chance) for _ in range(count)]
                for cache in ("cold", "warm"):
                    for at, position in enumerate(places):
                        order = ("page", "sdk") if (at + number) % 2 else ("sdk", "page")
                        loaded = {}
                        for who in order:
                            if who == "page":
                                status = viewer.land(position, self.radius_m)
                                note(cache, "page ready", status["readyMs"])
                                note(cache, "page on the GPU", status["presentableMs"])
                                loaded[who] = status["payloadBytes"]
                            else:
                                before = session.stats.payload_bytes
                                began_s = time.perf_counter()
                                session.land(position, radius_m=self.radius_m).ready(60)
                                note(cache, "SDK ready", 1e3 * (time.perf_counter() - began_s))
                                loaded[who] = session.stats.payload_bytes - before
                        moved.append((loaded["page"], loaded["sdk"]))
        print(f"{rounds} x {count} places, radius {self.radius_m:g} m; both loaded the same bytes:")
        print(f"  {all(page == sdk for page, sdk in moved)}, {sum(page for page, _ in moved):,}")
        print(f"{'':24} {'median':>9} {'p95':>9} ms")
        for (cache, what), values in samples.items():
            print(
                f"{cache + ', ' + what:24} {statistics.median(values):9.1f} {p(values, 0.95):9.1f}"
            )
        for cache in ("cold", "warm"):
            pairs = zip(samples[cache, "page ready"], samples[cache, "SDK ready"], strict=True)
            ratio = statistics.median(page / sdk for page, sdk in pairs)
            print(f"{cache}: page over SDK, median of the ratios {ratio:.2f}")


def p(values: list[float], quantile: float) -> float:
    """Return a percentile: the value at that part of them, sorted."""
    return sorted(values)[min(len(values) - 1, int(quantile * len(values)))]


def histogram(values: list[float]) -> str:
    """Count values by bands of milliseconds."""
    bands = (4, 8, 16.7, 33, 50, 100, 200)
    counts = [0] * (len(bands) + 1)
    for value in values:
        counts[sum(value > band for band in bands)] += 1
    names = [f"<= {band:g}" for band in bands] + [f"> {bands[-1]:g}"]
    bins = ", ".join(f"{name}: {count}" for name, count in zip(names, counts, strict=True) if count)
    middle, far = statistics.median(values), p(values, 0.99)
    return f"{bins}; median {middle:.1f}, p99 {far:.1f}, max {max(values):.1f}"


if __name__ == "__main__":
    sys.exit(main())
