"""The files of a survey: found, told apart, and refused where they are no one survey."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from pipeline.laz_files import Hill, write_laz, write_tiles
from pyproj import CRS

from terraport_pipeline import survey_files
from terraport_pipeline.errors import ReadError, SurveyError
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.survey_files import SurveyFiles, find_survey, one_crs

MESH = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
MESH += "property float z\nelement face 1\nproperty list uchar int i\nend_header\n"
MESH += "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


@pytest.fixture
def delivery(tmp_path: Path) -> Path:
    """Nine tiles in two folders, with what stands beside tiles in a real delivery."""
    folder = tmp_path / "delivery"
    tiles = write_tiles(folder / "tiles" / "north", Hill(900))
    (folder / "tiles" / "south").mkdir()
    for path in tiles[4:]:
        path.rename(folder / "tiles" / "south" / path.name)
    (folder / "README.txt").write_text("Delivered on Monday.\n")
    (folder / "cameras.csv").write_text("x,y,z\n1,2,3\n4,5,6\n")
    (folder / "area.prj").write_text("PROJCS[]")
    (folder / "mesh.ply").write_text(MESH)
    (folder / "photos").mkdir()
    (folder / "photos" / "1.jpg").write_bytes(b"\xff\xd8")
    (folder / "tiles" / "north" / "._tile_1.laz").write_bytes(b"AppleDouble")
    (folder / ".work").mkdir()
    (folder / ".work" / "old.laz").write_bytes(b"LASF")
    return folder


def names(survey: SurveyFiles) -> list[str]:
    return [Path(file.name).name for file in survey.files]


def test_a_folder_is_searched_and_the_rest_is_told(delivery: Path) -> None:
    survey = find_survey(delivery)
    assert survey.title == "delivery"
    assert names(survey) == [f"tile_{number}.laz" for number in range(1, 10)]
    assert survey.files[0].name == "tiles/north/tile_1.laz"
    assert dict(survey.ignored) == {
        "README.txt": "is text beside a survey; name it to read it as points",
        "cameras.csv": "is text beside a survey; name it to read it as points",
        "area.prj": "states no CRS of a survey beside it",
        "mesh.ply": "is a mesh; name it to read its vertices",
        "photos/1.jpg": "is no survey",
    }


def test_text_alone_is_a_survey_where_it_is_a_table(tmp_path: Path) -> None:
    (tmp_path / "README.txt").write_text("Delivered on Monday.\n")
    (tmp_path / "points.txt").write_text("1 2 3\n4 5 6\n")
    survey = find_survey(tmp_path)
    assert names(survey) == ["points.txt"]
    assert survey.ignored == (("README.txt", "is no table of points"),)


def test_files_and_patterns_in_natural_order(tmp_path: Path) -> None:
    hill = Hill(60)
    for number in (10, 9, 1):
        write_laz(tmp_path / f"t{number}.laz", hill)
    assert names(find_survey(tmp_path / "*.laz")) == ["t1.laz", "t9.laz", "t10.laz"]
    assert find_survey(tmp_path / "*.laz").title == "3 files"
    assert names(find_survey([tmp_path / "t9.laz", tmp_path / "t1.laz"])) == ["t1.laz", "t9.laz"]
    (tmp_path / "in").mkdir()
    (tmp_path / "t9.laz").rename(tmp_path / "in" / "t9.laz")
    assert len(find_survey(tmp_path / "**" / "*.laz").files) == 3
    (tmp_path / "t[1].laz").write_bytes((tmp_path / "t1.laz").read_bytes())
    assert names(find_survey(tmp_path / "t[1].laz")) == ["t[1].laz"]


def test_a_file_that_is_linked_twice_counts_once(tmp_path: Path) -> None:
    write_laz(tmp_path / "a.laz", Hill(60))
    (tmp_path / "b.laz").symlink_to(tmp_path / "a.laz")
    os.link(tmp_path / "a.laz", tmp_path / "c.laz")
    (tmp_path / "loop").symlink_to(tmp_path)
    survey = find_survey(tmp_path)
    assert names(survey) == ["a.laz"]
    assert [reason for _, reason in survey.ignored] == ["is the same file as a.laz"] * 2


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("none.laz", "no file .*none.laz"),
        ("*.las", "no file matches .*las; check the folder"),
        ("empty", "is empty; expected a folder with a survey in it"),
        ("photos", "holds no survey, but 1.jpg; terraport reads .las"),
    ],
)
def test_nothing_found_is_said(tmp_path: Path, given: str, told: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "1.jpg").touch()
    with pytest.raises(SurveyError, match=told):
        find_survey(tmp_path / given)


def test_too_many_files_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_tiles(tmp_path, Hill(90), tiles=2)
    monkeypatch.setattr(survey_files, "MAX_FILES", 3)
    with pytest.raises(SurveyError, match="4 files; a survey has at most 3"):
        find_survey(tmp_path)


def test_a_scene_beside_the_survey_is_not_searched(tmp_path: Path) -> None:
    write_laz(tmp_path / "a.laz", Hill(60))
    (tmp_path / "scene").mkdir()
    (tmp_path / "scene" / "scene.json").touch()
    (tmp_path / "scene" / "report.html").touch()
    survey = find_survey(tmp_path)
    assert (names(survey), survey.ignored) == (["a.laz"], ())


def test_damaged_files_are_named_all_at_once_or_left_out(delivery: Path) -> None:
    two = delivery / "tiles" / "north" / "tile_2.laz"
    two.write_bytes(two.read_bytes()[:300])
    (delivery / "tiles" / "south" / "tile_9.laz").write_bytes(b"")
    with pytest.raises(SurveyError) as caught:
        find_survey(delivery).heads(NullProgress())
    assert str(caught.value).startswith("2 of 9 files cannot be read; --skip-damaged goes on")
    assert "tile_2.laz" in str(caught.value)
    assert "tile_9.laz: the file is empty (0 bytes)" in str(caught.value)
    survey, heads = find_survey(delivery, skip_damaged=True).heads(NullProgress())
    assert len(survey.files) == len(heads) == 7
    assert [name for name, _ in survey.damaged] == [
        "tiles/north/tile_2.laz",
        "tiles/south/tile_9.laz",
    ]


def test_one_damaged_file_keeps_its_own_words(tmp_path: Path) -> None:
    write_tiles(tmp_path, Hill(90), tiles=2)
    (tmp_path / "tile_3.laz").write_bytes(b"PK\x03\x04")
    with pytest.raises(ReadError, match=r"tile_3.laz: this is a ZIP archive.*--skip-damaged"):
        find_survey(tmp_path).heads(NullProgress())


def test_a_link_to_nothing_is_a_tile_that_is_missing(tmp_path: Path) -> None:
    write_tiles(tmp_path, Hill(90), tiles=2)
    (tmp_path / "tile_5.laz").symlink_to(tmp_path / "gone.laz")
    with pytest.raises(ReadError, match=r"tile_5.laz: there is no such file"):
        find_survey(tmp_path).heads(NullProgress())
    survey, _ = find_survey(tmp_path, skip_damaged=True).heads(NullProgress())
    assert survey.damaged == (("tile_5.laz", "there is no such file"),)


def test_a_tile_without_points_is_left_out(tmp_path: Path) -> None:
    hill = Hill(90)
    write_laz(tmp_path / "a.laz", hill)
    write_laz(tmp_path / "b.las", hill, slice(0))
    survey, heads = find_survey(tmp_path).heads(NullProgress())
    assert names(survey) == ["a.laz"]
    assert survey.ignored == (("b.las", "has no points"),)
    assert heads[0].points == 90


def test_two_reference_systems_are_refused_with_names(tmp_path: Path) -> None:
    hill = Hill(90)
    for number in range(6):
        write_laz(tmp_path / f"t{number}.laz", hill, epsg=32736 if number == 4 else 32735)
    with pytest.raises(SurveyError) as caught:
        find_survey(tmp_path).heads(NullProgress())
    assert "2 coordinate reference systems" in str(caught.value)
    assert "UTM zone 35S in t0.laz, t1.laz, t2.laz and 2 more" in str(caught.value)
    assert "UTM zone 36S in t4.laz" in str(caught.value)
    assert str(caught.value).endswith("--skip-damaged goes on without the fewer")
    survey, heads = find_survey(tmp_path, skip_damaged=True).heads(NullProgress())
    assert len(heads) == 5
    reason = "it is in WGS 84 / UTM zone 36S, most others in WGS 84 / UTM zone 35S"
    assert survey.damaged == (("t4.laz", reason),)


def test_of_two_reference_systems_neither_is_left_out_where_none_is_of_most(tmp_path: Path) -> None:
    hill = Hill(90)
    for number in range(4):
        write_laz(tmp_path / f"t{number}.laz", hill, epsg=32735 + number % 2)
    with pytest.raises(SurveyError, match=r"or build them apart$"):
        find_survey(tmp_path, skip_damaged=True).heads(NullProgress())


def test_files_without_a_system_agree_with_any() -> None:
    assert one_crs([("a", None), ("b", None)]) is None
    assert one_crs([("a", None), ("b", CRS.from_epsg(32735))]) == CRS.from_epsg(32735)


def test_a_file_far_from_the_others_is_refused(tmp_path: Path) -> None:
    write_tiles(tmp_path, Hill(90), tiles=2)
    away = Hill(90)
    away.millimetres -= [641_000_000, 8_594_000_000, 0]
    write_laz(tmp_path / "local.laz", away, offset=(0.0, 0.0, 0.0), epsg=None)
    with pytest.raises(SurveyError, match=r"local.laz lies 8,594 km from the other files"):
        find_survey(tmp_path).heads(NullProgress())


def test_a_single_file_is_refused_in_its_own_words(tmp_path: Path) -> None:
    path = write_laz(tmp_path / "a.laz", Hill(90))
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(ReadError) as caught:
        SurveyFiles.of(path).heads(NullProgress())
    assert "--skip-damaged" not in str(caught.value)
