from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from pipeline.read.read_in_order import read_in_order

from terraport_pipeline.engines.readers import read_ply
from terraport_pipeline.errors import ReadError
from terraport_pipeline.stages.read import read_survey

TYPES = [
    ("x", "double", "f8"), ("y", "double", "f8"), ("z", "double", "f8"),
    ("red", "uchar", "u1"), ("green", "uchar", "u1"), ("blue", "uchar", "u1"),
    ("scalar_grade", "float", "f4"), ("class", "ushort", "u2"), ("id", "int", "i4"),
]  # fmt: skip


SPLAT = [*TYPES[:3], *((name, "float", "f4") for name in ("f_dc_0", "scale_0", "rot_0"))]


def header(kind: str, count: int, types=TYPES, tail="element face 2\nproperty list uchar int v\n"):
    lines = "".join(f"property {ply} {name}\n" for name, ply, _ in types)
    return (
        f"ply\nformat {kind} 1.0\ncomment made here\nelement vertex {count}\n{lines}{tail}"
        "end_header\n"
    ).encode()


def rows(sample, endian: str) -> np.ndarray:
    table = np.zeros(len(sample.points), [(name, endian + code) for name, _, code in TYPES])
    table["x"], table["y"], table["z"] = sample.points.T
    table["red"], table["green"], table["blue"] = sample.colours.T
    table["scalar_grade"], table["class"] = sample.grade, sample.classes
    table["id"] = -np.arange(len(table))
    return table


def write(path: Path, sample, kind: str) -> Path:
    faces = b"\x03" + np.array([0, 1, 2], "<i4").tobytes()
    if kind == "ascii":
        body = "".join(
            " ".join(repr(value.item()) for value in row) + "\n" for row in rows(sample, "<")
        ).encode()
        path.write_bytes(header(kind, 500) + body + b"3 0 1 2\n3 1 2 3\n")
    else:
        endian = "<" if kind == "binary_little_endian" else ">"
        path.write_bytes(header(kind, 500) + rows(sample, endian).tobytes() + faces * 2)
    return path


KINDS = ["ascii", "binary_little_endian", "binary_big_endian"]


@pytest.mark.parametrize("kind", KINDS)
def test_every_scalar_property_comes_back(tmp_path, sample, kind: str) -> None:
    survey = read_in_order(write(tmp_path / "a.ply", sample, kind), sample.points)
    np.testing.assert_array_equal(survey.points, sample.points)
    np.testing.assert_array_equal(survey.colours, sample.colours)
    assert list(survey.attributes) == ["scalar_grade", "class", "id"]
    np.testing.assert_array_equal(survey.attributes["scalar_grade"], sample.grade)
    assert survey.attributes["class"].dtype == np.uint16
    np.testing.assert_array_equal(survey.attributes["id"], -np.arange(500))
    warning, no_crs = survey.warnings
    assert warning == "Only the vertices are read; the file's 2 face elements are ignored."
    assert no_crs.startswith("No coordinate reference system")


@pytest.mark.parametrize("kind", KINDS[1:])
def test_a_cut_binary_file_says_at_which_vertex(tmp_path, sample, kind: str) -> None:
    path = write(tmp_path / "a.ply", sample, kind)
    row = rows(sample, "<").itemsize
    length = len(header(kind, 500)) + 77 * row + 3
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(ReadError, match="ends after 77 of 500 vertices") as caught:
        read_survey(path)
    assert caught.value.location == f"byte {length:,}"


def test_a_cut_ascii_file_says_at_which_vertex(tmp_path, sample) -> None:
    path = write(tmp_path / "a.ply", sample, "ascii")
    lines = path.read_bytes().splitlines(keepends=True)
    head = header("ascii", 500).count(b"\n")
    path.write_bytes(b"".join(lines[: head + 450]))
    with pytest.raises(ReadError, match="ends after 450 of 500 vertices"):
        read_survey(path)
    path.write_bytes(b"".join(lines[: head + 450]) + b"1.0 2.0")
    with pytest.raises(ReadError, match="is no row of 9 numbers") as caught:
        read_survey(path)
    assert caught.value.location == "vertex 450"


@pytest.mark.parametrize("kind", KINDS)
def test_every_truncation_of_the_vertices_is_a_read_error(tmp_path, sample, kind: str) -> None:
    path = write(tmp_path / "a.ply", sample, kind)
    data = path.read_bytes()
    last = data.rindex(b"3 0 1 2") - 8 if kind == "ascii" else len(data) - 2 * 13 - 1
    for length in range(3, last, 997):
        path.write_bytes(data[:length])
        with pytest.raises(ReadError):
            read_survey(path)


def test_nan_is_a_number_and_no_damage(tmp_path) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(header("ascii", 2, TYPES[:3], "") + b"nan 1 2\n3 4 5\n")
    survey = read_survey(path)
    assert survey.points.tolist() == [[3.0, 4.0, 5.0]]
    assert "1 of 2 points have no finite coordinates: dropped." in survey.warnings


def test_an_element_before_the_vertices_is_stepped_over(tmp_path) -> None:
    camera = b"element camera 1\nproperty double a\nproperty uchar b\n"
    head = header("binary_little_endian", 1, TYPES[:3], "")
    at = head.index(b"element vertex")
    path = tmp_path / "a.ply"
    path.write_bytes(head[:at] + camera + head[at:] + b"\x07" * 9 + np.arange(3.0).tobytes())
    assert read_survey(path).points.tolist() == [[0.0, 1.0, 2.0]]


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (header("ascii", 1, TYPES[:2], "") + b"1 2\n", "the vertices have no z"),
        (
            header("ascii", 1, SPLAT, "") + b"1 2 3 0 0 0\n",
            "these are Gaussian splats",
        ),
        (header("ascii", 0, TYPES[:3], ""), "the header says 0 vertices"),
        (header("binary_middle", 1, TYPES[:3], ""), "format is 'binary_middle'"),
        (b"ply\nformat ascii 1.0\nelement face 1\nend_header\n", "no vertex element, only face"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\n", "no PLY header ends"),
        (b"ply\nformat ascii 1.0\nproperty float x\nend_header\n", "'property float x'"),
        (b"ply\nformat ascii 1.0\nelement vertex many\nend_header\n", "'element vertex many'"),
        (b"ply\nelement vertex 1\nproperty half x\nend_header\n", "'property half x'"),
        (header("ascii", 10**12, TYPES[:3], "") + b"1 2 3\n", "1,000,000,000,000 vertices"),
        (header("binary_little_endian", 10**15, TYPES[:3], ""), "ends after 0 of"),
    ],
)
def test_bad_headers_are_named(tmp_path, data: bytes, text: str) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(data)
    with pytest.raises(ReadError) as caught:
        read_survey(path)
    assert text in str(caught.value)


def with_lists(sample, kind: str) -> bytes:
    """Vertices with lists before, between and after the scalars, and faces before the vertices."""
    head = (
        f"ply\nformat {kind} 1.0\nelement face 3\nproperty list uchar int vertex_indices\n"
        f"element vertex {len(sample.points)}\nproperty list ushort short seen_by\n"
        "property double x\nproperty double y\nproperty list int float weights\n"
        "property double z\nproperty uchar diffuse_red\nproperty uchar diffuse_green\n"
        "property uchar diffuse_blue\nproperty list uchar double nothing\nend_header\n"
    ).encode()
    e = "<" if kind == "binary_little_endian" else ">"
    body = []
    for n, (point, colour) in enumerate(zip(sample.points, sample.colours, strict=True)):
        seen, weights = [-1] * (n % 4), [0.5] * (n % 3)
        if kind == "ascii":
            values = [len(seen), *seen, *point[:2], len(weights), *weights, point[2], *colour, 0]
            body.append((" ".join(map(str, values)) + "\n").encode())
        else:
            form = f"{e}H{len(seen)}hddi{len(weights)}fd3BB"
            body.append(
                struct.pack(
                    form, len(seen), *seen, *point[:2], len(weights), *weights, point[2], *colour, 0
                )
            )
    triangle = struct.pack(f"{e}B3i", 3, 0, 1, 2) if kind != "ascii" else b"3 0 1 2\n"
    pair = struct.pack(f"{e}B2i", 2, 0, 1) if kind != "ascii" else b"2 0 1\n"
    return head + triangle + pair + triangle + b"".join(body)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("block", [1 << 24, 97])
def test_lists_at_vertices_are_left_out_and_named(
    tmp_path, sample, kind: str, block: int, monkeypatch
) -> None:
    monkeypatch.setattr(read_ply, "_LISTS_BYTES", block)
    path = tmp_path / "a.ply"
    path.write_bytes(with_lists(sample, kind))
    survey = read_in_order(path, sample.points)
    np.testing.assert_array_equal(survey.points, sample.points)
    np.testing.assert_array_equal(survey.colours, sample.colours)
    assert survey.attributes == {}
    assert survey.warnings[:2] == (
        "The vertices' lists (seen_by, weights, nothing) are left out.",
        "Only the vertices are read; the file's 3 face elements are ignored.",
    )


@pytest.mark.parametrize("kind", KINDS)
def test_every_truncation_of_vertices_with_lists_is_a_read_error(
    tmp_path, sample, kind: str
) -> None:
    path = tmp_path / "a.ply"
    data = with_lists(sample, kind)
    for length in range(3, len(data) - 3, 997):
        path.write_bytes(data[:length])
        with pytest.raises(ReadError):
            read_survey(path)


def test_a_list_of_negative_length_is_named(tmp_path) -> None:
    path = tmp_path / "a.ply"
    head = header("binary_little_endian", 2, TYPES[:3], "property list int uchar seen\n")
    row = np.arange(3.0).tobytes()
    path.write_bytes(head + row + b"\0" * 4 + row + b"\xff" * 4)
    with pytest.raises(ReadError, match="a list has -1 values") as caught:
        read_survey(path)
    assert caught.value.location == "vertex 1"
