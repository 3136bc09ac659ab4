"""What a frame of the viewer asks of WebGL: draw calls, all calls, CPU; and the room of its pages.

::

    python benchmarks/draw_calls.py [--scenes FOLDER --scene NAME] [--landings 20]
    python benchmarks/draw_calls.py --page BUILT --page OTHER    # two builds of the page, in turns
    python benchmarks/draw_calls.py --smoke

The built viewer in Chromium, by CPU (SwiftShader), on the real service. At a landing at everything
it draws frames from above and at eye height; the builds take turns, so that their ratio holds on a
busy machine. Then it walks over landings, and tells the most draw calls of any, and the most bytes
on the GPU for the bytes that lived in them. Skips, and says so, where there is no Chromium.

Fails (exit status 1) where the builds draw different pictures.
"""

from __future__ import annotations

import argparse
import base64
import math
import random
import shutil
import statistics
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

try:
    import numpy as np
    from browser.conftest import BUILT_PAGE, FLAGS, HINTS_SEEN, PROGRAMS
    from browser.driven_viewer import DrivenViewer
    from browser.small_scenes import SMALL, small_scenes
    from faults.service import Service
    from parts.gpu_process import cpu_ms, gpu_process
    from parts.viewer_places import corners, random_place
    from playwright.sync_api import sync_playwright
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(0)

MARK: Final = "terraport-draw-calls"
CALLS: Final = Path(__file__).with_name("parts") / "gl_calls.js"
FRAMES: Final = 4
"""Of one turn."""
RADIUS_M: Final = 60.0
"""Of the walk's landings."""
SEED: Final = 6
DRAW: Final = """async ([pose, frames]) => {
  await terraport.look(pose);
  window.glCalls = 0;
  for (let n = 0; n < frames; n += 1) await terraport.look(pose);
  const calls = window.glCalls / frames;
  const gl = glWatch.context;
  const [width, height] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
  const rgba = new Uint8Array(width * height * 4);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
  let text = "";
  for (let at = 0; at < rgba.length; at += 8192) {
    text += String.fromCharCode(...rgba.subarray(at, at + 8192));
  }
  return {calls, picture: btoa(text), draws: glWatch.draws, ranges: glWatch.ground().length};
}"""
MOST_APART: Final = 1e-4
"""Share of the pixels that may be far apart: of two segments at one depth the later is seen."""
FAR: Final = 3
"""Of 255, from which two pixels are far apart; levels of images are rounded, too."""


def main() -> int:
    """Draw, and tell; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--page", type=Path, action="append", help="folder of a built page")
    parser.add_argument("--scenes", type=Path, help="folder of scenes instead of the small one")
    parser.add_argument("--scene", default=SMALL)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--landings", type=int, default=20, help="of the walk")
    parser.add_argument("--smoke", action="store_true", help="once, briefly")
    options = parser.parse_args()
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    pages = options.page or [BUILT_PAGE]
    if program is None or not all((page / "index.html").is_file() for page in pages):
        print("skipped: no Chromium, or the viewer is not built")
        return 0
    rounds, landings = (1, 2) if options.smoke else (options.rounds, options.landings)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        # Beside the scenes the service writes its log.
        served = folder / "served" / "scenes"
        served.parent.mkdir()
        served.symlink_to((options.scenes or small_scenes(folder)).resolve())
        driver = stack.enter_context(sync_playwright())
        flags = [*FLAGS, f"--user-agent={MARK}"]
        browser = driver.chromium.launch(executable_path=program, args=flags)
        viewers = {}
        for page in pages:
            service = stack.enter_context(Service(served, viewer_dir=page))
            context = browser.new_context(viewport={"width": 640, "height": 360})
            context.add_init_script(HINTS_SEEN)
            viewer = DrivenViewer(context.new_page(), service.url, options.scene)
            viewer.page.add_init_script(path=CALLS)
            viewer.open()
            viewer.run("() => { glWatch.groundOnly = true; }")
            viewers[page.name if len(pages) > 1 else "the page"] = viewer
        differ = _frames(viewers, rounds)
        for name, viewer in viewers.items():
            _walk(name, viewer, max(1, landings))
        browser.close()
    if differ:
        print("MISSED: the builds drew different pictures")
    return int(differ)


def _frames(viewers: dict[str, DrivenViewer], rounds: int) -> bool:
    process = gpu_process(MARK)
    poses = {}
    for viewer in viewers.values():
        low, high = corners(viewer)
        middle = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
        radius_m = min(math.dist(low, high), 500.0)  # as far as a service allows
        viewer.land((middle[0], middle[1], middle[2]), radius_m)
        print(f"{len(viewer.visible)} segments, {viewer.digest}")
        above = {"eye": [middle[0], high[1] + 80, middle[2]], "yawDeg": 0, "pitchDeg": -90}
        eye = {"eye": [low[0] + 5, middle[1] + 5, middle[2]], "yawDeg": 90, "pitchDeg": -8}
        poses = {"above": above, "eye height": eye}
        _rest(viewer)
    told: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for _ in range(rounds):
        for pose, look in poses.items():
            for name, viewer in viewers.items():
                before = cpu_ms(process)
                one = viewer.run(DRAW, [look, FRAMES])
                one["cpu_ms"] = (cpu_ms(process) - before) / (FRAMES + 1)
                told.setdefault((pose, name), []).append(one)
    print(f"{'':28} {'ranges':>7} {'draws':>6} {'GL calls':>9} {'CPU ms a frame':>15} {'ratio':>6}")
    for pose in poses:
        first = statistics.median(one["cpu_ms"] for one in told[pose, next(iter(viewers))])
        for name in viewers:
            some = told[pose, name]
            one, ms = some[-1], statistics.median(turn["cpu_ms"] for turn in some)
            share = f"{ms / first:.2f}" if first else ""
            print(
                f"{pose + ', ' + name:28} {one['ranges']:7} {one['draws']:6} {one['calls']:9.0f}"
                f" {ms:15.0f} {share:>6}"
            )
    return any(
        _apart(pose, [told[pose, name][-1]["picture"] for name in viewers]) for pose in poses
    )


def _apart(pose: str, pictures: list[str]) -> bool:
    """Tell how many pixels differ from the first build's; True where it is too many."""
    first, *others = (
        np.frombuffer(base64.b64decode(picture), np.uint8).reshape(-1, 4).astype(int)
        for picture in pictures
    )
    is_wrong = False
    for other in others:
        by = np.abs(other - first).max(axis=1)
        far = int((by >= FAR).sum())
        is_wrong |= far > MOST_APART * len(first)
        print(
            f"{pose}: of {len(first):,} pixels {int((by > 0).sum())} differ from the first build's,"
            f" {far} by {FAR} of 255 or more"
        )
    return is_wrong


def _walk(name: str, viewer: DrivenViewer, landings: int) -> None:
    """Hops over the scene: draw calls of each landing, and what is allocated for what lives."""
    chance = random.Random(SEED)
    draws: list[int] = []
    ranges: list[int] = []
    least = viewer.run("terraport.stats.gpu")
    most_bytes = created = 0
    for _ in range(landings):
        x, y, z = random_place(viewer, chance)
        viewer.land((x, y, z), RADIUS_M)
        _rest(viewer)
        viewer.look((x, y + min(500.0, math.dist(*corners(viewer))), z), 0, -90)
        draws.append(viewer.run("glWatch.draws"))
        ranges.append(viewer.run("glWatch.ground().length"))
        gpu = viewer.run("terraport.stats.gpu")
        most_bytes = max(most_bytes, gpu["bufferBytes"] + gpu["textureBytes"])
        created = gpu["createdBytes"] - least["createdBytes"]
    print(
        f"{name}: {landings} landings of {RADIUS_M:g} m: {min(ranges)} to {max(ranges)} ranges,"
        f" {min(draws)} to {max(draws)} draw calls (median {statistics.median(draws):g}),"
        f" at most {most_bytes:,} bytes, {created:,} created"
    )


def _rest(viewer: DrivenViewer) -> None:
    """Wait until nothing is left to upload or to move: the page then draws no frame by itself."""
    frames = -1
    while frames != (now := viewer.run("glWatch.frames")):
        frames = now
        viewer.page.wait_for_timeout(300)


if __name__ == "__main__":
    sys.exit(main())
