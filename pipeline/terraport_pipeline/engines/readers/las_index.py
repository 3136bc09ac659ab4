"""Which blocks of a LAS, LAZ or COPC file may hold points within an extent, by its own index.

Three indices: the octree of COPC; LASindex (LAStools), a quadtree with intervals of rows, in the
file or beside it as ``NAME.lax``. Each is checked against the whole file before it is believed: it
must account for every point, or nothing is left out by it.

An index only says what need not be read. Which points are within is decided by their coordinates.

References
----------
Hobu Inc., COPC specification 1.0, 2021. M. Isenburg, LASindex: simple spatial indexing of LiDAR
data, 2012; the bytes are those of LASlib's ``lasindex``, ``lasquadtree`` and ``lasinterval``.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyArray, Bool, Int64
from terraport_pipeline.engines.readers.las_blocks import Blocks
from terraport_pipeline.extent import Extent

__all__ = ["Selection", "select_blocks"]

_MOST_INDEX_BYTES: Final = 1 << 28
"""An index that is longer is not read: 16 to 32 bytes for some thousand points are usual."""

_LASINDEX: Final = ("LAStools", 30)
"""User and record id of a LASindex that is in the file."""

_SPECIAL_RECORD: Final = 16
"""Where in the LASzip record the number and the offset of records behind the points stand."""

_EXTENDED_HEAD_BYTES: Final = 60

_MAX_LEVEL: Final = 15
"""Deepest level whose cells a signed 32-bit number can count."""

_ENTRY: Final = np.dtype(
    [("level", "<i4"), ("x", "<i4"), ("y", "<i4"), ("z", "<i4"), ("offset", "<u8"),
     ("bytes", "<i4"), ("points", "<i4")]
)  # fmt: skip
"""Of a page of COPC's hierarchy; ``points`` is -1 where it names a further page."""


@dataclass(frozen=True, slots=True, eq=False)
class Selection:
    """The blocks that an index leaves for an extent."""

    blocks: Blocks
    wanted: Bool
    """(B,)"""
    index: str
    """What said so, for people."""
    intervals: Int64 | None = None
    """(K, 2) first row and the one behind the last, ascending, apart from each other: no point
    within the extent has another row. None where the blocks alone are known."""

    @property
    def rows(self) -> int:
        """Points that are read."""
        return int(self.blocks.rows[self.wanted].sum())

    def ranges(self, size: int) -> tuple[tuple[int, int], ...]:
        """Bytes that are read of a file of that size: blocks, and the records around the points."""
        blocks = self.blocks
        wanted = np.flatnonzero(self.wanted)
        first = blocks.first_byte
        spans = [(0, blocks.start)]
        spans += [(int(first[n]), int(first[n] + blocks.bytes[n])) for n in wanted]
        if len(wanted):  # a CRS may stand behind the points
            spans.append((blocks.start + int(blocks.bytes.sum()), size))
        joined = spans[:1]
        for begin, end in spans[1:]:
            if begin == joined[-1][1]:
                joined[-1] = (joined[-1][0], end)
            else:
                joined.append((begin, end))
        return tuple(joined)


class _UnusableError(Exception):
    """An index cannot be used; says why."""


def select_blocks(
    path: Path, header: Any, blocks: Blocks, extent: Extent
) -> tuple[Selection | None, tuple[str, ...]]:
    """Select the blocks that may hold points within an extent.

    Parameters
    ----------
    path : pathlib.Path
    header : laspy.LasHeader
        The file's, with its records.
    blocks : Blocks
        Account for all of its points.
    extent : Extent

    Returns
    -------
    selection : Selection or None
        None where the file has no index that can be used.
    remarks : tuple of str
        Why an index is not used.
    """
    remarks = []
    for name, select in (
        ("its octree (COPC)", _by_octree),
        ("the LASindex in it", _by_inner_lasindex),
        (f"the LASindex {path.with_suffix('.lax').name} beside it", _by_outer_lasindex),
    ):
        try:
            selection = select(path, header, blocks, extent, name)
        except (_UnusableError, OSError, struct.error, ValueError, OverflowError) as error:
            remarks.append(f"{path.name}: {name} cannot be used ({error})")
            continue
        if selection is not None:
            return selection, tuple(remarks)
    return None, tuple(remarks)


def _by_octree(
    path: Path, header: Any, blocks: Blocks, extent: Extent, name: str
) -> Selection | None:
    """Go by the hierarchy of COPC: every node is a block, and has a cube."""
    records = [record for record in header.vlrs if record.user_id == "copc"]
    if not records or not hasattr(records[0], "halfsize"):
        return None
    info = records[0]
    entries = _hierarchy(path, int(info.hierarchy_root_offset), int(info.hierarchy_root_size))
    # (1) Every block is a node and every node with points a block, or one of them is damaged.
    nodes = entries[entries["points"] > 0]
    nodes = nodes[np.argsort(nodes["offset"], kind="stable")]
    filled = blocks.rows > 0
    if not (
        np.array_equal(nodes["offset"].astype(np.int64), blocks.first_byte[filled])
        and np.array_equal(nodes["bytes"].astype(np.int64), blocks.bytes[filled])
        and np.array_equal(nodes["points"].astype(np.int64), blocks.rows[filled])
    ):
        raise _UnusableError("its nodes are not the chunks of the file")
    # (2) Their cubes are an octree: each once, each within that of its parent.
    keys = [tuple(key) for key in entries[["level", "x", "y", "z"]].tolist()]
    cubes = {key for key, points in zip(keys, entries["points"], strict=True) if points >= 0}
    if len(cubes) < int((entries["points"] >= 0).sum()) or not all(
        level == 0 == max(cell) == min(cell) or (level - 1, *(v >> 1 for v in cell)) in cubes
        for level, *cell in cubes
    ):
        raise _UnusableError("its cubes are no octree")
    if not (np.isfinite([*info.center, info.halfsize]).all() and info.halfsize > 0):
        raise _UnusableError("its cubes have no size")
    # (3) Cubes seen from above. The margin: coordinates were rounded after they were sorted in.
    side = 2.0 * info.halfsize / np.exp2(nodes["level"])
    low = [info.center[axis] - info.halfsize + nodes["xy"[axis]] * side for axis in (0, 1)]
    step = 2.0 * np.abs(header.scales[:2])
    wanted = np.zeros(len(blocks.rows), bool)
    wanted[np.flatnonzero(filled)] = (
        (low[0] - step[0] <= extent.xmax)
        & (low[0] + side + step[0] >= extent.xmin)
        & (low[1] - step[1] <= extent.ymax)
        & (low[1] + side + step[1] >= extent.ymin)
    )
    return Selection(blocks, wanted, name)


def _hierarchy(path: Path, offset: int, size: int) -> AnyArray:
    """Read all pages of COPC's hierarchy, each once."""
    pages = [(offset, size)]
    seen = set(pages)
    read, entries = 0, []
    end = path.stat().st_size
    with path.open("rb") as file:
        while pages:
            offset, size = pages.pop()
            read += size
            if not (0 <= offset <= end - size and size >= 0) or read > _MOST_INDEX_BYTES:
                raise _UnusableError(f"a page of {size:,} bytes at byte {offset:,} of {end:,}")
            file.seek(offset)
            page = np.frombuffer(file.read(size // _ENTRY.itemsize * _ENTRY.itemsize), _ENTRY)
            entries.append(page)
            for entry in page[page["points"] == -1]:
                further = int(entry["offset"]), int(entry["bytes"])
                if further in seen:
                    raise _UnusableError(f"two entries name the page at byte {further[0]:,}")
                seen.add(further)
                pages.append(further)
    return np.concatenate(entries)


def _by_inner_lasindex(
    path: Path, header: Any, blocks: Blocks, extent: Extent, name: str
) -> Selection | None:
    """Go by a LASindex among the file's records, or behind its points."""
    for record in (*header.vlrs, *(header.evlrs or ())):
        if (record.user_id, record.record_id) == _LASINDEX:
            return _by_lasindex(bytes(record.record_data), header, blocks, extent, name)
    # LAStools appends it and lets the LASzip record point there: older LAS has no such records.
    zipped = header.vlrs.get("LasZipVlr")
    if not zipped:
        return None
    count, offset = struct.unpack_from("<qq", zipped[0].record_data, _SPECIAL_RECORD)
    if count < 1 or offset < 1:
        return None
    with path.open("rb") as file:
        file.seek(offset)
        head = file.read(_EXTENDED_HEAD_BYTES)
        _, user, number, size = struct.unpack_from("<H16sHQ", head)
        if (user.rstrip(b"\0").decode("latin-1"), number) != _LASINDEX:
            return None
        if size > _MOST_INDEX_BYTES:
            raise _UnusableError(f"it has {size:,} bytes")
        return _by_lasindex(file.read(size), header, blocks, extent, name)


def _by_outer_lasindex(
    path: Path, header: Any, blocks: Blocks, extent: Extent, name: str
) -> Selection | None:
    """Go by the LASindex in a file beside it."""
    for ending in (".lax", ".LAX"):
        beside = path.with_suffix(ending)
        if beside.is_file():
            if beside.stat().st_size > _MOST_INDEX_BYTES:
                raise _UnusableError(f"it has {beside.stat().st_size:,} bytes")
            return _by_lasindex(beside.read_bytes(), header, blocks, extent, name)
    return None


def _by_lasindex(data: bytes, header: Any, blocks: Blocks, extent: Extent, name: str) -> Selection:
    """Go by a quadtree whose cells list intervals of rows."""
    # (1) The quadtree: LASX, LASS, LASQ (which the first writers left out), then its corners.
    magic, _, spatial, kind = struct.unpack_from("<4sI4sI", data)
    if (magic, spatial, kind) != (b"LASX", b"LASS", 0):
        raise _UnusableError("it is no quadtree of LASindex")
    at = 16 + 8 * (data[16:20] == b"LASQ")
    levels, sub_level, _, xmin, xmax, ymin, ymax = struct.unpack_from("<III4f", data, at)
    if levels > _MAX_LEVEL or sub_level or not (xmin < xmax and ymin < ymax):
        raise _UnusableError("its quadtree is of an unknown form")
    # (2) All intervals, and of them those of cells that touch the extent.
    tree = (xmin, ymin, xmax, ymax)
    margin = _rounding(tree) + 2.0 * float(np.abs(header.scales[:2]).max())
    every, touching, points = [], [], 0
    for cell, number, intervals in _cells(data, at + 28):
        every.append(intervals)
        points += number
        low, high = _cell_box(cell, tree)
        if extent.touches(low, high, margin):
            touching.append(intervals)
    # (3) It must be of this file: every row in an interval, every point in one cell.
    count = int(blocks.rows.sum())
    covered = _joined(every)
    if points != count or covered.tolist() != [[0, count]]:
        raise _UnusableError(f"it is of {points:,} points, and the file has {count:,}")
    rows = _joined(touching)
    return Selection(blocks, _blocks_of(rows, blocks), name, rows)


def _cells(data: bytes, at: int) -> Iterator[tuple[int, int, Int64]]:
    """Yield (cell, points in it, its intervals as first row and the one behind the last)."""
    magic, version, cells = struct.unpack_from("<4sII", data, at)
    if magic != b"LASV" or version > 1:
        raise _UnusableError("its intervals are of an unknown form")
    at += 12
    head, rows = (struct.Struct("<iIQ"), "<u8") if version else (struct.Struct("<iII"), "<u4")
    for _ in range(cells):
        cell, number, points = head.unpack_from(data, at)
        at += head.size
        bounds = np.frombuffer(data, rows, 2 * number, at).reshape(-1, 2).astype(np.int64)
        at += bounds.size * np.dtype(rows).itemsize
        if (bounds[:, 0] > bounds[:, 1]).any() or cell < 0:
            raise _UnusableError("an interval ends before it begins")
        bounds[:, 1] += 1
        yield cell, points, bounds


def _cell_box(
    cell: int, tree: tuple[float, float, float, float]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Corners of a cell; those at the rim of the tree hold all that lies beyond it, too.

    Cells are counted level by level, within a level by the bits of their column and row, column
    first: 0 is the south-west quarter, 1 the south-east one, 2 the north-west one.
    """
    level = 0
    while cell >= 4**level:
        cell -= 4**level
        level += 1
        if level > _MAX_LEVEL:
            raise _UnusableError(f"cell {cell} is deeper than {_MAX_LEVEL} levels")
    columns = [0, 0]
    for bit in range(level):
        for axis in (0, 1):
            columns[axis] |= (cell >> (2 * bit + axis) & 1) << bit
    low, high = [], []
    for axis, column in enumerate(columns):
        side = (tree[axis + 2] - tree[axis]) / 2**level
        low.append(-np.inf if column == 0 else tree[axis] + column * side)
        high.append(np.inf if column == 2**level - 1 else tree[axis] + (column + 1) * side)
    return (low[0], low[1]), (high[0], high[1])


def _rounding(tree: tuple[float, float, float, float]) -> float:
    """How far a cell's walls may lie from where they should: they are halved in 32-bit floats."""
    return 2.0 * float(np.spacing(np.float32(max(map(abs, tree)))))


def _joined(intervals: list[Int64]) -> Int64:
    """Join intervals that overlap or meet; ascending."""
    if not intervals:
        return np.zeros((0, 2), np.int64)
    bounds = np.concatenate(intervals)
    bounds = bounds[np.argsort(bounds[:, 0], kind="stable")]
    reach = np.maximum.accumulate(bounds[:, 1])
    begins = np.ones(len(bounds), bool)
    begins[1:] = bounds[1:, 0] > reach[:-1]
    ends = np.append(np.flatnonzero(begins)[1:] - 1, len(bounds) - 1)
    return np.stack([bounds[begins, 0], reach[ends]], axis=1)


def _blocks_of(rows: Int64, blocks: Blocks) -> Bool:
    """Mark the blocks that hold any row of some intervals."""
    first = blocks.first_row
    change = np.zeros(len(first) + 1, np.int64)
    np.add.at(change, np.searchsorted(first, rows[:, 0], side="right") - 1, 1)
    np.add.at(change, np.searchsorted(first, rows[:, 1] - 1, side="right"), -1)
    wanted: Bool = (np.cumsum(change[:-1]) > 0) & (blocks.rows > 0)
    return wanted
