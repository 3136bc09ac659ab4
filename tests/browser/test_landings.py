"""Landings in the page: what is loaded, what is shown, and how one comes back to a place."""

from __future__ import annotations

import time
from collections.abc import Callable
from urllib.parse import urlsplit

import numpy as np
import pytest
from browser.driven_viewer import DrivenViewer, payload_bytes
from browser.small_scenes import SMALL
from browser.watched_page import Watch
from faults.service import Service
from playwright.sync_api import Page, expect

import terraport.sync

POSITION = (0.0, 2.0, 0.0)
NEXT = (30.0, 2.0, 10.0)
RADIUS_M = 50.0


@pytest.fixture
def viewer(page: Page, server: Service) -> DrivenViewer:
    opened = DrivenViewer(page, server.url, SMALL)
    opened.open()
    return opened


def test_land_hop_and_return(viewer: DrivenViewer, server: Service) -> None:
    before = payload_bytes(server.url)
    assert viewer.visible == []
    first = viewer.land(POSITION, RADIUS_M)
    hop = viewer.land(NEXT, RADIUS_M)
    back = viewer.land(POSITION, RADIUS_M)

    assert first["phase"] == hop["phase"] == back["phase"] == "shown"
    assert first["payloadBytes"] == first["plan"]["totalBytes"] > 0
    # The hop needs what is new alone; the way back nothing at all.
    assert 0 < hop["payloadBytes"] < hop["plan"]["totalBytes"]
    assert back["payloadBytes"] == 0
    assert first["digest"] == back["digest"] != hop["digest"]
    assert first["visible"] == back["visible"]
    assert back["visible"] == sorted(row["segment"] for row in back["plan"]["show"])
    assert not any(row["follows"] for row in back["plan"]["show"])
    # The server's own counter says the same.
    sent = payload_bytes(server.url)
    assert sent["land"] - before["land"] == first["payloadBytes"] + hop["payloadBytes"]
    assert sent["prefetch"] == before["prefetch"]
    assert viewer.stream["repeatedBytes"] == 0
    assert viewer.run("terraport.state.strayChanges") == 0


FRAMES_OF_A_RETURN = """async ([place, radiusM]) => {
  const digest = terraport.visibleDigest;
  let frames = 0, isKnown = null;
  const count = () => {
    frames += 1;
    if (terraport.visibleDigest === digest) requestAnimationFrame(count);
    else isKnown = terraport.status.readyMs !== null;
  };
  requestAnimationFrame(count);
  const { createdBytes } = terraport.stats.gpu;
  const { phase, payloadBytes, readyMs } = await terraport.land(place, radiusM);
  const uploadedBytes = terraport.stats.gpu.createdBytes - createdBytes;
  return { phase, payloadBytes, frames, isKnown, readyMs, uploadedBytes };
}"""


def test_a_return_shows_within_two_frames(viewer: DrivenViewer) -> None:
    """What a landing hides stays on the GPU, and what ``ready`` said holds again: nobody waits."""
    far = (90.0, 2.0, 40.0)
    viewer.land(POSITION, 25.0)
    viewer.land(far, 25.0)
    for place in (POSITION, far) * 3:
        back = viewer.run(FRAMES_OF_A_RETURN, [list(place), 25.0])
        assert back["phase"] == "shown"
        assert (back["payloadBytes"], back["uploadedBytes"]) == (0, 0)
        assert back["frames"] <= 2
        # The promise waits for the service's word, the picture does not.
        assert back["readyMs"] is not None


def test_what_is_drawn_is_what_the_sdk_shows(viewer: DrivenViewer, server: Service) -> None:
    """Segments and hidden base faces, as the GPU has them, beside the reference client's."""

    with terraport.sync.connect(f"{server.url}/scenes/{SMALL}") as session:
        session.land(POSITION, radius_m=RADIUS_M).ready(30)
        ready_segments = session.land(NEXT, radius_m=RADIUS_M).ready(30)
        segments, base = sorted(segment.id for segment in ready_segments), session.base()
        hidden_faces = session.hidden_faces

    viewer.land(POSITION, RADIUS_M)
    shown = viewer.land(NEXT, RADIUS_M)
    assert shown["visible"] == segments

    faces = {row["segment"]: row["faces"] for row in shown["plan"]["show"]}
    hidden = viewer.hidden_on_gpu(len(base.mesh.faces))
    assert hidden.any()
    assert np.array_equal(hidden, hidden_faces)
    # From far above everything is in view: each segment is drawn once, whole, and the base once.
    calls = viewer.look((0.0, 600.0, 0.0), 0.0, -90.0)
    counts = sorted(count for _, count in calls)
    assert len(counts) == len(segments) + 1
    assert counts[-1] == len(base.mesh.faces) * 3
    assert counts[:-1] == sorted(faces[segment] * 3 for segment in segments)


def _until_nothing_follows(server: Service) -> dict[str, int]:
    """Return the payload counters once the service has sent all of an aim: nothing says when."""
    counted = payload_bytes(server.url)
    for _ in range(100):
        time.sleep(0.5)
        before, counted = counted, payload_bytes(server.url)
        if counted == before:
            return counted
    raise AssertionError(f"payload still follows after 50 s: {counted}")


def test_an_aim_leaves_nothing_to_load(viewer: DrivenViewer, server: Service) -> None:
    before = payload_bytes(server.url)
    viewer.page.locator("canvas#view").focus()
    viewer.page.keyboard.press("Space")
    viewer.until("terraport.state.aim?.bytes > 0")
    aimed = _until_nothing_follows(server)
    assert aimed["prefetch"] > before["prefetch"]
    assert viewer.visible == []  # nothing is shown before the user lands

    viewer.page.keyboard.press("Enter")
    viewer.until("terraport.status.phase === 'shown'")
    assert viewer.run("terraport.status.payloadBytes") == 0
    assert viewer.visible != []
    assert payload_bytes(server.url)["land"] == before["land"]
    viewer.until("terraport.stats.stream?.aimHits === 1")


def test_a_click_lands_and_takes_one_there(viewer: DrivenViewer) -> None:
    canvas = viewer.page.locator("canvas#view")
    canvas.click(position={"x": 320, "y": 8})
    assert "no ground" in viewer.notice("ground")
    assert viewer.run("terraport.status.phase") == "idle"

    canvas.click(position={"x": 320, "y": 200})
    viewer.until("terraport.state.gain !== null")
    assert viewer.visible != []
    expect(viewer.page.locator("[data-notice='ground']")).to_have_count(0)
    expect(viewer.page.locator("#gain")).to_contain_text("times the triangles")
    assert viewer.run("terraport.state.view") == "walk"
    stand = viewer.run(SLOPE_AT, _feet(viewer))
    assert stand["degrees"] <= 50
    assert not stand["inRock"]


def test_before_and_after(viewer: DrivenViewer) -> None:
    """Left of the line the base is drawn whole, right of it what the landing shows."""
    page = viewer.page
    viewer.land(POSITION, RADIUS_M)
    viewer.until("terraport.state.gain !== null")
    eye = (0.0, 200.0, 0.0)
    apart = len(viewer.look(eye, 0.0, -90.0))
    digest = viewer.digest
    page.locator("canvas#view").focus()
    page.keyboard.press("KeyC")
    expect(page.get_by_label("Before and after: where")).to_be_visible()
    assert len(viewer.look(eye, 0.0, -90.0)) == apart + 1
    page.keyboard.press("KeyC")
    assert len(viewer.look(eye, 0.0, -90.0)) == apart
    assert viewer.digest == digest
    assert viewer.run("terraport.state.strayChanges") == 0


def test_a_press_aims_and_its_end_lands(viewer: DrivenViewer) -> None:
    mouse = viewer.page.mouse
    mouse.move(320, 200)
    mouse.down()
    viewer.until("terraport.state.aim !== null")
    mouse.move(324, 203)
    mouse.up()
    viewer.until("terraport.status.phase === 'shown'")
    assert viewer.visible != []


def test_a_copied_link_leads_to_the_same(
    open_page: Callable[..., tuple[Page, Watch]], server: Service
) -> None:
    page, _ = open_page(permissions=["clipboard-read", "clipboard-write"])
    viewer = DrivenViewer(page, server.url, SMALL)
    viewer.open("&mode=slope")
    viewer.land(NEXT, RADIUS_M)
    page.get_by_role("button", name="Walk").click()
    page.get_by_role("button", name="Panel").click()
    page.get_by_role("button", name="Copy a link to this place").click()
    expect(page.locator("#live")).to_contain_text("copied")
    link = str(viewer.run("navigator.clipboard.readText()"))
    assert link.startswith(server.url)
    assert "token" not in link

    other_page, _ = open_page()
    other = DrivenViewer(other_page, server.url, SMALL)
    hash_ = urlsplit(link).fragment
    other.open(hash_.removeprefix(f"scene={SMALL}"))
    other.until("terraport.status.phase === 'shown'")
    assert other.visible == viewer.visible
    assert other.digest == viewer.digest
    assert other.run("terraport.state.view") == "walk"
    assert other.run("terraport.state.mode.kind") == "slope"


def test_back_and_forward_land(viewer: DrivenViewer) -> None:
    first = viewer.land(POSITION, RADIUS_M)
    viewer.land(NEXT, RADIUS_M)
    viewer.until(  # the history has it a moment later
        f"parseFloat(new URLSearchParams(location.hash.slice(1)).get('at')) === {NEXT[0]}"
    )
    viewer.page.go_back()
    viewer.until("terraport.status.landing === 3 && terraport.status.phase === 'shown'")
    assert set(viewer.visible) >= set(first["visible"])
    assert viewer.run("terraport.status.payloadBytes") == 0
    viewer.page.go_forward()
    viewer.until("terraport.status.landing === 4 && terraport.status.phase === 'shown'")
    assert viewer.run("terraport.status.position[0]") == NEXT[0]


def test_a_kept_place_comes_back(viewer: DrivenViewer) -> None:
    page = viewer.page
    first = viewer.land(POSITION, RADIUS_M)
    page.get_by_role("button", name="Panel").click()
    page.get_by_role("tab", name="Places").click()
    page.get_by_label("Name of this place").fill("The floor")
    page.get_by_role("button", name="Keep", exact=True).click()
    viewer.land(NEXT, RADIUS_M)
    viewer.until("location.hash.includes('at=30,')")

    page.reload()
    viewer.until("window.terraport?.status.phase === 'shown'")
    page.get_by_role("button", name="Panel").click()
    page.get_by_role("tab", name="Places").click()
    page.get_by_role("button", name="The floor", exact=True).click()
    viewer.until("terraport.status.landing === 2 && terraport.status.phase === 'shown'")
    assert set(viewer.visible) >= set(first["visible"])


def test_a_reload_loads_nothing_twice(viewer: DrivenViewer, server: Service) -> None:
    first = viewer.land(POSITION, RADIUS_M)
    viewer.until(
        "caches.open('terraport-payload-2').then((cache) => cache.keys())"
        ".then((bundles) => bundles.length > 0)"
    )
    viewer.until("location.hash.includes('at=0,')")
    before = payload_bytes(server.url)
    viewer.page.reload()
    viewer.until("window.terraport?.status.phase === 'shown'")
    assert viewer.visible == first["visible"]
    assert viewer.digest == first["digest"]
    assert payload_bytes(server.url) == before


FIND_WALL = """(eye) => {
  for (let azimuth = 0; azimuth < 360; azimuth += 3) {
    const [dx, dz] = [Math.sin(azimuth * Math.PI / 180), -Math.cos(azimuth * Math.PI / 180)];
    const hit = terraport.cast(eye, [dx, 0, dz]);
    if (hit === null || Math.abs(hit.normal[1]) > 0.45 || hit.distanceM < 12) continue;
    const [x, y, z] = hit.position;
    const isSteepAt = (height) => {
      const at = terraport.cast([x - 8 * dx, height, z - 8 * dz], [dx, 0, dz]);
      return at !== null && Math.abs(at.normal[1]) <= 0.45 && Math.abs(at.distanceM - 8) < 3;
    };
    if (![y - 2, y - 1, y + 1, y + 2].every(isSteepAt)) continue;
    return {position: hit.position, azimuth, before: [x - 8 * dx, y, z - 8 * dz]};
  }
  return null;
}"""
"""A wall, steep from 2 m below to 2 m above an eye, its azimuth, and a place 8 m before it."""

SLOPE_AT = """([x, y, z]) => {
  const heights = [[0.4, 0], [-0.4, 0], [0, 0.4], [0, -0.4]].map(
    ([dx, dz]) => terraport.cast([x + dx, y + 1, z + dz], [0, -1, 0])?.position[1] ?? NaN);
  const rise = Math.hypot(heights[0] - heights[1], heights[2] - heights[3]) / 0.8;
  const above = terraport.cast([x, y + 0.5, z], [0, 1, 0]);
  return {degrees: Math.atan(rise) * 180 / Math.PI, inRock: above !== null && !above.isOuter};
}"""
"""How steep it is under two feet, and whether rock is all around."""


FEET = """() => {
  const fields = new URLSearchParams(location.hash.slice(1));
  const numbers = (name) => fields.get(name)?.split(',').map(Number) ?? null;
  const at = numbers('at');
  const isThere = at !== null && fields.get('view') === 'walk'
    && Math.abs(at[0] - terraport.state.landed.place[0]) < 0.01;
  return isThere ? numbers('focus') ?? at : null;
}"""
"""Where the walker stands, once the address has his landing; within a centimetre."""


def _feet(viewer: DrivenViewer) -> list[float]:
    viewer.until(f"({FEET})() !== null")
    feet: list[float] = viewer.run(FEET)
    return feet


def test_a_click_on_a_wall_leads_to_where_one_can_stand(viewer: DrivenViewer) -> None:
    viewer.land(POSITION, RADIUS_M)
    viewer.page.get_by_role("button", name="Walk").click()
    wall = viewer.run(FIND_WALL, [0.0, 4.0, 0.0])
    assert viewer.run(SLOPE_AT, wall["position"])["degrees"] > 50
    viewer.look(tuple(wall["before"]), wall["azimuth"], 0.0)
    canvas = viewer.page.locator("canvas#view")
    box = canvas.bounding_box()
    assert box is not None
    middle = {"x": box["width"] / 2, "y": box["height"] / 2}
    canvas.click(position=middle)
    viewer.until("terraport.status.landing === 2 && terraport.status.phase === 'shown'")
    stand = viewer.run(SLOPE_AT, _feet(viewer))
    assert stand["degrees"] <= 50
    assert not stand["inRock"]
    assert viewer.run("terraport.state.view") == "walk"


def test_a_link_that_leads_out_of_the_scene_says_so(viewer: DrivenViewer) -> None:
    viewer.land(POSITION, RADIUS_M)
    before = viewer.digest
    viewer.run("location.hash = '#scene=small&at=900,2,0&radius=60&view=walk'")
    notice = viewer.notice("landing")
    assert "outside the scene" in notice
    assert "more than the radius of 60 m" in notice
    assert viewer.digest == before
    assert viewer.run("terraport.status.landing") == 1
    assert viewer.run("terraport.state.view") == "orbit"
    viewer.land(NEXT, RADIUS_M)
    expect(viewer.page.locator("[data-notice='landing']")).to_have_count(0)
