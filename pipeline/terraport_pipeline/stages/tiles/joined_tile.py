"""One tile after the join: what the join must know of it, and at last the tile itself.

Everything here depends on the tile's own surface and on what the join says of it
(:class:`.TileJoin`, numbers of the tile's own); nothing on other tiles.
Memory: about 200 bytes per face of the tile.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from terraport_payload.types import AnyInt, Bool, Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.clouds.edges import EdgeRule
from terraport_pipeline.geometry.mesh.clip import Clip, clip_with_sources
from terraport_pipeline.geometry.mesh.trim import compact
from terraport_pipeline.geometry.mesh.vertex_normals import normal_sums, unit_normals
from terraport_pipeline.geometry.tiles.tile_plan import Lattice
from terraport_pipeline.stages.tiles.detail_tiles import vertex_box
from terraport_pipeline.stages.tiles.join_tiles import TileJoin
from terraport_pipeline.stages.tiles.settle_tiles import Forgiven, Look, SettledTile, Weak
from terraport_pipeline.stages.tiles.solve_tile import TileTask
from terraport_pipeline.stages.tiles.tile_arrays import TileArrays

__all__ = ["finish", "look", "weak_places"]


@dataclass(frozen=True, slots=True, eq=False)
class _Welded:
    """A tile with what it shares, before it is cut."""

    vertices: Float32
    """(V, 3) scene frame; the tile's own, then those of fillers."""
    faces: Int32
    shared: Int64
    """(V,) number of a shared vertex in the tile's join; -1 where a vertex is not shared."""
    ratio: Float32
    in_wall: Bool


def weak_places(task: TileTask, arrays: TileArrays, join: TileJoin) -> Weak:
    """Find the connected weak places of a tile and how weak they get."""
    welded = _weld(task, arrays, join)
    rows, label = _weak(welded, join.rule)
    farthest = np.zeros(int(label.max(initial=-1)) + 1, dtype=np.float32)
    np.maximum.at(farthest, label, welded.ratio[rows])
    shared = welded.shared[rows] >= 0
    touch = np.stack([label[shared], welded.shared[rows][shared]], axis=1)
    return Weak(farthest, touch)


def look(task: TileTask, arrays: TileArrays, join: TileJoin, forgiven: Forgiven) -> Look:
    """Look at a tile as it will be, but for its loose pieces and shared normals."""
    welded = _weld(task, arrays, join)
    cut = _cut(welded, join.rule, forgiven.detail)
    piece, sizes = _pieces(cut.faces, len(cut.vertices))
    of_vertex = np.zeros(len(cut.vertices), dtype=np.int64)
    of_vertex[cut.faces.ravel()] = np.repeat(piece, 3)
    ends = welded.shared[cut.ends]
    shared = np.flatnonzero((ends >= 0).all(axis=1))
    sums = normal_sums(cut.vertices, cut.faces)[shared]
    edges, middles = _open_wall_edges(task, cut, welded)
    return Look(sizes, of_vertex[shared], ends[shared], sums, edges, middles)


def finish(
    task: TileTask, arrays: TileArrays, join: TileJoin, forgiven: Forgiven, settled: SettledTile
) -> tuple[dict[str, npt.NDArray[np.generic]], Float64]:
    """Make a tile as it will be: arrays of :class:`.StoredTiles`, and its box.

    ``border-rows`` are its shared vertices, ``border-shared`` their places in
    :attr:`.Settled.ids`; ``base-vertices`` and ``base-faces`` are the surface that the base is
    thinned from.
    """
    # (1) Weld, cut to the edge, drop pieces that are islands over all tiles.
    welded = _weld(task, arrays, join)
    cut = _cut(welded, join.rule, forgiven.detail)
    piece, _ = _pieces(cut.faces, len(cut.vertices))
    keep = ~np.isin(piece, settled.dropped)
    used = np.zeros(len(cut.vertices), dtype=bool)
    used[cut.faces[keep].ravel()] = True
    # (2) Normals of shared vertices come from the join, so that both tiles shade alike.
    shared = np.flatnonzero((welded.shared[cut.ends] >= 0).all(axis=1))
    order = np.full(len(cut.vertices), -1, dtype=np.int32)
    order[shared] = np.arange(len(shared))
    normals = unit_normals(normal_sums(cut.vertices, cut.faces[keep]))
    normals[shared] = settled.normals
    # (3) Colours and attributes; shared vertices take the join's.
    guests = len(welded.vertices) - len(arrays["vertices"])
    at_shared = np.flatnonzero(welded.shared >= 0)
    colours = np.concatenate([arrays["colours"], np.zeros((guests, 3), np.uint8)])
    colours[at_shared] = join.colours[welded.shared[at_shared]]
    mixed = np.rint(_between(colours.astype(np.float64), cut)).astype(np.uint8)
    finished: dict[str, npt.NDArray[np.generic]] = {}
    for number, values in enumerate(join.attributes):
        column = np.concatenate([arrays[f"attribute-{number}"], np.zeros(guests, np.float32)])
        column[at_shared] = values[welded.shared[at_shared]]
        if number in join.codes:  # never mixed: the nearer end's
            nearer = np.where(cut.share > 0.5, cut.ends[:, 1], cut.ends[:, 0])
            finished[f"attribute-{number}"] = column[nearer][used]
        else:
            finished[f"attribute-{number}"] = _between(column.astype(np.float64), cut)[used].astype(
                np.float32
            )
    # (4) Without unused vertices. Invariant: a vertex that two tiles share has the same position,
    # normal, colour and attributes in both.
    final, faces = compact(cut.vertices, cut.faces, keep)
    border = np.flatnonzero(order[used] >= 0)
    finished |= {
        "vertices": final,
        "faces": faces,
        "normals": normals[used],
        "colours": mixed[used],
        "border-rows": border.astype(np.int32),
        "border-shared": order[used][border],
    }
    # (5) The surface for the base, cut farther out.
    wide = _cut(welded, join.base_rule, forgiven.base)
    every = np.ones(len(wide.faces), dtype=bool)
    finished["base-vertices"], finished["base-faces"] = compact(wide.vertices, wide.faces, every)
    return finished, vertex_box(final) if len(final) else np.zeros(6)


def _between(values: Float64, cut: Clip) -> Float64:
    """Values at vertices after the cut; at those that stayed, bit for bit what was there."""
    first, second = values[cut.ends[:, 0]], values[cut.ends[:, 1]]
    share = cut.share.reshape(-1, *(1,) * (values.ndim - 1))
    between: Float64 = np.where(share > 0, first + share * (second - first), first)
    return between


def _weld(task: TileTask, arrays: TileArrays, join: TileJoin) -> _Welded:
    own, rows = arrays["vertices"], join.rows
    guests = len(join.cells) - len(rows)
    at_shared = np.concatenate([rows, np.arange(len(own), len(own) + guests)])
    shared = np.full(len(own) + guests, -1, dtype=np.int64)
    shared[at_shared] = np.arange(len(join.cells))
    vertices = np.zeros((len(shared), 3), dtype=np.float32)
    vertices[: len(own)] = own.astype(np.float64) + task.centre_m
    vertices[at_shared] = Lattice(task.anchor_m, task.cell_m).metres(join.cells)
    vertices += np.float32(0.0)  # turns -0.0 into 0.0: equal places must be equal bits
    ratio = np.concatenate([arrays["ratio"], np.zeros(guests, np.float32)])
    ratio[at_shared] = join.ratio
    fillers = at_shared[join.fillers].astype(np.int32).reshape(-1, 3)
    faces = np.concatenate([arrays["faces"], fillers])
    in_wall = np.zeros(len(vertices), dtype=bool)
    in_wall[arrays["border-rows"]] = True
    in_wall[len(own) :] = True
    return _Welded(vertices, faces, shared, ratio, in_wall)


def _weak(welded: _Welded, rule: EdgeRule) -> tuple[Int64, Int64]:
    """Weak vertices and the connected weak place of each, numbered by their first vertex."""
    weak = welded.ratio > rule.threshold
    rows = np.flatnonzero(weak)
    number = np.cumsum(weak, dtype=np.int64) - 1
    faces = welded.faces
    links = [
        faces[weak[faces[:, start]] & weak[faces[:, end]]][:, [start, end]]
        for start, end in ((0, 1), (1, 2), (2, 0))
    ]
    pairs = number[np.concatenate(links)]
    graph = coo_matrix(
        (np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(len(rows),) * 2
    )
    if not len(rows):
        return rows, np.zeros(0, np.int64)
    _, label = connected_components(graph, directed=False)
    return rows, _renumbered(label)


def _cut(welded: _Welded, rule: EdgeRule, forgiven: Bool) -> Clip:
    """Cut along the end of support and footprint; as ``clouds/edges.py``, for the whole."""
    rows, label = _weak(welded, rule)
    limit = np.full(len(welded.ratio), rule.threshold, dtype=np.float32)
    limit[rows[forgiven[label]]] = rule.largest
    field_m = ((limit - welded.ratio) * np.float32(rule.spacing_m)).astype(np.float32)
    if rule.footprint is not None:
        np.minimum(field_m, rule.footprint.margin_m(welded.vertices), out=field_m)
    field_m += np.float32(rule.outward_m)
    return clip_with_sources(welded.vertices, welded.faces, field_m)


def _pieces(faces: Int32, vertex_count: int) -> tuple[Int64, Int64]:
    """Find the connected piece of every face, numbered by their first face, and pieces' sizes."""
    if not len(faces):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    start = np.concatenate([faces[:, 0], faces[:, 1]])
    end = np.concatenate([faces[:, 1], faces[:, 2]])
    links = coo_matrix(
        (np.ones(len(start), np.int8), (start, end)), shape=(vertex_count, vertex_count)
    )
    _, label = connected_components(links, directed=False)
    piece = _renumbered(label[faces[:, 0]])
    return piece, np.bincount(piece).astype(np.int64)


def _renumbered(labels: AnyInt) -> Int64:
    """Make labels 0, 1, 2, ... in order of their first occurrence: SciPy promises no order."""
    _, first, which = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first, kind="stable"), kind="stable")
    renumbered: Int64 = rank[which.ravel()].astype(np.int64)
    return renumbered


def _open_wall_edges(task: TileTask, cut: Clip, welded: _Welded) -> tuple[Int64, Float64]:
    """Open edges along walls as :attr:`.Look.edges`, and their middles in cells.

    A vertex that is not shared is named by ``-1 - row``.
    """
    in_wall = np.asarray(welded.in_wall[cut.ends].all(axis=1), dtype=np.bool_)
    some = cut.faces[in_wall[cut.faces].sum(axis=1) >= 2]
    edges = np.concatenate([some[:, [0, 1]], some[:, [1, 2]], some[:, [2, 0]]]).astype(np.int64)
    edges = edges[in_wall[edges].all(axis=1)]
    cells = Lattice(task.anchor_m, task.cell_m).cells(cut.vertices)
    low = np.array(task.centre_cells) - 0.5 * task.core_cells
    off = np.abs(cells - low) < _WALL_CELLS, np.abs(cells - low - task.core_cells) < _WALL_CELLS
    # Both ends of the edge on the same wall: low or high, along x, y or z.
    along = np.concatenate([np.asarray(side)[edges].all(axis=1) for side in off], axis=1)
    edges = edges[along.any(axis=1)]
    forward = edges[:, 0] * len(cut.vertices) + edges[:, 1]
    backward = edges[:, 1] * len(cut.vertices) + edges[:, 0]
    edges = edges[~np.isin(backward, forward)]
    ends = welded.shared[cut.ends]
    own = -1 - np.arange(len(cut.vertices))
    shared = np.all(ends >= 0, axis=1, keepdims=True)
    named = np.where(shared, ends, own[:, None])
    return named[edges], cells[edges].mean(axis=1)


_WALL_CELLS = 1e-2
"""Scene coordinates are 32 bit: this near a wall a vertex lies in it."""
