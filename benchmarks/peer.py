"""Compare terraport's page with 3DTilesRendererJS and its LoadRegion plugin, on the same data.

::

    npm install --prefix FOLDER 3d-tiles-renderer@0.5.3 three@0.187.0 esbuild
    TERRAPORT_TILES_TOOLS=FOLDER python benchmarks/peer.py --scenes SCENES --scene sample_scene

Both visit the same places in the same order, with the same radius, over the same connection
(50 Mbit/s, 40 ms round trip; a relay shapes it, since Chromium's network conditions do not apply to
WebSockets), through the same proxy (Caddy, TLS). Both pages are bundled, minified and compressed
with brotli beforehand, and decode meshes in workers; the proxy compresses JSON. The peer's page has
lights, as its examples have. A hop ends with the last frame that changes the picture. *Cold*: the
first visit to a place. *Warm*: a second visit in the same page.

The peer reads the service's live tileset, whose segments have the vertices that terraport streams,
byte for byte. ``peer`` reads it unchanged: a cell of up to 12 segments replaces its part of the
base at once (``REPLACE``). For ``peer+add`` segments are added to a cell one by one (``ADD``):
fewer bytes, but the base stays drawn and pokes through the detail.

Measured: time from the call to the last change; bytes on the wire, with TLS and headers; HTTP
requests of the page and its workers; frames longer than 50 ms and frames that change the picture,
both up to the last change. Both cameras look from above and see the whole scene; pictures are
small, since the CPU draws WebGL. Every variant runs several times, each time in a new browser
context. A figure is the median of all hops, followed by the smallest and the largest median of a
run.

Exits with a message if Chromium, Caddy, the built page or the peer's packages are missing.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

try:
    import httpx
    from browser.conftest import BUILT_PAGE, FLAGS, PROGRAMS
    from browser.driven_viewer import DrivenViewer
    from faults.service import Service
    from parts.shaped_line import ShapedLine, shaped_line
    from parts.viewer_places import corners, random_place
    from playwright.sync_api import Browser, BrowserContext, Page, Request, sync_playwright
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(0)

PARTS: Final = Path(__file__).with_name("parts") / "peer_page"
SAMPLE: Final = Path(__file__).resolve().parents[1] / "data" / "sample_scene"
TOOLS: Final = os.environ.get("TERRAPORT_TILES_TOOLS")
SIZE: Final = (160, 90)
"""Pixels of the picture: frames are SwiftShader's otherwise, and nobody's."""
QUIET_MS: Final = 700
"""So long after its last change a picture is taken for final."""
SEED: Final = 24
WARM_MOST_CHANGES: Final = 2
TIMEOUT_MS: Final = 180_000

Place = tuple[float, float, float]


def main() -> int:
    """Measure and print; returns the exit status."""
    parser = argparse.ArgumentParser(description="terraport beside 3DTilesRendererJS.")
    parser.add_argument("--smoke", action="store_true", help="two hops, terraport and one peer")
    parser.add_argument("--scenes", type=Path, default=SAMPLE.parent)
    parser.add_argument("--scene", default=SAMPLE.name)
    parser.add_argument("--radius-m", type=float, help="default: the page's own for the scene")
    parser.add_argument("--hops", type=int, default=10)
    parser.add_argument("--mbit", type=float, default=50.0)
    parser.add_argument("--round-trip-ms", type=float, default=40.0)
    parser.add_argument("--runs", type=int, default=3, help="of each way, in turn")
    parser.add_argument("--only", default="terraport h2,peer h2,peer+add h2")
    options = parser.parse_args()
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    packages = None if TOOLS is None else Path(TOOLS) / "node_modules"
    missing = [
        what
        for what, is_there in {
            "Chromium": program is not None,
            "Caddy": shutil.which("caddy") is not None,
            "the built page": (BUILT_PAGE / "index.html").is_file(),
            "TERRAPORT_TILES_TOOLS, a folder with `npm i 3d-tiles-renderer three esbuild`": packages
            is not None
            and (packages / "3d-tiles-renderer").is_dir()
            and (packages / "esbuild").is_dir(),
        }.items()
        if not is_there
    ]
    if missing or packages is None:
        print(f"skipped: without {', '.join(missing)}")
        return 0
    if options.smoke:
        options.hops, options.runs, options.only = 2, 1, "terraport h2,peer h2"
    with tempfile.TemporaryDirectory() as folder:
        served = Path(folder) / "served" / "scenes"
        served.mkdir(parents=True)
        (served / options.scene).symlink_to((options.scenes / options.scene).resolve())
        with Service(served) as service, sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=program, args=list(FLAGS))
            print(f"Chromium {browser.version}, load {os.getloadavg()[0]:.1f} before")
            bench = Bench(browser, service, packages, Path(folder), options)
            for _ in range(options.runs):
                for name in options.only.split(","):
                    who, protocol = name.split()
                    bench.run(who, protocol)
            bench.print_all()
            print(f"load {os.getloadavg()[0]:.1f} after")
            browser.close()
    for line in bench.missed:
        print(f"MISSED: {line}")
    return 1 if bench.missed else 0


class Bench:
    """One browser, one service, and the ways to look at it."""

    def __init__(
        self,
        browser: Browser,
        service: Service,
        packages: Path,
        folder: Path,
        options: argparse.Namespace,
    ) -> None:
        self.browser = browser
        self.service = service
        self.folder = folder
        self.page_folder = _bundled(packages, folder / "peer")
        self.options = options
        self.places: list[Place] = []
        self.radius_m = 0.0
        self.box: tuple[Place, Place] = ((0, 0, 0), (0, 0, 0))
        self.missed: list[str] = []
        self.opened: dict[str, list[dict[str, float]]] = defaultdict(list)
        """Measurements of opening the page, by variant and run."""
        self.hops: dict[str, list[list[dict[str, float]]]] = defaultdict(list)
        """Measurements of hops, by variant, cold or warm, and run."""
        self._choose_places()
        self._write_added_tileset()

    def _choose_places(self) -> None:
        """Choose places on the ground, by the page, over no line: the same for everybody."""
        context = self._context()
        viewer = DrivenViewer(context.new_page(), self.service.url, self.options.scene)
        viewer.open()
        chance = random.Random(SEED)
        self.box = corners(viewer)
        self.places = [random_place(viewer, chance) for _ in range(self.options.hops)]
        self.radius_m = self.options.radius_m or float(viewer.run("terraport.state.radiusM"))
        print(f"{len(self.places)} places of {self.radius_m:g} m in {self.options.scene}")
        context.close()

    def _write_added_tileset(self) -> None:
        """Write a copy of the live tileset that refines by ``ADD``, for the peer's page."""
        address = f"/scenes/{self.options.scene}/"
        tileset = httpx.get(f"{self.service.url}{address}tileset.json", timeout=60).json()

        def changed(tile: dict[str, Any]) -> None:
            tile["refine"] = "ADD"
            if "content" in tile:
                tile["content"]["uri"] = address + tile["content"]["uri"]
            for child in tile.get("children", ()):
                changed(child)

        changed(tileset["root"])
        (self.page_folder / "added.json").write_text(json.dumps(tileset))

    def _context(self) -> BrowserContext:
        width, height = SIZE
        # A window that is not small, with few pixels: in a small one Chromium gives few frames.
        context = self.browser.new_context(
            viewport={"width": width * 4, "height": height * 4},
            device_scale_factor=0.25,
            ignore_https_errors=True,
        )
        context.set_default_timeout(TIMEOUT_MS)
        return context

    def run(self, who: str, protocol: str) -> None:
        """Print the rows of one way to look at the scene."""
        with self._proxy(protocol) as port, self._line(port) as line:
            context = self._context()
            requests: list[str] = []

            def asked_for(request: Request) -> None:
                # The browser's own doing: it asks for the icon with each entry of the history.
                if "/assets/icon" not in request.url and "favicon" not in request.url:
                    requests.append(request.url)

            context.on("request", asked_for)
            page = context.new_page()
            # A page that cannot begin would be waited for; here it says why.
            page.on("pageerror", lambda error: print(f"the page: {error}", flush=True))
            page.on("requestfailed", lambda request: print(f"failed: {request.url}", flush=True))
            url = f"https://localhost:{line.port}"
            began_bytes, began_s = line.down_bytes, time.monotonic()
            is_ours = who == "terraport"
            land = self._terraport(page, url) if is_ours else self._peer(page, url, who)
            opened_ms = 1e3 * (time.monotonic() - began_s)
            page.wait_for_timeout(2000)
            self.opened[f"{who} {protocol}"].append(
                {
                    "ms": opened_ms,
                    "bytes": line.down_bytes - began_bytes,
                    "requests": len(requests),
                    "restMs": page.evaluate("watchRest(20)"),
                }
            )
            for heat in ("cold", "warm"):
                hops = []
                for place in self.places:
                    before, asked = line.down_bytes, len(requests)
                    hop = land(place)
                    hops.append(
                        hop | {"bytes": line.down_bytes - before, "requests": len(requests) - asked}
                    )
                self.hops[f"{who} {protocol} {heat}"].append(hops)
                times = [hop["allMs"] for hop in hops]
                print(f"{who} {protocol} {heat}: {statistics.median(times):,.0f} ms", flush=True)
                most = max(hop["changes"] for hop in hops)
                if is_ours and most > WARM_MOST_CHANGES:
                    self.missed.append(f"{protocol}, {heat}: {most:.0f} frames change the picture")
            context.close()

    def print_all(self) -> None:
        """Print medians over all runs as Markdown tables."""
        print(
            "\n| opening | ms | bytes | requests | a frame at rest, ms |"
            "\n| -- | -- | -- | -- | -- |"
        )
        for way, runs in self.opened.items():
            cells = [_medians([[run[key]] for run in runs]) for key in runs[0]]
            print(f"| {way} | {' | '.join(cells)} |")
        print(
            "\n| hops | all detail, ms | frames until then | over 50 ms | picture changes |"
            " bytes of a run | requests of a run |\n| -- | -- | -- | -- | -- | -- | -- |"
        )
        for way, runs in self.hops.items():
            cells = [
                _medians([[hop[key] for hop in hops] for hops in runs])
                for key in ("allMs", "frames", "slow", "changes")
            ]
            cells += [
                _medians([[sum(hop[key] for hop in hops)] for hops in runs])
                for key in ("bytes", "requests")
            ]
            print(f"| {way} | {' | '.join(cells)} |")

    def _terraport(self, page: Page, url: str) -> Callable[[Place], dict[str, float]]:
        page.add_init_script(path=PARTS / "watch.js")
        viewer = DrivenViewer(page, url, self.options.scene)
        viewer.open()

        def land(place: Place) -> dict[str, float]:
            hop: dict[str, float] = page.evaluate(
                "([place, radiusM, quietMs]) => watchHop("
                " () => { terraport.land(place, radiusM).catch(() => undefined); },"
                " () => terraport.visibleDigest, () => terraport.status.phase === 'shown',"
                " quietMs)",
                [list(place), self.radius_m, QUIET_MS],
            )
            return hop

        return land

    def _peer(self, page: Page, url: str, who: str) -> Callable[[Place], dict[str, float]]:
        page.add_init_script(path=PARTS / "watch.js")
        live = f"/scenes/{self.options.scene}/tileset.json"
        tileset = "/peer/added.json" if who == "peer+add" else live
        page.goto(f"{url}/peer/index.html#tileset={tileset}")
        low, high = self.box
        middle = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
        away_m = 1.3 * max(high[0] - low[0], high[2] - low[2])
        eye = [middle[0], high[1] + away_m, middle[2] + away_m / 3]
        page.wait_for_function("window.peer?.isPlaced")
        page.evaluate("([eye, middle]) => peer.look(eye, middle)", [eye, middle])
        page.wait_for_function("peer.isSettled && peer.digest !== ''")

        def land(place: Place) -> dict[str, float]:
            hop: dict[str, float] = page.evaluate(
                "([place, radiusM, quietMs]) => watchHop(() => peer.land(place, radiusM),"
                " () => peer.digest, () => peer.isSettled, quietMs)",
                [list(place), self.radius_m, QUIET_MS],
            )
            failures = page.evaluate("peer.failures")
            if failures:
                raise RuntimeError(f"the peer could not load {failures[0]}, expected the tileset")
            return hop

        return land

    def _line(self, port: int) -> contextlib.AbstractContextManager[ShapedLine]:
        return shaped_line(("127.0.0.1", port), self.options.mbit, self.options.round_trip_ms)

    @contextlib.contextmanager
    def _proxy(self, protocol: str) -> Iterator[int]:
        """Caddy before the service and the peer's page, speaking ``h1`` or ``h2``; its port."""
        with socket.create_server(("127.0.0.1", 0)) as probe:
            port = probe.getsockname()[1]
        protocols = "h1" if protocol == "h1" else "h1 h2"
        config = self.folder / f"{protocol}.caddyfile"
        config.write_text(
            f"""{{
  admin off
  auto_https disable_redirects
  skip_install_trust
  storage file_system {self.folder / "caddy"}
  servers {{
    protocols {protocols}
  }}
}}
https://localhost:{port} {{
  bind 127.0.0.1
  tls internal
  encode gzip
  handle_path /peer/* {{
    root * {self.page_folder}
    file_server {{
      precompressed br
    }}
  }}
  handle {{
    reverse_proxy 127.0.0.1:{self.service.port}
  }}
}}
"""
        )
        command = ["caddy", "run", "--config", str(config), "--adapter", "caddyfile"]
        with (self.folder / f"{protocol}.log").open("wb") as log:
            process = subprocess.Popen(command, stdout=log, stderr=log)
            try:
                self._until_up(port, process)
                yield port
            finally:
                process.terminate()
                process.wait(10)

    @staticmethod
    def _until_up(port: int, process: subprocess.Popen[bytes]) -> None:
        end_s = time.monotonic() + 30
        while time.monotonic() < end_s and process.poll() is None:
            try:
                socket.create_connection(("127.0.0.1", port), 1).close()
            except OSError:
                time.sleep(0.1)
            else:
                return
        raise RuntimeError(f"caddy did not come up on port {port} within 30 s")


def _bundled(packages: Path, folder: Path) -> Path:
    """Write the peer's page into a folder, bundled, minified and compressed; return the folder."""
    folder.mkdir()
    source = folder / "source"
    shutil.copytree(PARTS, source)
    (source / "node_modules").symlink_to(packages)
    options = ["--bundle", "--minify", "--format=esm", f"--outfile={folder / 'peer.js'}"]
    command = [str(packages / ".bin" / "esbuild"), str(source / "peer.js"), *options]
    subprocess.run([*command, "--log-level=warning"], check=True)
    shutil.copy(PARTS / "index.html", folder)
    compress = (
        "const { readFileSync, writeFileSync } = require('fs');"
        "for (const path of process.argv.slice(1)) writeFileSync(path + '.br',"
        " require('zlib').brotliCompressSync(readFileSync(path)));"
    )
    paths = [str(folder / name) for name in ("peer.js", "index.html")]
    subprocess.run(["node", "-e", compress, *paths], check=True)
    return folder


def _medians(runs: list[list[float]]) -> str:
    """Format the median of all values, with the smallest and the largest median of a run."""
    middles = sorted(statistics.median(values) for values in runs)
    middle = statistics.median(value for values in runs for value in values)
    return f"{middle:,.0f} ({middles[0]:,.0f} to {middles[-1]:,.0f})"


if __name__ == "__main__":
    sys.exit(main())
