"""The page as everybody meets it first: it answers, complains of nothing, lists, opens."""

from __future__ import annotations

import httpx
from browser.small_scenes import PHOTOGRAPHED, SMALL
from browser.watched_page import save_shot
from faults.service import Service
from playwright.sync_api import Page, expect


def test_the_page_that_is_served_is_the_built_one(server: Service) -> None:
    answer = httpx.get(server.url)
    assert answer.status_code == 200
    assert "script-src 'self' 'wasm-unsafe-eval'" in answer.headers["content-security-policy"]
    assert "./assets/" in answer.text


def test_the_list_shows_the_scenes(page: Page, server: Service) -> None:
    page.goto(server.url)
    for name in ("Small quarry", "Small quarry, photographed"):
        expect(page.get_by_role("link", name=name, exact=False).first).to_be_visible()
    save_shot(page, "list")


def test_a_scene_opens(page: Page, server: Service) -> None:
    for scene in (SMALL, PHOTOGRAPHED):
        page.goto(f"{server.url}/#scene={scene}")
        page.reload()
        expect(page.locator("canvas").first).to_be_visible()
        save_shot(page, f"opened-{scene}")
