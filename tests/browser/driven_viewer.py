"""The viewer in a page, driven as a user or an embedding page would, and watched from outside."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import httpx
import numpy as np
from eventually import eventually
from playwright.sync_api import Error, Page

from terraport_payload.types import Bool

__all__ = ["DrivenViewer", "payload_bytes"]

GL_WATCH: Final = Path(__file__).with_name("gl_watch.js")
"""Wraps WebGL before the page's own scripts run: ``glWatch`` tells what was really drawn."""

TIMEOUT_S: Final = 120.0
"""Of one wait: two cores are shared, and the browser draws by CPU."""


class DrivenViewer:
    """One page with one scene.

    Waiting is done here and not by Playwright: its ``wait_for_function`` evaluates text in the
    page, which the page's policy forbids.
    """

    def __init__(self, page: Page, server_url: str, scene: str) -> None:
        self.page = page
        self.server_url = server_url
        self.scene = scene
        page.add_init_script(path=GL_WATCH)

    def open(self, more: str = "", *, until_linked: bool = True) -> None:
        """Open the scene's address; ``more`` is what else stands in it, such as ``&mode=slope``."""
        self.page.goto(f"{self.server_url}/#scene={self.scene}{more}")
        if until_linked:
            self.until("window.terraport?.state.link?.state === 'open'")
            self.until("glWatch.ground().length > 0")

    def run(self, script: str, argument: object = None) -> Any:
        """Evaluate an expression or a function in the page."""
        return self.page.evaluate(script, argument)

    def until(self, script: str, timeout_s: float = TIMEOUT_S) -> None:
        """Wait until an expression is true in the page."""

        def holds() -> bool:
            try:
                return bool(self.page.evaluate(script))
            except Error as error:
                # The page was being loaded anew.
                if "context was destroyed" in str(error) or "navigat" in str(error):
                    return False
                raise

        try:
            eventually(holds, timeout_s)
        except AssertionError as error:
            state = self.run(
                "() => ({status: window.terraport?.status?.phase,"
                " link: window.terraport?.state.link,"
                " text: document.body.innerText.slice(0, 400)})"
            )
            message = f"never within {timeout_s:g} s: {script}\nthe page: {state}"
            raise AssertionError(message) from error

    def land(
        self, position: tuple[float, float, float], radius_m: float = 60.0, **options: float
    ) -> dict[str, Any]:
        """Land and wait until it is shown; returns its status and the digest.

        A region of the page's own: what a landing of the panel's button does.
        """
        status: dict[str, Any] = self.run(
            "async ([place, radiusM, options]) => {"
            " const status = await terraport.land(place, radiusM, options);"
            " return {...status, visible: [...terraport.visible],"
            " digest: terraport.visibleDigest}; }",
            [list(position), radius_m, options],
        )
        return status

    def begin_landing(
        self, position: tuple[float, float, float], radius_m: float = 60.0, **options: float
    ) -> None:
        """Land, and do not wait; how it went is then in ``window.went``."""
        self.run(
            "([place, radiusM, options]) => { window.went = null;"
            " terraport.land(place, radiusM, options).then("
            " (status) => { window.went = status.phase; },"
            " (error) => { window.went = String(error); }); }",
            [list(position), radius_m, options],
        )

    def look(
        self, eye: tuple[float, float, float], yaw_deg: float, pitch_deg: float
    ) -> list[list[int]]:
        """Draw one frame from there; returns the ground's draw calls: index buffer, indices."""
        calls: list[list[int]] = self.run(
            "async ([eye, yawDeg, pitchDeg]) => {"
            " await terraport.look({eye, yawDeg, pitchDeg});"
            " return glWatch.ground(); }",
            [list(eye), yaw_deg, pitch_deg],
        )
        return calls

    @property
    def visible(self) -> list[int]:
        """Segments that the page says are shown."""
        segment_ids: list[int] = self.run("[...terraport.visible]")
        return segment_ids

    @property
    def digest(self) -> str:
        """A digest of what is visible, computed by the page."""
        return str(self.run("terraport.visibleDigest"))

    @property
    def stream(self) -> dict[str, Any]:
        """The stream's counters; they are read every half second."""
        self.until("terraport.stats.stream !== null")
        stats: dict[str, Any] = self.run("terraport.stats.stream")
        return stats

    def hidden_on_gpu(self, base_faces: int) -> Bool:
        """Return which faces of the base the GPU really leaves out: those without any extent.

        Reads back the index buffer that the newest frame drew.
        """
        count = base_faces * 3
        drawn = [index for index, indices in self.run("glWatch.ground()") if indices == count]
        assert len(drawn) == 1, "the base is drawn once"
        size = self.run("(id) => glWatch.bytesOf(id)", drawn[0]) // count
        listed = self.run("([id, size]) => [...glWatch.indices(id, size)]", [drawn[0], size])
        corners = np.array(listed, np.int64).reshape(-1, 3)
        return (corners[:, 0] == corners[:, 1]) & (corners[:, 1] == corners[:, 2])

    def notice(self, key: str) -> str:
        """Wait for one of the page's messages; returns what it says."""
        box = self.page.locator(f"[data-notice='{key}']")
        box.wait_for()
        return box.inner_text()


def payload_bytes(server_url: str) -> dict[str, float]:
    """Payload bytes that the server says it sent, by kind: ``land``, ``prefetch``."""
    text = httpx.get(f"{server_url}/metrics").text
    totals = {"land": 0.0, "prefetch": 0.0}
    for line in text.splitlines():
        if line.startswith("terraport_payload_bytes_total{"):
            name = line.split('kind="')[1].split('"')[0]
            totals[name] = float(line.rsplit(" ", 1)[1])
    return totals
