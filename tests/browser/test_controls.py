"""Keys, whatever was clicked before and on whatever keyboard; presses that become drags.

Keyboards are emulated by what Chromium is told of each key: its position (``code``) and what is
printed on it (``key``).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import pytest
from browser.conftest import TIMEOUT_MS
from browser.driven_viewer import DrivenViewer
from browser.small_scenes import SMALL
from browser.watched_page import Watch
from faults.service import Service
from playwright.sync_api import CDPSession, Page, expect

VIEWPORT: Final = {"width": 900, "height": 600}

CONTROLS: Final = """() => {
  for (const tried of document.querySelectorAll("[data-tried]")) delete tried.dataset.tried;
  return [...document.querySelectorAll(
    "button, [role=tab], summary, input[type=range], input[type=checkbox], input[type=radio]")]
  .filter((control) => control.checkVisibility() && !control.disabled
    && !control.matches("[data-action=help], [data-action=panel]"))
  .map((control, number) => { control.dataset.tried = String(number);
    return control.id || control.dataset.action || control.textContent || control.value; });
}"""
"""Marks what can be clicked; returns a name of each. Help is a dialog, which takes all keys."""

HELD_S: Final = 0.7
"""Longer than a press takes."""


@pytest.fixture
def viewer(open_page: Callable[..., tuple[Page, Watch]], server: Service) -> DrivenViewer:
    """A page on the small scene, large enough for its panel."""
    page, _ = open_page(viewport=VIEWPORT)
    driven = DrivenViewer(page, server.url, SMALL)
    driven.open()
    return driven


class Keyboard:
    """Keys of a layout, pressed by the protocol of Chromium's tools."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._tools: CDPSession = page.context.new_cdp_session(page)

    def send(self, kind: str, code: str, key: str) -> None:
        """``kind``: ``keyDown`` or ``keyUp``."""
        text = {"text": key} if len(key) == 1 and kind == "keyDown" else {}
        self._tools.send("Input.dispatchKeyEvent", {"type": kind, "code": code, "key": key, **text})

    def press(self, code: str, key: str) -> None:
        """Down and up."""
        self.send("keyDown", code, key)
        self.send("keyUp", code, key)

    def walk(self, code: str, key: str) -> bool:
        """Hold a key; whether the view moves, as its address then says."""
        before = self._page.evaluate("location.hash")
        frames = self._page.evaluate("terraport.frames")
        self.send("keyDown", code, key)
        # The first frame after a rest moves nothing.
        for _ in range(60):
            self._page.wait_for_timeout(50)
            if self._page.evaluate("terraport.frames") > frames + 3:
                break
        self.send("keyUp", code, key)
        for _ in range(30):
            self._page.wait_for_timeout(100)
            if self._page.evaluate("location.hash") != before:
                return True
        return False


def tool(page: Page) -> Any:
    return page.evaluate("terraport.state.tool")


def test_keys_work_after_a_click_on_every_control(viewer: DrivenViewer) -> None:
    page, keyboard = viewer.page, Keyboard(viewer.page)
    page.set_default_timeout(TIMEOUT_MS)
    viewer.run("terraport.state.panelOpen") or page.get_by_role("button", name="Panel").click()
    tried: dict[str, Any] = {}
    for tab in ("landing", "look", "inspect", "places", "figures"):
        page.click(f"#tab-{tab}")
        for number, name in enumerate(viewer.run(CONTROLS)):
            control = page.locator(f"[data-tried='{number}']")
            if not control.is_visible():
                continue
            control.click(force=True)
            before = viewer.run("terraport.state.aim")
            keyboard.press("KeyP", "p")
            picks = tool(page)
            keyboard.press("KeyL", "l")
            # Space aims, and does not click the button once more.
            keyboard.press("Space", " ")
            aimed = viewer.run("terraport.state.aim") != before or before is not None
            keyboard.press("Escape", "Escape")
            tried[f"{tab}: {name}"] = (picks, tool(page), aimed)
            page.evaluate("document.querySelectorAll('dialog[open]').forEach((d) => d.close())")
    assert len(tried) > 40
    assert {name: seen for name, seen in tried.items() if seen[:2] != ("pick", "land")} == {}
    assert {name: seen for name, seen in tried.items() if not seen[2]} == {}
    page.click("#tab-landing")
    assert keyboard.walk("KeyW", "w")
    assert keyboard.walk("ArrowLeft", "ArrowLeft")


def test_text_is_typed_and_controls_reached_by_tab_keep_their_keys(viewer: DrivenViewer) -> None:
    page, keyboard = viewer.page, Keyboard(viewer.page)
    viewer.run("terraport.state.panelOpen") or page.get_by_role("button", name="Panel").click()
    page.click("#tab-places")
    page.click("#place-name")
    page.keyboard.type("palm wv?")
    expect(page.locator("#place-name")).to_have_value("palm wv?")
    assert tool(page) == "land"
    expect(page.locator("#help-dialog")).to_be_hidden()
    page.click("#tab-landing")
    page.locator("#radius").focus()
    page.keyboard.press("Tab")
    page.keyboard.press("Shift+Tab")
    before = viewer.run("terraport.state.radiusM")
    keyboard.press("ArrowLeft", "ArrowLeft")
    page.keyboard.press("ArrowLeft")
    assert viewer.run("terraport.state.radiusM") != before


FRENCH: Final = {"walk": ("KeyW", "z"), "measure": ("Semicolon", "m"), "nearer": ("Equal", "+")}
GERMAN: Final = {"walk": ("KeyW", "w"), "measure": ("KeyM", "m"), "nearer": ("BracketRight", "+")}
DVORAK: Final = {"walk": ("KeyW", ","), "measure": ("KeyM", "m"), "nearer": ("BracketRight", "=")}
RUSSIAN: Final = {"walk": ("KeyW", "ц"), "measure": ("KeyM", "ь"), "nearer": ("Equal", "=")}


@pytest.mark.parametrize("layout", [FRENCH, GERMAN, DVORAK, RUSSIAN])
def test_every_keyboard(viewer: DrivenViewer, layout: dict[str, tuple[str, str]]) -> None:
    """Movement goes by position, shortcuts by what is printed; the help tells the letters."""
    page, keyboard = viewer.page, Keyboard(viewer.page)
    assert keyboard.walk(*layout["walk"])
    assert keyboard.walk(*layout["nearer"])
    keyboard.press(*layout["measure"])
    assert tool(page) == "measure"
    if layout is FRENCH:
        # Where a US keyboard has M, there is a comma: no shortcut.
        keyboard.press("KeyL", "l")
        keyboard.press("KeyM", ",")
        assert tool(page) == "land"
    keyboard.press("Slash", "?")
    letters = layout["walk"][1].upper()
    expect(page.locator("#help-dialog")).to_contain_text(f"{letters} A S D")


def drag(page: Page, *, held_s: float, steps: int = 6) -> None:
    """Press in the middle, wait, move 150 pixels, let go."""
    page.mouse.move(300, 300)
    page.mouse.down()
    page.wait_for_timeout(1000 * held_s)
    page.mouse.move(450, 330, steps=steps)
    page.mouse.up()


def assert_no_landing(viewer: DrivenViewer) -> None:
    viewer.page.wait_for_timeout(300)
    assert viewer.run("[terraport.status.phase, terraport.state.aim]") == ["idle", None]


@pytest.mark.parametrize("slowdown", [1, 6])
def test_who_drags_does_not_land(viewer: DrivenViewer, slowdown: int) -> None:
    """However long it was held still, in one movement or many, on a machine six times as slow."""
    page = viewer.page
    tools = page.context.new_cdp_session(page)
    tools.send("Emulation.setCPUThrottlingRate", {"rate": slowdown})
    for held_s in (0, 0.3, 0.44, 0.46, HELD_S):
        for steps in (1, 6):
            before = viewer.run("location.hash")
            drag(page, held_s=held_s, steps=steps)
            assert_no_landing(viewer)
            viewer.until(f"location.hash !== {before!r}")
    # The wheel with the button down, as for who looks around with both.
    page.mouse.move(300, 300)
    page.mouse.down()
    page.wait_for_timeout(1000 * HELD_S)
    page.mouse.wheel(0, -50)
    page.mouse.up()
    assert_no_landing(viewer)


def test_fingers_that_drag_or_pinch_do_not_land(
    open_page: Callable[..., tuple[Page, Watch]], server: Service
) -> None:
    page, _ = open_page(viewport={"width": 390, "height": 780}, has_touch=True, is_mobile=True)
    viewer = DrivenViewer(page, server.url, SMALL)
    viewer.open()
    tools = page.context.new_cdp_session(page)

    def touch(kind: str, *points: tuple[float, float]) -> None:
        fingers = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(points)]
        tools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": fingers})

    for held_s in (0, HELD_S):
        touch("touchStart", (200, 300))
        page.wait_for_timeout(1000 * held_s)
        for step in range(1, 6):
            touch("touchMove", (200 + 20 * step, 300))
        touch("touchEnd")
        assert_no_landing(viewer)
        # A finger that was held, and a second one.
        touch("touchStart", (200, 300))
        page.wait_for_timeout(1000 * held_s)
        touch("touchStart", (200, 300), (240, 360))
        for step in range(1, 6):
            touch("touchMove", (200, 300), (240, 360 + 15 * step))
        touch("touchEnd")
        assert_no_landing(viewer)
    # Held still and let go, it lands.
    touch("touchStart", (200, 300))
    viewer.until("terraport.state.aim !== null")
    touch("touchEnd")
    viewer.until("terraport.status.phase === 'shown'")
