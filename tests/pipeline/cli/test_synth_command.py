from __future__ import annotations

import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from terraport_pipeline.cli.synth import register
from terraport_pipeline.stages.read import read_survey
from terraport_pipeline.synth.files import load_options


def run(*arguments: str | Path):
    app = typer.Typer(rich_markup_mode="markdown")  # as the command line has it
    app.callback()(lambda: None)
    register(app)
    return CliRunner().invoke(app, ["synth", *map(str, arguments)], env={"COLUMNS": "120"})


def test_a_quarry_and_its_table(tmp_path: Path) -> None:
    path = tmp_path / "a b" / "q.laz"
    path.parent.mkdir()
    result = run("-o", path, "--points", "2k", "--seed", "4", "--size", "90", "--noise", "0")
    assert result.exit_code == 0, result.output
    assert len(read_survey(path).points) == 2000
    assert "2,000" in result.output
    assert "EPSG:32735" in result.output
    assert "rock_face" in result.output
    assert result.output.endswith(f"Next: terraport build '{path}' -o scenes/quarry\n")
    options = load_options(path.with_suffix(".truth.npz"))
    assert (options.seed, options.size_m, options.noise_m, options.holes) == (4, 90.0, 0.0, 2)


def test_flags_override_a_parameter_file(tmp_path: Path) -> None:
    (tmp_path / "p.json").write_text(json.dumps({"points": 1500, "seed": 11, "benches": 3}))
    path = tmp_path / "q.laz"
    result = run("-o", path, "--parameters", tmp_path / "p.json", "--seed", "12")
    assert result.exit_code == 0, result.output
    options = load_options(tmp_path / "q.truth.npz")
    assert (options.points, options.seed, options.benches) == (1500, 12, 3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--points", "many"], "points 'many'; expected a number"),
        (["--points", "10"], "points 10; expected 1,000 to 200,000,000"),
        (["--outliers", "2"], "outliers 2; expected 0 to 0.2"),
        (["--parameters", "none.json"], "none.json: cannot be read"),
    ],
)
def test_wrong_options_end_with_one_line_and_two(tmp_path: Path, arguments, message: str) -> None:
    result = run("-o", tmp_path / "q.laz", *arguments)
    assert result.exit_code == 2
    assert message in result.output
    assert "error: " in result.output
    assert "Traceback" not in result.output
    assert list(tmp_path.iterdir()) == []


def test_files_that_are_there_stay_unless_forced(tmp_path: Path) -> None:
    path = tmp_path / "q.laz"
    path.write_text("mine")
    assert run("-o", path, "--points", "1k").exit_code == 2
    assert path.read_text() == "mine"
    assert run("-o", path, "--points", "1k", "--force").exit_code == 0
    assert len(read_survey(path).points) == 1000


def test_help_teaches(tmp_path: Path) -> None:
    text = run("--help").output
    for word in (
        "For example",
        "--points 5M",
        "truth.npz",
        "overhangs",
        "[default: 300,000]",
        "Shape of the site",
        "--benches",
    ):
        assert word in text


def test_photos_come_with_the_cloud_they_show(tmp_path: Path) -> None:
    path = tmp_path / "q.laz"
    result = run(
        "-o", path, "--points", "1k", "--size", "90", "--photos", tmp_path / "p",
        "--photo-count", "2", "--photo-size", "80x64", "--no-truck",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "cm a pixel" in result.output
    photos = tmp_path / "p"
    assert result.output.endswith(f" --photos {photos}/images --cameras {photos}/colmap\n")
    assert load_options(tmp_path / "q.truth.npz").detail == 1.0
    assert len(list((tmp_path / "p" / "images").iterdir())) == 2


def test_a_photo_size_that_is_none_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    arguments = ("--points", "1k", "--photos", tmp_path / "p", "--photo-size", "large")
    result = run("-o", tmp_path / "q.laz", *arguments)
    assert result.exit_code == 2
    assert "photo size is 'large'" in result.output
    assert list(tmp_path.iterdir()) == []
