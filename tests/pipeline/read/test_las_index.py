"""Indices of LAS, LAZ and COPC: what they leave out is outside, and they are checked first."""

from __future__ import annotations

import struct
from pathlib import Path

import laspy
import numpy as np
import pytest
from pipeline.indexed_files import append_lasindex, lasindex, strips, write_chunks, write_copc
from pipeline.laz_files import Hill, las_data

from terraport_payload.types import Float64, Int64
from terraport_pipeline.engines.readers import las_blocks
from terraport_pipeline.engines.readers.read_las import LasStream, open_las
from terraport_pipeline.errors import ReadError
from terraport_pipeline.extent import Extent

HILL = Hill(4000)
# Coordinates in whole decimetres: many points lie on the walls of cells.
HILL.millimetres[::2] = HILL.millimetres[::2] // 100 * 100
XYZ: Float64 = HILL.millimetres / 1000
CORNER = Extent(641_203, 8_594_704, 641_211, 8_594_710)


def write_laz_in_strips(path: Path) -> tuple[Path, laspy.LasData, Int64]:
    """Write LAZ in chunks of 100; return also its points, and in which order they lie in it."""
    las = las_data(HILL)
    chunks = strips(XYZ, 4.0, 100)
    write_chunks(path, las, chunks)
    return path, las, np.concatenate(chunks)


def laz_with_index_beside(folder: Path) -> Path:
    path, las, rows = write_laz_in_strips(folder / "a.laz")
    path.with_suffix(".lax").write_bytes(lasindex(las, rows))
    return path


def laz_with_index_behind(folder: Path) -> Path:
    path, las, rows = write_laz_in_strips(folder / "a.laz")
    append_lasindex(path, lasindex(las, rows))
    return path


def las_with_index_beside(folder: Path) -> Path:
    rows = np.concatenate(strips(XYZ, 4.0, 100))
    las = las_data(HILL, rows)
    las.write(folder / "a.las")
    (folder / "a.lax").write_bytes(lasindex(las, np.arange(len(rows))))
    return folder / "a.las"


def las_with_index_within(folder: Path) -> Path:
    rows = np.concatenate(strips(XYZ, 4.0, 100))
    las = las_data(HILL, rows)
    index = lasindex(las, np.arange(len(rows)))
    las.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR("LAStools", 30, "LAX", index)])
    las.write(folder / "a.las")
    return folder / "a.las"


def copc(folder: Path) -> Path:
    return write_copc(folder / "a.copc.laz", las_data(HILL))


WRITERS = [
    copc, laz_with_index_beside, laz_with_index_behind, las_with_index_beside,
    las_with_index_within,
]  # fmt: skip


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(las_blocks, "_LAS_BLOCK_ROWS", 100)
    monkeypatch.setattr(las_blocks, "CHUNK_POINTS", 350)


def points_within(stream: LasStream, extent: Extent) -> Float64:
    points = np.concatenate([np.zeros((0, 3)), *(chunk.points for chunk in stream.chunks())])
    assert len(points) == stream.rows
    return points[extent.holds(points)]


def assert_same_points(one: Float64, other: Float64) -> None:
    np.testing.assert_array_equal(one[np.lexsort(one.T)], other[np.lexsort(other.T)])


@pytest.mark.parametrize("write", WRITERS)
def test_what_an_index_leaves_holds_every_point_within(write, tmp_path: Path) -> None:
    """Against the plain filter, for rectangles with and without points on their edges."""
    path = write(tmp_path)
    rng = np.random.default_rng(4)
    extents = [CORNER, Extent(0, 0, 1e7, 1e7)]
    for _ in range(12):
        (x0, x1), (y0, y1) = np.sort(rng.choice(XYZ[:, :2], 2, replace=False), axis=0).T
        extents.append(Extent(x0, y0, x1, y1))
    for extent in extents:
        with open_las(path, extent=extent) as stream:
            assert stream.remarks == ()
            assert_same_points(points_within(stream, extent), XYZ[extent.holds(XYZ)])


@pytest.mark.parametrize("write", WRITERS)
def test_a_corner_costs_a_share_of_points_and_bytes(write, tmp_path: Path) -> None:
    path = write(tmp_path)
    with open_las(path, extent=CORNER) as stream:
        assert stream.count == 4000
        assert stream.rows < 1700
        assert stream.ranges is not None
        read = sum(end - begin for begin, end in stream.ranges)
        assert read < 0.5 * path.stat().st_size
        parts = [len(chunk.points) for chunk in stream.chunks()]
        assert max(parts) <= 350


def test_a_file_that_its_header_puts_outside_is_not_read(tmp_path: Path) -> None:
    path = write_copc(tmp_path / "a.copc.laz", las_data(HILL))
    with open_las(path, extent=Extent(0, 0, 10, 10)) as stream:
        assert (stream.rows, list(stream.chunks())) == (0, [])
        assert stream.ranges is not None
        assert len(stream.ranges) == 1


def test_a_file_without_an_index_is_read_whole(tmp_path: Path) -> None:
    path, _, _ = write_laz_in_strips(tmp_path / "a.laz")
    with open_las(path, extent=CORNER) as stream:
        assert (stream.rows, stream.ranges, stream.remarks) == (4000, None, ())


@pytest.mark.parametrize("end", [0, 3, 20, 50, 60, 200, -1])
def test_an_index_that_is_cut_off_leaves_nothing_out(tmp_path: Path, end: int) -> None:
    path = laz_with_index_beside(tmp_path)
    index = path.with_suffix(".lax").read_bytes()
    path.with_suffix(".lax").write_bytes(index[:end])
    with open_las(path, extent=CORNER) as stream:
        assert stream.ranges is None
        assert_same_points(points_within(stream, CORNER), XYZ[CORNER.holds(XYZ)])
        [remark] = stream.remarks
    assert remark.startswith("a.laz: the LASindex a.lax beside it cannot be used (")


def test_no_byte_of_an_index_loses_a_point_unseen(tmp_path: Path) -> None:
    """Flipped bytes: the same points, or an error that names the index."""
    path = laz_with_index_beside(tmp_path)
    index = path.with_suffix(".lax").read_bytes()
    rng = np.random.default_rng(5)
    refused = 0
    for at in rng.choice(len(index), 60, replace=False):
        damaged = bytearray(index)
        damaged[at] ^= 1 << rng.integers(8)
        path.with_suffix(".lax").write_bytes(damaged)
        try:
            with open_las(path, extent=CORNER) as stream:
                points = points_within(stream, CORNER)
        except ReadError as error:
            refused += error.advice.endswith("make it again (lasindex), or delete it")
            continue
        # The corners of the tree are four floats that nothing repeats.
        if not 36 <= at < 52:
            assert_same_points(points, XYZ[CORNER.holds(XYZ)])
    assert refused < 10


def test_an_index_of_another_file_is_not_believed(tmp_path: Path) -> None:
    path, las, rows = write_laz_in_strips(tmp_path / "a.laz")
    path.with_suffix(".lax").write_bytes(lasindex(las, rows[:-7]))
    with open_las(path, extent=CORNER) as stream:
        [remark] = stream.remarks
        assert_same_points(points_within(stream, CORNER), XYZ[CORNER.holds(XYZ)])
    assert remark.endswith("(it is of 3,993 points, and the file has 4,000)")


def test_an_index_of_an_earlier_order_is_refused(tmp_path: Path) -> None:
    """As many points, but sorted since: it would lose some, and does not say so itself."""
    path, las, rows = write_laz_in_strips(tmp_path / "a.laz")
    path.with_suffix(".lax").write_bytes(lasindex(las, rows[::-1].copy()))
    with (
        open_las(path, extent=Extent(641_203, 8_594_704, 641_218, 8_594_725)) as stream,
        pytest.raises(ReadError, match=r"a\.lax beside it leaves out points that lie within"),
    ):
        list(stream.chunks())


@pytest.mark.parametrize(
    ("field", "form", "value", "told"),
    [
        (16, "<Q", 5, "its nodes are not the chunks of the file"),
        (28, "<i", 7, "its nodes are not the chunks of the file"),
        (28, "<i", -1, "its nodes are not the chunks of the file"),
        (28, "<i", 0, "its nodes are not the chunks of the file"),
        (0, "<i", 99, "its cubes are no octree"),
        (4, "<i", 7, "its cubes are no octree"),
        (8, "<i", -1, "its cubes are no octree"),
    ],
)
def test_a_damaged_octree_leaves_nothing_out(
    tmp_path: Path, field: int, form: str, value: int, told: str
) -> None:
    path = copc(tmp_path)
    with laspy.open(path) as reader:
        info = reader.header.vlrs[0]
    with path.open("r+b") as file:
        file.seek(info.hierarchy_root_offset)
        entries = struct.iter_unpack("<4iQii", file.read(info.hierarchy_root_size))
        first_node = next(number for number, entry in enumerate(entries) if entry[-1] > 0)
        file.seek(info.hierarchy_root_offset + 32 * first_node + field)
        file.write(struct.pack(form, value))
    with open_las(path, extent=CORNER) as stream:
        assert told in stream.remarks[0]
        assert_same_points(points_within(stream, CORNER), XYZ[CORNER.holds(XYZ)])


def test_an_octree_without_a_size_or_a_whole_hierarchy_leaves_nothing_out(tmp_path: Path) -> None:
    path = copc(tmp_path)
    for at, form, value, told in (
        (24, "<d", 0.0, "its cubes have no size"),
        (40, "<Q", 1 << 60, "a page of"),
        (48, "<Q", 1 << 63, "a page of"),
        (48, "<Q", 0, "cannot be used"),
    ):
        damaged = bytearray(path.read_bytes())
        struct.pack_into(form, damaged, 375 + 54 + at, value)
        other = tmp_path / "other.copc.laz"
        other.write_bytes(damaged)
        with open_las(other, extent=CORNER) as stream:
            assert told in stream.remarks[0]
            assert stream.rows == 4000


@pytest.mark.parametrize("is_read", [True, False])
def test_damage_in_a_chunk_is_told_where_it_is_read(tmp_path: Path, is_read: bool) -> None:
    path = copc(tmp_path)
    with open_las(path, extent=CORNER) as stream:
        assert stream.ranges is not None
        begin, end = stream.ranges[1]
    with path.open("r+b") as file:
        file.seek((begin if is_read else end) + 60)
        file.write(bytes(range(200, 240)))
    with open_las(path, extent=CORNER) as stream:
        if is_read:
            with pytest.raises(ReadError, match="point data is cut off or damaged between points"):
                list(stream.chunks())
        else:
            assert_same_points(points_within(stream, CORNER), XYZ[CORNER.holds(XYZ)])


def test_the_octree_of_a_real_survey(shared_data: Path) -> None:
    path = shared_data / "lone_star_geyser/lone-star.copc.laz"
    with open_las(path) as stream:
        whole = np.concatenate([chunk.points for chunk in stream.chunks()])
    low, high = whole[:, :2].min(axis=0), whole[:, :2].max(axis=0)
    low, high = low + 0.3 * (high - low), low + 0.4 * (high - low)
    extent = Extent(*low, *high)
    with open_las(path, extent=extent) as stream:
        assert stream.rows < 0.7 * stream.count
        assert_same_points(points_within(stream, extent), whole[extent.holds(whole)])
