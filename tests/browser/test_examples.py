"""The examples for web developers, as Vite builds them, on another origin than the service's."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from browser.built_examples import EXAMPLES, built_examples, served
from browser.small_scenes import SMALL
from browser.watched_page import Watch, save_shot
from faults.service import Service
from playwright.sync_api import Page, Route, expect

from terraport_store import Scene
from terraport_store.layout import OVERVIEW

SAMPLE = Path(__file__).resolve().parents[2] / "data" / "sample_scene"

_TEXT = "document.querySelector('terraport-scene').shadowRoot.querySelector('p').textContent"
_SHOWN = "document.querySelector('terraport-scene').terrain.shownSegments.length"


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Origin of the built examples."""
    folder = tmp_path_factory.mktemp("examples")
    examples = [EXAMPLES / name for name in ("element", "fiber", "three")]
    with built_examples(folder, *examples) as origin:
        yield origin


def _with_package(name: str, folder: Path, package: str) -> Path:
    """Copy an example that needs a package which is no dependency of ours, with that package."""
    tools = os.environ.get("TERRAPORT_TILES_TOOLS")
    if tools is None or not (Path(tools) / "node_modules" / package).is_dir():
        pytest.skip(f"no folder with `npm i {package}` in TERRAPORT_TILES_TOOLS")
    app = folder / name
    shutil.copytree(EXAMPLES / name, app)
    (app / "node_modules").symlink_to(Path(tools).resolve() / "node_modules")
    return app


@pytest.fixture(scope="module")
def babylon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Origin of the example in Babylon.js."""
    folder = tmp_path_factory.mktemp("babylon")
    app = _with_package("babylon", folder / "app", "@babylonjs/core")
    with built_examples(folder / "out", app) as origin:
        yield origin


@pytest.fixture(scope="module")
def cesium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Origin of the example in CesiumJS, which needs no bundler."""
    folder = tmp_path_factory.mktemp("cesium")
    _with_package("cesium", folder, "cesium")
    with served(folder) as origin:
        yield origin


def _serve(scenes: Path, origin: str, **settings: str) -> Service:
    """Make a service that knows the examples' origin."""
    return Service(scenes, allowed_origins=json.dumps([origin]), **settings)


@pytest.fixture(scope="module")
def service(scenes: Path, example: str) -> Iterator[Service]:
    """One that asks for a token."""
    with _serve(scenes, example, token="sixteen-characters") as running:
        yield running


def _opened(page: Page, example: str, scene: str, **attributes: str) -> None:
    """Open the example on another scene, with a token from the start."""
    attributes = {"token": "sixteen-characters"} | attributes
    page.add_init_script(
        f"""
        window.told = [];
        document.addEventListener('DOMContentLoaded', () => {{
          const host = document.querySelector('terraport-scene');
          for (const name of ['opened', 'landed', 'failed'])
            // As JSON: what an event holds can be logged and sent.
            host.addEventListener(name, ({{ detail }}) =>
              window.told.push([name, JSON.parse(JSON.stringify(detail))]));
          for (const [name, value] of Object.entries({attributes!r}))
            host.setAttribute(name, value);
        }});
        """
    )
    page.goto(f"{example}/element/?scene={scene}")


def _told(page: Page, name: str) -> Any:
    page.wait_for_function(f"told.some(([name]) => name === '{name}')")
    return page.evaluate(f"told.findLast(([name]) => name === '{name}')[1]")


def test_it_lands_where_it_is_told_and_where_one_clicks(
    page: Page, example: str, service: Service
) -> None:
    """The attribute's landing, a click's, another by ``land``; each is told, and seen."""
    _opened(page, example, f"{service.url}/scenes/{SMALL}", at="0 0 0", radius="40")
    first = _told(page, "landed")
    assert first["position"] == [0, 0, 0]
    assert first["radiusM"] == 40
    host = page.locator("terraport-scene")
    expect(page.locator("#told")).to_contain_text("triangles within 40 m")
    page.wait_for_timeout(1500)  # the way there, and the wash of what is new
    before = host.screenshot()
    page.evaluate("told.length = 0")
    box = host.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + box["width"] * 0.3, box["y"] + box["height"] * 0.7)
    clicked = _told(page, "landed")
    assert clicked["position"] != [0, 0, 0]
    page.wait_for_timeout(1500)
    assert host.screenshot() != before
    status = page.evaluate("document.querySelector('terraport-scene').land([5, 0, 5], 20)")
    assert (status["phase"], status["radiusM"]) == ("shown", 20)
    visible = page.evaluate(_SHOWN)
    assert visible > 0
    # A drag turns the view and lands nowhere; nothing is there to be met at the upper edge.
    page.evaluate("told.length = 0")
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 300, box["y"] + 180, steps=4)
    page.mouse.up()
    page.wait_for_timeout(500)
    assert page.evaluate("told.length") == 0


def test_it_tells_a_refused_origin_from_a_server_that_is_away(
    open_page: Callable[..., tuple[Page, Watch]], example: str, scenes: Path
) -> None:
    """Browsers give one error for both; the first is mended by an option of the service."""
    page, watch = open_page()
    watch.allow(r"blocked by CORS policy|ERR_FAILED|ERR_CONNECTION_REFUSED")
    with Service(scenes, allowed_origins='["https://another.example"]') as running:
        url = f"{running.url}/scenes/{SMALL}"
        _opened(page, example, url)
        failed = _told(page, "failed")
    assert failed["code"] == "origin_not_allowed"
    assert f"--allow-origin {example}" in failed["message"]
    page.evaluate("told.length = 0")
    page.goto(f"{example}/element/?scene={url}&again")
    failed = _told(page, "failed")
    assert failed["code"] == "unreachable"
    assert "is the server running" in failed["message"]


def test_it_says_what_it_cannot_do(
    open_page: Callable[..., tuple[Page, Watch]], example: str, service: Service
) -> None:
    """No such scene, a wrong token, words for numbers, a mode that the scene does not have."""
    page, watch = open_page()
    watch.allow(r"Failed to load resource: .* (401|403|404) ")
    _opened(page, example, f"{service.url}/scenes/nosuch")
    assert _told(page, "failed")["code"] == "unknown_scene"
    assert "nosuch" in page.evaluate(_TEXT)
    host = "document.querySelector('terraport-scene')"
    page.evaluate("told.length = 0")
    page.evaluate(f"{host}.setAttribute('token', 'another-token-of-16')")
    page.evaluate(f"{host}.setAttribute('src', '{service.url}/scenes/{SMALL}')")
    assert _told(page, "failed")["code"] in ("unauthorised", "forbidden")
    page.evaluate("told.length = 0")
    page.evaluate(f"{host}.setAttribute('token', 'sixteen-characters')")
    assert _told(page, "opened")["segmentCount"] > 100
    page.evaluate(f"{host}.setAttribute('mode', 'gold')")
    assert "gold" in page.evaluate(_TEXT)
    assert "attribute:grade" in page.evaluate(_TEXT)
    page.evaluate(f"{host}.setAttribute('mode', 'attribute:grade')")
    assert page.evaluate(f"{host}.terrain.mode.name") == "grade"
    page.evaluate(f"{host}.setAttribute('at', 'here')")
    assert 'at="here"' in page.evaluate(_TEXT)
    rejected = page.evaluate(f"{host}.land([0, 0, 0], 1e5).catch((error) => error.code)")
    assert rejected == "radius_too_large"


def test_the_overview_is_there_before_the_base(page: Page, example: str, tmp_path: Path) -> None:
    """One can look and land while the base is held back; that landing is shown when it came."""
    shutil.copytree(SAMPLE, tmp_path / "scenes" / SAMPLE.name)
    with Scene.open(SAMPLE) as scene:
        overview_faces = len(scene.file_mesh(OVERVIEW).faces)
    held_back: list[Route] = []
    page.context.route(re.compile(r"/base\.(glb|tsg)"), lambda route: held_back.append(route))
    with _serve(tmp_path / "scenes", example, token="sixteen-characters") as running:
        _opened(page, example, f"{running.url}/scenes/{SAMPLE.name}", at="0 3 0", radius="6")
        _told(page, "opened")
        page.wait_for_function(
            "faces => document.querySelector('terraport-scene').terrain.stats().visibleTriangles"
            " === faces",
            arg=overview_faces,
        )
        assert held_back
        page.wait_for_function(
            "document.querySelector('terraport-scene').terrain.status.readyMs !== null"
        )
        assert not page.evaluate("told.some(([name]) => name === 'landed')")
        for route in held_back:
            route.continue_()
        assert _told(page, "landed")["phase"] == "shown"
        assert page.evaluate("told.filter(([name]) => name === 'opened').length") == 1


def test_it_is_gone_when_it_is_taken_out(page: Page, example: str, service: Service) -> None:
    """Twenty times in and out of the page: contexts and sessions are given back each time."""
    _opened(page, example, f"{service.url}/scenes/{SMALL}", at="0 0 0", radius="20")
    _told(page, "landed")
    for _ in range(20):
        page.evaluate("window.told.length = 0")
        page.evaluate(
            """() => {
              const host = document.querySelector('terraport-scene');
              const parent = host.parentNode;
              host.remove();
              parent.append(host);
            }"""
        )
        _told(page, "landed")
    assert page.evaluate(_SHOWN) > 0


def test_the_example_of_three_js_lands_where_one_clicks(
    page: Page, example: str, scenes: Path
) -> None:
    """One object: the base first, a landing in one frame, another at a double click, the end."""
    with _serve(scenes, example) as service:
        page.goto(f"{example}/three/?scene={service.url}/scenes/{SMALL}")
        page.wait_for_function("window.ground !== undefined")
        landed = page.evaluate("ground.land({ x: 0, y: 0, z: 0 }, 10)")
        assert (landed["phase"], landed["position"], landed["missing"]) == ("shown", [0, 0, 0], [])
        assert page.evaluate("ground.shownSegments.length") > 0
        save_shot(page, "example-three")
        height = page.evaluate("ground.heightAt(1, 2)")
        picked = page.evaluate("ground.pick([1, 100, 2])")
        assert abs(picked["position"][1] - height) < 0.01
        page.evaluate(
            "ground.addEventListener('landed', ({ status }) => { window.landed = status })"
        )
        box = page.locator("canvas").bounding_box()
        assert box is not None
        page.mouse.dblclick(box["width"] * 0.4, box["height"] * 0.7)
        page.wait_for_function("window.landed?.landing === ground.status.landing")
        assert page.evaluate("landed.position") != [0, 0, 0]
        refused = page.evaluate("ground.land([0, 0, 0], 1e5).catch(({ code }) => code)")
        assert refused == "radius_too_large"
        superseded = page.evaluate(
            "(() => { const first = ground.land([5, 0, 5], 20).catch(({ code }) => code);"
            " ground.land([0, 0, 0], 10); return first })()"
        )
        assert superseded == "superseded"
        page.evaluate("ground.dispose()")
        assert page.evaluate("ground.parent") is None


def test_the_example_of_react_three_fiber_lands(
    open_page: Callable[..., tuple[Page, Watch]], example: str, scenes: Path
) -> None:
    """It shows what the Python SDK would: segments, under a camera of fiber's own."""
    page, watch = open_page()
    watch.allow("THREE.Clock: This module has been deprecated")  # fiber's own
    with _serve(scenes, example) as service:
        page.goto(f"{example}/fiber/?scene={service.url}/scenes/{SMALL}")
        page.wait_for_function("window.ground?.status.phase === 'shown'")
        assert page.evaluate("ground.shownSegments.length") > 0
        save_shot(page, "example-fiber")


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of scenes with the sample alone: a service writes its log next to it."""
    folder = tmp_path_factory.mktemp("sample") / "scenes"
    shutil.copytree(SAMPLE, folder / SAMPLE.name)
    return folder


def test_the_example_of_babylon_lands_by_the_core_alone(
    page: Page, babylon: str, sample: Path
) -> None:
    with _serve(sample, babylon) as running:
        page.goto(f"{babylon}/babylon/?scene={running.url}/scenes/{SAMPLE.name}")
        page.wait_for_function("window.shown !== undefined")
        base_faces = page.evaluate("ground.getTotalIndices() / 3")
        drawn = "[...drawn].filter(([, mesh]) => mesh.isEnabled()).map(([key]) => key).sort()"
        assert page.evaluate(drawn) == page.evaluate("[...shown.visible].sort()") != []
        save_shot(page, "example-babylon")
        page.evaluate("land([9, 2, 4], 4)")
        page.wait_for_function("shown.landing === 2")
        assert page.evaluate(drawn) == page.evaluate("[...shown.visible].sort()") != []
        # Less is hidden of the base by a smaller landing.
        assert page.evaluate("ground.getTotalIndices() / 3") > base_faces


def test_the_example_of_cesium_draws_the_live_tileset(
    page: Page, cesium: str, sample: Path
) -> None:
    """Detail near the camera, base behind it, no request to any other host."""
    with _serve(sample, cesium) as running:
        page.goto(f"{cesium}/cesium/?scene={running.url}/scenes/{SAMPLE.name}")
        page.wait_for_function("window.tileset?.tilesLoaded && tileset.totalMemoryUsageInBytes > 0")
        page.wait_for_timeout(1000)  # a frame with all of it
        drawn = page.evaluate("tileset.statistics.numberOfTrianglesSelected")
        assert drawn > 1000
        save_shot(page, "example-cesium")
