"""What ``terraport inspect`` says of a survey: by its headers, then by its points."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
import typer
from pipeline.laz_files import Hill, write_laz, write_tiles
from typer.testing import CliRunner

from terraport_pipeline.cli.inspect import register
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.survey.find_survey import find_survey
from terraport_pipeline.survey_inspection import inspect_headers, inspect_survey

HILL = Hill(600)


def _headers(path: Path, **given: Any) -> dict[str, Any]:
    return inspect_headers(*find_survey(path, **given).heads(NullProgress(), check_meaning=False))


def _facts(path: Path) -> dict[str, Any]:
    return inspect_survey(find_survey(path), max_memory_bytes=4 << 30, threads=2)


@pytest.fixture
def app() -> typer.Typer:
    app = typer.Typer()
    app.callback()(lambda: None)
    register(app)
    return app


def test_files_points_extent_and_reference_system(tmp_path: Path) -> None:
    write_tiles(tmp_path, HILL, tiles=2)
    (tmp_path / "README.txt").write_text("Delivered on Monday.\n")
    facts = _headers(tmp_path)
    assert facts["name"] == tmp_path.name
    assert facts["points"] == sum(file["points"] for file in facts["files"]) == len(HILL)
    assert facts["crs"] == {"name": "WGS 84 / UTM zone 35S", "epsg": 32735}
    low, high = HILL.millimetres.min(axis=0) / 1000, HILL.millimetres.max(axis=0) / 1000
    assert facts["bounds"][0] == pytest.approx(low.tolist(), abs=1e-6)
    assert facts["bounds"][1] == pytest.approx(high.tolist(), abs=1e-6)
    assert [file["name"] for file in facts["left_out"]] == ["README.txt"]


def test_text_has_no_box(tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_text("1 2 3\n4 5 6\n")
    facts = _headers(tmp_path / "a.xyz")
    assert facts["bounds"] is None
    assert facts["files"][0]["bounds"] is None


def test_units_are_those_of_the_reference_system(tmp_path: Path) -> None:
    metres = {"horizontal": "metre", "horizontal_m": 1.0, "vertical": "metre", "vertical_m": 1.0}
    assert _headers(write_laz(tmp_path / "a.laz", HILL))["units"] == metres
    assert _headers(write_laz(tmp_path / "b.laz", HILL, epsg=None))["units"] is None
    feet = _headers(write_laz(tmp_path / "c.laz", HILL, epsg=2263))["units"]
    assert feet["horizontal"] == "US survey foot"
    assert feet["vertical_m"] == pytest.approx(0.3048006)


def test_what_a_build_refuses_by_the_headers_is_told_with_them(tmp_path: Path) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.array([1e-7, 1e-7, 1e-3]), np.array([-100.0, 40.0, 0.0])
    las = laspy.LasData(header)
    place = HILL.millimetres - HILL.millimetres.min(axis=0)
    las.x, las.y = (-100.0 + place[:, 0] * 1e-8, 40.0 + place[:, 1] * 1e-8)
    las.z = place[:, 2] / 1000 * 5
    las.write(tmp_path / "degrees.laz")
    facts = _facts(tmp_path / "degrees.laz")
    assert "look like degrees" in facts["refused"]
    assert facts["points"] == len(HILL)
    assert "sample" not in facts


def test_what_a_build_refuses_by_the_points_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_text("1 2 3\n4 5 6\n")
    facts = _facts(tmp_path / "a.xyz")
    assert "2 different points" in facts["refused"]
    assert "forecast" not in facts


def test_points_are_measured_and_a_build_is_forecast(tmp_path: Path) -> None:
    hill = Hill(8000)
    facts = _facts(write_laz(tmp_path / "a.laz", hill))
    json.dumps(facts)
    assert facts["refused"] is None
    assert facts["sample"]["whole"]
    assert facts["sample"]["share"] == 1.0
    density = facts["density"]
    assert density["points_per_m2"]["median"] == pytest.approx(5.0, rel=0.15)
    rows = density["map"]
    counted = np.array(rows["points_per_m2"]).sum() * rows["cell_m"] ** 2
    assert counted == pytest.approx(len(hill), rel=0.01)
    assert facts["ground"]["area_m2"] == pytest.approx(1600, rel=0.15)
    assert facts["spacing"]["surface_m"] == pytest.approx((1600 / 8000) ** 0.5, rel=0.15)
    assert facts["duplicates"] == {"records": 0, "positions": 0, "share": 0.0}
    assert facts["colours"]["depths"] == ["sixteen"]
    assert [column["name"] for column in facts["attributes"]] == ["classification", "grade"]
    forecast = facts["forecast"]
    assert forecast["faces"] == pytest.approx(1.6 * len(hill), rel=0.25)
    assert forecast["cores"] == 2
    assert forecast["max_memory_bytes"] == 4 << 30
    assert {"seconds", "memory_bytes", "scene_bytes", "work_bytes", "tiles"} < set(forecast)


def test_what_looks_wrong_is_told(tmp_path: Path) -> None:
    hill = Hill(4000)
    rng = np.random.default_rng(8)
    hill.millimetres[:, 2] += np.rint(rng.normal(0, 600, len(hill))).astype(np.int64)
    hill.colours[:400] = 0
    place = (hill.millimetres[:, :2] - [641_200_000, 8_594_700_000]) / 1000
    open_ground = ((place - 20.0) ** 2).sum(axis=1) > 36.0
    rows = np.flatnonzero(open_ground)
    again = np.concatenate([rows, rows[:200]])
    warnings = " ".join(_facts(write_laz(tmp_path / "a.laz", hill, again))["warnings"])
    assert "are there twice (200 records" in warnings
    assert "times their spacing: they are smoothed" in warnings
    assert "within the survey have no points" in warnings
    assert "are black: without colour?" in warnings
    even = " ".join(_facts(write_laz(tmp_path / "b.laz", Hill(4000)))["warnings"])
    assert even == ""
    bare = _facts(write_laz(tmp_path / "c.laz", Hill(4000), colour=False))
    assert bare["colours"] is None
    assert "no colour" in " ".join(bare["warnings"])


def test_uneven_density_is_told(tmp_path: Path) -> None:
    hill = Hill(30_000)
    place = (hill.millimetres[:, :2] - [641_200_000, 8_594_700_000]) / 1000
    thin = (place[:, 0] > 30.0) & (np.arange(len(hill)) % 40 > 0)
    facts = _facts(write_laz(tmp_path / "a.laz", hill, np.flatnonzero(~thin)))
    assert "The density is uneven" in " ".join(facts["warnings"])


def test_the_command_lists_damage_and_takes_what_build_takes(
    app: typer.Typer, tmp_path: Path
) -> None:
    paths = write_tiles(tmp_path, HILL, tiles=2)
    paths[2].write_bytes(b"")
    for given in ([tmp_path], [tmp_path / "*.laz"], paths):
        command = ["inspect", "--headers", *map(str, given)]
        result = CliRunner().invoke(app, command, env={"COLUMNS": "100"})
        assert result.exit_code == 0, result.output
        assert "3 files" in result.output
        assert "look: 1 of 4 files cannot be read (tile_3.laz)" in result.output
        assert "damaged: tile_3.laz (the file is empty (0 bytes))" in result.output
    result = CliRunner().invoke(app, ["inspect", "--headers", "--json", str(tmp_path)])
    facts = json.loads(result.stdout)
    assert [file["damaged"] for file in facts["left_out"]] == [True]


def test_a_single_file_is_described(app: typer.Typer, tmp_path: Path) -> None:
    path = write_laz(tmp_path / "a.laz", HILL)
    picture = tmp_path / "map.png"
    command = ["inspect", str(path), "--map", str(picture)]
    result = CliRunner().invoke(app, command, env={"COLUMNS": "100"})
    assert result.exit_code == 0, result.output
    assert "a.laz  600 points" in result.output
    order = ["metre", "points read", "density", "noise", "classification", "A build", "faces"]
    places = [result.output.index(text) for text in order]
    assert places == sorted(places)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_text_is_a_survey_unless_it_holds_cameras(app: typer.Typer, tmp_path: Path) -> None:
    lines = [f"{x} {y} {z}" for x, y, z in (HILL.millimetres / 1000).tolist()]
    for name in ("a.xyz", "b.txt"):
        (tmp_path / name).write_text("\n".join(lines))
        result = CliRunner().invoke(app, ["inspect", "--json", str(tmp_path / name)])
        assert result.exit_code == 0, result.output
        facts = json.loads(result.stdout)
        assert facts["sample"]["points"] == facts["points"] == len(HILL)
        assert facts["bounds"][0] == pytest.approx((HILL.millimetres.min(axis=0) / 1000).tolist())
    (tmp_path / "c.txt").write_text("Delivered on Monday.\n")
    result = CliRunner().invoke(app, ["inspect", str(tmp_path / "c.txt")])
    assert result.exit_code == 1


def test_what_is_stated_is_taken(app: typer.Typer, tmp_path: Path) -> None:
    path = write_laz(tmp_path / "a.laz", Hill(4000), epsg=None)
    command = ["inspect", "--json", str(path)]
    metres = json.loads(CliRunner().invoke(app, command).stdout)
    feet = json.loads(CliRunner().invoke(app, [*command, "--units", "ft"]).stdout)
    ratio = feet["spacing"]["surface_m"] / metres["spacing"]["surface_m"]
    assert ratio == pytest.approx(0.3048, rel=1e-3)


@pytest.mark.parametrize("given", ["none", "photos"])
def test_what_is_neither_scene_nor_survey_is_said(
    app: typer.Typer, tmp_path: Path, given: str
) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "1.jpg").touch()
    result = CliRunner().invoke(app, ["inspect", str(tmp_path / given)])
    assert result.exit_code == 1
    assert "error: " in result.output


def test_an_extent_leaves_the_files_that_touch_it(app: typer.Typer, tmp_path: Path) -> None:
    write_tiles(tmp_path, Hill(4000), tiles=2)
    extent = ("--extent", "641200", "8594700", "641210", "8594710")
    result = CliRunner().invoke(app, ["inspect", "--json", "--headers", str(tmp_path), *extent])
    facts = json.loads(result.stdout)
    [file] = facts["files"]
    assert (file["name"], facts["points"]) == ("tile_1.laz", file["points"])
    within = facts["within"]
    assert within["values"] == [641_200, 8_594_700, 641_210, 8_594_710]
    assert within["points"] == pytest.approx(file["points"] / 4, rel=0.2)
    assert within["read"] == file["points"]
    command = ["inspect", "--json", str(tmp_path), *extent]
    measured = json.loads(CliRunner().invoke(app, command).stdout)
    assert measured["points"] == facts["points"]
    assert measured["sample"]["points"] == pytest.approx(within["points"], rel=0.2)
    assert measured["ground"]["area_m2"] < 200
    outside = ("tile_2.laz", "tile_3.laz", "tile_4.laz")
    assert [(one["name"], one["reason"]) for one in facts["left_out"]] == [
        (name, "lies outside the extent") for name in outside
    ]
    shown = (
        CliRunner()
        .invoke(app, ["inspect", "--headers", str(tmp_path), *extent], env={"COLUMNS": "100"})
        .output
    )
    assert "641200 8594700 641210 8594710" in shown
    assert "not read: tile_2.laz (lies outside the extent)" in shown
    refused = CliRunner().invoke(app, ["inspect", str(tmp_path), "--extent", "1", "2", "1", "3"])
    assert refused.exit_code == 2
    assert "XMIN 1 is not below XMAX 1" in refused.output
