from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from pipeline.read.read_in_order import read_in_order
from pypcd4 import Encoding, PointCloud

from terraport_pipeline.errors import ReadError
from terraport_pipeline.stages.read import read_survey

ENCODINGS = [Encoding.ASCII, Encoding.BINARY, Encoding.BINARY_COMPRESSED]


def write(path: Path, sample, encoding, *, packed=True) -> Path:
    names = ["x", "y", "z", "intensity", "label"]
    types = [np.float64, np.float64, np.float64, np.float32, np.uint16]
    columns = [*sample.points.T, sample.grade, sample.classes.astype(np.uint16)]
    if packed:
        wide = sample.colours.astype(np.uint32)
        bits = (wide[:, 0] << 16) | (wide[:, 1] << 8) | wide[:, 2]
        names.append("rgb")
        types.append(np.uint32)
        columns.append(bits)
    else:
        names += ["r", "g", "b"]
        types += [np.uint8] * 3
        columns += list(sample.colours.T)
    cloud = PointCloud.from_points(columns, tuple(names), tuple(types))
    cloud.save(path, encoding=encoding)
    return path


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("packed", [True, False])
def test_everything_comes_back(tmp_path, sample, encoding, packed: bool) -> None:
    survey = read_in_order(
        write(tmp_path / "a.pcd", sample, encoding, packed=packed), sample.points
    )
    np.testing.assert_allclose(survey.points, sample.points, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(survey.colours, sample.colours)
    np.testing.assert_allclose(survey.attributes["intensity"], sample.grade, rtol=1e-6)
    np.testing.assert_array_equal(survey.attributes["label"], sample.classes)
    assert list(survey.attributes) == ["intensity", "label"]


def test_colour_packed_into_a_float(tmp_path, sample) -> None:
    """PCL's own habit: 0x00RRGGBB stored as if it were a float32."""
    wide = sample.colours.astype(np.uint32)
    bits = (wide[:, 0] << 16) | (wide[:, 1] << 8) | wide[:, 2]
    local = (sample.points - sample.points[0]).astype(np.float32)
    columns = [*local.T, bits.view(np.float32)]
    path = tmp_path / "a.pcd"
    PointCloud.from_points(columns, ("x", "y", "z", "rgb"), (np.float32,) * 4).save(
        path, encoding=Encoding.BINARY
    )
    np.testing.assert_array_equal(read_in_order(path, local).colours, sample.colours)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_every_truncation_is_a_read_error(tmp_path, sample, encoding) -> None:
    path = write(tmp_path / "a.pcd", sample, encoding)
    data = path.read_bytes()
    # A cut within the last ASCII number still leaves a number: stop before it.
    for length in range(5, len(data) - 12, 601):
        path.write_bytes(data[:length])
        with pytest.raises(ReadError):
            read_survey(path)


def test_damage_inside_compressed_points_is_a_read_error(tmp_path, sample) -> None:
    path = write(tmp_path / "a.pcd", sample, Encoding.BINARY_COMPRESSED)
    data = path.read_bytes()
    start = data.index(b"DATA binary_compressed\n") + 23
    for at in (start, start + 4, start + 8):  # packed size, whole size, first control byte
        spoilt = bytearray(data)
        spoilt[at] = 255 - spoilt[at]
        path.write_bytes(spoilt)
        with pytest.raises(ReadError):
            read_survey(path)


def test_a_cut_binary_file_says_at_which_point(tmp_path, sample) -> None:
    path = write(tmp_path / "a.pcd", sample, Encoding.BINARY)
    data = path.read_bytes()
    start = data.index(b"DATA binary\n") + 12
    path.write_bytes(data[: start + 100 * 34 + 1])
    with pytest.raises(ReadError, match="ends after 100 of 500 points"):
        read_survey(path)


HEAD = "VERSION 0.7\nFIELDS {fields}\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {n}\nHEIGHT 1\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD.format(fields="x y w", n=1) + "POINTS 1\nDATA ascii\n1 2 3\n", "no field z"),
        (HEAD.format(fields="x y z", n=0) + "POINTS 0\nDATA ascii\n", "0 points"),
        (
            HEAD.format(fields="x y z", n=1).replace("SIZE 4 4 4", "SIZE 4 4 9")
            + "POINTS 1\nDATA ascii\n1 2 3\n",
            "cannot be read",
        ),
        (
            HEAD.format(fields="x y z", n=1).replace("SIZE 4 4 4", "SIZE 4 4 9")
            + "POINTS 1\nDATA binary\n12345678901234567",
            "cannot be read",
        ),
        (
            HEAD.format(fields="x y z", n=1).replace("COUNT 1 1 1", "COUNT 1 1 2")
            + "POINTS 1\nDATA ascii\n1 2 3 4\n",
            "no field z",
        ),
        (HEAD.format(fields="x y", n=1) + "POINTS 1\nDATA ascii\n1 2\n", ""),
        (HEAD.format(fields="x y z", n=1) + "POINTS 1\n", "no DATA line"),
        (HEAD.format(fields="x y z", n=1) + "POINTS 1\nDATA zip\n", "header is wrong"),
        (HEAD.format(fields="x y z", n=9) + "POINTS 99999999999\nDATA binary\n1", "ends after 0"),
        (
            HEAD.format(fields="x y z", n=9) + "POINTS 9\nDATA ascii\n" + "1.25 2.25 3.25\n" * 8,
            "8 of 9",
        ),
        (HEAD.format(fields="x y z", n=1) + "POINTS 1\nDATA ascii\n1 2 three\n", "cannot be read"),
    ],
)
def test_bad_files_are_named(tmp_path, text: str, message: str) -> None:
    path = tmp_path / "a.pcd"
    path.write_text(text)
    with pytest.raises(ReadError) as caught:
        read_survey(path)
    assert message in str(caught.value)


@pytest.mark.parametrize("version", [".5", "0.5", ".6", ".7"])
@pytest.mark.parametrize(
    ("fields", "types"),
    [("FIELDS", "SIZE 8 8 8 4\nTYPE F F F F\n"), ("COLUMNS", "size 8 8 8 4\ntype f f f f\n")],
)
def test_older_versions_in_any_case(tmp_path, sample, version: str, fields: str, types) -> None:
    """Without COUNT, HEIGHT, VIEWPOINT and POINTS, as PCL's first versions and ROS wrote them."""
    path = tmp_path / "a.pcd"
    head = f"# made here\n\nVERSION {version}\n{fields} X Y Z Intensity\n{types}WIDTH 500\n"
    table = np.zeros(500, [("x", "<f8", 3), ("i", "<f4")])
    table["x"], table["i"] = sample.points, sample.grade
    path.write_bytes(head.encode() + b"DATA binary\n" + table.tobytes())
    survey = read_in_order(path, sample.points)
    np.testing.assert_array_equal(survey.attributes["Intensity"], sample.grade)
    assert list(survey.attributes) == ["Intensity"]


def test_text_with_wide_gaps_and_capitals(tmp_path) -> None:
    path = tmp_path / "a.pcd"
    head = "VERSION .7\nFIELDS X Y Z RGB\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
    rows = "1.5  2.5\t3.5 660510\n 4.5 5.5 6.5   16711935\n"
    path.write_text(f"{head}WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ASCII\n{rows}")
    survey = read_in_order(path, np.array([[1.5, 2.5, 3.5], [4.5, 5.5, 6.5]]))
    assert survey.colours is not None
    assert survey.colours.tolist() == [[10, 20, 30], [255, 0, 255]]


def test_compressed_fields_of_several_values_keep_their_points(tmp_path) -> None:
    """PCL compresses field by field, and a field of three values point by point."""
    points = np.array([[1, 2, 3], [4, 5, 6], [7, 8, 9], [2, 4, 8]], "<f4")
    normals = np.arange(12, dtype="<f4").reshape(4, 3)
    whole = points.T.tobytes() + normals.tobytes()
    packed = b"".join(  # LZF with literal runs alone
        bytes([len(whole[at : at + 32]) - 1]) + whole[at : at + 32]
        for at in range(0, len(whole), 32)
    )
    head = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z normal\nSIZE 4 4 4 4\nTYPE F F F F\n"
        "COUNT 1 1 1 3\nWIDTH 4\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\n"
        "DATA binary_compressed\n"
    )
    path = tmp_path / "a.pcd"
    path.write_bytes(head.encode() + struct.pack("<II", len(packed), len(whole)) + packed)
    survey = read_in_order(path, points.astype(np.float64))
    read = np.stack([survey.attributes[f"normal__000{n}"] for n in range(3)], axis=1)
    np.testing.assert_array_equal(read, normals)
