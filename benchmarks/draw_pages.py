"""What pages of segments cost: ranges of common buffers beside one draw call each.

::

    python benchmarks/draw_pages.py [--rounds 6] [--cells 24]
    python benchmarks/draw_pages.py --smoke

200 made segments in Chromium, by CPU (SwiftShader), with the viewer's own ground shader: in pages
by ``WEBGL_multi_draw`` as the viewer draws them, and one by one, with and without textures, each
with what is near first and as it came. Told are draw calls, GL calls, CPU milliseconds of the GPU's
process a frame, and whether all ways drew the same picture. The ways take turns, so that their
ratios hold on a busy machine. Skips, and says so, where there is no Chromium.

Then what three.js, as the viewer has it, makes of a page: a mesh with ranges of its own, with
``WEBGL_multi_draw`` and without it, each beside one mesh per range.

Fails (exit status 1) where the pictures differ.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import statistics
import sys
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

try:
    from browser.conftest import FLAGS, PROGRAMS
    from parts.gpu_process import cpu_ms, gpu_process
    from playwright.sync_api import sync_playwright
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(0)

ROOT: Final = Path(__file__).resolve().parents[1]
THREE: Final = ROOT / "client_sdk" / "web" / "src" / "three"
PAGE: Final = Path(__file__).with_name("parts") / "draw_pages.js"
FRAMES: Final = 2
"""Of one turn."""
THREE_PARTS: Final = PAGE.with_name("draw_pages_three.js")
THREE_BUILD: Final = ROOT / "client_sdk" / "web" / "node_modules" / "three" / "build"
RANGES_SIDE: Final = 7
"""Ranges of the page of three.js: 7 x 7, of at most 64."""
MARK: Final = "terraport-draw-pages"
"""By which this browser's process for the GPU is known."""


def shader(name: str) -> str:
    """Read one of the viewer's shaders; its numbers are put in as TypeScript does."""
    text = (THREE / "ground-shader.ts").read_text()
    palette = (THREE / "palette.ts").read_text()
    modes = re.findall(r'"?([\w-]+)"?: (\d)', _found(r"MODE_NUMBER = \{(.*?)\}", text))
    stops = int(_found(r"RAMP_STOPS = (\d+)", palette))
    ranges = int(_found(r"MAX_RANGES = (\d+)", text))
    vectors = int(_found(r"TRAIT_VECTORS = (\d+)", text))
    values = {
        "TINT_RELIEF": _found(r"TINT_RELIEF = ([\d.]+)", text),
        "(RAMP_STOPS - 1).toFixed(1)": f"{stops - 1:.1f}",
        "RAMP_STOPS - 2": str(stops - 2),
        "MAX_RANGES * TRAIT_VECTORS": str(ranges * vectors),
        "TRAIT_VECTORS": str(vectors),
        # As in a scene without lights.
        "IS_SHADED": "",
        "LIGHT": "#define LIGHT(strength) mix(1.0, light, strength)",
        **{f"MODE_NUMBER.{mode}": number for mode, number in modes},
        **{f'MODE_NUMBER["{mode}"]': number for mode, number in modes},
    }
    body = _found(name + r" = /\* glsl \*/ `\n(.*?)`;", text)
    body = re.sub(r"\$\{(.*?)\}", lambda match: values[match[1]], body)
    # Pieces of three.js, none of which such a scene makes use of.
    return re.sub(r"#include <.*>", "", body).replace("NUM_CLIPPING_PLANES", "0")


def _found(pattern: str, text: str) -> str:
    match = re.search(pattern, text, re.DOTALL)
    if match is None:
        raise SystemExit(f"{pattern!r} is not in {THREE}: this benchmark is behind the viewer")
    return match[1]


def main() -> None:
    """Draw, and tell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--cells", type=int, default=24, help="faces of a segment: 2 n^2")
    parser.add_argument("--smoke", action="store_true", help="eight small segments, once")
    options = parser.parse_args()
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        print("skipped: there is no Chromium")
        return
    wanted = {
        "v": shader("VERTEX_SHADER"),
        "f": shader("FRAGMENT_SHADER"),
        **({"columns": 4, "rows": 2} if options.smoke else {"columns": 20, "rows": 10}),
        "cells": 6 if options.smoke else options.cells,
        "texSide": 32 if options.smoke else 256,
        "width": 160 if options.smoke else 640,
        "height": 90 if options.smoke else 360,
        "frames": FRAMES,
        "eyeM": 1.7,
    }
    with sync_playwright() as driver:
        flags = [*FLAGS, f"--user-agent={MARK}"]
        browser = driver.chromium.launch(executable_path=program, args=flags)
        page = browser.new_page()
        page.set_default_timeout(600_000)
        made = page.evaluate(PAGE.read_text(), wanted)
        if "error" in made or made["glError"]:
            print(f"skipped: {made}")
            return
        print(json.dumps(made))
        differ = _measure(page, made["ways"], 1 if options.smoke else options.rounds)
        differ |= _three(browser.new_page())
        browser.close()
    if differ:
        raise SystemExit("the ways drew different pictures, or three.js more draws than told")


def _measure(page: Any, ways: list[str], rounds: int) -> bool:
    process = gpu_process(MARK)
    looks = [(pose, textured) for pose in ("eye", "above") for textured in (0, 1)]
    seen: dict[tuple[str, int, str], list[dict[str, Any]]] = {}
    for _ in range(rounds):
        for pose, textured in looks:
            for way in ways:
                before = cpu_ms(process)
                told = page.evaluate("(given) => runBlock(...given)", [way, pose, textured])
                told["cpu_ms"] = (cpu_ms(process) - before) / FRAMES
                seen.setdefault((pose, textured, way), []).append(told)
    print(f"{'':34} {'draws':>6} {'GL calls':>9} {'CPU ms, median':>15} {'of one each':>12}")
    for pose, textured in looks:
        first = statistics.median(t["cpu_ms"] for t in seen[pose, textured, ways[0]])
        for way in ways:
            some = seen[pose, textured, way]
            median_ms = statistics.median(told["cpu_ms"] for told in some)
            name = f"{pose}{', textured' if textured else ''}: {way}"
            share = f"{median_ms / first:.2f}" if first else ""
            told = some[0]
            print(f"{name:44} {told['draws']:6g} {told['calls']:9g} {median_ms:15.0f} {share:>12}")
    return any(
        len({told["picture"] for way in ways for told in seen[pose, textured, way]}) > 1
        for pose, textured in looks
    )


def _three(page: Any) -> bool:
    """Tell the draw calls of three.js; True where pictures differ, or a page is not one draw."""
    if not THREE_BUILD.is_dir():
        print("three.js: skipped, the viewer's packages are not installed")
        return False

    def serve(route: Any) -> None:
        file = THREE_BUILD / route.request.url.rsplit("/", 1)[1]
        if file.is_file():
            route.fulfill(path=file, content_type="text/javascript")
        else:
            route.fulfill(body="", content_type="text/html")

    # Never reaches a network: every request is answered here.
    page.route("**/*", serve)
    page.goto("http://127.0.0.1/page")
    is_wrong = False
    for told in page.evaluate(THREE_PARTS.read_text(), {"side": RANGES_SIDE}):
        each, paged = told["one draw each"], told["a page"]
        drawn = RANGES_SIDE**2
        differs = each["picture"] != paged["picture"] or each["drawn"] == 0
        is_wrong |= differs
        is_wrong |= each["draws"] != drawn or each["error"] != 0 or paged["error"] != 0
        is_wrong |= paged["draws"] != (1 if told["hasMultiDraw"] else drawn)
        name = "with" if told["hasMultiDraw"] else "without"
        print(
            f"three.js, {drawn} ranges, {name} WEBGL_multi_draw: {each['draws']} draws one by one,"
            f" {paged['draws']} as a page, {'other' if differs else 'same'} picture"
        )
    return is_wrong


if __name__ == "__main__":
    main()
