"""The viewer as it was built, in the system's Chromium, on the real service.

Skipped where Chromium or the built page is missing, unless ``TERRAPORT_BROWSER=required``.
``TERRAPORT_SCREENSHOTS=FOLDER`` keeps what :func:`watched_page.save_shot` takes. One file of tests
is one browser, and one worker runs all files of this folder (``tests/conftest.py``): a browser
without a graphics card takes all the CPU it is given. Few files, a small window.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final, NoReturn

import pytest
from browser.small_scenes import small_scenes
from browser.watched_page import Watch
from faults.service import Service
from playwright.sync_api import Browser, Page, Playwright, expect, sync_playwright

from terraport_server.http.viewer import BUILT_PAGE

HINTS_SEEN: Final = """try { localStorage.setItem("terraport.hints", "3"); } catch {}"""
"""As the page keeps it; a page without an origin has no storage."""

PROGRAMS: Final = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome")

FLAGS: Final = (
    "--headless=new",
    "--no-sandbox",  # tests run as root in containers; the pages are our own
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)

VIEWPORT: Final = {"width": 640, "height": 360}
"""A frame of it with both scenes' triangles takes some 100 ms."""

TIMEOUT_MS: Final = 120_000
"""Of one step in the page: two cores are shared with other tests."""
TEST_TIMEOUT_S: Final = 900
"""Of one test: it may wait for the scenes to be built, or for another file's browser."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give the tests of this folder the time that they may need."""
    for item in items:
        if item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.timeout(TEST_TIMEOUT_S))


def _skip(reason: str) -> NoReturn:
    if os.environ.get("TERRAPORT_BROWSER") == "required":
        pytest.fail(f"TERRAPORT_BROWSER=required, but {reason}")
    pytest.skip(reason)


@pytest.fixture(scope="session")
def chromium_path() -> str:
    """The system's browser."""
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        _skip("there is no Chromium (apt-get install chromium)")
    if not (BUILT_PAGE / "index.html").is_file():
        _skip("the viewer is not built (pip install -e . builds it)")
    return program


@pytest.fixture(scope="module")
def playwright(chromium_path: str) -> Iterator[Playwright]:
    """The browser's driver, no longer than one file's tests.

    While it lives this thread has a running event loop, and the tests of other files in the same
    process could not ``asyncio.run``.
    """
    del chromium_path  # skips first
    expect.set_options(timeout=TIMEOUT_MS)
    with sync_playwright() as driver:
        yield driver


@pytest.fixture(scope="module")
def browser(playwright: Playwright, chromium_path: str) -> Iterator[Browser]:
    """A browser for the tests of one file: what one of them leaks, the next file is spared."""
    running = playwright.chromium.launch(executable_path=chromium_path, args=list(FLAGS))
    try:
        yield running
    finally:
        running.close()


@pytest.fixture(scope="session")
def scenes(chromium_path: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the two scenes."""
    del chromium_path
    return small_scenes(tmp_path_factory.mktemp("browser"))


@pytest.fixture(scope="session")
def server(scenes: Path) -> Iterator[Service]:
    """The service in a process of its own, open."""
    with Service(scenes) as running:
        yield running


@pytest.fixture
def open_page(browser: Browser) -> Iterator[Callable[..., tuple[Page, Watch]]]:
    """Makes pages in contexts of their own; what they complain of fails the test at its end.

    ``open_page(**options)``: options of Playwright's ``new_context``, such as ``has_touch``; and
    ``hints=True`` for who opens the viewer for the first time.
    """
    opened: list[tuple[Any, Watch]] = []

    def open_one(**options: Any) -> tuple[Page, Watch]:
        is_new = options.pop("hints", False)
        context = browser.new_context(**{"viewport": VIEWPORT, **options})
        if not is_new:
            context.add_init_script(HINTS_SEEN)
        context.set_default_timeout(TIMEOUT_MS)
        watch = Watch(context)
        opened.append((context, watch))
        return context.new_page(), watch

    yield open_one
    for context, _ in opened:
        context.close()
    for _, watch in opened:
        watch.check()


@pytest.fixture
def page(open_page: Callable[..., tuple[Page, Watch]]) -> Page:
    """One page, watched, without anything that a test foresees."""
    return open_page()[0]
