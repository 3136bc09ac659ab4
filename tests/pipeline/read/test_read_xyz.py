from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pipeline.read.read_in_order import read_in_order

from terraport_pipeline.engines.readers import clean_text, read_xyz
from terraport_pipeline.errors import ReadError
from terraport_pipeline.stages.read import read_survey

NO_CRS = (
    "No coordinate reference system is stated: the coordinates are taken as metres. If they are "
    "feet, build with --units us-ft or ft; --crs EPSG:n says where on Earth they lie."
)


def lines(sample, delimiter=" ", decimal=".") -> str:
    text = []
    for point, colour, grade in zip(sample.points, sample.colours, sample.grade, strict=True):
        cells = [f"{value:.3f}" for value in point] + [str(value) for value in colour]
        text.append(delimiter.join([*cells, f"{grade:.9g}"]).replace(".", decimal))
    return "\n".join(text) + "\n"


def check(survey, sample) -> None:
    np.testing.assert_allclose(survey.points, sample.points, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(survey.colours, sample.colours)
    np.testing.assert_allclose(survey.attributes["grade"], sample.grade, rtol=1e-7)


@pytest.mark.parametrize("delimiter", [" ", "   ", "\t", " \t", ",", ";", ", "])
@pytest.mark.parametrize("head", ["{h}", "// {h}", "# made by us\n#{h}", "\n{h}"])
def test_delimiters_and_headers(tmp_path, sample, delimiter: str, head: str) -> None:
    names = delimiter.join(["X", "Y", "Z", "R", "G", "B", "grade"])
    path = tmp_path / "a.csv"
    path.write_text(head.format(h=names) + "\n" + lines(sample, delimiter))
    survey = read_in_order(path, sample.points)
    check(survey, sample)
    assert survey.warnings == (NO_CRS,)


def test_windows_line_ends_bom_and_blanks_at_both_ends(tmp_path, sample) -> None:
    path = tmp_path / "a.txt"
    body = "x y z r g b grade\n" + lines(sample)
    text = "".join(f"  {line} \r\n" for line in body.splitlines())
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    check(read_in_order(path, sample.points), sample)


@pytest.mark.parametrize("delimiter", [";", "\t", " "])
def test_decimal_comma(tmp_path, sample, delimiter: str) -> None:
    path = tmp_path / "a.csv"
    names = delimiter.join(["x", "y", "z", "r", "g", "b", "grade"])
    path.write_text(names + "\n" + lines(sample, delimiter, decimal=","))
    check(read_in_order(path, sample.points), sample)


def test_numbers_alone_are_taken_by_rule_and_said(tmp_path, sample) -> None:
    path = tmp_path / "a.xyz"
    path.write_text(lines(sample))
    survey = read_in_order(path, sample.points)
    np.testing.assert_array_equal(survey.colours, sample.colours)
    np.testing.assert_allclose(survey.attributes["intensity"], sample.grade, rtol=1e-7)
    assert survey.warnings == (
        "The file has no header; its columns were taken as x, y, z, red, green, blue, intensity.",
        NO_CRS,
    )


def test_pts_with_a_count_line(tmp_path) -> None:
    path = tmp_path / "a.pts"
    path.write_text("2\n1.5 2.5 3.5 -1200 10 20 30\n4.5 5.5 6.5 900 11 21 31\n")
    survey = read_in_order(path, np.array([[1.5, 2.5, 3.5], [4.5, 5.5, 6.5]]))
    assert survey.colours is not None
    assert survey.colours.tolist() == [[10, 20, 30], [11, 21, 31]]
    assert survey.attributes["intensity"].tolist() == [-1200, 900]


def test_northing_before_easting_is_put_right(tmp_path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("Northing,Easting,Height,class\n8594700.25,641200.5,1287,3\n")
    survey = read_survey(path)
    assert survey.points.tolist() == [[641200.5, 8594700.25, 1287.0]]
    assert survey.attributes["class"].tolist() == [3]
    assert survey.attributes["class"].dtype == np.int64


def test_text_columns_are_left_out_and_named(tmp_path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("x,y,z,name\n1,2,3,rock\n4,5,6,road\n")
    survey = read_survey(path)
    assert survey.attributes == {}
    assert survey.warnings[0] == "The columns name hold text and were left out."


def test_missing_values_become_nan(tmp_path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("x,y,z,g\n1,2,nan,0.5\n4,5,6,\n7,8,,2.5\n7,8,9,1.5\n")
    survey = read_in_order(path, np.array([[4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]))
    np.testing.assert_array_equal(survey.attributes["g"], [np.nan, 1.5])
    assert survey.warnings[0] == "2 of 4 points have no finite coordinates: dropped."


def test_a_type_that_changes_many_blocks_later_is_followed(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(clean_text, "BLOCK_BYTES", 4096)
    monkeypatch.setattr(read_xyz, "_BLOCK_BYTES", 4096)
    numbers = np.arange(3000)
    path = tmp_path / "a.csv"
    path.write_text(
        "x,y,z,value\n" + "".join(f"{n},{n},{n},{n}\n" for n in numbers) + "1,2,3,0.25\n"
    )
    written = np.concatenate([np.repeat(numbers, 3).reshape(-1, 3), [[1, 2, 3]]])
    survey = read_in_order(path, written.astype(np.float64))
    assert survey.attributes["value"].tolist() == [*numbers, 0.25]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b,c\n", "is not followed by rows of numbers"),
        ("hello world\nthis is prose\n", "is not followed by rows of numbers"),
        ("# only a comment\n\n", "not one row of numbers"),
        ("1 2\n3 4\n", "the rows have 2 columns"),
        ("lon,lat,height\n28.3,-12.7,1287\n", "the columns lon, lat are degrees"),
        ("x,y,z\n1,2,3\n4,5\n", "expected 3 columns, got 2"),
        ("x,y,z\n1,2,3\n4,five,6\n", "five"),
        ("x,y,class\n1,2,3\n", "no column z"),
    ],
)
def test_bad_text_is_named(tmp_path, text: str, message: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(ReadError) as caught:
        read_survey(path)
    assert message.lower() in str(caught.value).lower()


def test_the_line_of_a_damaged_row_is_named(tmp_path, sample) -> None:
    path: Path = tmp_path / "a.csv"
    body = ("x y z r g b grade\n" + lines(sample)).splitlines()
    body[400] = "1.0 2.0"
    path.write_text("\n".join(body))
    with pytest.raises(ReadError) as caught:
        read_survey(path)
    assert caught.value.location == "line 401 (comments not counted)"


def test_binary_under_a_text_name_is_refused(tmp_path) -> None:
    path = tmp_path / "a.xyz"
    path.write_bytes(b"1 2 3\n\x00\x01\x02")
    with pytest.raises(ReadError, match="no text: it has zero bytes") as caught:
        read_survey(path)
    assert caught.value.location == "byte 6"
