"""3D Tiles of a running service in CesiumJS: that it opens them, and what it draws from where.

CesiumJS is no dependency of ours: TERRAPORT_TILES_TOOLS names a folder with `npm install cesium`.
"""

from __future__ import annotations

import functools
import http.server
import io
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from terraport_server import BackgroundServer

SAMPLE = Path(__file__).resolve().parents[2] / "data" / "sample_scene"

PAGE = """<!doctype html><body style="margin:0"><div id="globe" style="width:480px;height:320px">
</div><link rel="stylesheet" href="cesium/Widgets/widgets.css">
<script>window.CESIUM_BASE_URL = "cesium/";</script><script src="cesium/Cesium.js"></script><script>
window.open_tileset = async (url, eye, aim) => {
  const widget = new Cesium.CesiumWidget("globe", {
    baseLayer: false, skyBox: false, skyAtmosphere: false,
    contextOptions: { webgl: { preserveDrawingBuffer: true } },
  });
  widget.scene.globe.show = false;
  widget.scene.backgroundColor = Cesium.Color.BLUE;
  const tileset = await Cesium.Cesium3DTileset.fromUrl(url);
  window.failures = [];
  tileset.tileFailed.addEventListener((failed) => failures.push(failed.url + failed.message));
  widget.scene.primitives.add(tileset);
  const placed = (at) => Cesium.Matrix4.multiplyByPoint(
    tileset.root.transform, new Cesium.Cartesian3(...at), new Cesium.Cartesian3());
  const from = placed(eye);
  const along = Cesium.Cartesian3.subtract(placed(aim), from, new Cesium.Cartesian3());
  widget.camera.setView({ destination: from, orientation: {
    direction: Cesium.Cartesian3.normalize(along, along),
    up: Cesium.Cartesian3.normalize(from, new Cesium.Cartesian3()) } });
  window.tileset = tileset;
};
window.drawn = () => tileset.tilesLoaded && tileset._selectedTiles.length > 0
  ? tileset._selectedTiles.map((tile) => tile._contentResource.url) : null;
</script>"""


@pytest.fixture(scope="module")
def cesium() -> Path:
    tools = os.environ.get("TERRAPORT_TILES_TOOLS")
    if tools is None:
        pytest.skip("TERRAPORT_TILES_TOOLS is not set, expected a folder with `npm i cesium`")
    built = Path(tools) / "node_modules" / "cesium" / "Build" / "Cesium"
    if not (built / "Cesium.js").is_file():
        pytest.skip(f"no CesiumJS in {built}, expected `npm i cesium` in {tools}")
    return built


@pytest.fixture(scope="module")
def page_url(cesium: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("tiles")
    (folder / "index.html").write_text(PAGE)
    (folder / "cesium").symlink_to(cesium, target_is_directory=True)
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()


@pytest.mark.thorough
def test_cesium_draws_base_far_away_and_segments_near(browser: Any, page_url: str) -> None:
    with BackgroundServer(SAMPLE, allowed_origins=(page_url,)) as running:
        url = f"{running.url}/scenes/sample_scene/tileset.json"
        for eye, near in (([0, -90, 60], False), ([-9, -2, 14], True)):
            page = browser.new_page(viewport={"width": 480, "height": 320})
            page.goto(page_url)
            page.evaluate("([url, eye]) => open_tileset(url, eye, [0, 4, 9])", [url, eye])
            page.wait_for_function("drawn() !== null", timeout=60_000)
            drawn = page.evaluate("drawn()")
            assert page.evaluate("failures") == []
            assert any("/segments/" in uri for uri in drawn) == near
            picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
            levels = np.asarray(picture).astype(int)
            blue = (levels[..., 2] > 200) & (levels[..., 0] < 60)
            assert 0.05 < 1 - blue.mean() < 0.98
            page.close()
