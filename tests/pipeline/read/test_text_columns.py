from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.engines.readers.text_columns import (
    first_column_names_points,
    name_bare_columns,
    name_header_columns,
)

XYZ = [[1.5, 2.5, 3.5], [1.6, 2.6, 3.6], [1.7, 2.7, 3.7]]
RGB = [[200, 100, 50], [201, 101, 51], [202, 0, 255]]
INTENSITY = [[-1200.5], [900.0], [12.0]]
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
    ],
)
def test_numbers_alone_are_named_by_rule(columns, expected: str) -> None:
    assert name(*columns) == expected.split()


def test_pts_files_have_intensity_first() -> None:
    grey = [[100], [101], [102]]
    assert name(XYZ, grey, RGB)[3:] == ["red", "green", "blue", "intensity"]
    assert name(XYZ, grey, RGB, pts=True)[3:] == ["intensity", "red", "green", "blue"]


def test_constant_columns_are_no_colours() -> None:
    assert name(XYZ, np.ones((3, 3)))[3:] == ["column_4", "column_5", "column_6"]


def test_headers_in_any_case_order_and_dress() -> None:
    assert name_header_columns(["//X", "Y", "Z", "R", "G", "B"]) == [
        "x", "y", "z", "red", "green", "blue",
    ]  # fmt: skip
    assert name_header_columns(['"Easting"', "Northing", "Elevation", "Class"]) == [
        "x", "y", "z", "Class",
    ]  # fmt: skip
    assert name_header_columns(["x", "y", "z", "g"])[3] == "g"
    # The first column of a meaning wins; empty and repeated names get numbers.
    assert name_header_columns(["x", "east", "", "x"]) == ["x", "east", "column_3", "column_4"]


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ([[1, 594.25, 412.5, 12.1], [2, 593.5, 411.75, 12.2]], "counts the points"),
        ([[7, 594.25, 412.5, 12.1], [19, 593.5, 411.75, 12.2]], "counts the points"),
        ([[np.nan, 594.25, 412.5, 12.1], [np.nan, 593.5, 411.75, 12.2]], "is text"),
        # A raster by rows: x rises by whole metres, y stays.
        ([[641200, 8594700, 12.1, 3], [641201, 8594700, 12.2, 3]], None),
        ([[641200, 8594700.5, 12.1], [641201, 8594700.5, 12.2]], None),
        ([[5, 594.25, 412.5, 12.1], [2, 593.5, 411.75, 12.2]], None),
        ([[1.5, 594.25, 412.5, 12.1], [2.5, 593.5, 411.75, 12.2]], None),
    ],
)
def test_first_columns_that_name_points(rows, says) -> None:
    assert first_column_names_points(np.array(rows, dtype=np.float64)) == says
