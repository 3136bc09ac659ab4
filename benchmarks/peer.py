"""terraport's page beside 3DTilesRendererJS with its LoadRegion plugin: same browser, same bytes.

::

    npm install --prefix FOLDER 3d-tiles-renderer@0.5.3 three@0.187.0
    TERRAPORT_TILES_TOOLS=FOLDER python benchmarks/peer.py --scenes SCENES --scene sample_scene

Both go to the same places in turn, with the same radius, over the same line (50 Mbit/s and 40 ms
there and back, shaped by a relay of our own, since Chromium's network conditions do not reach
WebSockets), through the same proxy (Caddy, TLS). The peer reads the service's live tileset: its
segments are the payload that terraport streams, byte for byte. A hop ends with the frame after
which the picture does not change any more. *Cold*: for the first time. *Warm*: the same places
again, in the same page.

What is counted: time from the call to the last change; bytes on the line, with TLS and headers;
HTTP requests of the page and its workers; frames of over 50 ms and frames whose picture changes,
both up to the last change. The camera stands above, the same in both, with all of the scene in
view; pictures are small, since WebGL is drawn by the CPU.

Skips, and says so, without Chromium, Caddy, the built page, or the peer's packages.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

try:
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
    parser.add_argument("--only", default="terraport h1,terraport h2,peer h1,peer h2")
    options = parser.parse_args()
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    packages = None if TOOLS is None else Path(TOOLS) / "node_modules"
    missing = [
        what
        for what, is_there in {
            "Chromium": program is not None,
            "Caddy": shutil.which("caddy") is not None,
            "the built page": (BUILT_PAGE / "index.html").is_file(),
            "TERRAPORT_TILES_TOOLS, a folder with `npm i 3d-tiles-renderer three`": packages
            is not None
            and (packages / "3d-tiles-renderer").is_dir(),
        }.items()
        if not is_there
    ]
    if missing or packages is None:
        print(f"skipped: without {', '.join(missing)}")
        return 0
    if options.smoke:
        options.hops, options.only = 2, "terraport h2,peer h2"
    with tempfile.TemporaryDirectory() as folder:
        served = Path(folder) / "served" / "scenes"
        served.mkdir(parents=True)
        (served / options.scene).symlink_to((options.scenes / options.scene).resolve())
        with Service(served) as service, sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=program, args=list(FLAGS))
            bench = Bench(browser, service, packages, Path(folder), options)
            for name in options.only.split(","):
                who, protocol = name.split()
                bench.run(who, protocol)
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
        self.packages = packages
        self.folder = folder
        self.options = options
        self.places: list[Place] = []
        self.radius_m = 0.0
        self.box: tuple[Place, Place] = ((0, 0, 0), (0, 0, 0))
        self.missed: list[str] = []
        self._choose_places()

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
            land = self._terraport(page, url) if who == "terraport" else self._peer(page, url)
            opened = f"{line.down_bytes - began_bytes:,} bytes, {len(requests)} requests"
            rest_ms = page.evaluate("watchRest(20)")
            print(
                f"\n{who}, {protocol}: opened with {opened}, {time.monotonic() - began_s:.1f} s;"
                f" a frame at rest {rest_ms:.0f} ms"
            )
            for heat in ("cold", "warm"):
                hops = []
                for place in self.places:
                    before, asked = line.down_bytes, len(requests)
                    hop = land(place)
                    hops.append(
                        hop | {"bytes": line.down_bytes - before, "requests": len(requests) - asked}
                    )
                self._print(who, protocol, heat, hops)
            context.close()

    def _print(self, who: str, protocol: str, heat: str, hops: list[dict[str, float]]) -> None:
        def low_to_high(key: str) -> str:
            values = sorted(hop[key] for hop in hops)
            middle = statistics.median(values)
            return f"{middle:,.0f} ({values[0]:,.0f} to {values[-1]:,.0f})"

        print(
            f"{who:9} {protocol} {heat}: all detail ms {low_to_high('allMs')};"
            f" frames until then {low_to_high('frames')}; over 50 ms {low_to_high('slow')};"
            f" picture changes {low_to_high('changes')};"
            f" bytes {sum(hop['bytes'] for hop in hops):,.0f};"
            f" requests {sum(hop['requests'] for hop in hops):,.0f}",
            flush=True,
        )
        most = max(hop["changes"] for hop in hops)
        if who == "terraport" and most > WARM_MOST_CHANGES:
            self.missed.append(f"{protocol}, {heat}: {most:.0f} frames change the picture")

    def _terraport(self, page: Page, url: str) -> Callable[[Place], dict[str, float]]:
        page.add_init_script(path=PARTS / "watch.js")
        viewer = DrivenViewer(page, url, self.options.scene)
        viewer.open()
        page.wait_for_timeout(2000)

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

    def _peer(self, page: Page, url: str) -> Callable[[Place], dict[str, float]]:
        page.add_init_script(path=PARTS / "watch.js")
        tileset = f"/scenes/{self.options.scene}/tileset.json"
        page.goto(f"{url}/peer/index.html#tileset={tileset}")
        low, high = self.box
        middle = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
        away_m = 1.3 * max(high[0] - low[0], high[2] - low[2])
        eye = [middle[0], high[1] + away_m, middle[2] + away_m / 3]
        page.wait_for_function("window.peer?.isPlaced")
        page.evaluate("([eye, middle]) => peer.look(eye, middle)", [eye, middle])
        page.wait_for_function("peer.isSettled && peer.digest !== ''")
        page.wait_for_timeout(2000)

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
  handle_path /tools/* {{
    root * {self.packages}
    file_server
  }}
  handle_path /peer/* {{
    root * {PARTS}
    file_server
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


if __name__ == "__main__":
    sys.exit(main())
