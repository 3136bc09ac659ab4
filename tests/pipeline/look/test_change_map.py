"""What the last survey changed, in the report: a picture and volumes that add up."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from terraport_pipeline.engines.palettes import DIVERGING_STOPS, NO_VALUE, diverging_colours
from terraport_pipeline.geometry.regions.region_changes import ChangeMap
from terraport_pipeline.model import Mesh
from terraport_pipeline.report.change_map import (
    change_colours,
    change_facts,
    change_span_m,
    find_change_map,
)
from terraport_pipeline.report.picture import PictureOptions
from terraport_pipeline.report.report import ReportOptions, write_report
from terraport_store import Scene

COUNTS = {"cut_m3": 120.0, "fill_m3": 30.0, "changed_blocks": 4}
CELL_M = 5.0
SMALL = ReportOptions(PictureOptions(320, 180, 1), rays=0)


def volumes(cut: float, fill: float = 0.0, area: float = 10.0) -> dict[str, float]:
    return {"cut_m3": cut, "fill_m3": fill, "area_m2": area, "uncertainty_m3": 0.1 * area}


DOCUMENT = {
    "change": {"whole": volumes(120.0, 30.0, 60.0), "beyond": volumes(15.0, 0.0, 5.0)},
    "next_stable_id": 9,
    "regions": [
        {"id": 0, "stable_id": 4, "change": volumes(5.0, 30.0, 15.0)},
        {"id": 1, "stable_id": 8, "label": "pit <old>", "change": volumes(100.0, 0.0, 40.0)},
    ],
}


def save_raster(work: Path, *, depth_m: float = 3.0) -> None:
    """A hole of 30 m by 30 m in a scene of 100 m, and a corner of doubtful ground."""
    folder = work / "renew"
    folder.mkdir(parents=True)
    dz_m = np.full((20, 20), 0.02, np.float32)
    moved = np.zeros((20, 20), np.bool_)
    dz_m[3:9, 3:9], moved[3:9, 3:9] = -depth_m, True
    dz_m[12:18, 3:9], moved[12:18, 3:9] = 0.05, True
    np.save(folder / "change-dz.npy", dz_m)
    np.save(folder / "change-lod.npy", np.full((20, 20), 0.1, np.float32))
    np.save(folder / "change-moved.npy", moved)
    raster = {
        "low_m": [0.0, 0.0], "cell_m": CELL_M, "shape": [20, 20], "registration_m": 0.05,
    }  # fmt: skip
    record = {"values": {"raster": raster}, "facts": {"counts": COUNTS}}
    (folder / "stage.json").write_text(json.dumps(record))


@pytest.fixture(scope="module")
def renewed(write_scene, model, detail, base, tmp_path_factory) -> Path:
    """A scene that was built over another, with its work directory."""
    scene = tmp_path_factory.mktemp("renewed") / "ground"
    stages = ({"name": "read", "counts": {}}, {"name": "renew", "counts": COUNTS})
    write_scene(scene, model, detail, base, regions=DOCUMENT, stages=stages)
    save_raster(scene.parent / ".ground.work")
    return scene


def found(scene: Path) -> ChangeMap | None:
    with Scene.open(scene) as opened:
        return find_change_map(opened)


def test_the_map_is_found_beside_the_scene(renewed: Path) -> None:
    change = found(renewed)
    assert change is not None
    assert (change.cell_m, change.registration_m, int(change.counted.sum())) == (CELL_M, 0.05, 72)


def test_a_first_survey_has_no_map(scene_path: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(scene_path, tmp_path / "ground")
    save_raster(tmp_path / ".ground.work")
    assert found(copy) is None


@pytest.mark.parametrize("damage", ["other", "gone", "cut", "no json", "shape"])
def test_a_map_of_another_build_is_not_taken(renewed: Path, tmp_path: Path, damage: str) -> None:
    copy = shutil.copytree(renewed, tmp_path / "ground")
    folder = shutil.copytree(renewed.parent / ".ground.work", tmp_path / ".ground.work") / "renew"
    record = json.loads((folder / "stage.json").read_text())
    if damage == "other":
        record["facts"]["counts"]["cut_m3"] = 120.5
    if damage == "shape":
        record["values"]["raster"]["shape"] = [20, 21]
    (folder / "stage.json").write_text("[" if damage == "no json" else json.dumps(record))
    if damage == "gone":
        (folder / "change-lod.npy").unlink()
    if damage == "cut":
        (folder / "change-dz.npy").write_bytes(b"")
    assert found(copy) is None


def test_faces_over_the_hole_are_red_and_all_others_grey(renewed: Path, detail) -> None:
    change = found(renewed)
    assert change is not None
    span_m = change_span_m(change)
    assert span_m == 3.0
    mesh = Mesh(detail.vertices, detail.faces, detail.vertices, detail.colours, {})
    colours = change_colours(change, mesh, span_m)
    x, z = (mesh.vertices[:, axis][mesh.faces].mean(axis=1) for axis in (0, 2))
    inside = (x > 15) & (x < 45) & (z > 15) & (z < 45)
    assert (colours[inside] == [0x67, 0x00, 0x1F]).all()
    assert (colours[~inside] == NO_VALUE).all()


def test_rise_is_blue_and_nothing_is_pale() -> None:
    hexes = ["#" + bytes(row).hex() for row in diverging_colours(np.array([-9.0, 0.0, 2.0]), 2.0)]
    assert hexes == [DIVERGING_STOPS[0], "#f7f7f7", DIVERGING_STOPS[-1]]
    assert diverging_colours(np.array([np.nan]), 2.0).tolist() == [list(NO_VALUE)]


def test_rows_are_largest_first_and_add_up() -> None:
    rows = [
        {"region": 0, "stable_id": 4, "label": ""},
        {"region": 1, "stable_id": 8, "label": "pit"},
    ]
    facts = change_facts(DOCUMENT, rows, has_map=True)
    assert facts is not None
    assert [row["name"] for row in facts.rows] == ["8", "4", "below no region", "all"]
    for name in ("cut", "fill", "uncertainty", "area"):
        *pieces, whole = (float(row[name]) for row in facts.rows)
        assert sum(pieces) == pytest.approx(whole)
    assert facts.rows[1]["net"] == "+25.0"


def test_many_regions_are_one_row_behind_the_largest() -> None:
    regions = [{"id": n, "change": volumes(float(n))} for n in range(30)]
    rows = [{"region": n, "stable_id": None, "label": ""} for n in range(30)]
    document = {"change": {"whole": volumes(435.0)}, "regions": regions}
    facts = change_facts(document, rows, has_map=False)
    assert facts is not None
    assert [row["name"] for row in facts.rows[:2]] == ["29", "28"]
    assert facts.rows[-2]["name"] == "10 others"
    assert sum(float(row["cut"]) for row in facts.rows[:-1]) == 435.0


@pytest.mark.parametrize("change", [None, 3, []])
def test_without_volumes_there_is_no_table(change: object) -> None:
    assert change_facts({"change": change, "regions": []}, [], has_map=False) is None


@pytest.fixture(scope="module")
def page(renewed: Path, tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("page") / "page.html"
    result = write_report(renewed, path, SMALL)
    assert {"change", "change-above"} <= set(result.pictures)
    return path.read_text()


def shown(page: str, key: str) -> np.ndarray:
    """Pixels of one picture."""
    figure = page[page.index(f'id="picture-{key}"') :]
    data = re.search(r'data:image/jpeg;base64,([^"]+)', figure)
    assert data is not None
    return np.array(Image.open(io.BytesIO(base64.b64decode(data[1])))).astype(int)


def is_red(image: np.ndarray) -> np.ndarray:
    red, green, blue = (image[..., channel] for channel in range(3))
    return (red > 1.5 * green) & (red > 1.5 * blue) & (red > 40)


def test_the_map_is_red_where_the_ground_sank_and_grey_elsewhere(page: str) -> None:
    """North is up: the hole is 15 m to 45 m from the west, and as far from the north."""
    image = shown(page, "change-above")
    red = is_red(image)
    metres = 180 / (100 * 1.06)  # pixels; the margin is 3 % on each side
    left, top = 160 - 50 * metres, 90 - 50 * metres
    hole = np.s_[
        round(top + 17 * metres) : round(top + 43 * metres),
        round(left + 17 * metres) : round(left + 43 * metres),
    ]
    assert red[hole].mean() > 0.95
    assert red.sum() == pytest.approx((30 * metres) ** 2, rel=0.1)
    ground = np.s_[round(top + 4) : round(top + 98 * metres), round(left + 4) : 235]
    grey = ~red[ground] & (np.ptp(image[ground], axis=-1) < 30)
    assert (red[ground] | grey).mean() > 0.95


def test_the_other_picture_shows_it_and_both_have_the_ramp(page: str) -> None:
    assert 0.01 < is_red(shown(page, "change")).mean() < 0.3
    for key in ("change", "change-above"):
        assert ", ".join(DIVERGING_STOPS) in page[page.index(f'id="picture-{key}"') :]
    assert 'href="#change"' in page
    assert "pit &lt;old&gt;" in page
    assert "below no region" in page


def test_without_the_work_directory_the_volumes_stay(renewed: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(renewed, tmp_path / "ground")
    result = write_report(copy, options=SMALL)
    text = result.path.read_text()
    assert "change" not in result.pictures
    assert "No picture of the change" in text
    assert "below no region" in text


def test_a_first_survey_says_nothing_of_change(scene_path: Path, tmp_path: Path) -> None:
    result = write_report(scene_path, tmp_path / "page.html", SMALL)
    assert "change" not in result.pictures
    assert 'id="change"' not in result.path.read_text()
