from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pipeline.read.read_in_order import read_in_order

from terraport_pipeline.engines.readers import clean_text, read_xyz
from terraport_pipeline.errors import ReadError, SurveyError
from terraport_pipeline.stages.read import read_survey
from terraport_pipeline.survey.find_survey import find_survey
from terraport_pipeline.survey_statement import SurveyStatement

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


def rows(sample, columns: str, sep: str = " ", end: str = "\n", decimal: str = ".") -> str:
    """Rows of x, y, z (also in feet), i (intensity 0..255), r, g, b (also f: 0..1, w: 16 bits)."""
    values = {
        **dict(zip("xyz", sample.points.T, strict=True)),
        **dict(zip("XYZ", sample.points.T / 0.3048, strict=True)),
        **dict(zip("rgb", sample.colours.T.astype(int), strict=True)),
        **dict(zip("RGB", sample.colours.T.astype(int) * 257, strict=True)),
        "i": np.arange(len(sample.points)) % 230 + 20,
        "c": sample.classes.astype(int),
        "n": np.arange(len(sample.points)),
    }
    table = [[f"{v:.6f}" if v.dtype.kind == "f" else f"{v}" for v in values[c]] for c in columns]
    return "".join(sep.join(row).replace(".", decimal) + end for row in zip(*table, strict=True))


@pytest.mark.parametrize(
    ("name", "columns", "stated"),
    [
        ("a.xyz", "xyzirgb", "x,y,z,intensity,red,green,blue"),
        ("a.txt", "xyzrgbi", "x,y,z,red,green,blue,intensity"),
        ("a.xyz", "xyzirgbc", "x,y,z,intensity,red,green,blue,column_8"),
        ("a.asc", "xyziRGB", "x,y,z,intensity,red,green,blue"),
        ("a.pts", "xyzirgb", "x,y,z,intensity,red,green,blue"),
    ],
)
def test_intensity_before_or_after_colour_is_never_taken_for_colour(
    tmp_path, sample, name: str, columns: str, stated: str
) -> None:
    """Where both readings fit the error has the option for each, and the right one reads right."""
    path = tmp_path / name
    path.write_text(rows(sample, columns))
    statement = SurveyStatement()
    if columns != "xyziRGB" and name != "a.pts":  # 16 bits after 8 have one reading, PTS by rule
        with pytest.raises(ReadError, match="it can be read in 2 ways") as caught:
            read_survey(path)
        assert f"--columns {stated}" in caught.value.advice
        statement = SurveyStatement(columns=tuple(stated.split(",")))
    survey = read_in_order(path, sample.points, statement)
    np.testing.assert_array_equal(survey.colours, sample.colours)
    np.testing.assert_array_equal(survey.attributes["intensity"], np.arange(500) % 230 + 20)


def test_a_folder_whose_texts_can_be_read_in_two_ways_says_how(tmp_path, sample) -> None:
    for name in ("a.xyz", "b.xyz"):
        (tmp_path / name).write_text(rows(sample, "xyzirgb"))
    survey = find_survey(tmp_path, skip_damaged=True)
    with pytest.raises(SurveyError, match=r"not one of its files can be used: a\.xyz") as caught:
        read_survey(survey)
    assert "--columns x,y,z,intensity,red,green,blue" in str(caught.value)


def test_two_sets_of_coordinates_in_a_header_are_refused_with_both_readings(
    tmp_path, sample
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("E,N,H,X,Y,Z\n" + rows(sample, "xyzXYZ", ","))
    with pytest.raises(ReadError, match="it can be read in 2 ways") as caught:
        read_survey(path)
    assert "--columns -,-,-,x,y,z or --columns x,y,z,-,-,-" in caught.value.advice


def test_columns_that_stop_being_colours_are_named(tmp_path, sample) -> None:
    path = tmp_path / "a.xyz"
    late = "641000.5 8594000.5 1200.5 4000 300 20\n"
    path.write_text(rows(sample, "xyzrgb") * 4 + late)
    with pytest.raises(ReadError, match="columns 4 to 6 are 0 to 255 as colours in the first rows"):
        read_survey(path)


@pytest.mark.parametrize(
    ("head", "columns", "sep", "encoding"),
    [
        ('"X (m)","Y (m)","Z (m)",Red,Green,Blue\n', "xyzrgb", ",", "utf-8"),
        ("Northing[m];Easting[m];Elevation[m];R;G;B\r\n", "yxzrgb", ";", "utf-8"),
        ("Rechtswert [m];Hochwert [m];Höhe [m];Rot;Grün;Blau\n", "xyzrgb", ";", "cp1252"),
        ("\ufeffOstwert;Nordwert;Höhe;Rot;Grün;Blau\n", "xyzrgb", ";", "utf-8"),
        ("\ufeffX\tY\tZ\tR\tG\tB\r\n", "xyzrgb", "\t", "utf-16-le"),
        ("\ufeffX,Y,Z,R,G,B\n", "xyzrgb", ",", "utf-16-be"),
        ("X (m) Y (m) Z (m) R G B\n", "xyzrgb", " ", "utf-8"),
        ("// X, Y, Z, R, G, B\n# made by us\n", "xyzrgb", " ", "utf-8"),
        ("Point no;X;Y;Z;R;G;B\n-;m;m;m;;;\n", "nxyzrgb", ";", "utf-8"),
        ("Project Quarry North\nDate 2024-05-01\n\nX,Y,Z,R,G,B\n", "xyzrgb", ",", "utf-8"),
        ("Project,,,,,\nDate,2024,5,1,,\nX,Y,Z,R,G,B\n", "xyzrgb", ",", "utf-8"),
        ("//X Y Z Rf Gf Bf\n500\n", "xyzrgb", " ", "utf-8"),
    ],
)
def test_headers_units_titles_and_encodings(
    tmp_path, sample, head: str, columns: str, sep: str, encoding: str, monkeypatch
) -> None:
    monkeypatch.setattr(clean_text, "BLOCK_BYTES", 4098)
    path = tmp_path / "a.csv"
    path.write_bytes((head + rows(sample, columns, sep)).encode(encoding))
    survey = read_in_order(path, sample.points)
    np.testing.assert_array_equal(survey.colours, sample.colours)
    assert set(survey.attributes) <= {"Point no"}
    titles = "Project Quarry" in head or "Project," in head
    assert ("What is above the table was left out: 'Project" in survey.warnings[0]) == titles


def test_decimal_commas_in_quotes_and_without(tmp_path, sample) -> None:
    path = tmp_path / "a.csv"
    quoted = rows(sample, "xyz", '","', '"\n', ",").replace("\n", '\n"')[:-1]
    path.write_text('"X","Y","Z"\n"' + quoted)
    read_in_order(path, sample.points)
    path.write_text("12,07,3,50,1,25\n12,08,3,51,1,27\n")
    with pytest.raises(ReadError, match="commas stand between its values and within them"):
        read_survey(path)


FEET = "add --units us-ft (US survey feet, 1200/3937 m) or --units ft"


@pytest.mark.parametrize(
    ("head", "columns", "advice"),
    [
        ("X (ft),Y (ft),Z (ft)\n", "XYZ", FEET),
        ("Easting [US survey feet],Northing [US survey feet],Z\n", "XYZ", FEET),
        ("x_ft,y_ft,z_ft\n", "XYZ", FEET),
        ("Ost,Nord,Höhe\n[Fuß],[Fuß],[Fuß]\n", "XYZ", FEET),
        ("All values in US Survey Feet\nE,N,Z\n", "XYZ", FEET),
        ("# units: feet\n", "XYZ", FEET),
        ("X (m),Y (m),Z (ft)\n", "xyZ", FEET.replace("--units", "--height-units")),
        ("X (yd),Y (yd),Z (yd)\n", "xyz", "convert the coordinates to metres"),
    ],
)
def test_units_other_than_metres_are_never_taken_as_metres(
    tmp_path, sample, head: str, columns: str, advice: str
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(head + rows(sample, columns, ","))
    with pytest.raises(ReadError, match="would be read in units of 1 m") as caught:
        read_survey(path)
    assert caught.value.advice.startswith(advice)
    if "--units" in advice:
        read_in_order(path, sample.points, SurveyStatement(units="ft"))
    elif "--height-units" in advice:
        read_in_order(path, sample.points, SurveyStatement(height_units="ft"))


def test_metres_in_a_header_contradict_a_crs_in_feet(tmp_path, sample) -> None:
    path = tmp_path / "a.csv"
    path.write_text("X (m),Y (m),Z (m)\n" + rows(sample, "xyz", ","))
    with pytest.raises(
        ReadError, match=r"'X \(m\)' for x \(1 m\), but x would be read in units of 0.3048"
    ) as caught:
        read_in_order(path, sample.points, SurveyStatement(crs="EPSG:2263"))
    assert caught.value.advice.startswith("add --units m")


def test_pts_of_several_scans_with_a_count_before_each(tmp_path, sample) -> None:
    path = tmp_path / "a.pts"
    lines = rows(sample, "xyzirgb").splitlines()
    parts = ["200", *lines[:200], " 120 ", *lines[200:320], "180", *lines[320:]]
    path.write_text("\r\n".join(parts) + "\r\n")
    survey = read_in_order(path, sample.points)
    np.testing.assert_array_equal(survey.colours, sample.colours)
    assert not any("truncated" in warning for warning in survey.warnings)
    path.write_text("\n".join(parts[:-50]))
    expected = "The file states 500 points but has 450: it may be truncated."
    assert expected in read_survey(path).warnings


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("x,y,z\n1,2,3\n".encode("utf-16-le"), "UTF-16 without the mark"),
        ("x,y,z\n1,2,3\n".encode("utf-32"), "UTF-16 without the mark"),
        (b"x y z\r1 2 3\r4 5 6\r", "lines end with CR alone"),
        (b"Hoch Rechts Hoehe mNN\n5654000.5 412000.5 180.2\n", "the header has 4 columns"),
        (b"X (deg),Y (deg),Z (m)\n28.3,-12.7,1287\n", "columns X (deg), Y (deg) are degrees"),
    ],
)
def test_texts_that_need_another_form_say_which(tmp_path, data: bytes, message: str) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(data)
    with pytest.raises(ReadError) as caught:
        read_survey(path)
    assert message in str(caught.value)


def test_text_in_windows_1252_beside_the_numbers_is_left_out(tmp_path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes("x;y;z;Art\n1,5;2,5;3,5;Böschung\n4,5;5,5;6,5;Straße\n".encode("cp1252"))
    survey = read_survey(path)
    assert len(survey.points) == 2
    assert "The columns Art hold text and were left out." in survey.warnings


def test_northing_before_easting_without_a_header_is_suspected(tmp_path, sample) -> None:
    path = tmp_path / "a.xyz"
    path.write_text(rows(sample, "yxzrgb"))
    with pytest.raises(ReadError, match="or like northing before easting") as caught:
        read_survey(path)
    assert "--columns y,x,z" in caught.value.advice
    stated = SurveyStatement(columns=tuple("yxzrgb"))
    np.testing.assert_array_equal(
        read_in_order(path, sample.points, stated).colours, sample.colours
    )
