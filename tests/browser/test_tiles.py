"""3D Tiles of a running service in other viewers: that they open them, and what they draw.

CesiumJS and 3DTilesRendererJS are no dependencies of ours: TERRAPORT_TILES_TOOLS names a folder
with `npm install cesium 3d-tiles-renderer three`.
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

from terraport_pipeline.export.hand_on import ExportRequest, export_scene
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
window.refine_to = (pixels) => { tileset.maximumScreenSpaceError = pixels; };
window.drawn = () => tileset.tilesLoaded && tileset._selectedTiles.length > 0
  ? tileset._selectedTiles.map((tile) => tile._contentResource.url) : null;
</script>"""

THREE_PAGE = """<!doctype html><body style="margin:0"><canvas id="view" width="480" height="320">
</canvas><script type="importmap">{"imports": {
  "three": "/tools/three/build/three.module.js",
  "three/addons/": "/tools/three/examples/jsm/",
  "3d-tiles-renderer/core": "/tools/3d-tiles-renderer/build/index.core.js",
  "3d-tiles-renderer/three": "/tools/3d-tiles-renderer/build/index.three.js"
}}</script><script type="module">
import { TilesRenderer } from "3d-tiles-renderer/three";
import { Color, Matrix4, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { MeshoptDecoder } from "three/addons/libs/meshopt_decoder.module.js";
window.failures = [];
window.open_tileset = async (url, eye, aim) => {
  const renderer = new WebGLRenderer({
    canvas: document.querySelector("#view"), preserveDrawingBuffer: true });
  const scene = new Scene();
  scene.background = new Color(0, 0, 1);
  const camera = new PerspectiveCamera(60, 480 / 320, 0.1, 1e5);
  camera.up.set(0, 0, 1);
  camera.position.set(...eye);
  camera.lookAt(...aim);
  const tiles = window.tiles = new TilesRenderer(url);
  const loader = new GLTFLoader(tiles.manager).setMeshoptDecoder(MeshoptDecoder);
  tiles.manager.addHandler(/\\.(glb|gltf)(\\?.*)?$/, loader);
  tiles.addEventListener("load-error", ({ url, error }) => failures.push(`${url}${error}`));
  tiles.setCamera(camera);
  tiles.setResolutionFromRenderer(camera, renderer);
  scene.add(tiles.group);
  const frame = () => {
    requestAnimationFrame(frame);
    if (tiles.root) {  // Earth-centred metres are no place for float32
      tiles.group.matrixAutoUpdate = false;
      tiles.group.matrix.fromArray(tiles.root.transform).invert();
      tiles.group.updateMatrixWorld(true);
    }
    camera.updateMatrixWorld(true);
    tiles.update();
    renderer.render(scene, camera);
  };
  frame();
};
window.refine_to = (pixels) => { tiles.errorTarget = pixels; };
window.drawn = () => {
  const { downloading, parsing } = tiles.stats;
  const shown = [...tiles.visibleTiles].map((tile) => tile.content?.uri).filter(Boolean);
  return tiles.loadProgress === 1 && downloading + parsing === 0 && shown.length ? shown : null;
};
</script>"""

PACKAGES = (
    "cesium/Build/Cesium/Cesium.js",
    "three/build/three.module.js",
    "3d-tiles-renderer/build",
)
PAGES = {"cesium": "", "three": "three.html"}


@pytest.fixture(scope="module")
def packages() -> Path:
    tools = os.environ.get("TERRAPORT_TILES_TOOLS")
    wanted = "npm i cesium three 3d-tiles-renderer"
    if tools is None:
        pytest.skip(f"TERRAPORT_TILES_TOOLS is not set, expected a folder with `{wanted}`")
    found = Path(tools) / "node_modules"
    for name in PACKAGES:
        if not (found / name).exists():
            pytest.skip(f"no {name} in {found}, expected `{wanted}` in {tools}")
    return found


@pytest.fixture(scope="module")
def page_url(packages: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("tiles")
    (folder / "index.html").write_text(PAGE)
    (folder / "three.html").write_text(THREE_PAGE)
    (folder / "cesium").symlink_to(packages / "cesium/Build/Cesium", target_is_directory=True)
    (folder / "tools").symlink_to(packages, target_is_directory=True)
    request = ExportRequest(folder / "exported", product="tiles")
    export_scene(SAMPLE, request)
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


@pytest.mark.thorough
@pytest.mark.parametrize("viewer", PAGES)
def test_base_and_detail_are_as_bright_as_each_other(
    browser: Any, page_url: str, viewer: str
) -> None:
    """The same view of the base (an error of 50 pixels) and of all segments, live and exported."""
    with BackgroundServer(SAMPLE, allowed_origins=(page_url,)) as running:
        live = f"{running.url}/scenes/sample_scene/tileset.json"
        for url in (live, f"{page_url}/exported/tileset.json"):
            page = browser.new_page(viewport={"width": 480, "height": 320})
            page.goto(f"{page_url}/{PAGES[viewer]}")
            page.evaluate("([url, eye]) => open_tileset(url, eye, [0, 4, 9])", [url, [0, -40, 40]])
            levels = []
            for pixels, near in ((50, False), (0.01, True)):
                page.evaluate(f"refine_to({pixels})")
                wanted = (
                    f"drawn()?.some((uri) => uri.includes('segments/')) === {str(near).lower()}"
                )
                page.wait_for_function(wanted, timeout=60_000)
                page.wait_for_timeout(500)
                assert page.evaluate("failures") == []
                picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
                levels.append(np.asarray(picture).astype(float))
            page.close()
            ground = [~((image[..., 2] > 200) & (image[..., 0] < 60)) for image in levels]
            both = ground[0] & ground[1]
            assert both.mean() > 0.05
            far, close = (image[both].mean() for image in levels)
            assert far > 30, "black without a lamp"
            assert 0.93 < close / far < 1.07, (viewer, url, far, close)
