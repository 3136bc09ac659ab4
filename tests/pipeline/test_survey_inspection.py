"""What ``terraport inspect`` says of a survey, from its headers alone."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import typer
from pipeline.laz_files import Hill, write_laz, write_tiles
from typer.testing import CliRunner

from terraport_pipeline.cli.inspect import register
from terraport_pipeline.survey_files import find_survey
from terraport_pipeline.survey_inspection import inspect_survey

HILL = Hill(600)


@pytest.fixture
def app() -> typer.Typer:
    app = typer.Typer()
    app.callback()(lambda: None)
    register(app)
    return app


def test_files_points_extent_and_reference_system(tmp_path: Path) -> None:
    write_tiles(tmp_path, HILL, tiles=2)
    (tmp_path / "README.txt").write_text("Delivered on Monday.\n")
    facts = inspect_survey(find_survey(tmp_path))
    assert facts["name"] == tmp_path.name
    assert facts["points"] == sum(file["points"] for file in facts["files"]) == len(HILL)
    assert facts["crs"] == {"name": "WGS 84 / UTM zone 35S", "epsg": 32735}
    low, high = HILL.millimetres.min(axis=0) / 1000, HILL.millimetres.max(axis=0) / 1000
    assert facts["bounds"][0] == pytest.approx(low.tolist(), abs=1e-6)
    assert facts["bounds"][1] == pytest.approx(high.tolist(), abs=1e-6)
    assert [file["name"] for file in facts["left_out"]] == ["README.txt"]


def test_text_has_no_box(tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_text("1 2 3\n4 5 6\n")
    facts = inspect_survey(find_survey(tmp_path / "a.xyz"))
    assert facts["bounds"] is None
    assert facts["files"][0]["bounds"] is None


def test_the_command_lists_damage_and_takes_what_build_takes(
    app: typer.Typer, tmp_path: Path
) -> None:
    paths = write_tiles(tmp_path, HILL, tiles=2)
    paths[2].write_bytes(b"")
    for given in ([tmp_path], [tmp_path / "*.laz"], paths):
        result = CliRunner().invoke(app, ["inspect", *map(str, given)], env={"COLUMNS": "100"})
        assert result.exit_code == 0, result.output
        assert "3 files" in result.output
        assert "damaged: tile_3.laz (the file is empty (0 bytes))" in result.output
    result = CliRunner().invoke(app, ["inspect", "--json", str(tmp_path)])
    facts = json.loads(result.stdout)
    assert [file["damaged"] for file in facts["left_out"]] == [True]


def test_a_single_file_is_described(app: typer.Typer, tmp_path: Path) -> None:
    path = write_laz(tmp_path / "a.laz", HILL)
    result = CliRunner().invoke(app, ["inspect", str(path)])
    assert result.exit_code == 0, result.output
    assert "a.laz  600 points" in result.output


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
    write_tiles(tmp_path, HILL, tiles=2)
    extent = ("--extent", "641200", "8594700", "641210", "8594710")
    result = CliRunner().invoke(app, ["inspect", "--json", str(tmp_path), *extent])
    facts = json.loads(result.stdout)
    [file] = facts["files"]
    assert (file["name"], facts["points"]) == ("tile_1.laz", file["points"])
    within = facts["within"]
    assert within["values"] == [641_200, 8_594_700, 641_210, 8_594_710]
    assert within["points"] == pytest.approx(file["points"] / 4, rel=0.2)
    assert within["read"] == file["points"]
    outside = ("tile_2.laz", "tile_3.laz", "tile_4.laz")
    assert [(one["name"], one["reason"]) for one in facts["left_out"]] == [
        (name, "lies outside the extent") for name in outside
    ]
    shown = (
        CliRunner().invoke(app, ["inspect", str(tmp_path), *extent], env={"COLUMNS": "100"}).output
    )
    assert "641200 8594700 641210 8594710" in shown
    assert "not read: tile_2.laz (lies outside the extent)" in shown
    refused = CliRunner().invoke(app, ["inspect", str(tmp_path), "--extent", "1", "2", "1", "3"])
    assert refused.exit_code == 2
    assert "XMIN 1 is not below XMAX 1" in refused.output
