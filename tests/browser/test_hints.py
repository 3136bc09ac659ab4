"""A newcomer's first minute."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from browser.driven_viewer import DrivenViewer
from browser.small_scenes import SMALL
from browser.watched_page import Watch, save_shot
from faults.service import Service
from playwright.sync_api import Page, expect

PHONE = {"viewport": {"width": 390, "height": 780}, "has_touch": True, "is_mobile": True}


@pytest.mark.parametrize("options", [{}, PHONE], ids=["desktop", "phone"])
def test_three_hints_and_none_of_them_twice(
    open_page: Callable[..., tuple[Page, Watch]], server: Service, options: dict[str, object]
) -> None:
    page, _ = open_page(hints=True, **options)
    viewer = DrivenViewer(page, server.url, SMALL)
    viewer.open()
    hint = page.locator("#hint")
    expect(hint).to_contain_text("Drag to look round")
    save_shot(page, f"hints-1-{'phone' if options else 'desktop'}")
    page.click("[data-action=next-hint]")
    expect(hint).to_contain_text("the ground")
    # What was told is not told again after a reload; the rest is.
    page.reload()
    expect(hint).to_contain_text("the ground")
    # Done, and so told: the landing's own card stands in the place first.
    viewer.until("window.terraport?.state.link?.state === 'open'")
    viewer.land((0.0, 2.0, 0.0), 30.0)
    expect(page.locator(".gain-card")).to_be_visible()
    expect(hint).to_be_hidden()
    page.evaluate("document.querySelector('.gain-card').hidden = true")
    expect(hint).to_contain_text("before and after")
    save_shot(page, f"hints-3-{'phone' if options else 'desktop'}")
    page.click("[data-action=next-hint]")
    expect(hint).to_be_hidden()
    page.reload()
    viewer.until("window.terraport?.state.link?.state === 'open'")
    expect(hint).to_have_count(0)


def test_none_for_who_wants_none(
    open_page: Callable[..., tuple[Page, Watch]], server: Service
) -> None:
    page, _ = open_page(hints=True)
    viewer = DrivenViewer(page, server.url, SMALL)
    viewer.open()
    page.click("[data-action=no-hints]")
    expect(page.locator("#hint")).to_be_hidden()
    assert viewer.run("localStorage.getItem('terraport.hints')") == "3"


@pytest.mark.parametrize("how", ["drag", "wheel", "keys"])
def test_the_first_goes_when_one_looks_round(
    open_page: Callable[..., tuple[Page, Watch]], server: Service, how: str
) -> None:
    """Also after a landing: then the second has been done before, and the third comes."""
    page, _ = open_page(hints=True)
    viewer = DrivenViewer(page, server.url, SMALL)
    viewer.open()
    hint = page.locator("#hint")
    if how == "keys":
        viewer.land((0.0, 2.0, 0.0), 30.0)
        page.evaluate("document.querySelector('.gain-card').hidden = true")
    expect(hint).to_contain_text("look round")
    page.mouse.move(300, 150)
    if how == "drag":
        page.mouse.down()
        page.mouse.move(340, 160, steps=3)
        page.mouse.up()
    elif how == "wheel":
        page.mouse.wheel(0, -100)
    else:
        page.keyboard.down("ArrowLeft")
        viewer.until("!document.querySelector('#hint').textContent.includes('look')")
        page.keyboard.up("ArrowLeft")
    expect(hint).to_contain_text("before and after" if how == "keys" else "the ground")
