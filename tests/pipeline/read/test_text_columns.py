from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.engines.readers.text_columns import (
    degree_columns,
    first_column_names_points,
    header_readings,
    name_bare_columns,
    name_header_columns,
)

XYZ = [[1.5, 2.5, 3.5], [1.6, 2.6, 3.6], [1.7, 2.7, 3.7]]
RGB = [[200, 100, 50], [201, 101, 51], [202, 0, 255]]
INTENSITY = [[-1200.5], [900.0], [12.0]]
GREY = [[100], [101], [102]]
SHARE = [[0.125], [0.5], [0.75]]
CLASS = [[2], [6], [5]]
OPAQUE = [[255], [255], [255]]
RGB16 = [[51400, 25700, 12850], [51657, 25957, 13107], [51914, 0, 65535]]
UP = [[0, 0, 1], [0, 0, 1], [0, 1, 0]]
NORMALS = [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, -1.0, 0.0]]


def name(*columns, pts=False):
    return name_bare_columns(np.hstack(columns), intensity_first=pts)


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ((XYZ,), "x y z"),
        ((XYZ, INTENSITY), "x y z intensity"),
        ((XYZ, RGB), "x y z red green blue"),
        ((XYZ, RGB, INTENSITY), "x y z red green blue intensity"),
        ((XYZ, INTENSITY, RGB), "x y z intensity red green blue"),
        ((XYZ, NORMALS), "x y z nx ny nz"),
        ((XYZ, RGB, NORMALS), "x y z red green blue nx ny nz"),
        ((XYZ, RGB, INTENSITY, INTENSITY), "x y z red green blue intensity column_8"),
        ((XYZ, INTENSITY, INTENSITY), "x y z column_4 column_5"),
        ((XYZ, NORMALS, RGB), "x y z nx ny nz red green blue"),
        ((XYZ, UP, RGB), "x y z nx ny nz red green blue"),
        ((XYZ, SHARE, RGB), "x y z intensity red green blue"),
        ((XYZ, SHARE, RGB, NORMALS), "x y z intensity red green blue nx ny nz"),
        ((XYZ, RGB16), "x y z red green blue"),
        ((XYZ, RGB16, GREY), "x y z red green blue intensity"),
        ((XYZ, RGB, CLASS), "x y z red green blue column_7"),
        ((XYZ, RGB, OPAQUE), "x y z red green blue column_7"),
        ((XYZ, [[0]] * 3, RGB), "x y z column_4 red green blue"),
        ((XYZ, np.ones((3, 3))), "x y z column_4 column_5 column_6"),
        ((XYZ, [[200, 100, 50]] * 3), "x y z red green blue"),
    ],
)
def test_numbers_alone_are_named_by_rule(columns, expected: str) -> None:
    assert name(*columns) == [expected.split()]


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ((XYZ, GREY, RGB), ["red green blue intensity", "intensity red green blue"]),
        ((XYZ, RGB, GREY), ["red green blue intensity", "intensity red green blue"]),
        (
            (XYZ, GREY, RGB, CLASS),
            ["red green blue intensity column_8", "intensity red green blue column_8"],
        ),
        (
            (XYZ, RGB, GREY, NORMALS),
            ["red green blue intensity nx ny nz", "intensity red green blue nx ny nz"],
        ),
        (
            (XYZ, np.array(RGB16)[:, :1], RGB16),
            ["red green blue intensity", "intensity red green blue"],
        ),
        # Shares of one, or codes, that may be colours.
        ((XYZ, SHARE, SHARE, SHARE), ["red green blue", "column_4 column_5 column_6"]),
        ((XYZ, CLASS, CLASS, CLASS), ["red green blue", "column_4 column_5 column_6"]),
        (
            (XYZ, GREY, CLASS, CLASS, CLASS),
            [
                "red green blue column_7",
                "intensity red green blue",
                "column_4 column_5 column_6 column_7",
            ],
        ),
    ],
)
def test_every_reading_that_fits_is_returned(columns, expected: list[str]) -> None:
    assert [" ".join(reading[3:]) for reading in name(*columns)] == expected


def test_pts_files_have_intensity_first() -> None:
    [reading] = name(XYZ, GREY, RGB, pts=True)
    assert reading[3:] == ["intensity", "red", "green", "blue"]


def test_headers_in_any_case_order_and_dress() -> None:
    assert name_header_columns(["//X", "Y", "Z", "R", "G", "B"]) == [
        "x", "y", "z", "red", "green", "blue",
    ]  # fmt: skip
    assert name_header_columns(['"Easting"', "Northing", "Elevation", "Class"]) == [
        "x", "y", "z", "Class",
    ]  # fmt: skip
    assert name_header_columns(["x", "y", "z", "g"])[3] == "g"
    # The one spelled x wins; empty and repeated names get numbers.
    assert name_header_columns(["x", "east", "", "x"]) == ["x", "east", "column_3", "column_4"]


@pytest.mark.parametrize(
    ("header", "readings"),
    [
        ('"X (m)","Y (m)","Z (m)",Red,Green,Blue', ["x,y,z,red,green,blue"]),
        ("Easting[m],Northing[m],Elevation[m],R,G,B", ["x,y,z,red,green,blue"]),
        ("Rechtswert,Hochwert,Höhe (mNN),Rot,Grün,Blau", ["x,y,z,red,green,blue"]),
        ("Hochwert,Rechtswert,Höhe", ["y,x,z"]),
        ("Est,Nord,Altitude,Rouge,Vert,Bleu", ["x,y,z,red,green,blue"]),
        ("ESTE,NORTE,COTA", ["x,y,z"]),
        ("OID_,POINT_X,POINT_Y,POINT_Z,Rf,Gf,Bf", ["OID_,x,y,z,red,green,blue"]),
        ("X (North),Y (East),Z", ["y,x,z"]),
        ("northing_ft,easting_ft,elev. ft", ["y,x,z"]),
        ("Point,UTM_E,UTM_N,RL,Code", ["Point,x,y,z,Code"]),
        ("X,Y,Z (depth)", ["x,y,Z (depth)"]),
        # A letter counts only where no word does: N is the number, E an error.
        ("N,X,Y,Z", ["N,x,y,z"]),
        ("E,X,Y,Z", ["E,x,y,z"]),
        ("N,E,Z", ["y,x,z"]),
        ("Easting,Northing,Elevation,H", ["x,y,z,H"]),
        ("x,y,z,height,r", ["x,y,z,height,r"]),
        # Two whole sets, or two heights without a letter that decides.
        ("Easting,Northing,Height,X,Y,Z", ["-,-,-,x,y,z", "x,y,z,-,-,-"]),
        ("E,N,H,X,Y,Z", ["-,-,-,x,y,z", "x,y,z,-,-,-"]),
        ("x,y,height,elevation", ["x,y,z,-", "x,y,-,z"]),
    ],
)
def test_what_headers_of_many_programs_mean(header: str, readings: list[str]) -> None:
    assert [",".join(reading) for reading in header_readings(header.split(","))] == readings


def test_columns_in_degrees_by_name_or_by_unit() -> None:
    assert degree_columns(["Lon", "Lat", "h"]) == ["Lon", "Lat"]
    assert degree_columns(["X (deg)", "Y [°]", "Z (m)"]) == ["X (deg)", "Y [°]"]
    assert degree_columns(["x", "y", "z", "lat", "lon"]) == []


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ([[1, 594.25, 412.5, 12.1], [2, 593.5, 411.75, 12.2]], "counts the points"),
        ([[7, 594.25, 412.5, 12.1], [19, 593.5, 411.75, 12.2]], "counts the points"),
        ([[np.nan, 594.25, 412.5, 12.1], [np.nan, 593.5, 411.75, 12.2]], "is text"),
        # A raster by rows: x rises by whole metres, y stays.
        ([[641200, 8594700, 12.1, 3], [641201, 8594700, 12.2, 3]], None),
        ([[641200, 8594700.5, 12.1], [641201, 8594700.5, 12.2]], None),
        ([[5, 594.25, 412.5, 12.1], [2, 593.5, 411.75, 12.2]], "counts the points"),
        ([[5, 594.25, 412.5, 12.1], [5, 593.5, 411.75, 12.2]], None),
        ([[1.5, 594.25, 412.5, 12.1], [2.5, 593.5, 411.75, 12.2]], None),
    ],
)
def test_first_columns_that_name_points(rows, says) -> None:
    assert first_column_names_points(np.array(rows, dtype=np.float64)) == says
