from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from terraport_pipeline.engines.readers.read_xyz import read_xyz
from terraport_pipeline.errors import ReadError


def lines(sample, delimiter=" ", decimal=".") -> str:
    text = []
    for point, colour, grade in zip(sample.points, sample.colours, sample.grade, strict=True):
        cells = [f"{value:.3f}" for value in point] + [str(value) for value in colour]
        text.append(delimiter.join([*cells, f"{grade:.9g}"]).replace(".", decimal))
    return "\n".join(text) + "\n"


def check(raw, sample) -> None:
    np.testing.assert_allclose(raw.points, sample.points, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(raw.colours, sample.colours)
    np.testing.assert_allclose(raw.attributes["grade"], sample.grade, rtol=1e-7)


@pytest.mark.parametrize("delimiter", [" ", "   ", "\t", " \t", ",", ";", ", "])
@pytest.mark.parametrize("head", ["{h}", "// {h}", "# made by us\n#{h}", "\n{h}"])
def test_delimiters_and_headers(tmp_path, sample, advance, delimiter: str, head: str) -> None:
    names = delimiter.join(["X", "Y", "Z", "R", "G", "B", "grade"])
    path = tmp_path / "a.csv"
    path.write_text(head.format(h=names) + "\n" + lines(sample, delimiter))
    raw = read_xyz(path, advance=advance)
    check(raw, sample)
    assert raw.warnings == ()


def test_windows_line_ends_bom_and_blanks_at_both_ends(tmp_path, sample, advance) -> None:
    path = tmp_path / "a.txt"
    body = "x y z r g b grade\n" + lines(sample)
    text = "".join(f"  {line} \r\n" for line in body.splitlines())
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    check(read_xyz(path, advance=advance), sample)


@pytest.mark.parametrize("delimiter", [";", "\t", " "])
def test_decimal_comma(tmp_path, sample, advance, delimiter: str) -> None:
    path = tmp_path / "a.csv"
    names = delimiter.join(["x", "y", "z", "r", "g", "b", "grade"])
    path.write_text(names + "\n" + lines(sample, delimiter, decimal=","))
    check(read_xyz(path, advance=advance), sample)


def test_numbers_alone_are_taken_by_rule_and_said(tmp_path, sample, advance) -> None:
    path = tmp_path / "a.xyz"
    path.write_text(lines(sample))
    raw = read_xyz(path, advance=advance)
    np.testing.assert_array_equal(raw.colours, sample.colours)
    np.testing.assert_allclose(raw.attributes["intensity"], sample.grade, rtol=1e-7)
    assert raw.warnings == (
        "The file has no header; its columns were taken as x, y, z, red, green, blue, intensity.",
    )


def test_pts_with_a_count_line(tmp_path, advance) -> None:
    path = tmp_path / "a.pts"
    path.write_text("2\n1.5 2.5 3.5 -1200 10 20 30\n4.5 5.5 6.5 900 11 21 31\n")
    raw = read_xyz(path, advance=advance)
    assert raw.points.tolist() == [[1.5, 2.5, 3.5], [4.5, 5.5, 6.5]]
    assert raw.colours.tolist() == [[10, 20, 30], [11, 21, 31]]
    assert raw.attributes["intensity"].tolist() == [-1200, 900]


def test_northing_before_easting_is_put_right(tmp_path, advance) -> None:
    path = tmp_path / "a.csv"
    path.write_text("Northing,Easting,Height,class\n8594700.25,641200.5,1287,3\n")
    raw = read_xyz(path, advance=advance)
    assert raw.points.tolist() == [[641200.5, 8594700.25, 1287.0]]
    assert raw.attributes["class"].tolist() == [3]
    assert raw.attributes["class"].dtype == np.int64


def test_text_columns_are_left_out_and_named(tmp_path, advance) -> None:
    path = tmp_path / "a.csv"
    path.write_text("x,y,z,name\n1,2,3,rock\n4,5,6,road\n")
    raw = read_xyz(path, advance=advance)
    assert raw.attributes == {}
    assert raw.warnings == ("The columns name hold text and were left out.",)


def test_missing_values_become_nan(tmp_path, advance) -> None:
    path = tmp_path / "a.csv"
    path.write_text("x,y,z,g\n1,2,nan,0.5\n4,5,,\n7,8,9,1.5\n")
    raw = read_xyz(path, advance=advance)
    assert np.isnan(raw.points[:2, 2]).all()
    np.testing.assert_array_equal(raw.attributes["g"], [0.5, np.nan, 1.5])


def test_a_type_that_changes_late_is_followed(tmp_path, advance) -> None:
    path = tmp_path / "a.csv"
    rows = "".join(f"{n},{n},{n},{n}\n" for n in range(600_000))
    path.write_text("x,y,z,value\n" + rows + "1,2,3,0.25\n")
    raw = read_xyz(path, advance=advance)
    assert raw.attributes["value"][-1] == 0.25
    assert len(raw.points) == 600_001


def test_thinning_takes_whole_points(tmp_path, sample, advance) -> None:
    path = tmp_path / "a.csv"
    path.write_text("x y z r g b grade\n" + lines(sample))
    raw = read_xyz(path, advance=advance, max_points=40)
    assert len(raw.points) == 40
    at = [int(np.abs(sample.points - point).sum(axis=1).argmin()) for point in raw.points]
    np.testing.assert_array_equal(raw.colours, sample.colours[at])


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
def test_bad_text_is_named(tmp_path, advance, text: str, message: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(ReadError) as caught:
        read_xyz(path, advance=advance)
    assert message.lower() in str(caught.value).lower()


def test_the_line_of_a_damaged_row_is_named(tmp_path, sample, advance) -> None:
    path: Path = tmp_path / "a.csv"
    body = ("x y z r g b grade\n" + lines(sample)).splitlines()
    body[400] = "1.0 2.0"
    path.write_text("\n".join(body))
    with pytest.raises(ReadError) as caught:
        read_xyz(path, advance=advance)
    assert caught.value.location == "line 401 (comments not counted)"


def test_binary_under_a_text_name_is_refused(tmp_path, advance) -> None:
    path = tmp_path / "a.xyz"
    path.write_bytes(b"1 2 3\n\x00\x01\x02")
    with pytest.raises(ReadError, match="no text: it has zero bytes") as caught:
        read_xyz(path, advance=advance)
    assert caught.value.location == "byte 6"
