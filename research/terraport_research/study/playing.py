"""Plays a walk in a browser, in one condition after the other, on a service of its own."""

from __future__ import annotations

import importlib
import json
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from terraport_pipeline.errors import PipelineError, SurveyError
from terraport_pipeline.progress import Progress
from terraport_research.study.session_log import CONDITIONS

__all__ = ["play_walk"]

_BROWSERS: Final = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome")
_FLAGS: Final = (
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--no-first-run",
    "--disable-background-networking",
)
_VIEWPORT: Final = {"width": 640, "height": 360}
_SERVE: Final = "import sys; from terraport.cli import main; sys.exit(main())"
_START_S: Final = 60.0
_MOST_MS: Final = 3_600_000.0
"""Of one condition."""


def play_walk(
    scene: Path,
    walk: dict[str, Any],
    folder: Path,
    *,
    radius_m: float,
    frames_per_s: int,
    progress: Progress,
) -> list[Path]:
    """Play a walk in every condition and keep the logs.

    Parameters
    ----------
    scene : Path
        A built scene.
    walk : dict
        See ``spec/study-log.md``.
    folder : Path
        Logs are written there: ``walk-landings.json``, ``walk-head.json``.
    radius_m : float
        That the baseline refines to, as the landings do.
    frames_per_s : int
        Frames of each second of the walk, however long the machine takes to draw them.
    progress : Progress

    Returns
    -------
    list of Path

    Raises
    ------
    PipelineError
        There is no Chromium, no Playwright, or no viewer; the text says what to install.
    SurveyError
        The page refused the walk or the scene.
    """
    paths = []
    progress.start("walk", float(len(CONDITIONS)), "conditions")
    with _served(scene, folder / "serve.log") as address, _browser() as browser:
        listing = browser.new_context().request.get(f"{address}/scenes").json()
        scene_id = listing["scenes"][0]["id"]
        for condition in CONDITIONS:
            path = folder / f"walk-{condition}.json"
            # A context of its own: nothing of one condition is at hand in the other.
            context = browser.new_context(viewport=_VIEWPORT)
            page = context.new_page()
            page.set_default_timeout(_MOST_MS)
            page.goto(
                f"{address}/study.html?condition={condition}&participant=walk"
                f"&radius={radius_m:g}&forms=no#scene={scene_id}"
            )
            log = _played(page, walk, frames_per_s)
            path.write_text(json.dumps(log) + "\n", encoding="utf-8")
            page.screenshot(path=folder / f"walk-{condition}.png")
            context.close()
            paths.append(path)
            progress.advance(1)
    progress.done({"conditions": len(paths)})
    return paths


def _played(page: Any, walk: dict[str, Any], frames_per_s: int) -> Any:
    deadline = time.monotonic() + _START_S
    while not page.evaluate("window.study !== undefined"):
        if page.locator("#study-failed").count():
            raise SurveyError(f"the study's page: {page.locator('#study-failed').inner_text()}")
        if time.monotonic() > deadline:
            raise SurveyError(f"the study's page did not begin within {_START_S:g} s")
        time.sleep(0.2)
    script = "([walk, framesPerS]) => window.study.play(walk, framesPerS)"
    return page.evaluate(script, [walk, frames_per_s])


@contextmanager
def _served(scene: Path, log_path: Path) -> Iterator[str]:
    """``terraport serve`` on a free port of this machine."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    command = [sys.executable, "-c", _SERVE, "serve", str(scene), "--port", str(port)]
    with log_path.open("wb") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log)
    try:
        deadline = time.monotonic() + _START_S
        while True:
            try:
                socket.create_connection(("127.0.0.1", port), 1).close()
                break
            except OSError:
                if process.poll() is not None or time.monotonic() > deadline:
                    words = log_path.read_text(encoding="utf-8", errors="replace")[-400:]
                    raise SurveyError(f"terraport serve {scene} did not start: {words}") from None
                time.sleep(0.2)
        yield f"http://127.0.0.1:{port}"
    finally:
        process.terminate()
        process.wait()


@contextmanager
def _browser() -> Iterator[Any]:
    program = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if program is None:
        raise PipelineError("there is no Chromium: install it to play walks (apt install chromium)")
    try:
        playwright = importlib.import_module("playwright.sync_api")
    except ImportError:
        raise PipelineError(
            "Playwright is not installed: pip install 'terraport[study]' plays walks; logs are "
            "evaluated without it"
        ) from None
    with playwright.sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=program, args=list(_FLAGS))
        try:
            yield running
        finally:
            running.close()
