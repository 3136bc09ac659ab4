"""Small LAS and LAZ files with an index of their own: COPC, and LASindex beside them or in them.

Nothing in the environment writes either, so this does, by the specifications: COPC 1.0, and
LASlib's ``lasindex``, ``lasquadtree`` and ``lasinterval``.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from pathlib import Path

import laspy
import lazrs
import numpy as np
from laspy.vlrs.known import LasZipVlr

from terraport_payload.types import Float64, Int64

_HEADER_BYTES = 375
_RECORD_BYTES = 54


def write_copc(path: Path, las: laspy.LasData, *, node_points: int = 60) -> Path:
    """Write COPC: an octree of nodes with so many points, each a chunk; every page two levels."""
    # (1) The octree: a node takes the first of its points, its children the others.
    points = np.stack([las.x, las.y, las.z], axis=1)
    half = float(np.ptp(points, axis=0).max()) / 2 + 1.0
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    nodes: dict[tuple[int, int, int, int], Int64] = {}
    waiting = [((0, 0, 0, 0), np.random.default_rng(1).permutation(len(points)))]
    while waiting:
        key, rows = waiting.pop()
        nodes[key], rest = rows[:node_points], rows[node_points:]
        level, *cell = key
        middle = centre - half + (np.array(cell) + 0.5) * (2 * half / 2**level)
        octant = (points[rest] >= middle) @ [1, 2, 4]
        for bits in range(8):
            inside = rest[octant == bits]
            if len(inside):
                child = [2 * place + (bits >> axis & 1) for axis, place in enumerate(cell)]
                waiting.append(((level + 1, child[0], child[1], child[2]), inside))
    # (2) Chunks, in an order that is not the tree's.
    keys = sorted(nodes, key=lambda key: hash(key) % 997)
    info = laspy.VLR("copc", 1, "COPC info", bytes(160))
    starts, sizes = write_chunks(path, las, [nodes[key] for key in keys], [info])
    # (3) The hierarchy behind them: the root's page names a page for every two further levels.
    entry_of = {
        key: struct.pack("<4iQii", *key, start, size, len(nodes[key]))
        for key, start, size in zip(keys, starts, sizes, strict=True)
    }
    begin = path.stat().st_size + 60
    pages, root = _pages(entry_of, begin)
    with path.open("r+b") as file:
        file.seek(0, io.SEEK_END)
        file.write(struct.pack("<H16sHQ32s", 0, b"copc", 1000, len(pages), b"EPT hierarchy"))
        file.write(pages)
        file.seek(235)
        file.write(struct.pack("<QI", begin - 60, 1))
        file.seek(_HEADER_BYTES + _RECORD_BYTES)
        file.write(struct.pack("<5d2Q2d", *centre, half, half / 64, *root, 0.0, 0.0))
    return path


def _pages(
    entry_of: dict[tuple[int, int, int, int], bytes], begin: int
) -> tuple[bytes, tuple[int, int]]:
    """All pages, and where the root's is; a page holds two levels below its own node."""
    data = bytearray()

    def page(top: tuple[int, int, int, int]) -> tuple[int, int]:
        entries = bytearray()
        for key, entry in entry_of.items():
            down = key[0] - top[0]
            if down < 0 or tuple(v >> down for v in key[1:]) != top[1:]:
                continue
            if down < 2:
                entries += entry
            elif down == 2:
                entries += struct.pack("<4iQii", *key, *page(key), -1)
        at = begin + len(data)
        data.extend(entries)
        return at, len(entries)

    root = page((0, 0, 0, 0))
    return bytes(data), root


def write_chunks(
    path: Path, las: laspy.LasData, chunks: Sequence[Int64], records: Sequence[laspy.VLR] = ()
) -> tuple[list[int], list[int]]:
    """Write LAZ with these rows as chunks; return where each begins, and its size."""
    # (1) The header as laspy writes it, with the records in front of its own.
    las.update_header()
    header = las.header.copy()
    vlr = lazrs.LazVlr.new_for_compression(
        header.point_format.id, header.point_format.num_extra_bytes, True
    )
    for record in (*reversed(records),):
        header.vlrs.insert(0, record)
    header.vlrs.append(LasZipVlr(bytes(vlr.record_data())))
    header.set_compressed(True)
    with path.open("wb") as file:
        header.write_to(file)
        # (2) Chunks of different sizes.
        compressor = lazrs.LasZipCompressor(file, vlr)
        compressor.reserve_offset_to_chunk_table()
        starts = []
        for rows in chunks:
            starts.append(file.tell())
            compressor.compress_many(np.ascontiguousarray(las.points.array[rows]).tobytes())
            compressor.finish_current_chunk()
        end = file.tell()
        compressor.done()
    return starts, np.diff([*starts, end]).tolist()


def lasindex(
    las: laspy.LasData, rows: Int64, *, levels: int = 4, least: int = 40, gap: int = 5
) -> bytes:
    """Index rows as LAStools does: a quadtree, its cells with intervals of row numbers.

    Four cells with fewer than `least` points together become one of the level above; intervals
    that are `gap` apart or less are joined.
    """
    # (1) Cell of every point, halved in 32-bit floats.
    x, y = np.asarray(las.x)[rows], np.asarray(las.y)[rows]
    tree = [np.float32(v) for v in (x.min() - 1, x.max() + 1, y.min() - 1, y.max() + 1)]
    low = [np.full(len(x), tree[0]), np.full(len(x), tree[2])]
    high = [np.full(len(x), tree[1]), np.full(len(x), tree[3])]
    index = np.zeros(len(x), np.int64)
    for _ in range(levels):
        index <<= 2
        for axis, values in enumerate((x, y)):
            middle = (low[axis] + high[axis]) / np.float32(2)
            upper = values >= middle
            low[axis], high[axis] = (
                np.where(upper, middle, low[axis]),
                np.where(upper, high[axis], middle),
            )
            index |= upper.astype(np.int64) << axis
    # (2) Sparse cells are joined, level by level.
    level = np.full(len(x), levels)
    for upper_level in range(levels - 1, 0, -1) if least else ():
        parent = index >> 2
        for value in np.unique(parent[level == upper_level + 1]):
            inside = (level == upper_level + 1) & (parent == value)
            deeper = (level > upper_level + 1) & (
                index >> 2 * (level - upper_level).clip(0) == value
            )
            if inside.sum() < least and not deeper.any():
                index[inside], level[inside] = value, upper_level
    number = index + np.array([(4**n - 1) // 3 for n in range(levels + 1)])[level]
    # (3) The bytes.
    data = bytearray(struct.pack("<4sI4sI4sI", b"LASX", 0, b"LASS", 0, b"LASQ", 0))
    data += struct.pack("<III4f", levels, 0, 0, *tree)
    cells, first = np.unique(np.sort(number), return_index=True)
    rows_of = np.split(np.argsort(number, kind="stable"), first[1:])
    data += struct.pack("<4sII", b"LASV", 0, len(cells))
    for cell, own in zip(cells, rows_of, strict=True):
        breaks = np.flatnonzero(np.diff(own) > gap + 1)
        begins = own[np.append(0, breaks + 1)]
        ends = own[np.append(breaks, len(own) - 1)]
        data += struct.pack("<iII", cell, len(begins), len(own))
        data += np.stack([begins, ends], axis=1).astype("<u4").tobytes()
    return bytes(data)


def append_lasindex(path: Path, index: bytes) -> None:
    """Put an index behind the points of a LAZ file, as ``lasindex -append`` does."""
    data = bytearray(path.read_bytes())
    record = data.index(b"laszip encoded") - 2 + _RECORD_BYTES
    data[record + 16 : record + 32] = struct.pack("<qq", 1, len(data))
    data += struct.pack("<H16sHQ32s", 0, b"LAStools", 30, len(index), b"LAX spatial indexing")
    path.write_bytes(data + index)


def strips(points: Float64, width_m: float, rows: int) -> list[Int64]:
    """Rows strip by strip from west to east, each from south to north, cut into chunks."""
    strip = np.floor((points[:, 0] - points[:, 0].min()) / width_m)
    order = np.lexsort([points[:, 1], strip])
    return np.split(order, np.arange(rows, len(order), rows))
