"""The page's controls without a mouse, and by axe-core's rules."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest
from browser.driven_viewer import DrivenViewer
from browser.small_scenes import SMALL
from browser.watched_page import Watch
from faults.service import Service
from playwright.sync_api import Page, expect

AXE: Final = Path(__file__).resolve().parents[2] / "client_sdk/web/node_modules/axe-core/axe.min.js"

OpenPage = Callable[..., tuple[Page, Watch]]


def violations(page: Page, where: str) -> list[str]:
    """Ask axe-core, which is read from disk: the page's policy lets nothing else in."""
    # Transitions over: a colour half way to another has no contrast to speak of.
    page.wait_for_timeout(400)
    page.evaluate(AXE.read_text(encoding="utf-8") + "; 0")
    reported = page.evaluate("async () => (await axe.run(document)).violations")
    return [
        f"{where}: {violation['id']} ({violation['impact']}): {node['html'][:120]}"
        for violation in reported
        for node in violation["nodes"]
    ]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing(open_page: OpenPage, server: Service, scheme: str) -> None:
    if not AXE.is_file():
        pytest.skip("axe-core is not installed (npm ci in client_sdk/web)")
    page, _ = open_page(color_scheme=scheme, reduced_motion="reduce")
    viewer = DrivenViewer(page, server.url, SMALL)
    page.goto(f"{server.url}/#list")
    expect(page.locator("#scene-list")).to_be_visible()
    faults = violations(page, "list")
    viewer.open()
    viewer.land((0.0, 2.0, 0.0), 40.0)
    faults += violations(page, "viewer")
    page.get_by_role("button", name="Panel").click()
    for tab in page.get_by_role("tab").all():
        tab.click()
        faults += violations(page, f"panel, {tab.inner_text()}")
    page.get_by_role("button", name="Help").first.click()
    expect(page.locator("#help-dialog")).to_be_visible()
    faults += violations(page, "help")
    assert faults == []


def test_axe_finds_nothing_in_the_token_dialog(open_page: OpenPage, scenes: Path) -> None:
    if not AXE.is_file():
        pytest.skip("axe-core is not installed (npm ci in client_sdk/web)")
    with Service(scenes, token="a-token-of-this-test") as service:
        page, watch = open_page()
        watch.allow("status of 401")
        page.goto(f"{service.url}/#scene={SMALL}")
        expect(page.get_by_label("Token", exact=True)).to_be_visible()
        assert violations(page, "token") == []


def test_everything_by_keyboard(page: Page, server: Service) -> None:
    """Open a scene, aim, land, colour by slope, measure: no mouse."""
    viewer = DrivenViewer(page, server.url, SMALL)
    press = page.keyboard.press
    # Open a scene from the list.
    page.goto(f"{server.url}/#list")
    link = page.get_by_role("link", name="Small quarry").first
    expect(link).to_be_visible()
    for _ in range(12):
        press("Tab")
        if viewer.run("document.activeElement?.textContent?.includes('Small quarry')"):
            break
    press("Enter")
    viewer.until("window.terraport?.state.link?.state === 'open'")
    viewer.until("glWatch.ground().length > 0")

    # Aim and land.
    press("Space")
    viewer.until("terraport.state.aim?.bytes > 0")
    press("Enter")
    viewer.until("terraport.status.phase === 'shown'")
    expect(page.locator("#live")).to_contain_text("Landed")

    # Measure between two points.
    press("KeyM")
    assert viewer.run("terraport.state.tool") == "measure"
    press("Enter")
    before = viewer.run("terraport.state.measured[0]")
    frames = viewer.run("terraport.frames")
    page.keyboard.down("KeyW")
    viewer.until(f"terraport.frames > {frames} + 10")
    page.keyboard.up("KeyW")
    press("Enter")
    viewer.until("terraport.state.measured.length === 2")
    assert viewer.run("terraport.state.measured[1]") != before
    # Who lands is taken to the ground, and goes up again.
    press("KeyV")
    viewer.until("terraport.state.view === 'orbit'")

    # The panel: to its tabs, to the tab of looks, to the mode of slopes.
    press("KeyI")
    expect(page.locator("#panel")).to_be_visible()
    for _ in range(40):
        press("Tab")
        if viewer.run("document.activeElement?.getAttribute('role') === 'tab'"):
            break
    for _ in range(6):
        if viewer.run("terraport.state.tab === 'look'"):
            break
        press("ArrowRight")
    for _ in range(10):
        press("Tab")
        if viewer.run("document.activeElement?.name === 'mode'"):
            break
    for _ in range(8):
        if viewer.run("terraport.state.mode.kind === 'slope'"):
            break
        press("ArrowDown")
    viewer.until("terraport.state.mode.kind === 'slope'")
