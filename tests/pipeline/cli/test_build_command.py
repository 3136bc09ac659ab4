from __future__ import annotations

import re
from pathlib import Path

import pytest
import typer
from pipeline.laz_files import Hill, write_tiles
from typer.testing import CliRunner

from terraport_pipeline.cli.build import register
from terraport_store.validate import validate_scene


def run(*arguments: object) -> tuple[int, str]:
    app = typer.Typer()
    register(app)
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return result.exit_code, " ".join(result.output.split())


def test_a_survey_becomes_a_scene_with_a_table(hill_file: Path, tmp_path: Path) -> None:
    code, output = run(
        hill_file, "--units", "m", "-o", tmp_path / "hill", "--min-faces", 150, "--max-faces", 900,
        "--base-faces", "1k", "--max-memory", "4G", "--no-report",
    )  # fmt: skip
    assert code == 0, output
    assert validate_scene(tmp_path / "hill") == []
    for word in ("read", "clean", "reconstruct", "segment", "pack", "MiB", "published"):
        assert word in output
    assert "report " not in output.partition("published")[2]
    assert "land terraport land http://127.0.0.1:8080/scenes/hill " in output
    assert "warning" not in output  # nothing was asked for that was not done
    assert re.search(r"\d\.\d{8}", output) is None  # figures for people
    assert not (tmp_path / "hill" / "report.html").exists()


def test_without_an_output_the_scene_is_called_as_the_survey_and_the_last_lines_say_what_next(
    hill_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    survey = tmp_path / "surveys" / "north pit.xyz"
    survey.parent.mkdir()
    survey.write_bytes(hill_file.read_bytes())
    monkeypatch.chdir(tmp_path)
    options = ("--min-faces", 150, "--max-faces", 900, "--base-faces", "1k", "--no-report")
    code, output = run("surveys/north pit.xyz", *options)
    assert code == 0, output
    scene = tmp_path / "north pit"
    assert validate_scene(scene) == []
    (scene / "report.html").write_text("<html>")
    code, output = run("surveys/north pit.xyz", *options)
    land = "land terraport land http://127.0.0.1:8080/scenes/north%20pit 0 0 0 --ground"
    assert output.endswith(
        f"{scene} is up to date report {scene}/report.html serve terraport serve 'north pit' "
        f"{land} tiles http://127.0.0.1:8080/scenes/north%20pit/tileset.json"
    )
    code, output = run("surveys/north pit.xyz", "-o", "scenes/pit", *options)
    assert "serve terraport serve scenes land terraport land http" in output


def test_a_folder_and_a_pattern_become_a_scene_and_say_what_was_read(tmp_path: Path) -> None:
    tiles = write_tiles(tmp_path / "tiles", Hill(3000), tiles=2, margin_m=1.0)
    (tmp_path / "tiles" / "README.txt").write_text("Delivered on Monday.\n")
    tiles[3].write_bytes(b"")
    folder, pattern = tmp_path / "tiles", tmp_path / "tiles" / "*.laz"
    options = ("-o", tmp_path / "hill", "--min-faces", 150, "--base-faces", "1k", "--no-report")
    code, said = run(folder, *options)
    assert code == 1
    assert "tile_4.laz: the file is empty (0 bytes)" in said
    assert "or go on without the file: --skip-damaged" in said
    code, said = run(folder, *options, "--skip-damaged")
    assert code == 0, said
    assert "3 files with " in said
    assert "not read: README.txt (is text beside a survey" in said
    assert "warning: Left out, 25.0% of the files, as they cannot be used: tile_4.laz (" in said
    code, said = run(pattern, *options, "--skip-damaged")
    assert code == 0, said
    assert "is up to date" in said


@pytest.mark.parametrize(
    ("more", "code", "message"),
    [
        (["--detail-depth", "99"], 2, "error: detail depth 99; expected 3 to 16"),
        (["--streamed", "tiles"], 2, "error: streamed 'tiles'; expected segments or pools"),
        (["--max-memory", "lots"], 2, "error: max memory 'lots'; expected a number with"),
        (
            ["--max-memory", "1k"],
            2,
            "error: max memory 0.001 MiB; expected at least 256 MiB",
        ),
        (["--max-points", "10"], 2, "error: max points 10; expected at least 50"),
        (["--threads", "0"], 2, "error: threads 0; expected at least 1"),
        (["--engine", "magic"], 2, "error: engine 'magic'; expected borders, means, graph, "),
        (
            ["--grid-cell-m", "5"],
            2,
            "error: grid cell 5 m with engine borders; expected engine grid",
        ),
        (
            ["--camera-offset", "1,2"],
            2,
            "error: camera offset '1,2'; expected three finite numbers",
        ),
        (["--extent", "nan", "0", "1", "1"], 2, "error: extent nan 0 1 1; expected four finite"),
        (["--extent", "5", "0", "1", "1"], 2, "error: extent 5 0 1 1: XMIN 5 is not below XMAX 1"),
        (["--texture-quality", "50"], 2, "without photos; expected the folder of the photos with"),
        (["--no-such-option"], 2, "No such option"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_wrong_options_exit_with_2(
    hill_file: Path, tmp_path: Path, more: list[str], code: int, message: str
) -> None:
    got, output = run(hill_file, "-o", tmp_path / "scene", *more)
    assert got == code
    assert message in output
    assert not (tmp_path / "scene").exists()
    assert not (tmp_path / ".scene.work").exists()


def test_a_bad_survey_exits_with_1(tmp_path: Path) -> None:
    bad = tmp_path / "bad.xyz"
    bad.write_text("x y z\n1 2 3\n4 5 6\n7 8 1\n", encoding="ascii")
    code, output = run(bad, "-o", tmp_path / "scene")
    assert code == 1
    assert "error: 3 different points (of 3 read)" in output
    assert "Traceback" not in output


def test_an_extent_beside_the_survey_exits_with_1(hill_file: Path, tmp_path: Path) -> None:
    """Negative coordinates are no options."""
    code, output = run(hill_file, "-o", tmp_path / "scene", "--extent", "-9.5", "-9", "9", "9")
    assert code == 1
    assert "has no point within extent -9.5 -9 9 9: it spans" in output
    assert not (tmp_path / "scene").exists()


def test_ctrl_c_exits_with_130_and_says_how_to_go_on(
    hill_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("terraport_pipeline.workflow.build.build", interrupted)
    code, output = run(hill_file, "-o", tmp_path / "scene", "--quiet")
    assert code == 130
    assert "the same command goes on after the last finished stage" in output
