"""Names are painted on the ground in the page, answered beside the service, and shown at once."""

from __future__ import annotations

import io
import math
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import numpy as np
import pytest
from browser.driven_viewer import DrivenViewer
from browser.watched_page import Watch, save_shot
from eventually import eventually
from faults.service import PROGRAM, Service
from PIL import Image
from pipeline.naming.named_ground import ground_at, is_dark, write_named_ground
from playwright.sync_api import Page, expect

from terraport_store import read_manifest, read_strokes

EYE: Final = (50.0, 130.0, 50.0)
FOV_DEG: Final = 55.0
ANNA, BEN, GUEST = (
    "anna-has-sixteen-letters",
    "ben-has-sixteen-letters",
    "guest-has-sixteen-letters",
)
DARK = (((30, 38), (38, 44)), ((20, 92), (32, 93)), ((70, 94), (82, 95)))
PALE = (((70, 20), (80, 25)), ((62, 60), (75, 70)), ((80, 40), (90, 45)))

OpenPage = Callable[..., tuple[Page, Watch]]


@pytest.fixture
def pit(tmp_path: Path) -> Path:
    (tmp_path / "scenes").mkdir()
    return write_named_ground(tmp_path / "scenes" / "pit")


@pytest.fixture
def service(pit: Path, tmp_path: Path) -> Iterator[Service]:
    tokens = tmp_path / "tokens"
    tokens.write_text(f"anna {ANNA} +teach\nben {BEN} +teach\nguest {GUEST}\n")
    with Service(pit.parent, tokens_file=tokens) as running:
        yield running


@pytest.fixture
def teacher(pit: Path) -> Iterator[subprocess.Popen[bytes]]:
    """What answers beside the service."""
    command = [sys.executable, "-c", PROGRAM, "teach", str(pit.parent), "--watch"]
    with subprocess.Popen(command, stderr=subprocess.PIPE) as process:
        yield process
        process.terminate()


def opened(service: Service, open_page: OpenPage, token: str, extra: str = "") -> DrivenViewer:
    page, _ = open_page(viewport={"width": 800, "height": 600})
    page.add_init_script(f"sessionStorage.setItem('terraport.token', '{token}')")
    viewer = DrivenViewer(page, service.url, "pit")
    viewer.open(extra)
    return viewer


def pixel(viewer: DrivenViewer, x: float, z: float) -> tuple[float, float]:
    """Where ground is in the page, seen straight from above, north up."""
    box = viewer.page.locator("#view").bounding_box()
    assert box is not None
    scale = box["height"] / 2 / math.tan(math.radians(FOV_DEG) / 2) / EYE[1]
    across, along = (x - EYE[0]) * scale, (z - EYE[2]) * scale
    return box["x"] + box["width"] / 2 + across, box["y"] + box["height"] / 2 + along


def paint(
    viewer: DrivenViewer, name: str, *strokes: tuple[tuple[int, int], tuple[int, int]]
) -> None:
    page = viewer.page
    page.locator("#brush-name").fill(name)
    page.locator("#brush-name").press("Tab")
    for (x, z), (to_x, to_z) in strokes:
        page.mouse.move(*pixel(viewer, x, z))
        page.mouse.down()
        page.mouse.move(*pixel(viewer, to_x, to_z), steps=6)
        page.mouse.up()


def test_what_is_painted_is_learned_shown_and_published(
    service: Service, open_page: OpenPage, pit: Path, teacher: subprocess.Popen[bytes]
) -> None:
    version = read_manifest(pit).version
    viewer = opened(service, open_page, ANNA)
    page = viewer.page
    viewer.look(EYE, 0.0, -89.9)
    page.locator("[data-tool='brush']").click()
    expect(page.locator("#brush-card")).to_be_visible()
    plain = np.asarray(
        Image.open(io.BytesIO(save_shot(page, "brush-before"))).convert("RGB"), float
    )
    paint(viewer, "tailings", *DARK)
    expect(page.locator("#brush-count")).to_have_text("3 strokes, 3 of them yours.")
    expect(page.locator("#brush-status")).to_contain_text("strokes of 1 names, expected 2")
    paint(viewer, "limestone", *PALE)
    expect(page.locator("#brush-status")).to_contain_text("Learned")
    expect(page.locator("#brush-legend li")).to_have_count(2)
    # The strokes lie where the mouse was, in who painted's name.
    kept = read_strokes(pit).strokes
    assert [one.who for one in kept] == ["anna"] * 6
    for one, (start, end) in zip(kept, (*DARK, *PALE), strict=True):
        assert one.line[0] == pytest.approx(start, abs=2.5)
        assert one.line[-1] == pytest.approx(end, abs=2.5)
    # The ground is shown in the colours of its names, at once.
    shown = np.asarray(
        Image.open(io.BytesIO(save_shot(page, "brush-taught"))).convert("RGB"), float
    )
    changed = np.abs(shown - plain).max(axis=2)
    for x, z in ((25, 50), (60, 30), (90, 70), (50, 95)):
        at = pixel(viewer, x, z)
        assert changed[int(at[1]) - 2 : int(at[1]) + 3, int(at[0]) - 2 : int(at[0]) + 3].max() > 15
    # Nobody paints any more: the names are the regions'.
    eventually(lambda: read_manifest(pit).version != version, 60)
    expect(page.locator("#brush-status")).to_have_text("Learned and published.")
    ground = ground_at(pit)
    dark = [ground.names.label(n) == "tailings" for n in range(len(ground.document["regions"]))]
    right = np.array(dark)[ground.region_of_face] == is_dark(
        ground.centres[:, 0], ground.centres[:, 2]
    )
    assert right.mean() > 0.97
    # The last stroke is taken back.
    page.locator("[data-action='brush-undo']").click()
    expect(page.locator("#brush-count")).to_have_text("5 strokes, 5 of them yours.")
    eventually(lambda: len(read_strokes(pit).strokes) == 5, 20)
    # The published names are a look: a colour each, and a legend that adds them up.
    shows_names(opened(service, open_page, ANNA, "&mode=names"))


def shows_names(viewer: DrivenViewer) -> None:
    page = viewer.page
    viewer.look(EYE, 0.0, -89.9)
    page.get_by_role("button", name="Panel").click()
    page.get_by_role("tab", name="Look").click()
    rows = page.locator("#legend li[data-name]")
    expect(rows).to_have_count(2)
    expect(rows.first).to_contain_text("limestone")  # the larger one
    viewer.look(EYE, 0.0, -89.9)
    shown = np.asarray(Image.open(io.BytesIO(save_shot(page, "brush-names"))).convert("RGB"), float)
    for name, x, z in (("tailings", 35, 40), ("limestone", 20, 70)):
        swatch = page.locator(f"#legend li[data-name='{name}'] .swatch")
        css = swatch.evaluate("element => getComputedStyle(element).backgroundColor")
        colour = np.array([float(n) for n in re.findall(r"[\d.]+", css)[:3]])
        at = pixel(viewer, x, z)
        ground = shown[int(at[1]) - 2 : int(at[1]) + 3, int(at[0]) - 2 : int(at[0]) + 3]
        mean = ground.mean(axis=(0, 1))
        cosine = mean @ colour / np.linalg.norm(mean) / np.linalg.norm(colour)
        assert cosine > 0.99, (name, mean, colour)


def test_ground_that_looks_like_two_names_is_striped(
    service: Service, open_page: OpenPage, pit: Path, teacher: subprocess.Popen[bytes]
) -> None:
    viewer = opened(service, open_page, ANNA)
    page = viewer.page
    viewer.look(EYE, 0.0, -89.9)
    page.locator("[data-tool='brush']").click()
    plain = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), float)
    # Dark ground has one name; pale ground, all of one look, is said to be two.
    paint(viewer, "tailings", *DARK)
    paint(viewer, "limestone", PALE[0], PALE[2])
    paint(viewer, "bench", PALE[1], ((60, 75), (75, 78)))
    expect(page.locator("#brush-legend li")).to_have_count(3)
    expect(page.locator("#brush-status")).to_contain_text("Learned")
    page.wait_for_timeout(1000)
    taught = np.asarray(
        Image.open(io.BytesIO(save_shot(page, "brush-unsure"))).convert("RGB"), float
    )
    changed = np.abs(taught - plain).max(axis=2) > 12

    def coloured(x0: float, z0: float, x1: float, z1: float) -> float:
        left, top = pixel(viewer, x0, z0)
        right, bottom = pixel(viewer, x1, z1)
        return float(changed[int(top) : int(bottom), int(left) : int(right)].mean())

    assert coloured(38, 35, 45, 45) > 0.95  # sure: the colour of its name without a gap
    assert 0.2 < coloured(56, 8, 94, 82) < 0.97  # unsure: every other stripe shows the ground


def test_two_paint_and_each_takes_back_their_own(
    service: Service, open_page: OpenPage, pit: Path
) -> None:
    anna, ben = opened(service, open_page, ANNA), opened(service, open_page, BEN)
    for viewer, name, stroke in ((anna, "tailings", DARK[0]), (ben, "limestone", PALE[0])):
        viewer.look(EYE, 0.0, -89.9)
        viewer.page.locator("[data-tool='brush']").click()
        paint(viewer, name, stroke)
        eventually(lambda name=name: name in {one.name for one in read_strokes(pit).strokes}, 20)
    expect(anna.page.locator("#brush-count")).to_have_text(
        "2 strokes by 2 people, 1 of them yours."
    )
    ben.page.locator("[data-action='brush-undo']").click()
    eventually(lambda: [one.who for one in read_strokes(pit).strokes] == ["anna"], 20)
    expect(ben.page.locator("[data-action='brush-undo']")).to_be_disabled()


def test_who_may_not_teach_has_no_brush(service: Service, open_page: OpenPage) -> None:
    viewer = opened(service, open_page, GUEST)
    expect(viewer.page.locator("button.icon-button[data-tool='measure']")).to_be_visible()
    expect(viewer.page.locator("[data-tool='brush']")).to_have_count(0)
    viewer.page.locator("#view").focus()
    viewer.page.keyboard.press("t")
    assert viewer.run("terraport.state.tool") == "land"
