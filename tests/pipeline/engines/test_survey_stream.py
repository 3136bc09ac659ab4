"""Surveys of every format in chunks: the openers agree on what they promise."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest

from terraport_pipeline.engines.readers import read_las, read_xyz
from terraport_pipeline.engines.readers.survey_stream import (
    FileHead,
    open_stream,
    read_head,
    survey_size,
)
from terraport_pipeline.errors import ReadError

COUNT = 500
PLACES = np.random.default_rng(1).integers(0, 50_000, (COUNT, 3)) * 0.001


@pytest.fixture(autouse=True)
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(read_las, "_CHUNK_POINTS", 150)
    monkeypatch.setattr(read_xyz, "_BLOCK_BYTES", 4096)


def write_las(path: Path, *, coloured: bool = True) -> Path:
    header = laspy.LasHeader(point_format=7 if coloured else 6, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.array([641_000.0, 8_594_000.0, 1_200.0])
    las = laspy.LasData(header)
    las.x, las.y, las.z = (PLACES + header.offsets).T
    if coloured:
        las.red = las.green = las.blue = np.arange(COUNT, dtype=np.uint16)
    las.write(path)
    return path


def write_xyz(path: Path) -> Path:
    rows = [" ".join(f"{v:.3f}" for v in row) + " 10 20 30" for row in PLACES.tolist()]
    path.write_text("\n".join(["x y z red green blue", *rows, ""]))
    return path


def write_ply(path: Path) -> Path:
    table = np.zeros(COUNT, [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("grade", "<f4")])
    table["x"], table["y"], table["z"] = PLACES.T
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {COUNT}"]
    head += [f"property {kind} {name}" for kind, name in zip(("double",) * 3, "xyz", strict=True)]
    head += ["property float grade", "end_header", ""]
    path.write_bytes("\n".join(head).encode() + table.tobytes())
    return path


FILES = [("las", "a.las", write_las), ("xyz", "a.xyz", write_xyz), ("ply", "a.ply", write_ply)]


@pytest.mark.parametrize(("name", "file", "write"), FILES, ids=[name for name, _, _ in FILES])
def test_chunks_add_up_to_what_was_announced(tmp_path, name, file, write) -> None:
    path = write(tmp_path / file)
    with open_stream(path, name) as stream:
        assert stream.format == name
        assert stream.unit == ("bytes" if name == "xyz" else "points")
        chunks = list(stream.chunks())
        assert isinstance(stream.late_warnings(), tuple)
    assert sum(chunk.read for chunk in chunks) == stream.total
    assert sum(len(chunk.points) for chunk in chunks) == COUNT
    first = {column: values.dtype for column, values in chunks[0].columns.items()}
    for chunk in chunks:
        assert {column: values.dtype for column, values in chunk.columns.items()} == first
        assert all(len(values) == len(chunk.points) for values in chunk.columns.values())
    assert set(stream.colours) <= set(first)


def test_chunks_hold_the_points_in_order(tmp_path) -> None:
    with open_stream(write_las(tmp_path / "a.las"), "las") as stream:
        chunks = list(stream.chunks())
    assert len(chunks) == 4
    points = np.concatenate([chunk.points for chunk in chunks]) - (641_000.0, 8_594_000.0, 1_200.0)
    assert points == pytest.approx(PLACES, abs=1e-6)
    assert np.concatenate([chunk.columns["red"] for chunk in chunks]).tolist() == list(range(COUNT))


def test_colours_are_named_only_where_there_are_any(tmp_path) -> None:
    for coloured, named in ((True, ("red", "green", "blue")), (False, ())):
        path = write_las(tmp_path / f"{coloured}.las", coloured=coloured)
        with open_stream(path, "las") as stream:
            assert stream.colours == named
            # standard columns that say nothing go; a column of the surveyor's own never does
            assert stream.unset["user_data"] == (0,)


def test_a_header_tells_the_size(tmp_path) -> None:
    size = survey_size([read_head(write_las(tmp_path / "a.las"), "las")])
    sides = np.ptp(PLACES, axis=0)
    assert size.points == COUNT
    assert size.extent == pytest.approx(sides.max(), abs=0.01)
    assert size.area == pytest.approx(sides[0] * sides[1], rel=1e-3)


def test_a_header_that_states_no_box_tells_the_points_alone(tmp_path) -> None:
    path = write_las(tmp_path / "a.las")
    data = bytearray(path.read_bytes())
    data[179:187] = np.float64(1e30).tobytes()  # max x
    path.write_bytes(data)
    size = survey_size([read_head(path, "las")])
    assert (size.points, size.extent, size.area) == (COUNT, None, None)


def test_text_is_judged_by_its_size(tmp_path) -> None:
    path = write_xyz(tmp_path / "a.xyz")
    size = survey_size([read_head(path, "xyz")])
    assert 0.3 * COUNT < size.points < 3 * COUNT
    assert size.extent is None


def test_damage_is_told_when_the_file_is_opened(tmp_path) -> None:
    path = tmp_path / "a.las"
    path.write_bytes(b"LASF" + bytes(100))
    with pytest.raises(ReadError), open_stream(path, "las"):
        pass
    with pytest.raises(ReadError):
        survey_size([read_head(path, "las")])


def test_the_size_of_several_files_is_of_the_box_round_all() -> None:
    west = FileHead(10, None, (0.0, 0.0, 0.0), (50.0, 40.0, 5.0))
    east = FileHead(20, None, (50.0, 0.0, 1.0), (90.0, 40.0, 9.0))
    size = survey_size([west, east])
    assert (size.points, size.extent, size.area) == (30, 90.0, 90.0 * 40.0)
    assert survey_size([west, FileHead(5)]).extent is None
