"""The terrain in the oldest and the newest version of three.js that the package allows.

The ground is drawn, lit, shadowed and veiled without a complaint of the browser, and stays whole
wherever it is moved, turned and scaled to.
"""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Final

import numpy as np
import pytest
from browser.built_examples import EXAMPLES, WEB, built_examples
from browser.conftest import TIMEOUT_MS
from browser.watched_page import Watch, save_shot
from faults.service import Service
from playwright.sync_api import Browser

SAMPLE: Final = Path(__file__).resolve().parents[2] / "data" / "sample_scene"
DRIVEN: Final = Path(__file__).with_name("in_a_scene.js")

MOVED: Final = {
    "moved": "o.position.set(1000, -50, 300)",
    "turned": "o.rotation.set(0.3, 1.2, -0.4)",
    "a model on a table": "o.scale.setScalar(0.01); o.position.set(0.3, 0.8, -0.2)",
    "large": "o.scale.setScalar(25); o.rotation.y = 2",
    "higher than wide, mirrored": "o.scale.set(-1, 3, 1)",
    "in a group": """o.parent.position.set(5, 6, 7); o.parent.scale.setScalar(2);
        o.rotation.z = 0.2; o.scale.set(1, 0.5, 2)""",
    "by its matrix": """o.matrixAutoUpdate = false; o.matrix.makeTranslation(40, 0, 0);
        o.matrixWorldNeedsUpdate = true""",
}
"""What is done to the terrain ``o``, in a group of its own."""

SCRIPT: Final = """
window.holes = (move) => {
  plain();
  const o = ground;
  const group = new three.Group();
  group.add(o);
  scene.add(group);
  new Function("o", move)(o);
  group.updateMatrixWorld(true);
  // From where it was seen before, as far as its size allows: every way of it is another look.
  const eye = o.localToWorld(new three.Vector3(24, 18, 26));
  const at = o.localToWorld(new three.Vector3(0, 4, 0));
  camera.position.copy(eye);
  camera.lookAt(at);
  const distance = eye.distanceTo(at);
  [camera.near, camera.far] = [distance / 500, distance * 10];
  camera.updateProjectionMatrix();
  camera.updateMatrixWorld();
  drawn([]);
  const gl = renderer.getContext();
  const [width, height] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
  const rgba = new Uint8Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
  const raycaster = new three.Raycaster();
  let [met, wrong] = [0, 0];
  for (let y = 6; y < height; y += 6) for (let x = 6; x < width; x += 6) {
    const pixel = new three.Vector2((2 * (x + 0.5)) / width - 1, (2 * (y + 0.5)) / height - 1);
    raycaster.setFromCamera(pixel, camera);
    const [hit] = raycaster.intersectObject(scene.getObjectByName("terrain"));
    const isGround = hit !== undefined;
    const seen = hit?.point.clone().project(camera);
    if (isGround && Math.hypot(seen.x - pixel.x, seen.y - pixel.y) > 1e-4)
      throw new Error(`the ray of pixel ${x} ${y} meets the ground elsewhere`);
    const p = 4 * (y * width + x);
    const isSky = rgba[p] === 0xb9 && rgba[p + 1] === 0xcd && rgba[p + 2] === 0xd8;
    met += isGround;
    wrong += isGround === isSky;
  }
  const middle = drawn([at.toArray()]);
  o.matrixAutoUpdate = true;
  o.position.set(0, 0, 0); o.rotation.set(0, 0, 0); o.scale.set(1, 1, 1);
  scene.add(o);
  group.removeFromParent();
  [camera.near, camera.far] = [0.1, 500];
  camera.updateProjectionMatrix();
  scene.updateMatrixWorld(true);
  return { met, wrong };
};
"""


@pytest.mark.parametrize("three", ["three-oldest", "three"])
def test_it_draws_and_stays_whole_wherever_it_is_put(
    browser: Browser, tmp_path: Path, three: str
) -> None:
    shutil.copytree(SAMPLE, tmp_path / "scenes" / SAMPLE.name)
    context = browser.new_context(viewport={"width": 320, "height": 180})
    context.set_default_timeout(TIMEOUT_MS)
    watch = Watch(context)
    page = context.new_page()
    with (
        built_examples(tmp_path / "built", EXAMPLES / "sun", three=three) as origin,
        Service(tmp_path / "scenes", allowed_origins=json.dumps([origin])) as service,
    ):
        page.goto(f"{origin}/sun/?scene={service.url}/scenes/{SAMPLE.name}")
        page.wait_for_function("window.ground?.status.phase === 'shown'")
        save_shot(page, three)
        page.evaluate(DRIVEN.read_text())
        page.evaluate(SCRIPT)
        assert page.evaluate("three.REVISION") == revision(three)
        # The photographs are drawn, and light, shadow and fog change them.
        plain = np.array(page.evaluate("() => { plain(); return drawn([DETAIL, BASE]) }"), float)
        assert (plain.mean((1, 2)) > 40).all()
        assert (np.ptp(plain.mean(1), axis=1) > 5).all()
        for setting in (
            "ground.setShading({lit: true}); sky.intensity = 1",
            "ground.setShading(HAS_ALL); sun.intensity = 3",
            "scene.fog = new three.Fog(0xb9cdd8, 10, 60)",
        ):
            script = f"() => {{ plain(); {setting}; return drawn([DETAIL, BASE]) }}"
            assert np.abs(np.array(page.evaluate(script)) - plain).max() > 5, setting
        for name, move in {"where it was": "", **MOVED}.items():
            seen = page.evaluate("(move) => holes(move)", move)
            assert seen["met"] > 150, name
            # At the rim a pixel may be either.
            assert seen["wrong"] <= 0.02 * seen["met"], (name, seen)
    context.close()
    watch.check()


def revision(package: str) -> str:
    """The middle number of an installed version: what three.js calls its revision."""
    facts = json.loads((WEB / "node_modules" / package / "package.json").read_text())
    found = re.fullmatch(r"0\.(\d+)\.\d+", facts["version"])
    assert found is not None
    return found[1]
