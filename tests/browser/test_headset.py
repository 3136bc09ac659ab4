"""The viewer in an emulated headset, on the real service: teleports, turns, hands, comfort."""

from __future__ import annotations

import io
import math
import os
import random
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from browser.emulated_headset import IWER, EmulatedHeadset
from browser.small_scenes import SMALL
from browser.watched_page import Watch, save_shot
from faults.service import Service
from PIL import Image
from playwright.sync_api import Page

CANVAS_SIZE = (
    "(() => { const { width, height } = document.querySelector('canvas');"
    " return [width, height]; })()"
)

BLACK = 3
"""Brightest channel of a frame that counts as black."""


@pytest.fixture
def headset(open_page: Callable[..., tuple[Page, Watch]], server: Service) -> EmulatedHeadset:
    """A page with a scene and a headset, not yet entered."""
    if not IWER.is_file():
        if os.environ.get("TERRAPORT_BROWSER") == "required":
            pytest.fail("TERRAPORT_BROWSER=required, but the emulator is not installed (npm ci)")
        pytest.skip("the emulator is not installed (npm ci in client_sdk/web)")
    page, _ = open_page()
    emulated = EmulatedHeadset(page)
    emulated.open(f"{server.url}/#scene={SMALL}")
    return emulated


def _ground(headset: EmulatedHeadset, position: list[float]) -> float:
    """Height of what is shown, under a place."""
    hit: dict[str, Any] = headset.page.evaluate(
        "([x, y, z]) => terraport.cast([x, y + 1, z], [0, -1, 0])", position
    )
    height: float = hit["position"][1]
    return height


def _turned(degrees_from: float, degrees_to: float) -> float:
    """Clockwise from one azimuth to another, in (-180, 180]."""
    return 180.0 - (180.0 - (degrees_to - degrees_from)) % 360.0


def _check_eyes(picture: bytes) -> None:
    """Both eyes see the same place, from two places."""
    pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("L"), dtype=np.float64)
    half = pixels.shape[1] // 2
    left, right = pixels[:, :half], pixels[:, half : 2 * half]
    unlike = float(np.abs(left - right).mean())
    # Not one picture twice, nor two different ones: rows of one eye are rows of the other.
    assert 0.05 < unlike < 12
    assert float(left.std()) > 5
    assert unlike < float(np.abs(left[:-12] - right[12:]).mean())


def _land(headset: EmulatedHeadset) -> None:
    headset.press("right", "trigger", 1)
    headset.frames(3)
    assert headset.phase() == "aiming"
    headset.press("right", "trigger", 0)
    headset.until("terraport.status.phase === 'shown'")
    headset.until("terraport.headset.stats().phase === 'idle'")


def test_a_teleport_swaps_and_moves_in_one_black_frame(headset: EmulatedHeadset) -> None:
    headset.enter()
    assert headset.page.evaluate("terraport.headset.stats().frameRateHz") == 90
    before, facing = headset.standpoint()
    assert _ground(headset, before) == pytest.approx(before[1], abs=0.01)
    headset.point("right", pitch=-6, yaw=3)
    headset.press("right", "trigger", 1)
    headset.frames(4)
    assert headset.phase() == "aiming"
    assert 0 < headset.page.evaluate("terraport.headset.stats().casts") <= 24
    _check_eyes(save_shot(headset.page, "headset-aiming"))
    headset.trace()
    headset.press("right", "trigger", 0)
    headset.until("terraport.status.phase === 'shown'")
    headset.until("terraport.headset.stats().phase === 'idle'")
    headset.frames(2)
    frames = headset.traced()

    changes = [k for k, (a, b) in enumerate(pairwise(frames), 1) if a["digest"] != b["digest"]]
    assert len(changes) == 1
    (swap,) = changes
    assert frames[swap]["most"] <= BLACK
    # Black is left again only after that frame, and the move is in it, not before and not after.
    assert frames[swap + 1]["most"] <= BLACK
    assert frames[swap - 1]["standpoint"] != frames[swap]["standpoint"]
    for standpoint in (each["standpoint"] for each in frames[:swap]):
        assert standpoint["place"] == pytest.approx(before)
    assert frames[0]["most"] > 40
    assert frames[-1]["most"] > 40

    after, azimuth = headset.standpoint()
    ring = headset.page.evaluate("terraport.status.position")
    # The head, 0.36 m beside the middle of the play space, stands over the ring.
    assert (after[0], after[2]) == pytest.approx((ring[0], ring[2]), abs=1e-4)
    assert math.dist(before, after) > 3
    assert after[1] == pytest.approx(_ground(headset, after), abs=0.01)
    assert _turned(facing, azimuth) == pytest.approx(0, abs=1e-3)
    assert headset.page.evaluate("terraport.state.strayChanges") == 0
    save_shot(headset.page, "headset-landed")


def test_what_is_visible_does_not_depend_on_the_head(headset: EmulatedHeadset) -> None:
    headset.enter()
    headset.point("right", pitch=0)
    _land(headset)
    digest = headset.page.evaluate("terraport.visibleDigest")
    random_source = random.Random(5)
    headset.trace()
    for _ in range(24):
        at = (
            random_source.uniform(-2, 2),
            random_source.uniform(0.4, 2),
            random_source.uniform(-2, 2),
        )
        headset.head(*at, yaw=random_source.uniform(0, 360), pitch=random_source.uniform(-90, 90))
        headset.frames(1)
    frames = headset.traced()
    assert len(frames) >= 24
    assert {each["digest"] for each in frames} == {digest}
    assert headset.page.evaluate("terraport.state.strayChanges") == 0
    assert headset.page.evaluate("terraport.state.swaps") == 1


def test_the_thumbstick_turns_about_the_head_and_chooses_the_facing(
    headset: EmulatedHeadset,
) -> None:
    headset.enter()
    headset.head(1.2, 1.7, -0.8, yaw=25)
    headset.frames(2)
    before, facing = headset.standpoint()
    headset.trace()
    headset.push("left", 1, 0)
    headset.frames(6)
    headset.push("left", 0, 0)
    headset.frames(2)
    frames = headset.traced()
    position, azimuth = headset.standpoint()
    assert _turned(facing, azimuth) == pytest.approx(30, abs=1e-3)
    assert position == pytest.approx(before, abs=1e-4)
    turns = [
        k
        for k, (a, b) in enumerate(pairwise(frames), 1)
        if abs(_turned(a["standpoint"]["yawDeg"], b["standpoint"]["yawDeg"])) > 1
    ]
    assert len(turns) == 1
    turn = frames[turns[0]]
    assert turn["corners"] <= BLACK < 30 < turn["middle"]
    assert frames[0]["corners"] > 30
    assert frames[-1]["corners"] > 30

    # Pushed forward the stick aims, and its direction then is the facing after the landing.
    headset.point("left", pitch=-6, at=(-0.2, 1.3, -0.3))
    headset.push("left", 0, -1)
    headset.frames(3)
    assert headset.phase() == "aiming"
    headset.push("left", 1, 0)
    headset.frames(2)
    headset.push("left", 0, 0)
    headset.until("terraport.status.phase === 'shown'")
    headset.until("terraport.headset.stats().phase === 'idle'")
    _, chosen = headset.standpoint()
    assert _turned(azimuth, chosen) == pytest.approx(90, abs=1e-3)


def test_an_aim_is_called_off(headset: EmulatedHeadset) -> None:
    headset.enter()
    landing = headset.page.evaluate("terraport.status.landing")

    def aim() -> None:
        headset.point("right", pitch=-6)
        headset.press("right", "trigger", 1)
        headset.frames(3)
        assert headset.phase() == "aiming"

    def let_go() -> None:
        headset.press("right", "trigger", 0)
        headset.frames(3)
        assert headset.phase() == "idle"

    # By the grip.
    aim()
    headset.press("right", "squeeze", 1)
    headset.frames(3)
    assert headset.phase() == "idle"
    headset.press("right", "squeeze", 0)
    let_go()

    # By the second button.
    aim()
    headset.press("right", "b-button", 1)
    headset.frames(3)
    assert headset.phase() == "idle"
    headset.press("right", "b-button", 0)
    let_go()

    # By pointing at the sky.
    aim()
    headset.point("right", pitch=75)
    headset.frames(3)
    let_go()

    # By the headset's own menu in front of the page.
    aim()
    headset.page.evaluate("emulated.device.updateVisibilityState('visible-blurred')")
    headset.frames(3)
    assert headset.phase() == "idle"
    headset.page.evaluate("emulated.device.updateVisibilityState('visible')")
    let_go()

    # Recentred in the headset's own menu: nothing moves.
    headset.head(1.5, 1.65, -0.7, yaw=40)
    headset.frames(2)
    before, facing = headset.standpoint()
    headset.page.evaluate("emulated.device.recenter()")
    headset.frames(3)
    after, azimuth = headset.standpoint()
    assert after == pytest.approx(before, abs=1e-4)
    assert _turned(facing, azimuth) == pytest.approx(0, abs=1e-3)
    assert headset.page.evaluate("terraport.status.landing") == landing


def test_a_hand_teleports_by_pinching(headset: EmulatedHeadset) -> None:
    headset.page.evaluate("emulated.device.primaryInputMode = 'hand'")
    headset.enter()
    before, _ = headset.standpoint()
    headset.point("right", pitch=-8, kind="hands")
    headset.frames(2)
    headset.pinch("right", 1)
    headset.frames(4)
    assert headset.phase() == "aiming"
    save_shot(headset.page, "headset-hand")
    headset.pinch("right", 0)
    headset.until("terraport.status.phase === 'shown'")
    headset.until("terraport.headset.stats().phase === 'idle'")
    after, _ = headset.standpoint()
    assert math.dist(before, after) > 2


MENU: dict[str, tuple[float, float]] = {
    "overview": (635, 60),
    "pick": (515, 388),
    "measure": (690, 388),
    "leave": (500, 808),
}
"""Middles of buttons on the menu: its units, from its upper left corner (xr/menu-layout.ts)."""
MENU_SIZE = (1000, 880)
HEAD = (0.3, 1.65, 0.2)


def _open_menu(headset: EmulatedHeadset) -> None:
    headset.press("right", "a-button", 1)
    headset.frames(2)
    headset.press("right", "a-button", 0)
    headset.frames(2)


def _point_at_menu(headset: EmulatedHeadset, button: str) -> None:
    """Point from the head at a button: the menu hangs 0.75 m ahead of it and 0.22 m below."""
    x, y = MENU[button]
    lean = math.atan2(0.22, 0.75)
    right, up = (x - MENU_SIZE[0] / 2) * 0.0005, (MENU_SIZE[1] / 2 - y) * 0.0005
    away, height = 0.75 + up * math.sin(lean), up * math.cos(lean) - 0.22
    yaw = math.degrees(math.atan2(-right, away))
    pitch = math.degrees(math.atan2(height, math.hypot(right, away)))
    headset.point("right", pitch=pitch, yaw=yaw, at=HEAD)
    headset.frames(2)


def _click(headset: EmulatedHeadset) -> None:
    headset.press("right", "trigger", 1)
    headset.frames(2)
    headset.press("right", "trigger", 0)
    headset.frames(2)


def _choose(headset: EmulatedHeadset, button: str) -> None:
    _open_menu(headset)
    _point_at_menu(headset, button)
    _click(headset)


def test_the_overview_lands_far_away_in_one_teleport(headset: EmulatedHeadset) -> None:
    page = headset.page
    headset.enter()
    before, _ = headset.standpoint()
    digest = page.evaluate("terraport.visibleDigest")
    _choose(headset, "overview")
    headset.head(*HEAD, pitch=-30)
    # A corner of the model, 0.85 m ahead and 0.6 m below the eyes; the ground's place there.
    x0, y0, z0, x1, y1, z1 = page.evaluate("[...terraport.state.manifest.bounds]")
    scale = 0.9 / max(x1 - x0, z1 - z0)
    east, south = 0.3 * (x1 - x0), -0.3 * (z1 - z0)
    middle = [(x0 + x1) / 2, y0, (z0 + z1) / 2]
    ground = _ground(headset, [middle[0] + east, y1, middle[2] + south])
    # On the model, seen from the head, which looks north.
    on = (scale * east, scale * (ground - y0) - 0.6, scale * south - 0.85)
    headset.point(
        "right",
        pitch=math.degrees(math.atan2(on[1], math.hypot(on[0], on[2]))),
        yaw=math.degrees(math.atan2(-on[0], -on[2])),
        at=HEAD,
    )
    headset.frames(3)
    save_shot(page, "headset-overview")
    # A model is no ground: nothing of what is visible has changed.
    assert page.evaluate("terraport.visibleDigest") == digest
    assert page.evaluate("terraport.status.phase") == "idle"
    headset.trace()
    _click(headset)
    headset.until("terraport.status.phase === 'shown'")
    headset.until("terraport.headset.stats().phase === 'idle'")
    frames = headset.traced()
    changes = [k for k, (a, b) in enumerate(pairwise(frames), 1) if a["digest"] != b["digest"]]
    assert len(changes) == 1
    assert frames[changes[0]]["most"] <= BLACK
    after, _ = headset.standpoint()
    wanted = (middle[0] + east, middle[2] + south)
    # Where one can stand beside the place, within 12 m of it.
    assert math.dist((after[0], after[2]), wanted) < 12.5
    assert math.dist(before, after) > 40
    assert after[1] == pytest.approx(_ground(headset, after), abs=0.01)
    assert page.evaluate("terraport.state.strayChanges") == 0
    save_shot(page, "headset-overview-landed")


def test_picks_and_measures_by_the_trigger(headset: EmulatedHeadset) -> None:
    page = headset.page
    headset.enter()
    _choose(headset, "pick")
    assert page.evaluate("terraport.state.tool") == "pick"
    save_shot(page, "headset-menu-tools")
    _open_menu(headset)
    headset.point("right", pitch=-14, yaw=4)
    headset.press("right", "trigger", 1)
    headset.frames(3)
    save_shot(page, "headset-probe")
    landing = page.evaluate("terraport.status.landing")
    headset.press("right", "trigger", 0)
    headset.until("terraport.state.picked?.answer")
    picked = page.evaluate("terraport.state.picked.place")
    assert picked[1] == pytest.approx(_ground(headset, picked), abs=0.05)
    headset.frames(3)
    save_shot(page, "headset-picked")

    _choose(headset, "measure")
    _open_menu(headset)
    for pitch, yaw in ((-18, 20), (-9, -10)):
        headset.point("right", pitch=pitch, yaw=yaw)
        headset.frames(2)
        _click(headset)
    measured = page.evaluate("terraport.state.measured")
    assert len(measured) == 2
    assert math.dist(*measured) > 1
    # Whoever picks and measures goes nowhere.
    assert page.evaluate("terraport.status.landing") == landing
    headset.frames(2)
    save_shot(page, "headset-measured")


def test_the_page_gets_its_camera_back(headset: EmulatedHeadset) -> None:
    page = headset.page
    size = page.evaluate(CANVAS_SIZE)
    headset.enter()
    headset.point("right", pitch=0)
    _land(headset)
    position, azimuth = headset.standpoint()
    digest = page.evaluate("terraport.visibleDigest")
    # Out by the menu, as a user would.
    _open_menu(headset)
    headset.point("right", pitch=-12, at=(0.3, 1.45, 0.2))
    headset.frames(3)
    save_shot(page, "headset-menu")
    _point_at_menu(headset, "leave")
    headset.press("right", "trigger", 1)
    headset.until("terraport.headset === null")
    headset.until("terraport.state.presenting === false")
    assert size == page.evaluate(CANVAS_SIZE)
    assert page.evaluate("terraport.visibleDigest") == digest
    state = page.evaluate("terraport.state")
    assert state["view"] == "walk"
    assert page.evaluate("terraport.status.position")[0] == pytest.approx(position[0], abs=0.01)
    assert 0 <= azimuth < 360
    # And in again.
    headset.press("right", "trigger", 0)
    # The emulator puts the canvas back as the last of its parent, over the page's bars.
    page.locator("#enter-headset").dispatch_event("click")
    headset.until("!!terraport.headset && terraport.headset.standpoint !== null")
    headset.frames(3)
    again, _ = headset.standpoint()
    assert (again[0], again[2]) == pytest.approx((position[0], position[2]), abs=0.2)
