"""What the headers of a survey's files say together; refused where they are no one survey."""

from __future__ import annotations

from pathlib import Path

import pytest
from pipeline.laz_files import Hill, write_laz, write_tiles

from terraport_pipeline.errors import ReadError, SurveyError
from terraport_pipeline.progress import NullProgress
from terraport_pipeline.survey.find_survey import find_survey
from terraport_pipeline.survey.survey_files import SurveyFiles


def names(survey: SurveyFiles) -> list[str]:
    return [Path(file.name).name for file in survey.files]


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
