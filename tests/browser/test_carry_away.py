"""What a person takes from the page: the profile of a measured path, the picture."""

from __future__ import annotations

import csv
from pathlib import Path

import ezdxf
import numpy as np
import pytest
from browser.driven_viewer import DrivenViewer
from browser.small_scenes import SMALL
from faults.service import Service
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Error, Page, expect

from terraport_store import Scene


@pytest.fixture
def viewer(page: Page, server: Service) -> DrivenViewer:
    opened = DrivenViewer(page, server.url, SMALL)
    opened.open()
    opened.land((0.0, 2.0, 0.0), 50.0)
    return opened


def save(page: Page, action: str, folder: Path) -> Path:
    with page.expect_download() as saving:
        page.locator(f"[data-action={action}]").click()
    path = folder / saving.value.suggested_filename
    saving.value.save_as(path)
    return path


def test_a_measured_path_has_a_profile(viewer: DrivenViewer, scenes: Path, tmp_path: Path) -> None:
    page = viewer.page
    viewer.look((0.0, 60.0, 40.0), 0.0, -60.0)
    page.keyboard.press("m")
    page.keyboard.press("i")
    box = page.locator("#view").bounding_box()
    assert box is not None
    for share in (0.4, 0.6):
        page.mouse.click(box["x"] + share * box["width"], box["y"] + 0.5 * box["height"])
    viewer.until("terraport.state.measured.length === 2")
    expect(page.locator("#profile")).to_be_visible()
    page.screenshot(path=tmp_path / "profile.png")

    text = save(page, "save-profile-csv", tmp_path).read_text(encoding="utf-8")
    rows = list(csv.reader(text.splitlines()))
    assert rows[0] == ["line", "distance", "easting", "northing", "height"]
    table = np.array(rows[1:], dtype=np.float64)
    assert len(table) > 100
    # Ends of the path, in the survey's coordinates.
    with Scene.open(scenes / SMALL) as scene:
        origin = np.array(scene.manifest.origin)
    measured = np.array(viewer.run("terraport.state.measured"))
    clicked = origin + measured[:, [0, 2, 1]] * [1, -1, 1]
    assert np.abs(table[[0, -1], 2:4] - clicked[:, :2]).max() < 0.001
    assert np.abs(table[[0, -1], 4] - clicked[:, 2]).max() < 0.05
    assert table[-1, 1] == pytest.approx(np.hypot(*np.diff(clicked[:, :2], axis=0)[0]), abs=0.001)

    drawing = ezdxf.readfile(save(page, "save-profile-dxf", tmp_path))
    assert not drawing.audit().has_errors
    where = drawing.modelspace().query('POLYLINE[layer=="SECTION"]')
    points = np.concatenate([[vertex.dxf.location for vertex in line.vertices] for line in where])
    assert np.abs(points - table[:, 2:5]).max() < 1e-9
    drawn = drawing.modelspace().query('POLYLINE[layer=="PROFILE"]')
    assert sum(len(line.vertices) for line in drawn) == len(table)
    assert drawing.layers.get("PROFILE").is_off()


def test_the_picture_is_what_is_shown(viewer: DrivenViewer, tmp_path: Path) -> None:
    page = viewer.page
    viewer.look((0.0, 60.0, 40.0), 0.0, -60.0)
    page.keyboard.press("i")
    picture = np.asarray(Image.open(save(page, "save-picture", tmp_path)).convert("RGB"), float)
    shot_path = tmp_path / "shot.png"
    page.screenshot(path=shot_path)
    shot = np.asarray(Image.open(shot_path).convert("RGB"), float)
    # The middle of the picture, where nothing of the page lies over it.
    box = page.locator("#view").bounding_box()
    assert box is not None
    assert picture.shape[:2] == (round(box["height"]), round(box["width"]))
    rows = slice(int(0.3 * box["height"]), int(0.45 * box["height"]))
    columns = slice(int(0.55 * box["width"]), int(0.7 * box["width"]))
    top, left = round(box["y"]), round(box["x"])
    seen = shot[top : top + picture.shape[0], left : left + picture.shape[1]]
    assert picture[rows, columns].std() > 5
    assert np.abs(picture[rows, columns] - seen[rows, columns]).mean() < 4


def test_the_picture_has_the_labels_of_a_measurement(viewer: DrivenViewer, tmp_path: Path) -> None:
    """Pins and lengths are where the page has them."""
    page = viewer.page
    viewer.look((0.0, 60.0, 40.0), 0.0, -60.0)
    page.keyboard.press("m")
    box = page.locator("#view").bounding_box()
    assert box is not None
    for share in (0.35, 0.6):
        page.mouse.click(box["x"] + share * box["width"], box["y"] + 0.5 * box["height"])
    viewer.until("document.querySelectorAll('.label[data-kind=measure]').length === 2")
    page.keyboard.press("i")
    page.click("#tab-landing")
    picture = Image.open(save(page, "save-picture", tmp_path)).convert("RGB")
    pin = page.locator(".label[data-kind=measure]").first.bounding_box()
    length = page.locator(".label[data-kind=length]").bounding_box()
    view = page.locator("#view").bounding_box()
    assert pin is not None
    assert length is not None
    assert view is not None
    scale = picture.width / view["width"]

    def colour(x: float, y: float) -> NDArray[np.float64]:
        at = round((x - view["x"]) * scale), round((y - view["y"]) * scale)
        return np.array(picture.getpixel(at), np.float64)

    middle = colour(pin["x"] + pin["width"] / 2, pin["y"] + pin["height"] / 2)
    assert np.abs(middle - [0xE0, 0x21, 0x8A]).max() < 40
    # The box of the length is dark beside its words, which are white.
    left, y = length["x"], length["y"] + length["height"] / 2
    assert colour(left + 4, y).max() < 90
    row = [colour(left + x, y).min() for x in np.arange(6, length["width"] - 6, 0.5)]
    assert max(row) > 180


def test_a_mode_is_an_object_or_its_text_and_nothing_else(viewer: DrivenViewer) -> None:
    for given, kind in (
        ("'slope'", "slope"),
        ("'attribute:grade'", "attribute"),
        ("{kind: 'regions'}", "regions"),
        ("{kind: 'attribute', name: 'grade', min: 0, max: 1}", "attribute"),
    ):
        viewer.run(f"terraport.setMode({given})")
        assert viewer.run("terraport.state.mode.kind") == kind
    for wrong in (
        "'gold'",
        "'attribute:gold'",
        "{kind: 'gold'}",
        "{kind: 'toString'}",
        "{kind: 'attribute', name: 'gold', min: 0, max: 1}",
        "{kind: 'attribute', name: 'grade'}",
        "null",
        "undefined",
        "7",
    ):
        script = "(() => { try { terraport.setMode(%s); return 'taken'; }"
        refusal = viewer.run((script + " catch (error) { return error.message; } })()") % wrong)
        assert "expected one of colour, regions" in refusal, wrong
        assert "attribute:grade" in refusal
    assert viewer.run("terraport.state.mode.name") == "grade"
    for call in ("setView('fly')", "on('landed', () => {})"):
        with pytest.raises(Error, match="expected"):
            viewer.run(f"terraport.{call}")
