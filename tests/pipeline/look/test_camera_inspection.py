"""inspect: cameras alone, and with their survey and photos."""

from __future__ import annotations

import json

import numpy as np
import pytest
import typer
from PIL import Image
from pipeline.engines.camera_files.known_cameras import (
    BROWN,
    HEIGHT,
    ORIGIN,
    SQUARE,
    WIDTH,
    flight,
    ground,
    truth,
    write_bundler,
    write_colmap_text,
)
from typer.testing import CliRunner

from terraport_pipeline.camera_inspection import inspect_cameras, inspect_photos
from terraport_pipeline.cli import inspect
from terraport_pipeline.model import to_crs


def shade(points):
    """Brightness of the ground: broad stripes."""
    return 128 + 100 * np.sin(0.35 * points[:, 0]) * np.cos(0.3 * points[:, 2])


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A survey, its cameras, and photos rendered on flat ground at an eighth of the size."""
    folder = tmp_path_factory.mktemp("project")
    cameras = flight(BROWN)
    write_colmap_text(folder / "colmap", cameras)
    points = ground() * (1.0, 0.0, 1.0)
    level = shade(points).astype(np.uint8)
    rows = np.column_stack([to_crs(points, ORIGIN), level, level, level])
    np.savetxt(
        folder / "survey.txt",
        rows,
        fmt="%.3f %.3f %.3f %d %d %d",
        header="x y z r g b",
        comments="",
    )
    (folder / "photos").mkdir()
    width, height = WIDTH // 8, HEIGHT // 8 + 1
    across, down = np.meshgrid(8 * (np.arange(width) + 0.5), 8 * (np.arange(height) + 0.5))
    for view in truth(cameras):
        rays = view.rays(np.column_stack([across.ravel(), down.ravel()]))
        hits = view.position + rays * (-view.position[1] / rays[:, 1])[:, None]
        picture = shade(hits).reshape(height, width).astype(np.uint8)
        Image.fromarray(picture).save(folder / "photos" / view.name, quality=95)
    return folder


def test_cameras_alone(project):
    inspection = inspect_cameras(project / "colmap")
    assert inspection["format"] == "COLMAP (text)"
    assert inspection["count"] == 6
    (lens,) = inspection["lenses"]
    assert lens["size"] == [WIDTH, HEIGHT]
    assert lens["photos"] == 6
    assert 36 < lens["corner_deg"] < 40
    assert "OFFSET.txt" in inspection["frames"][0]
    assert inspection["centres"]["min"][0] == pytest.approx(100.0)


def test_with_survey_and_photos(project):
    inspection = inspect_photos(
        project / "survey.txt", project / "colmap", photos=project / "photos"
    )
    assert inspection["coverage"]["share"] > 0.8
    assert inspection["pixel_m"]["median"] == pytest.approx(62.5 / 1456 * 8, rel=0.1)
    assert inspection["height_above_m"]["median"] == pytest.approx(62.5, abs=0.1)
    assert inspection["colours"]["median"] > 0.97
    assert inspection["idle"] == []
    assert any("another size" in text for text in inspection["warnings"])


def test_cameras_a_little_off_disagree_in_colour(project):
    (east, north, up), agreements = (576_600.0, 5_188_100.0, 0.0), []
    for away in (0.0, 4.0):
        inspection = inspect_photos(
            project / "survey.txt",
            project / "colmap",
            photos=project / "photos",
            offset=(east + away, north, up),
        )
        agreements.append(inspection["colours"]["median"])
    assert agreements[0] > 0.97
    assert agreements[1] < 0.5


def run(*words):
    app = typer.Typer()
    inspect.register(app)
    app.command("other")(lambda: None)
    return CliRunner().invoke(app, ["inspect", *map(str, words)])


def test_the_command(project):
    options = ("--cameras", project / "colmap", "--photos", project / "photos")
    rows = np.loadtxt(project / "survey.txt", skiprows=1)
    rows[:, 2] += 0.4 * np.sin(rows[:, 0] / 7) * np.cos(rows[:, 1] / 9)  # flat ground is refused
    rolling = project / "rolling.txt"
    np.savetxt(rolling, rows, fmt="%.3f %.3f %.3f %d %d %d", header="x y z r g b", comments="")
    shown = run(rolling, *options)
    assert shown.exit_code == 0, shown.output
    for phrase in (
        "6 photos", "pixel on the ground", "colours agree", "radial, distorted",
        "A build with these photos",
    ):  # fmt: skip
        assert phrase in shown.output
    inspection = json.loads(run(rolling, *options, "--json").stdout)
    assert inspection["count"] == 6
    assert inspection["survey"]["name"] == "rolling.txt"
    assert inspection["forecast"]["seconds"] > inspection["survey"]["forecast"]["seconds"]
    refused = json.loads(run(project / "survey.txt", *options, "--json").stdout)
    assert "one plane" in refused["survey"]["refused"]
    assert "forecast" not in refused
    assert "perhaps" in run(project / "colmap").output
    assert json.loads(run(project / "colmap" / "images.txt", "--json").stdout)["count"] == 6


def test_errors_are_one_line(project, tmp_path):
    shown = run(project / "survey.txt", "--cameras", project / "colmap", "--camera-offset", "1,2")
    assert shown.exit_code == 2
    assert "three finite numbers E,N,H" in shown.output
    assert run(project / "colmap", "--camera-offset", "1,2,3").exit_code == 2
    shown = run(project / "survey.txt", "--cameras", project / "colmap", "--camera-offset", "1,2,3")
    assert shown.exit_code == 1
    assert "do not look at the cloud" in shown.output
    shown = run(tmp_path)
    assert shown.exit_code == 1
    assert "error:" in shown.output


def test_bundler_sizes_come_from_the_photos(project, tmp_path):
    write_bundler(tmp_path, flight(SQUARE))
    inspection = inspect_cameras(tmp_path / "bundle.out", project / "photos")
    assert inspection["lenses"][0]["size"] == [WIDTH // 8, HEIGHT // 8 + 1]


def test_brighton_beach(shared_data):
    folder = shared_data / "brighton_beach"
    inspection = inspect_photos(folder / "model.laz", folder / "colmap", photos=folder / "images")
    assert inspection["count"] == 18
    assert inspection["coverage"]["share"] > 0.99
    assert inspection["colours"]["median"] > 0.7
    assert 0.01 < inspection["pixel_m"]["median"] < 0.05
    assert "576,600.000, 5,188,100.000" in inspection["frame"]
