"""Read in parts and put into order, a survey is what the whole reader makes of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pye57
import pytest
from pypcd4 import Encoding, PointCloud
from pyproj import CRS

from terraport_pipeline.engines.readers import read_e57, read_las, read_pcd, read_ply, read_xyz
from terraport_pipeline.errors import ReadError
from terraport_pipeline.stages import read_streamed
from terraport_pipeline.stages.contract import Context
from terraport_pipeline.stages.read import find_format, read_survey

COUNT = 700
rng = np.random.default_rng(5)
POINTS = rng.integers(0, 50_000, (COUNT, 3)) * 0.001 + np.array([641_000.0, 8_594_000.0, 1_200.0])
COLOURS = rng.integers(1, 256, (COUNT, 3)).astype(np.uint8)
GRADE = rng.uniform(0, 4, COUNT).astype(np.float32)
CLASSES = rng.integers(1, 9, COUNT).astype(np.uint8)


@pytest.fixture(autouse=True)
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Several parts of a small file."""
    for module in (read_las, read_e57, read_pcd, read_ply):
        monkeypatch.setattr(module, "_CHUNK_POINTS", 150)
    monkeypatch.setattr(read_ply, "_ASCII_CHUNK", 150)
    monkeypatch.setattr(read_xyz, "_BLOCK_BYTES", 4096)
    monkeypatch.setattr(read_streamed, "_BLOCK_ROWS", 128)
    monkeypatch.setattr(read_streamed, "_BUCKET_ROWS", 200)
    monkeypatch.setattr(read_streamed, "_SAMPLE_STEP", 7)


def write_las(path: Path, *, epsg: int = 32735, widen: int = 257) -> None:
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


def write_las_eight(path: Path) -> None:
    write_las(path, widen=1)


def write_las_feet(path: Path) -> None:
    write_las(path, epsg=2277)


def write_las_black(path: Path) -> None:
    write_las(path, widen=0)


def write_ply(path: Path, *, kind: str = "binary_big_endian") -> None:
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


def write_ply_text(path: Path) -> None:
    write_ply(path, kind="ascii")


def write_pcd(path: Path) -> None:
    packed = COLOURS.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], dtype=np.uint32)
    local = (POINTS - POINTS[0]).astype(np.float32)
    cloud = PointCloud.from_points(
        [*local.T, packed.view(np.float32), GRADE],
        ("x", "y", "z", "rgb", "grade"),
        (np.float32,) * 5,
    )
    cloud.save(path, encoding=Encoding.BINARY)


def write_e57(path: Path) -> None:
    local = (POINTS - POINTS[0]).astype(np.float32).astype(np.float64)

    def fields(rows: slice) -> dict[str, np.ndarray]:
        data = {f"cartesian{axis}": local[rows, k].copy() for k, axis in enumerate("XYZ")}
        return data | {"intensity": GRADE[rows]}

    with pye57.E57(str(path), mode="w") as file:
        first = fields(slice(0, 400))
        first["cartesianInvalidState"] = (np.arange(400) % 5 == 0).astype(np.int8)
        for k, name in enumerate(("Red", "Green", "Blue")):
            first[f"color{name}"] = COLOURS[:400, k]
        file.write_scan_raw(first, translation=POINTS[0])
        file.write_scan_raw(fields(slice(400, COUNT)), translation=POINTS[0] + 3.0)


def write_csv(path: Path) -> None:
    lines = ["x,y,z,red,green,blue,grade,class,note,late,empty"]
    for i in range(COUNT):
        late = "1.5" if i == COUNT - 3 else str(i)
        colour = ",".join(map(str, COLOURS[i]))
        coordinates = ",".join(f"{value:.3f}" for value in POINTS[i])
        code = "" if i == 600 else str(CLASSES[i])
        lines.append(f"{coordinates},{colour},{GRADE[i]:.6f},{code},stone,{late},")
    path.write_text("\n".join(lines) + "\n")


def write_bare(path: Path) -> None:
    rows = np.column_stack([POINTS, COLOURS])
    np.savetxt(path, rows, fmt=["%.3f"] * 3 + ["%d"] * 3)


WRITERS: list[tuple[str, Callable[[Path], None]]] = [
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


READERS = {
    "las": read_las.read_las,
    "ply": read_ply.read_ply,
    "pcd": read_pcd.read_pcd,
    "e57": read_e57.read_e57,
    "xyz": read_xyz.read_xyz,
}


def rows_of(points: np.ndarray, colours: np.ndarray, attributes: list[np.ndarray]) -> np.ndarray:
    """All values of every point as one row of float64, sorted: a survey without its order."""
    table = np.column_stack([points, colours, *attributes]).astype(np.float64)
    return table[np.lexsort(table.T)]


@pytest.mark.parametrize(("name", "write"), WRITERS, ids=[name for name, _ in WRITERS])
def test_the_same_points_as_the_whole_reader(
    tmp_path: Path, name: str, write: Callable[[Path], None]
) -> None:
    path = tmp_path / name
    write(path)
    raw = READERS[find_format(path)](path, advance=lambda _read, _total: None)
    survey = read_survey(path)
    finite = np.isfinite(raw.points).all(axis=1)
    factor = 0.3048006096012192 if name == "feet.las" else 1.0
    assert list(survey.attributes) == list(raw.attributes)
    for column, values in survey.attributes.items():
        assert values.dtype == raw.attributes[column].dtype.newbyteorder("="), column
    assert (survey.colours is None) == (raw.colours is None)
    none = np.zeros((int(finite.sum()), 0))
    np.testing.assert_allclose(
        rows_of(
            survey.points,
            none if survey.colours is None else survey.colours,
            list(survey.attributes.values()),
        ),
        rows_of(
            raw.points[finite] * factor,
            none if raw.colours is None else raw.colours[finite],
            [values[finite] for values in raw.attributes.values()],
        ),
        rtol=1e-15,
    )
    assert set(raw.warnings) <= set(survey.warnings)


@pytest.mark.parametrize(("name", "write"), WRITERS, ids=[name for name, _ in WRITERS])
def test_thinned_points_are_of_the_survey_and_spread(
    tmp_path: Path, name: str, write: Callable[[Path], None]
) -> None:
    path = tmp_path / name
    write(path)
    whole, thin = read_survey(path), read_survey(path, max_points=200)
    assert len(thin.points) == 200
    assert {tuple(point) for point in thin.points} <= {tuple(point) for point in whole.points}
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
