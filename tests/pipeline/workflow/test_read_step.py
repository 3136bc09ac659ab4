"""A delivery in a folder is built as its merged file is, and says what it was made of."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pipeline.laz_files import Hill, write_laz, write_tiles

from terraport_pipeline.errors import ReadError
from terraport_pipeline.options import reconstruct
from terraport_pipeline.options import regions as segment
from terraport_pipeline.options.tiles import TileOptions
from terraport_pipeline.report.facts import input_line
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_store.reader import Scene

HILL = Hill(3000)


def options_for(survey: Path | tuple[Path, ...], scene: Path, **more: Any) -> BuildOptions:
    return BuildOptions(
        survey,
        scene,
        reconstruct=reconstruct.Options(base_faces=800),
        segment=segment.Options(min_faces=150, max_faces=900),
        threads=1,
        **more,
    )


def published_bytes(scene: Path) -> dict[str, bytes]:
    """Everything that is part of the published version."""
    with Scene.open(scene) as opened:
        files = {file.path for file in opened.manifest.files.values()}
    return {path: (scene / path).read_bytes() for path in ("scene.json", *files)}


@pytest.fixture(scope="module")
def merged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a merged survey and its scene; never modified."""
    folder = tmp_path_factory.mktemp("merged")
    build(options_for(write_laz(folder / "merged.laz", HILL), folder / "pit"))
    return folder


@pytest.fixture
def tiles(tmp_path: Path) -> Path:
    """Nine tiles with margins, a copy and a link, and what stands beside tiles."""
    folder = tmp_path / "tiles"
    first, *_ = write_tiles(folder, HILL, margin_m=1.5)
    (folder / "copy.laz").write_bytes(first.read_bytes())
    (folder / "link.laz").symlink_to(first)
    (folder / "README.txt").write_text("Delivered on Monday.\n")
    return folder


def test_the_tiles_are_the_merged_file(merged: Path, tiles: Path, tmp_path: Path) -> None:
    report = build(options_for(tiles, tmp_path / "pit"))
    assert published_bytes(tmp_path / "pit") == published_bytes(merged / "pit")
    # Files stand beside the version, not in it.
    document = json.loads((tmp_path / "pit" / "build.json").read_text())
    names = [file["name"] for file in document["inputs"]]
    assert names == ["copy.laz", *(f"tile_{number}.laz" for number in range(2, 10))]
    assert sum(file["points"] - file["repeats"] for file in document["inputs"]) == len(HILL)
    assert {(file["name"], file["reason"]) for file in document["left_out"]} == {
        ("tile_1.laz", "has the same bytes as copy.laz"),
        ("link.laz", "is the same file as tile_1.laz"),
        ("README.txt", "is text beside a survey; name it to read it as points"),
    }
    assert input_line(document).startswith("9 files, ")
    assert any(note.startswith("9 files with ") for note in report.notes)
    assert any("README.txt (is text" in note for note in report.notes)


@pytest.mark.parametrize("depth", [8, pytest.param(7, marks=pytest.mark.thorough)])
def test_tiles_of_tiles_are_the_merged_file_in_tiles(
    tiles: Path, tmp_path: Path, depth: int
) -> None:
    path = write_laz(tmp_path / "merged.laz", HILL)
    both = []
    for number, survey in enumerate((path, tiles)):
        scene = tmp_path / str(number) / "pit"
        build(options_for(survey, scene, tiles=TileOptions(depth=depth)))
        both.append(published_bytes(scene))
    assert both[0] == both[1]


def test_another_cut_of_the_same_points_is_taken_up_after_reading(
    merged: Path, tiles: Path, tmp_path: Path
) -> None:
    """The work directory's keys go by the points, not by their files."""
    scene = tmp_path / "pit"
    build(options_for(merged / "merged.laz", scene))
    report = build(options_for(tiles, scene))
    assert [stage.taken_up for stage in report.stages] == [False, *[True] * 5]
    assert not report.published
    again = build(options_for(tuple(tiles.glob("*.laz")), scene))
    assert all(stage.taken_up for stage in again.stages)


def test_a_damaged_tile_ends_the_build_or_is_left_out_and_told(tiles: Path, tmp_path: Path) -> None:
    cut = tiles / "tile_5.laz"
    cut.write_bytes(cut.read_bytes()[:-400])
    with pytest.raises(ReadError, match=r"tile_5\.laz.*--skip-damaged"):
        build(options_for(tiles, tmp_path / "pit"))
    assert not (tmp_path / "pit").exists()
    report = build(options_for(tiles, tmp_path / "pit", skip_damaged=True))
    [told] = [text for text in report.warnings if text.startswith("Left out, ")]
    assert told.startswith("Left out, 11.1% of the files, as")  # one of nine: copies do not count
    assert "tile_5.laz (" in told
    [left] = [file for file in report.left_out if file["damaged"]]
    assert left["name"] == "tile_5.laz"
    manifest = json.loads((tmp_path / "pit" / "scene.json").read_text())
    assert told in manifest["build"]["warnings"]
