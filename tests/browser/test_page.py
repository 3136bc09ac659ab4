"""The page as everybody meets it first: it answers, complains of nothing, lists, opens."""

from __future__ import annotations

import shutil
from io import BytesIO
from pathlib import Path

import httpx
import pytest
from browser.prefix_proxy import PrefixProxy
from browser.small_scenes import PHOTOGRAPHED, SMALL
from browser.watched_page import save_shot
from eventually import eventually
from faults.service import Service
from PIL import Image
from playwright.sync_api import Page, expect

from terraport_store import end_building, say_building

GROUND_COLOURS = 2000
"""The sky is a gradient of some hundred colours, the ground has thousands."""


def shows_ground(page: Page) -> bool:
    """Whether something other than sky is drawn in the middle of the page."""
    picture = Image.open(BytesIO(page.screenshot())).convert("RGB")
    width, height = picture.size
    middle = picture.crop((width // 4, height // 4, 3 * width // 4, 3 * height // 4))
    return len(middle.getcolors(1 << 20) or ()) > GROUND_COLOURS


def test_the_page_that_is_served_is_the_built_one(server: Service) -> None:
    answer = httpx.get(server.url)
    assert answer.status_code == 200
    assert "script-src 'self' 'wasm-unsafe-eval'" in answer.headers["content-security-policy"]
    assert "./assets/" in answer.text
    notices = httpx.get(f"{server.url}/third-party.txt").text
    assert "\nthree " in notices


def test_the_list_shows_the_scenes(page: Page, server: Service) -> None:
    page.goto(server.url)
    for name in ("Small quarry", "Small quarry, photographed"):
        expect(page.get_by_role("link", name=name).first).to_be_visible()
    save_shot(page, "list")


def test_cards_show_what_builds_drew(page: Page, scenes: Path, tmp_path: Path) -> None:
    """One scene with a picture, one with a broken one: with a token, which no link can carry."""
    shutil.copytree(scenes, tmp_path / "scenes")
    Image.new("RGB", (64, 36), (200, 120, 40)).save(tmp_path / "scenes" / SMALL / "preview.jpg")
    (tmp_path / "scenes" / PHOTOGRAPHED / "preview.jpg").write_bytes(b"no picture")
    with Service(tmp_path / "scenes", token="sixteen-characters") as service:
        page.add_init_script("sessionStorage.setItem('terraport.token', 'sixteen-characters')")
        page.goto(f"{service.url}/#list")
        image = page.locator(f"[data-scene={SMALL}] .preview img")
        expect(image).to_be_visible()
        assert image.evaluate("(image) => image.naturalWidth") == 64
        expect(page.locator(f"[data-scene={PHOTOGRAPHED}] .preview svg")).to_be_visible()


@pytest.mark.parametrize("scene", [SMALL, PHOTOGRAPHED])
def test_a_scene_opens(page: Page, server: Service, scene: str) -> None:
    page.goto(f"{server.url}/#scene={scene}")
    expect(page.get_by_text("Connected")).to_be_visible()
    eventually(lambda: shows_ground(page), 60)
    save_shot(page, f"opened-{scene}")


def test_below_a_prefix_of_a_proxy(page: Page, server: Service) -> None:
    """Page, scripts, workers, scene files and the stream: all beside the page, wherever it is."""
    with PrefixProxy(server.url, "/maps/pit") as proxy:
        page.goto(proxy.url)
        page.get_by_role("link", name="Small quarry").first.click()
        expect(page.get_by_text("Connected")).to_be_visible()
        eventually(lambda: shows_ground(page), 60)
        assert proxy.strays == []
        page.goto("about:blank")  # lets go of the stream


def test_a_build_is_followed_until_its_scene_can_be_opened(
    page: Page, scenes: Path, tmp_path: Path
) -> None:
    shutil.copytree(scenes / SMALL, tmp_path / SMALL)
    with Service(tmp_path) as server:
        # Here, not before: on a busy machine the service takes long to start, and who has said
        # nothing for a while is taken for dead.
        say_building(tmp_path / "pit", "The pit", "clean: normals", 0.5)
        page.goto(f"{server.url}/#list")
        card = page.locator("[data-building=pit]")
        expect(card).to_contain_text("Clean: normals, 50 %")
        save_shot(page, "building")
        page.goto(f"{server.url}/#scene={SMALL}")
        message = page.locator("[data-notice=building]")
        expect(message).to_contain_text("The pit is being built")
        shutil.copytree(scenes / SMALL, tmp_path / "pit")
        end_building(tmp_path / "pit")
        expect(message).to_contain_text("The pit is ready")
        message.locator("[data-action=scenes]").click()
        expect(page.get_by_role("link", name="Small quarry")).to_have_count(2)
        page.goto("about:blank")  # lets go of the stream
