"""From the tiles' own pieces to pieces of one surface.

In three passes, each of which holds one tile at a time:

1. the borders alone: vertices in walls become one, gaps are filled
   (:mod:`~terraport_pipeline.geometry.tile_weld`);
2. every tile is looked at as it will be: how large its loose pieces are, what its faces add to the
   normals of shared vertices, which edges along walls stay open;
3. every tile is written.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from terraport_pipeline.geometry.tile_plan import Lattice
from terraport_pipeline.geometry.tile_weld import Seams
from terraport_pipeline.geometry.trim import compact
from terraport_pipeline.geometry.vertex_normals import normal_sums, unit_normals
from terraport_pipeline.model import Float32, Float64, Int32
from terraport_pipeline.stages.contract import Stored
from terraport_pipeline.stages.solve_tile import TileTask
from terraport_pipeline.tiles import vertex_box

__all__ = [
    "NAME",
    "Join",
    "Look",
    "Settled",
    "finish",
    "from_stored",
    "look",
    "settle",
    "to_stored",
]

NAME: Final = "join_tiles"

Int64 = npt.NDArray[np.int64]
Arrays = Mapping[str, npt.NDArray[Any]]

_CRACK_CELLS: Final = 1.0
"""Open edges of two tiles this near to each other are a crack, not two rims."""


@dataclass(frozen=True, slots=True, eq=False)
class Join:
    """What the join says of all tiles; small, and the same for every worker."""

    cells: Float64
    """(G, 3) shared vertices, lattice cells."""
    ratio: Float32
    """(G,)"""
    colours: npt.NDArray[np.uint8]
    """(G, 3)"""
    attributes: tuple[Float32, ...]
    """(G,) each."""
    rows: tuple[Int32, ...]
    """Per tile: its shared vertices."""
    ids: tuple[Int64, ...]
    """Per tile: their ids, then those of vertices it gets for its fillers."""
    fillers: tuple[Int64, ...]
    """Per tile: (K, 3) ids."""
    max_ratio: float
    """Faces with a vertex beyond this go."""

    @classmethod
    def of(cls, seams: Seams, tiles: Sequence[Arrays], names: int, max_ratio: float) -> Join:
        """Take colours and attributes of shared vertices from their owners.

        Parameters
        ----------
        seams : Seams
        tiles : sequence of mapping
            Gives ``colours`` and ``attribute-<i>`` of every tile; only of owners is anything read.
        names : int
            Number of attributes.
        """
        count = len(seams.cells)
        colours = np.zeros((count, 3), np.uint8)
        attributes = tuple(np.zeros(count, np.float32) for _ in range(names))
        for tile, arrays in enumerate(tiles):
            mine = np.flatnonzero(seams.owner_tile == tile)
            if not len(mine):
                continue
            rows = seams.owner_row[mine]
            colours[mine] = arrays["colours"][rows]
            for place, values in enumerate(attributes):
                values[mine] = arrays[f"attribute-{place}"][rows]
        return cls(
            seams.cells,
            seams.ratio,
            colours,
            attributes,
            seams.tile_rows,
            seams.tile_ids,
            seams.fillers,
            max_ratio,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What a tile will be like."""

    sizes: Int64
    """(P,) faces of each of its loose pieces."""
    touch: Int64
    """(K, 2) (piece, id) of shared vertices in use."""
    ids: Int64
    """(S,) ids of shared vertices in use, ascending."""
    sums: Float64
    """(S, 3) what its faces add to their normals."""
    edges: Int64
    """(E, 2) open edges along walls; ids, or -1 - row for vertices that are not shared."""
    middles: Float64
    """(E, 3) their middles, cells."""


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """What all looks together decide."""

    normals: Float32
    """(G, 3) unit normals of shared vertices."""
    dropped: tuple[Int64, ...]
    """Per tile: loose pieces that go."""
    islands: int
    """Pieces of the whole surface that go."""
    seam_edges: int
    """Edges along walls that two tiles share."""
    cracks: int
    """Edges along walls that are open on both sides within a cell: must be 0."""
    rims: int
    """Other open edges along walls: the surface ends there."""


def look(task: TileTask, tile: int, arrays: Arrays, join: Join) -> Look:
    """Look at a tile as it will be."""
    vertices, faces, ids = _assemble(task, tile, arrays, join)
    piece, sizes = _pieces(faces, len(vertices))
    shared = np.flatnonzero(ids >= 0)
    used = np.zeros(len(vertices), dtype=bool)
    used[faces.ravel()] = True
    shared = shared[used[shared]]
    shared = shared[np.argsort(ids[shared])]
    of_vertex = np.zeros(len(vertices), dtype=np.int64)
    of_vertex[faces.ravel()] = np.repeat(piece, 3)
    sums = normal_sums(vertices, faces)[shared]
    edges, middles = _open_wall_edges(task, vertices, faces, ids, arrays, tile, join)
    return Look(
        sizes, np.stack([of_vertex[shared], ids[shared]], axis=1), ids[shared], sums, edges, middles
    )


def settle(looks: Sequence[Look], count: int, *, min_faces: int) -> Settled:
    """Decide what only all tiles together can decide.

    Parameters
    ----------
    looks : sequence of Look
    count : int
        Shared vertices.
    min_faces : int
        Pieces of the joined surface with fewer faces go; the largest stays.
    """
    starts = np.cumsum([0, *(len(each.sizes) for each in looks)])
    nodes = int(starts[-1])
    touch = [
        each.touch + np.array([start, nodes]) for each, start in zip(looks, starts, strict=False)
    ]
    links = np.concatenate([np.zeros((0, 2), np.int64), *touch])
    graph = coo_matrix(
        (np.ones(len(links), np.int8), (links[:, 0], links[:, 1])), shape=(nodes + count,) * 2
    )
    _, label = connected_components(graph, directed=False)
    label = label[:nodes]
    sizes = np.concatenate([np.zeros(0, np.int64), *(each.sizes for each in looks)])
    whole = np.bincount(label, sizes, minlength=1)
    large = whole >= min_faces
    large[int(whole.argmax())] = True
    goes = ~large[label] if nodes else np.zeros(0, bool)
    dropped = tuple(
        np.flatnonzero(goes[starts[t] : starts[t + 1]]).astype(np.int64) for t in range(len(looks))
    )
    total = np.zeros((count, 3))
    for each in looks:
        total[each.ids] += each.sums
    islands = int(((whole > 0) & ~large).sum())
    return Settled(unit_normals(total), dropped, islands, *_count_open(looks))


def finish(
    task: TileTask, tile: int, arrays: Arrays, join: Join, settled: Settled
) -> tuple[dict[str, npt.NDArray[np.generic]], Float64]:
    """Make a tile as it will be: arrays of :class:`~terraport_pipeline.tiles.StoredTiles`, box."""
    vertices, faces, ids = _assemble(task, tile, arrays, join)
    piece, _ = _pieces(faces, len(vertices))
    keep = ~np.isin(piece, settled.dropped[tile])
    used = np.zeros(len(vertices), dtype=bool)
    used[faces[keep].ravel()] = True
    normals = unit_normals(normal_sums(vertices, faces[keep]))
    shared = np.flatnonzero(ids >= 0)
    normals[shared] = settled.normals[ids[shared]]
    guests = len(vertices) - len(arrays["vertices"])
    colours = np.concatenate([arrays["colours"], np.zeros((guests, 3), np.uint8)])
    colours[shared] = join.colours[ids[shared]]
    made: dict[str, npt.NDArray[np.generic]] = {}
    for place, values in enumerate(join.attributes):
        column = np.concatenate([arrays[f"attribute-{place}"], np.zeros(guests, np.float32)])
        column[shared] = values[ids[shared]]
        made[f"attribute-{place}"] = column[used]
    final, final_faces = compact(vertices, faces, keep)
    border = np.flatnonzero(ids[used] >= 0)
    made |= {
        "vertices": final,
        "faces": final_faces,
        "normals": normals[used],
        "colours": colours[used],
        "border-rows": border.astype(np.int32),
        "border-ids": ids[used][border],
    }
    return made, vertex_box(final) if len(final) else np.zeros(6)


def to_stored(join: Join, settled: Settled) -> Stored:
    """Turn the join into arrays and values."""
    arrays: dict[str, npt.NDArray[np.generic]] = {
        "cells": join.cells,
        "ratio": join.ratio,
        "colours": join.colours,
        "normals": settled.normals,
    }
    arrays |= {f"attribute-{i}": values for i, values in enumerate(join.attributes)}
    for name, parts in (
        ("rows", join.rows),
        ("ids", join.ids),
        ("fillers", join.fillers),
        ("dropped", settled.dropped),
    ):
        arrays[name] = np.concatenate(parts)
        arrays[f"{name}-starts"] = np.cumsum([0, *(len(part) for part in parts)])
    values = {
        "max_ratio": join.max_ratio,
        "attributes": len(join.attributes),
        "islands": settled.islands,
        "seam_edges": settled.seam_edges,
        "cracks": settled.cracks,
        "rims": settled.rims,
    }
    return Stored(arrays, values)


def from_stored(stored: Stored) -> tuple[Join, Settled]:
    """Turn arrays and values back."""
    arrays, values = stored.arrays, stored.values

    def parts(name: str) -> tuple[Any, ...]:
        return tuple(np.split(arrays[name], arrays[f"{name}-starts"][1:-1]))

    attributes = tuple(
        np.asarray(arrays[f"attribute-{i}"], np.float32) for i in range(values["attributes"])
    )
    join = Join(
        np.asarray(arrays["cells"], np.float64),
        np.asarray(arrays["ratio"], np.float32),
        np.asarray(arrays["colours"], np.uint8),
        attributes,
        parts("rows"),
        parts("ids"),
        parts("fillers"),
        values["max_ratio"],
    )
    settled = Settled(
        np.asarray(arrays["normals"], np.float32),
        parts("dropped"),
        values["islands"],
        values["seam_edges"],
        values["cracks"],
        values["rims"],
    )
    return join, settled


def _assemble(
    task: TileTask, tile: int, arrays: Arrays, join: Join
) -> tuple[Float32, Int32, Int64]:
    """A tile's vertices in the scene frame, its faces after trimming, and its vertices' ids."""
    own = arrays["vertices"]
    rows, ids = join.rows[tile], join.ids[tile]
    guests = len(ids) - len(rows)
    numbers = np.full(len(own) + guests, -1, dtype=np.int64)
    numbers[rows] = ids[: len(rows)]
    numbers[len(own) :] = ids[len(rows) :]
    shared = np.concatenate([rows, np.arange(len(own), len(own) + guests)])
    vertices = np.zeros((len(numbers), 3), dtype=np.float32)
    vertices[: len(own)] = own.astype(np.float64) + task.centre_m + 0.0
    lattice = Lattice(task.anchor_m, task.cell_m)
    vertices[shared] = lattice.metres(join.cells[ids])
    vertices += np.float32(0.0)  # turns -0.0 into 0.0: equal places must be equal bits
    ratio = np.concatenate([arrays["ratio"], np.zeros(guests, np.float32)])
    ratio[shared] = join.ratio[ids]
    order = np.argsort(ids)
    fillers = shared[order][np.searchsorted(ids[order], join.fillers[tile])]
    faces = np.concatenate([arrays["faces"], fillers.astype(np.int32).reshape(-1, 3)])
    faces = faces[(ratio[faces] <= join.max_ratio).all(axis=1)]
    return vertices, faces, numbers


def _pieces(faces: Int32, vertex_count: int) -> tuple[Int64, Int64]:
    """Connected piece of every face, numbered from 0 in order of their first face, and sizes."""
    if not len(faces):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    links = coo_matrix(
        (
            np.ones(2 * len(faces), np.int8),
            (
                np.concatenate([faces[:, 0], faces[:, 1]]),
                np.concatenate([faces[:, 1], faces[:, 2]]),
            ),
        ),
        shape=(vertex_count, vertex_count),
    )
    _, label = connected_components(links, directed=False)
    found = label[faces[:, 0]]
    _, first, piece = np.unique(found, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first, kind="stable"), kind="stable")
    piece = rank[piece.ravel()]
    return piece.astype(np.int64), np.bincount(piece).astype(np.int64)


def _open_wall_edges(
    task: TileTask,
    vertices: Float32,
    faces: Int32,
    ids: Int64,
    arrays: Arrays,
    tile: int,
    join: Join,
) -> tuple[Int64, Float64]:
    """Open edges whose two vertices lie in walls: named by ids, and their middles in cells."""
    in_wall = np.zeros(len(vertices), dtype=bool)
    in_wall[arrays["border-rows"]] = True
    in_wall[len(arrays["vertices"]) :] = True
    some = faces[in_wall[faces].sum(axis=1) >= 2]
    edges = np.concatenate([some[:, [0, 1]], some[:, [1, 2]], some[:, [2, 0]]]).astype(np.int64)
    edges = edges[in_wall[edges].all(axis=1)]
    cells = Lattice(task.anchor_m, task.cell_m).cells(vertices)
    core = np.array(task.centre_cells) - 0.5 * task.core_cells
    place = (cells - core) / task.core_cells
    # Both in one wall: the same coordinate is 0, or 1, of the core's width.
    off = 1e-2 / task.core_cells
    low = np.abs(place[edges]) < off
    high = np.abs(place[edges] - 1.0) < off
    edges = edges[(low.all(axis=1) | high.all(axis=1)).any(axis=1)]
    forward = edges[:, 0] * len(vertices) + edges[:, 1]
    backward = edges[:, 1] * len(vertices) + edges[:, 0]
    edges = edges[~np.isin(backward, forward)]
    named = np.where(ids >= 0, ids, -1 - np.arange(len(ids)))
    return named[edges], cells[edges].mean(axis=1)


def _count_open(looks: Sequence[Look]) -> tuple[int, int, int]:
    """Edges that two tiles share, cracks, rims."""
    tile = np.repeat(np.arange(len(looks)), [len(each.edges) for each in looks])
    edges = np.concatenate([np.zeros((0, 2), np.int64), *(each.edges for each in looks)])
    middles = np.concatenate([np.zeros((0, 3)), *(each.middles for each in looks)])
    shared = (edges >= 0).all(axis=1)
    ordered = np.sort(edges, axis=1)
    _, which = np.unique(ordered, axis=0, return_inverse=True)
    sign = np.where(edges[:, 0] < edges[:, 1], 1, -1)
    balance = np.bincount(which.ravel(), sign, minlength=1)[which.ravel()]
    closed = shared & (balance == 0)
    left = np.flatnonzero(~closed)
    if not len(left):
        return int(closed.sum()) // 2, 0, 0
    near = cKDTree(middles[left]).query_pairs(_CRACK_CELLS, output_type="ndarray")
    other = tile[left][near[:, 0]] != tile[left][near[:, 1]] if len(near) else np.zeros(0, bool)
    cracked = np.unique(near[other])
    return int(closed.sum()) // 2, len(cracked), len(left) - len(cracked)
