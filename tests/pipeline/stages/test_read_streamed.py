"""Read in parts and put into order, a survey is what was written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import laspy
import numpy as np
import pye57
import pytest
from pipeline.read.read_in_order import read_in_order
from pypcd4 import Encoding, PointCloud
from pyproj import CRS

from terraport_pipeline.engines.readers import read_e57, read_las, read_pcd, read_ply, read_xyz
from terraport_pipeline.errors import ReadError
from terraport_pipeline.model import Survey
from terraport_pipeline.stages import read_streamed
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.stages.read import read_survey
from terraport_pipeline.stages.reading import sort, spool, strays

COUNT = 700
rng = np.random.default_rng(5)
POINTS = rng.integers(0, 50_000, (COUNT, 3)) * 0.001 + np.array([641_000.0, 8_594_000.0, 1_200.0])
COLOURS = rng.integers(1, 256, (COUNT, 3)).astype(np.uint8)
GRADE = rng.uniform(0, 4, COUNT).astype(np.float32)
CLASSES = rng.integers(1, 7, COUNT).astype(np.uint8)
GREY = "The survey has no colour (RGB): what no photo shows will be grey."


@dataclass(frozen=True)
class Written:
    """What a file holds, as a survey has it."""

    points: np.ndarray
    """(N, 3) in metres."""
    attributes: dict[str, np.ndarray] = field(default_factory=dict)
    colours: np.ndarray | None = field(default_factory=lambda: COLOURS)
    warnings: tuple[str, ...] = ()
    """All but that no CRS is stated."""


@pytest.fixture(autouse=True)
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Several parts of a small file."""
    for module in (read_las, read_e57, read_pcd, read_ply):
        monkeypatch.setattr(module, "_CHUNK_POINTS", 150)
    monkeypatch.setattr(read_ply, "_ASCII_CHUNK", 150)
    monkeypatch.setattr(read_xyz, "_BLOCK_BYTES", 4096)
    monkeypatch.setattr(strays, "BLOCK_ROWS", 128)
    monkeypatch.setattr(sort, "BLOCK_ROWS", 128)
    monkeypatch.setattr(sort, "_BUCKET_ROWS", 200)
    monkeypatch.setattr(spool, "_SAMPLE_STEP", 7)


def write_las(path: Path, *, epsg: int = 32735, widen: int = 257) -> Written:
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), POINTS[0]
    header.add_crs(CRS.from_epsg(epsg))
    header.add_extra_dim(laspy.ExtraBytesParams("grade", np.float32))
    header.add_extra_dim(laspy.ExtraBytesParams("way", "3float32"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = POINTS.T
    las.red, las.green, las.blue = COLOURS.T.astype(np.uint16) * widen
    las.classification, las.grade = CLASSES, GRADE
    las.way = np.stack([GRADE, GRADE, -GRADE], axis=1)
    las.write(path)
    way = {f"way_{k}": values for k, values in enumerate((GRADE, GRADE, -GRADE))}
    return Written(POINTS, {"classification": CLASSES, "grade": GRADE, **way})


def write_las_eight(path: Path) -> Written:
    warning = "The colours use only 8 of the 16 bits that LAS gives them; they are taken as 0..255."
    return replace(write_las(path, widen=1), warnings=(warning,))


def write_las_feet(path: Path) -> Written:
    warnings = (
        (
            "The coordinates (about 641,025, 8,594,025) lie outside the area that NAD83 / Texas "
            "Central (ftUS) is made for: sizes are as they say, the place on Earth is not to be "
            "relied on. --crs EPSG:n states another."
        ),
    )
    written = write_las(path, epsg=2277)
    return replace(written, points=POINTS * 0.3048006096012192, warnings=warnings)


GREY_POINTS = (
    f"{COUNT - 400:,} of {COUNT - 80:,} points have no colour, or one that is marked as invalid: "
    "they are grey."
)


def write_las_black(path: Path) -> Written:
    black = "The fields red, green, blue are 0 in every point."
    return replace(write_las(path, widen=0), colours=None, warnings=(black, GREY))


def write_ply(path: Path, *, kind: str = "binary_big_endian") -> Written:
    types = [("x", "f8"), ("y", "f8"), ("z", "f8"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]
    table = np.zeros(COUNT, dtype=[*types, ("grade", "f4"), ("class", "u1")])
    for axis, name in enumerate("xyz"):
        table[name] = POINTS[:, axis]
    for k, name in enumerate(("red", "green", "blue")):
        table[name] = COLOURS[:, k]
    table["grade"], table["class"] = GRADE, CLASSES
    table["x"][17] = np.nan
    words = {"f8": "double", "f4": "float", "u1": "uchar"}
    names = [f"property {words[table.dtype[n].str[1:]]} {n}" for n in table.dtype.names or ()]
    head = ["ply", f"format {kind} 1.0", f"element vertex {COUNT}", *names]
    head += ["element face 0", "end_header", ""]
    body = table.astype(table.dtype.newbyteorder(">")).tobytes()
    if kind == "ascii":
        body = "\n".join(" ".join(map(repr, map(float, row))) for row in table.tolist()).encode()
    path.write_bytes("\n".join(head).encode() + body)
    finite = np.arange(COUNT) != 17
    attributes = {"grade": GRADE[finite], "class": CLASSES[finite]}
    warning = "1 of 700 points have no finite coordinates: dropped."
    return Written(POINTS[finite], attributes, COLOURS[finite], (warning,))


def write_ply_text(path: Path) -> Written:
    return write_ply(path, kind="ascii")


def write_pcd(path: Path) -> Written:
    packed = COLOURS.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], dtype=np.uint32)
    local = (POINTS - POINTS[0]).astype(np.float32)
    cloud = PointCloud.from_points(
        [*local.T, packed.view(np.float32), GRADE],
        ("x", "y", "z", "rgb", "grade"),
        (np.float32,) * 5,
    )
    cloud.save(path, encoding=Encoding.BINARY)
    return Written(local.astype(np.float64), {"grade": GRADE})


def write_e57(path: Path) -> Written:
    local = (POINTS - POINTS[0]).astype(np.float32).astype(np.float64)

    def fields(rows: slice) -> dict[str, np.ndarray]:
        data = {f"cartesian{axis}": local[rows, k].copy() for k, axis in enumerate("XYZ")}
        return data | {"intensity": GRADE[rows]}

    with pye57.E57(str(path), mode="w") as file:
        first = fields(slice(0, 400))
        valid = np.arange(COUNT) % 5 != 0
        valid[400:] = True
        first["cartesianInvalidState"] = (~valid[:400]).astype(np.int8)
        for k, name in enumerate(("Red", "Green", "Blue")):
            first[f"color{name}"] = COLOURS[:400, k]
        file.write_scan_raw(first, translation=POINTS[0])
        file.write_scan_raw(fields(slice(400, COUNT)), translation=POINTS[0] + 3.0)
    second = np.arange(COUNT) >= 400
    points = local + np.where(second[:, None], POINTS[0] + 3.0, POINTS[0])
    attributes = {"intensity": GRADE.astype(np.float64), "scan": second.astype(np.uint8)}
    return Written(
        points[valid],
        {name: values[valid] for name, values in attributes.items()},
        np.where(second[:, None], 160, COLOURS)[valid],
        (
            "80 points that the scanner marked invalid were left out.",
            "There is no colour in scan 1: its points are grey.",
            GREY_POINTS,
        ),
    )


def write_csv(path: Path) -> Written:
    lines = ["x,y,z,red,green,blue,grade,class,note,late,empty"]
    for i in range(COUNT):
        late = "1.5" if i == COUNT - 3 else str(i)
        colour = ",".join(map(str, COLOURS[i]))
        coordinates = ",".join(f"{value:.3f}" for value in POINTS[i])
        code = "" if i == 600 else str(CLASSES[i])
        lines.append(f"{coordinates},{colour},{GRADE[i]:.6f},{code},stone,{late},")
    path.write_text("\n".join(lines) + "\n")
    gap, late = CLASSES.astype(np.float64), np.arange(COUNT, dtype=np.float64)
    gap[600], late[COUNT - 3] = np.nan, 1.5
    grade = np.array([float(f"{value:.6f}") for value in GRADE])
    warning = "The columns note hold text and were left out."
    return Written(POINTS, {"grade": grade, "class": gap, "late": late}, warnings=(warning,))


def write_bare(path: Path) -> Written:
    rows = np.column_stack([POINTS, COLOURS])
    np.savetxt(path, rows, fmt=["%.3f"] * 3 + ["%d"] * 3)
    warning = "The file has no header; its columns were taken as x, y, z, red, green, blue."
    return Written(POINTS, warnings=(warning,))


WRITERS: list[tuple[str, Callable[[Path], Written]]] = [
    ("a.laz", write_las),
    ("eight.las", write_las_eight),
    ("feet.las", write_las_feet),
    ("black.las", write_las_black),
    ("a.ply", write_ply),
    ("text.ply", write_ply_text),
    ("a.pcd", write_pcd),
    ("a.e57", write_e57),
    ("a.csv", write_csv),
    ("bare.xyz", write_bare),
]


@pytest.mark.parametrize(("name", "write"), WRITERS, ids=[name for name, _ in WRITERS])
def test_everything_that_was_written_comes_back(
    tmp_path: Path, name: str, write: Callable[[Path], Written]
) -> None:
    path = tmp_path / name
    written = write(path)
    survey = read_in_order(path, written.points)
    np.testing.assert_allclose(survey.points, written.points, rtol=1e-15)
    np.testing.assert_array_equal(survey.colours, written.colours)
    assert list(survey.attributes) == list(written.attributes)
    for column, values in written.attributes.items():
        np.testing.assert_array_equal(survey.attributes[column], values, strict=True)
    warnings = [text for text in survey.warnings if not text.startswith("No coordinate reference")]
    assert warnings == list(written.warnings)


def rows_of(survey: Survey) -> set[bytes]:
    """All values of every point, as bytes: a survey without its order."""
    colours = [] if survey.colours is None else [survey.colours]
    table = np.column_stack([survey.points, *colours, *survey.attributes.values()])
    return {row.tobytes() for row in table.astype(np.float64)}


@pytest.mark.parametrize(("name", "write"), WRITERS, ids=[name for name, _ in WRITERS])
def test_thinned_points_are_of_the_survey_and_spread(
    tmp_path: Path, name: str, write: Callable[[Path], Written]
) -> None:
    path = tmp_path / name
    write(path)
    whole, thin = read_survey(path), read_survey(path, max_points=200)
    assert len(thin.points) == 200
    assert rows_of(thin) <= rows_of(whole)
    # Every octant of the box keeps its share.
    middle = np.median(whole.points, axis=0)
    octants = [
        np.bincount((survey.points > middle) @ [1, 2, 4], minlength=8) / len(survey.points)
        for survey in (whole, thin)
    ]
    assert np.abs(octants[0] - octants[1]).max() < 0.05


def test_neighbours_in_the_order_are_near_in_space(tmp_path: Path) -> None:
    write_las(tmp_path / "a.las")
    points = read_survey(tmp_path / "a.las").points
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    shuffled = np.linalg.norm(np.diff(rng.permutation(points), axis=0), axis=1)
    assert np.median(steps) < 0.4 * np.median(shuffled)


def test_a_compressed_pcd_says_how_to_convert_it(tmp_path: Path) -> None:
    path = tmp_path / "a.pcd"
    cloud = PointCloud.from_xyz_points((POINTS - POINTS[0]).astype(np.float32))
    cloud.save(path, encoding=Encoding.BINARY_COMPRESSED)
    with pytest.raises(ReadError, match="cannot be read in parts; convert it to DATA binary"):
        read_streamed.run(path, tmp_path, Context(tmp_path))


def test_no_finite_point_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("x,y,z\nnan,1,2\n,3,4\n")
    with pytest.raises(ReadError, match="not one of 2 points has finite coordinates"):
        read_streamed.run(path, tmp_path, Context(tmp_path))


def test_a_damaged_line_deep_in_a_text_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    lines = ["x,y,z"] + [f"{i},{i + 1},{i + 2}" for i in range(3000)]
    lines[2500] = "1,2"
    path.write_text("\n".join(lines))
    with pytest.raises(ReadError, match="the text is no table of 3 columns"):
        read_streamed.run(path, tmp_path, Context(tmp_path))
