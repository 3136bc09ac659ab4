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
from PIL import Image
from playwright.sync_api import Page, expect

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
