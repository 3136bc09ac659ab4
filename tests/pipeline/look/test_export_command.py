"""``terraport export``: what it prints, how it fails, and where scenes may lie."""

from __future__ import annotations

from pathlib import Path

import laspy
import pytest
import rasterio
import typer
from s3_servers import s3_environment
from typer.testing import CliRunner, Result

from terraport_pipeline.cli import export, upload


def run(*arguments: object) -> Result:
    app = typer.Typer()
    export.register(app)
    upload.register(app)
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_the_last_lines_say_what_was_written_and_where_it_is(scene_path, tmp_path) -> None:
    path = tmp_path / "h.tif"
    done = run("export", scene_path, "-o", path, "--as", "heights", "--step-m", 2)
    assert done.exit_code == 0, done.output
    first, second = done.stdout.splitlines()
    assert first.startswith(f"{path}  heights, ")
    assert "step 2 m, pixels 50 x 50, with a surface 100.0%" in first
    assert second == "coordinates: WGS 84 / UTM zone 33N, unit m"
    with rasterio.open(path) as picture:
        assert picture.shape == (50, 50)


def test_without_a_step_a_pixel_is_about_a_cell_of_the_mesh(scene_path, tmp_path) -> None:
    done = run("export", scene_path, "-o", tmp_path / "h.tif", "--as", "heights")
    assert "step 0.5 m, pixels 200 x 200" in done.stdout


def test_a_mesh_says_what_to_add(scene_path, tmp_path) -> None:
    box = (500_010, 5_999_950, 500_020, 5_999_970)
    done = run("export", scene_path, "-o", tmp_path / "m.ply", "--extent", *box)
    assert "add 500000 6000000 120" in done.stdout
    assert "beside it: m.ply.offset.xyz, m.ply.global_shift.txt" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("-o", "x.tif"), 2, "x.tif may be orthophoto or heights; add --as"),
        (("-o", "x.tif", "--as", "photo"), 2, "photo"),
        (("-o", "x.laz", "--extent", "5", "0", "1", "1"), 2, "XMIN 5 is not below XMAX 1"),
        (("-o", "x.laz", "--region", "pit"), 2, "region 'pit'; expected a stable id"),
        ((), 2, "--output"),
    ],
)
def test_wrong_options_are_one_line(
    scene_path, tmp_path, monkeypatch, arguments, code, said
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run("export", scene_path, *arguments)
    assert done.exit_code == code
    assert said in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_no_scene_is_said(tmp_path) -> None:
    done = run("export", tmp_path / "no", "-o", tmp_path / "x.laz")
    assert done.exit_code == 1
    assert "error: no scene" in done.stderr or "scene.json" in done.stderr


def test_a_failed_export_leaves_the_old_file(scene_path, tmp_path) -> None:
    path = tmp_path / "p.laz"
    assert run("export", scene_path, "-o", path).exit_code == 0
    before = path.read_bytes()
    again = run("export", scene_path, "-o", path)
    assert again.exit_code == 2
    assert "exists already" in again.stderr
    assert run("export", scene_path, "-o", path, "--force", "--region", "9").exit_code == 2
    assert path.read_bytes() == before
    assert run("export", scene_path, "-o", path, "--force", "--region", "1").exit_code == 0
    assert len(laspy.read(path)) < 40_000
    assert [file.name for file in tmp_path.iterdir()] == ["p.laz"]


def test_the_same_scene_gives_the_same_bytes(scene_path, tmp_path) -> None:
    for name in ("a.laz", "b.laz"):
        run("export", scene_path, "-o", tmp_path / name)
    assert (tmp_path / "a.laz").read_bytes() == (tmp_path / "b.laz").read_bytes()


def test_a_scene_in_object_storage(moto: str, scene_path: Path, tmp_path, monkeypatch) -> None:
    with s3_environment():
        url = f"s3://scenes/{tmp_path.name}/ground"
        assert run("upload", scene_path, url, "--endpoint", moto).exit_code == 0
        monkeypatch.setenv("AWS_ENDPOINT_URL", moto)
        done = run("export", url, "-o", tmp_path / "p.laz", "--region", "0")
        assert done.exit_code == 0, done.output
    assert len(laspy.read(tmp_path / "p.laz")) == 50_000
