"""The commands: exit codes, one-line errors, JSON that parses."""

from __future__ import annotations

import json
import shutil

import pytest
import typer
from typer.testing import CliRunner

from terraport_pipeline.cli import inspect, report, validate


@pytest.fixture(scope="module")
def app() -> typer.Typer:
    commands = typer.Typer()
    for module in (inspect, validate, report):
        module.register(commands)
    return commands


def run(app, *arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_inspect_prints_tables_and_json(app, scene_path) -> None:
    shown = run(app, "inspect", scene_path)
    assert shown.exit_code == 0
    for words in ("rolling <ground>", "EPSG:32633", "80,000 triangles", "12 points were outliers"):
        assert words in shown.stdout
    assert json.loads(run(app, "inspect", scene_path, "--json").stdout)["counts"]["segments"] == 64


def test_validate_passes_and_fails_by_exit_code(app, scene_path, tmp_path) -> None:
    options = ("--rays", "2000", "--subsets", "4")
    good = run(app, "validate", scene_path, *options)
    assert good.exit_code == 0
    assert "0 holes" in good.stdout
    copy = shutil.copytree(scene_path, tmp_path / "copy")
    pack = next(copy.glob("v-*/segments.pack"))
    data = bytearray(pack.read_bytes())
    data[1_000] ^= 1
    pack.write_bytes(data)
    bad = run(app, "validate", copy, *options)
    assert bad.exit_code == 1
    assert "failed" in bad.stdout
    assert "segment 0" in bad.stdout
    plain = json.loads(run(app, "validate", copy, *options, "--json").stdout)
    assert plain["problems"] >= 1
    assert plain["hand_off"] is None


def test_validate_json_of_a_good_scene(app, scene_path) -> None:
    shown = run(app, "validate", scene_path, "--rays", "2000", "--subsets", "4", "--json")
    plain = json.loads(shown.stdout)
    assert plain["problems"] == plain["hand_off"]["holes"] == 0
    assert plain["hand_off"]["distance_m"]["p99.9"] < 1
    assert plain["hand_off"]["rays_per_second"] > 0
    worst = plain["hand_off"]["worst"]
    assert worst["verdict"] in {"excused", "distance"}
    assert len(worst["target"]) == len(worst["target_crs"]) == 3


def test_validate_says_that_the_gltf_was_not_judged_and_how(app, scene_path) -> None:
    shown = run(app, "validate", scene_path, "--rays", "0")
    assert shown.exit_code == 0
    assert "not run" in shown.stdout
    assert "only with --khronos" in shown.stdout


def test_validate_draws_the_worst_place_and_says_where_it_is(app, scene_path, tmp_path) -> None:
    picture = tmp_path / "worst.png"
    options = ("--rays", "2000", "--subsets", "4", "--picture", picture)
    shown = run(app, "validate", scene_path, *options)
    assert shown.exit_code == 0
    assert picture.stat().st_size > 10_000
    words = " ".join(shown.stdout.split())
    assert "worst place: " in words
    assert "in the survey's coordinates" in words
    assert "rays/s" in words


def test_report_writes_the_page(app, scene_path, tmp_path) -> None:
    shown = run(
        app, "report", scene_path, "-o", tmp_path / "r.html", "--width", "160", "--rays", "0"
    )
    assert shown.exit_code == 0
    assert "9 pictures" in shown.stdout
    assert (tmp_path / "r.html").stat().st_size > 20_000


@pytest.mark.parametrize("command", ["inspect", "validate", "report"])
def test_no_scene_is_one_line_and_exit_code_1(app, tmp_path, command) -> None:
    shown = run(app, command, tmp_path)
    assert shown.exit_code == 1
    assert shown.stderr.startswith("error: no scene at")
    assert "Traceback" not in shown.stderr
    assert list(tmp_path.iterdir()) == []


def test_wrong_options_are_exit_code_2(app, scene_path) -> None:
    shown = run(app, "validate", scene_path, "--rays", "3", "--subsets", "9")
    assert shown.exit_code == 2
    assert "received 3 rays and 9 subsets" in shown.stderr
