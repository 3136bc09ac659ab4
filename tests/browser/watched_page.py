"""A browser's page that is watched: whatever it complains of fails the test."""

from __future__ import annotations

import os
import re
from pathlib import Path

from playwright.sync_api import BrowserContext, ConsoleMessage, Page

__all__ = ["Watch", "save_shot"]

# Software rendering: Chromium says so itself, and that reading pixels back is slow then. three.js
# says that it cannot compile shaders beside the page's thread. ANGLE tells of uploads between
# draws, after which it begins a new pass: levels of layers of images are such.
_HARMLESS = (
    re.compile(r"GPU stall due to ReadPixels"),
    re.compile(r"Automatic fallback to software WebGL"),
    re.compile(r"Running out of reserved outsideRenderPass queueSerial"),
    re.compile(r"KHR_parallel_shader_compile extension not supported"),
)


class Watch:
    """Collects what the pages of one context complain of.

    Console errors and warnings (violations of the content policy are among them), exceptions that
    nobody caught, pages and workers that crashed.
    """

    def __init__(self, context: BrowserContext) -> None:
        self.complaints: list[str] = []
        self._allowed: list[re.Pattern[str]] = [*_HARMLESS]
        context.on("console", self._heard)
        context.on("weberror", lambda error: self._note(f"exception: {error.error}"))
        context.on("page", self._watch)

    def allow(self, pattern: str) -> None:
        """Let a test go on that provokes a complaint, such as a refused request."""
        self._allowed.append(re.compile(pattern))

    def check(self) -> None:
        """Fail when there was a complaint that is not allowed."""
        assert not self.unforeseen, "\n".join(self.unforeseen)

    @property
    def unforeseen(self) -> list[str]:
        """Complaints that no pattern allows."""
        return [
            complaint
            for complaint in self.complaints
            if not any(each.search(complaint) for each in self._allowed)
        ]

    def _watch(self, page: Page) -> None:
        page.on("crash", lambda _page: self._note("the page crashed"))

    def _heard(self, message: ConsoleMessage) -> None:
        if message.type in {"error", "warning"}:
            where = message.location.get("url", "")
            self._note(f"console {message.type}: {message.text} ({where})")

    def _note(self, text: str) -> None:
        self.complaints.append(text)


def save_shot(page: Page, name: str) -> bytes:
    """Return a picture of the page, and keep it where TERRAPORT_SCREENSHOTS names a folder."""
    picture = page.screenshot()
    folder = os.environ.get("TERRAPORT_SCREENSHOTS")
    if folder:
        Path(folder).mkdir(parents=True, exist_ok=True)
        (Path(folder) / f"{name}.png").write_bytes(picture)
    return picture
