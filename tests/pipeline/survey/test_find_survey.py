"""The files of a survey: found, and told from what is none."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from pipeline.laz_files import Hill, write_laz, write_tiles

from terraport_pipeline.errors import MissingReaderError, SurveyError
from terraport_pipeline.survey.find_survey import find_survey
from terraport_pipeline.survey.survey_files import SurveyFiles


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
    (tmp_path / "gcp_list.txt").write_text("EPSG:32633\n500000.5 5200000.5 310.2 1024 768 a.jpg\n")
    (tmp_path / "points.txt").write_text("1 2 3\n4 5 6\n")
    (tmp_path / "titled.csv").write_text("Quarry North\nX (m),Y (m),Z (m)\n1,2,3\n4,5,6\n")
    survey = find_survey(tmp_path)
    assert names(survey) == ["points.txt", "titled.csv"]
    reason = "is no table of points"
    assert sorted(survey.ignored) == [("README.txt", reason), ("gcp_list.txt", reason)]


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
        ("none.laz", "none.laz: no such file or folder"),
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
    monkeypatch.setattr("terraport_pipeline.survey.find_survey.MAX_FILES", 3)
    with pytest.raises(SurveyError, match="4 files; a survey has at most 3"):
        find_survey(tmp_path)


def test_a_scene_beside_the_survey_is_not_searched(tmp_path: Path) -> None:
    write_laz(tmp_path / "a.laz", Hill(60))
    (tmp_path / "scene").mkdir()
    (tmp_path / "scene" / "scene.json").touch()
    (tmp_path / "scene" / "report.html").touch()
    survey = find_survey(tmp_path)
    assert (names(survey), survey.ignored) == (["a.laz"], ())


@pytest.mark.parametrize(
    ("name", "content", "package", "extra"),
    [("a.e57", b"ASTM-E57 and more", "pye57", "e57"), ("a.xyz", b"1 2 3\n", "pyarrow", "text")],
)
def test_a_reader_that_is_not_installed_is_named_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    name: str, content: bytes, package: str, extra: str,
) -> None:  # fmt: skip
    """Whole files are never left out as damaged: that would be half a survey."""
    (tmp_path / name).write_bytes(content)
    assert find_survey(tmp_path).files
    monkeypatch.setitem(sys.modules, package, None)
    for given in (tmp_path, tmp_path / name):
        with pytest.raises(MissingReaderError) as refused:
            find_survey(given, skip_damaged=True)
        assert str(refused.value).startswith(f"{tmp_path / name}: ")
        assert f"pip install 'terraport[{extra}]'" in str(refused.value)
    # Other kinds need none of it.
    write_laz(tmp_path / "b.laz", Hill(60))
    assert names(find_survey(tmp_path / "b.laz")) == ["b.laz"]
