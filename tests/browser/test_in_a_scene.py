"""The ground in a three.js scene of one's own, as its pixels tell: fog, planes, tones, lights.

Photographs are the ground here, drawn as they are where nothing is set: so what each thing makes of
a pixel is known from the pixel without it.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import pytest
from browser.built_examples import EXAMPLES, built_examples
from browser.conftest import TIMEOUT_MS
from browser.watched_page import Watch, save_shot
from faults.service import Service
from numpy.typing import NDArray
from playwright.sync_api import Browser, Page

Colours = NDArray[np.float64]

SAMPLE = Path(__file__).resolve().parents[2] / "data" / "sample_scene"
DRIVEN = Path(__file__).with_name("in_a_scene.js")

DETAIL: Final = "DETAIL"
"""Level ground within the landing."""
BASE: Final = "BASE"
"""The same outside it."""
SKY: Final = (0xB9, 0xCD, 0xD8)
"""The example's background, and its fog."""
NOTHING: Final = np.tile(SKY, (25, 1))
"""Pixels without ground."""
FOREIGN: Final = {"fogColor", "ambientLightColor", "toneMappingExposure", "receiveShadow"}
"""Uniforms of three.js's own pieces of shader, one each."""
CLOSE: Final = 1.0
"""Of 255: colours are rounded once more."""


@pytest.fixture(scope="module")
def shown(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """The example with its landing shown; what it complains of fails the file."""
    folder = tmp_path_factory.mktemp("in-a-scene")
    shutil.copytree(SAMPLE, folder / "scenes" / SAMPLE.name)
    context = browser.new_context(viewport={"width": 320, "height": 180})
    context.set_default_timeout(TIMEOUT_MS)
    watch = Watch(context)
    page = context.new_page()
    with (
        built_examples(folder / "built", EXAMPLES / "sun") as origin,
        Service(folder / "scenes", allowed_origins=json.dumps([origin])) as service,
    ):
        page.goto(f"{origin}/sun/?scene={service.url}/scenes/{SAMPLE.name}")
        page.wait_for_function("window.ground?.status.phase === 'shown'")
        save_shot(page, "in-a-scene")
        page.evaluate(DRIVEN.read_text())
        yield page
    context.close()
    watch.check()


def drawn(page: Page, setting: str, *points: str) -> Colours:
    """Draw after some lines of script, from the plain state on: colours, points x pixels x 3."""
    return np.array(
        page.evaluate(f"() => {{ plain(); {setting}; return drawn([{','.join(points)}]) }}")
    )


def linear(colours: Colours) -> Colours:
    """Light of sRGB colours of 0 to 255."""
    share = colours / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def srgb(light: Colours) -> Colours:
    """Undo :func:`linear`."""
    light = np.clip(light, 0, 1)
    return 255 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def assert_close(
    seen: Colours, expected: Colours | Sequence[float], tolerance: float = CLOSE
) -> None:
    means = seen.mean(-2), np.broadcast_to(expected, seen.shape).mean(-2)
    assert np.abs(means[0] - means[1]).max() <= tolerance, f"{means[0]} is not {means[1]}"


def test_nothing_is_changed_where_nothing_is_set(shown: Page) -> None:
    """Lights, shadow maps and a box are in the scene, and the ground is as without them."""
    without = drawn(shown, "renderer.shadowMap.enabled = false", DETAIL, BASE)
    among = drawn(
        shown,
        "renderer.shadowMap.enabled = true; sun.intensity = 9; box.visible = true",
        DETAIL,
        BASE,
    )
    assert (without == among).all()
    # And costs nothing: the programs that drew it know of nothing else.
    for setting, found in (
        ("", set()),
        ("ground.setShading(HAS_ALL)", {"ambientLightColor", "receiveShadow"}),
    ):
        known = shown.evaluate(
            f"() => {{ plain(); sun.intensity = 9; {setting}; return uniformsOfGround() }}"
        )
        assert {"measureRange", "traits"} <= set(known)
        assert FOREIGN & set(known) == found


def test_fog_veils_it_by_its_depth(shown: Page) -> None:
    """Linear and squared exponential, mixed as three.js does: with colours for the screen."""
    plain = drawn(shown, "", DETAIL, BASE)
    depths = np.array(shown.evaluate(f"depthsOf([{DETAIL}, {BASE}])"))[:, None, None]
    share = np.clip((depths - 10) / (60 - 10), 0, 1)
    for fog, veil in (
        ("new three.Fog(0xb9cdd8, 10, 60)", share**2 * (3 - 2 * share)),
        ("new three.FogExp2(0xb9cdd8, 0.025)", 1 - np.exp(-((0.025 * depths) ** 2))),
    ):
        assert 0.1 < veil.min() < veil.max() < 0.95
        seen = drawn(shown, f"scene.fog = {fog}", DETAIL, BASE)
        assert_close(seen, (1 - veil) * plain + veil * np.array(SKY))
        left_out = drawn(
            shown, f"scene.fog = {fog}; ground.setShading({{fog: false}})", DETAIL, BASE
        )
        assert (left_out == plain).all()


def test_planes_cut_it(shown: Page) -> None:
    """The renderer's, and the ground's own where the renderer allows them; all or any."""
    plain = drawn(shown, "", DETAIL, BASE)
    plane = "new three.Plane(new three.Vector3(1, 0, 0), 0)"  # keeps the east, where the detail is
    seen = drawn(shown, f"renderer.clippingPlanes = [{plane}]", DETAIL, BASE)
    assert_close(seen, [plain[0], NOTHING], 0)
    own = f"ground.setShading({{clippingPlanes: [{plane}]}})"
    assert (drawn(shown, own, DETAIL, BASE) == plain).all()
    seen = drawn(shown, f"renderer.localClippingEnabled = true; {own}", DETAIL, BASE)
    assert_close(seen, [plain[0], NOTHING], 0)
    # Two that leave nothing between them cut all, or nothing where both have to.
    other = "new three.Plane(new three.Vector3(-1, 0, 0), 0)"
    seen = drawn(
        shown,
        "renderer.localClippingEnabled = true;"
        f"ground.setShading({{clippingPlanes: [{plane}, {other}], clipIntersection: true}})",
        DETAIL,
        BASE,
    )
    assert (seen == plain).all()


def test_tones_and_colour_space_are_the_renderers(shown: Page) -> None:
    """Exposure, ACES and linear output; the ground can be left out of the tones."""
    plain = drawn(shown, "", DETAIL, BASE)
    tone = "renderer.toneMapping = three.ACESFilmicToneMapping; renderer.toneMappingExposure = 0.5"
    assert_close(drawn(shown, tone, DETAIL, BASE), srgb(aces(linear(plain) / 2)))
    left_out = tone + "; ground.setShading({toneMapped: false})"
    assert (drawn(shown, left_out, DETAIL, BASE) == plain).all()
    as_light = "renderer.outputColorSpace = three.LinearSRGBColorSpace"
    assert_close(drawn(shown, as_light, DETAIL, BASE), 255 * linear(plain))


def aces(light: Colours) -> Colours:
    """Map tones as ``ACESFilmicToneMapping`` does (Stephen Hill's fit of RRT and ODT)."""
    into = [[0.59719, 0.35458, 0.04823], [0.076, 0.90834, 0.01566], [0.0284, 0.13383, 0.83777]]
    out = [
        [1.60475, -0.53108, -0.07367],
        [-0.10208, 1.10813, -0.00605],
        [-0.00327, -0.07276, 1.07602],
    ]
    v = light / 0.6 @ np.array(into).T
    v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.432951) + 0.238081)
    return np.clip(v @ np.array(out).T, 0, 1)


def test_lights_light_it(shown: Page) -> None:
    """Sky and sun on matt ground: its photographs are the colours; in every mode."""
    plain = linear(drawn(shown, "", DETAIL, BASE))
    lit = "ground.setShading({lit: true})"
    assert_close(drawn(shown, f"{lit}; sky.intensity = Math.PI / 2", DETAIL, BASE), srgb(plain / 2))
    # The sun is straight above, the ground nearly level.
    above = f"{lit}; sky.intensity = 0; sun.intensity = Math.PI / 2; sun.position.set(0, 50, 0)"
    assert_close(drawn(shown, above, DETAIL, BASE), srgb(plain / 2), 8)
    lamp = "const lamp = new three.PointLight(0xffffff, Math.PI * 4); scene.add(lamp)"
    place = f"lamp.position.set(...{DETAIL}); lamp.position.y += 2"
    seen = shown.evaluate(
        f"""() => {{ plain(); {lit}; sky.intensity = 0; {lamp}; {place};
          const seen = drawn([{DETAIL}, {BASE}]); lamp.removeFromParent(); return seen }}"""
    )
    # Two metres away a quarter of it is left, and 20 m away next to nothing.
    assert_close(np.array(seen[0]), srgb(plain[0]), 10)
    assert np.max(seen[1]) < 20
    for mode in ("regions", "slope", "segments"):
        night = drawn(
            shown, f"ground.setMode({{kind: '{mode}'}}); {lit}; sky.intensity = 0", DETAIL, BASE
        )
        assert_close(night, 0, 0)


SHADOWED: Final = """
box.visible = true; sun.position.set(6, 50, 2); sun.intensity = Math.PI; sky.intensity = Math.PI;
camera.position.set(16, 5, 10); camera.lookAt(6, 1, 2); box.position.set(6, 6, 2)
"""
"""The box hovers over its shadow."""


def test_shadows_fall_on_it(shown: Page) -> None:
    """Below a box half of the light is left, whether the photograph is lit or has its light."""
    points = ("placeAt(6, 2)", "placeAt(6, 6)")
    view = SHADOWED + "; box.visible = false"
    plain = drawn(shown, view, *points)
    unlit = drawn(shown, SHADOWED + "; ground.setShading({receiveShadow: true})", *points)
    assert_close(unlit[0], srgb(linear(plain[0]) / 2), 8)
    assert_close(unlit[1], plain[1], 1)
    lit = drawn(shown, SHADOWED + "; ground.setShading({lit: true, receiveShadow: true})", *points)
    assert_close(lit[0], srgb(linear(plain[0])), 8)
    assert lit[1].mean() > lit[0].mean() + 15
    not_received = drawn(shown, SHADOWED + "; ground.setShading({lit: true})", *points)
    assert_close(not_received[1], lit[1], 1)
    assert not_received[0].mean() > lit[0].mean() + 15


SCREEN: Final = """
if (!window.screen_) {
  window.screen_ = new three.Mesh(
    new three.PlaneGeometry(60, 60).rotateX(-Math.PI / 2), new three.MeshLambertMaterial());
  screen_.position.y = -40; screen_.receiveShadow = true; scene.add(screen_);
}
screen_.visible = true; sun.position.set(0, 40, 0); sun.intensity = Math.PI; sky.intensity = 0;
camera.position.set(0, -0.5, 0.01); camera.lookAt(0, -40, 0);
"""
"""What lies below the ground, seen from below it."""


def test_what_is_shown_of_it_casts_shadows(shown: Page) -> None:
    """One shadow of base and detail together, without a gap; what is not drawn casts none."""
    points = [f"[{x}, -40, {z}]" for x in (-9, -3, 3, 6, 9) for z in (-9, -3, 0, 3, 9)]
    lit = drawn(shown, SCREEN, *points)
    assert (lit > 250).all()
    cast = "ground.setShading({castShadow: true})"
    assert (drawn(shown, SCREEN + cast, *points) == 0).all()
    # Pages are hidden: the light goes through where the base's faces are blanked, there alone.
    pages = "ground.children[0].children.filter((mesh) => mesh.name === 'page')"
    hide = f"for (const page of {pages}) page.visible = {{}}"
    through = drawn(shown, SCREEN + cast + ";" + hide.format("false"), *points, "[6, -40, 0]")
    shown.evaluate(hide.format("true"))
    assert (through[-1] > 250).all()
    assert (through[:5] == 0).all()
    assert 0 < (through > 250).mean() < 0.7
    # In the very frame of a swap to another landing it is still one shadow without a gap.
    gaps = shown.evaluate(
        f"""async () => {{
          plain(); {SCREEN}; {cast};
          ground.autoSwap = false;
          ground.land([-6, 2, 4], 7);
          let gaps = 0;
          for (let frames = 0; frames < 600 && ground.status.phase !== "shown"; frames += 1) {{
            if (ground.status.phase === "presentable") ground.swap();
            gaps += drawn([{",".join(points)}]).flat(2).filter((value) => value > 0).length;
            await new Promise((resolve) => setTimeout(resolve, 10));
          }}
          const {{ phase }} = ground.status;
          ground.land([6, 2, 0], 6);
          while (ground.status.phase !== "presentable") {{
            drawn([]);
            await new Promise((resolve) => setTimeout(resolve, 10));
          }}
          ground.swap();
          screen_.visible = false;
          return [phase, gaps];
        }}"""
    )
    assert gaps == ["shown", 0]


def test_everything_at_once_in_every_look(shown: Page) -> None:
    """Fog, a plane, tones, lights and shadows with modes, a dimmed region, a wash, the slider."""
    everything = """
    scene.fog = new three.Fog(0xb9cdd8, 10, 60); renderer.toneMapping = three.ACESFilmicToneMapping;
    renderer.clippingPlanes = [new three.Plane(new three.Vector3(0, 0, -1), 8)];
    box.visible = true; sun.intensity = 3; ground.setShading(HAS_ALL);
    """
    far, cut = "placeAt(-12, 2)", "placeAt(8, 10)"
    for look in (
        "ground.setMode({kind: 'regions'}); ground.highlightRegion(0)",
        "ground.setMode({kind: 'slope'}); ground.setSplit(0.5); ground.markFresh()",
    ):
        bare = drawn(shown, look, far, DETAIL)
        seen = drawn(shown, f"{everything}; {look}", far, cut, DETAIL)
        assert_close(seen[1], SKY, 0)
        towards = np.abs(seen[0] - np.array(SKY)).mean()
        assert towards < np.abs(bare[0] - np.array(SKY)).mean(), look
        assert np.abs(seen[2] - bare[1]).mean() > 2, look
