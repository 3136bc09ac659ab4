"""Join the surfaces of neighbouring tiles along their common walls.

Both tiles' solvers refined the same lattice, so in the wall both surfaces end in polylines whose
vertices lie on lattice lines. Where both saw the same samples, they cut the same lines, a hundredth
of a cell apart; such vertices are made one. Where they did not, the two polylines part for a cell
or two and meet again: the sliver between them, which lies in the wall, is filled with triangles.

1. Vertices of both sides are matched per lattice edge, each other's nearest; then what is left, in
the plane, at most a quarter of a cell apart. (Matched per lattice line, crossings on both sides of
a lattice corner were exchanged: four faces at one edge.)
2. Matches become classes in order of distance; a class never holds two vertices of one tile. On
the line where four cores meet a class has up to four members.
3. Edges that run along the wall in opposite directions on both sides cancel. The rest, reversed, is
the boundary of what is missing; its loops are filled by the triangulation of least area
(G. Barequet and M. Sharir, "Filling gaps in the boundary of a polyhedron", CAGD 12, 1995;
:mod:`~terraport_pipeline.geometry.tiles.wall_gaps`).

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numba
import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Bool, Float32, Float64, Int32, Int64, UInt8
from terraport_pipeline.geometry.mesh.loop_fill import fill_loop
from terraport_pipeline.geometry.tiles.wall_gaps import ON_LINE_CELLS, missing_loops

__all__ = ["HeldBorder", "Seams", "TileBorder", "weld_tiles"]


EDGE_REACH_CELLS: Final = 1.0
"""The same crossing lies on the same edge of a cell."""

PLANE_REACH_CELLS: Final = 0.25
"""Vertices that took different edges at one lattice corner."""

_FAR: Final = 1e7
"""Parts lattice lines in a search by distance: more than any cell index."""


@dataclass(frozen=True, slots=True, eq=False)
class TileBorder:
    """Vertices and edges of a tile that lie in the walls of its core."""

    rows: Int32
    """(B,) vertices of the tile that lie in a wall of its core, ascending."""
    cells: Float64
    """(B, 3) their positions in lattice cells, exact in the wall's axis."""
    ratio: Float32
    """(B,) support ratio."""
    edges: Int32
    """(E, 2) open edges that run along a wall, as their faces go round; places in `rows`."""
    walls: UInt8
    """(E,) wall of each edge: 2 * axis, and 1 more for the high one."""
    apart: Int32 = field(default_factory=lambda: np.zeros(0, np.int32))
    """Places in `rows` of vertices that are joined to nothing, by a match or by fillers."""


@dataclass(frozen=True, slots=True, eq=False)
class HeldBorder:
    """What an earlier join said of a tile that is as it was: it enters this one as it left that."""

    rows: Int32
    """(R,) its vertices that were shared; among the rows of its border."""
    cells: Float64
    """(K, 3) positions of these, then of vertices that it got for its fillers."""
    ratio: Float32
    """(K,) support ratio."""
    fillers: Int32
    """(M, 3) triangles that it got, places in `cells`."""
    core: tuple[Int64, Int64]
    """Low and high corner of its core, cells."""
    largest_ratio: float
    """Support ratio from which the detail is cut away, whatever it is joined to."""

    def entered(self, border: TileBorder) -> TileBorder:
        """Give the tile's border, moved to where it was, with its fillers as faces of the tile's.

        Vertices that it got follow its own, and have no row (-1). Those that were not shared and
        will be cut away stay apart: a chance match there would change the tile.
        """
        # (1) Vertices at their earlier positions. `place` is that of each of the K.
        shared, guests = len(self.rows), len(self.cells) - len(self.rows)
        place = np.concatenate(
            [np.searchsorted(border.rows, self.rows), len(border.rows) + np.arange(guests)]
        )
        cells = np.concatenate([border.cells, self.cells[shared:]])
        ratio = np.concatenate([border.ratio, self.ratio[shared:]])
        cells[place], ratio[place] = self.cells, self.ratio
        rows = np.concatenate([border.rows, np.full(guests, -1, np.int32)])
        # (2) Edges of fillers, on the wall that each filler lies in. An edge is open where the
        # tile has no face that runs along it the other way.
        faces = place[self.fillers.reshape(-1, 3)]
        planes = np.stack(self.core, axis=1)  # (3, 2)
        off = np.abs(cells[faces][:, :, :, None] - planes).max(axis=1).reshape(-1, 6)
        sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        edges = np.concatenate([border.edges, sides.astype(np.int32)])
        walls = np.concatenate([border.walls, np.tile(off.argmin(axis=1), 3).astype(np.uint8)])
        key = edges[:, 0].astype(np.int64) * len(rows) + edges[:, 1]
        opposite = edges[:, 1].astype(np.int64) * len(rows) + edges[:, 0]
        alone = ratio > self.largest_ratio
        alone[place] = False
        is_open = ~np.isin(key, opposite)
        # (3) Nor is one open on a line where walls meet: there fillers of all walls close up.
        off = np.abs(cells[edges][:, :, :, None] - planes).max(axis=1).reshape(-1, 6)
        is_open &= (off < ON_LINE_CELLS).sum(axis=1) < 2
        apart = np.flatnonzero(alone).astype(np.int32)
        return TileBorder(rows, cells, ratio, edges[is_open], walls[is_open], apart)


@dataclass(frozen=True, slots=True, eq=False)
class Seams:
    """How the tiles are joined. Shared vertices have ids 0 to G-1."""

    cells: Float64
    """(G, 3) position of every shared vertex."""
    ratio: Float32
    """(G,) support ratio: the least of its members'."""
    owner_tile: Int32
    """(G,) tile that gives colour and attributes: the first."""
    owner_row: Int32
    """(G,) vertex in that tile; -1 where it was held and had none."""
    tile_rows: tuple[Int32, ...]
    """Per tile: its vertices that are shared, ascending."""
    tile_ids: tuple[Int64, ...]
    """Per tile: the ids of these, and then of vertices it gets for its fillers."""
    fillers: tuple[Int64, ...]
    """Per tile: (K, 3) ids of the triangles it gets."""
    gaps: Float64
    """(M,) distance in cells of every pair of vertices that was joined, before."""
    unmatched: int
    """Vertices in walls between tiles that found no counterpart."""
    open_edges: int
    """Edges along walls between tiles that neither cancel nor bound a filled loop: rims of the
    surface, mostly."""
    held: frozenset[int] = frozenset()
    """Tiles of which all is as it was in the earlier join."""


def weld_tiles(
    borders: Sequence[TileBorder],
    neighbours: Sequence[tuple[int, int, int]],
    held: Mapping[int, HeldBorder] | None = None,
) -> Seams:
    """Join tiles.

    Parameters
    ----------
    borders : sequence of TileBorder
        Of all tiles.
    neighbours : sequence of (tile, tile, axis)
        The second lies beyond the high wall of the first; ``TilePlan.neighbours``.
    held : mapping of int to HeldBorder, optional
        Of tiles whose own surface is as it was in an earlier join. What they shared stays where it
        was, and their neighbours come to it; those whose border cannot stay are joined anew
        (:attr:`Seams.held` names the others).

    Returns
    -------
    Seams
        Depends on the tiles alone, not on the order of `neighbours`.
    """
    held = dict(held or {})
    # A tile that cannot be held is let go, and its neighbours try again: at most once per tile.
    while True:
        seams = _weld(borders, sorted(neighbours), held)
        kept = frozenset(tile for tile, border in held.items() if _is_held(seams, tile, border))
        if len(kept) == len(held):
            return replace(seams, held=kept)
        held = {tile: held[tile] for tile in kept}


def _is_held(seams: Seams, tile: int, border: HeldBorder) -> bool:
    """Check that a tile came out as it was."""
    ids = seams.tile_ids[tile]
    return (
        np.array_equal(seams.tile_rows[tile], border.rows)
        and np.array_equal(seams.cells[ids], border.cells)
        and np.array_equal(seams.ratio[ids], border.ratio)
        and np.array_equal(seams.fillers[tile], ids[border.fillers.reshape(-1, 3)])
    )


def _weld(
    borders: Sequence[TileBorder],
    neighbours: Sequence[tuple[int, int, int]],
    held: Mapping[int, HeldBorder],
) -> Seams:
    borders = [
        held[tile].entered(border) if tile in held else border
        for tile, border in enumerate(borders)
    ]
    starts = np.cumsum([0, *(len(border.rows) for border in borders)])
    count = int(starts[-1])
    tile_of = np.repeat(np.arange(len(borders)), np.diff(starts))
    cells = np.concatenate([np.zeros((0, 3)), *(border.cells for border in borders)])
    walls = [_wall_pair(borders, starts, *pair) for pair in neighbours]
    # (1) match
    matches = [_match(cells, wall) for wall in walls]
    pairs = np.concatenate([np.zeros((0, 2), np.int64), *(pair for pair, _ in matches)])
    gaps = np.concatenate([np.zeros(0), *(gap for _, gap in matches)])
    unmatched = sum(
        len(w.low) + len(w.high) - 2 * len(p) for w, (p, _) in zip(walls, matches, strict=True)
    )
    # (2) classes
    order = np.lexsort((pairs[:, 1], pairs[:, 0], np.round(gaps, 9)))
    root = _classes(pairs[order], tile_of, count)
    # (3) what is missing
    loops: list[tuple[int, Int64]] = []
    open_edges = 0
    at_line = _at_lines(borders, root)
    is_apart = np.zeros(count, dtype=np.bool_)
    for border, start in zip(borders, starts[:-1], strict=True):
        is_apart[border.apart + start] = True
    for wall, keep in zip(walls, _uncancelled(walls, root), strict=True):
        closed, left = missing_loops(root[wall.edges[keep]], wall.side[keep], cells, at_line)
        filled = wall.beyond if wall.tile in held and wall.beyond not in held else wall.tile
        loops += [(filled, loop) for loop in closed if not is_apart[loop].any()]
        open_edges += left + sum(len(loop) for loop in closed if is_apart[loop].any())
    return _assemble(
        borders, starts, tile_of, cells, root, loops, gaps, unmatched, open_edges, held
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Wall:
    """A wall between two tiles; vertices by their number over all tiles."""

    tile: int
    """The one below."""
    beyond: int
    axis: int
    low: Int64
    """Vertices of the tile below it that may be joined, ascending."""
    high: Int64
    edges: Int64
    """(E, 2) of both sides."""
    side: UInt8
    """(E,) 0 below, 1 above."""


def _wall_pair(
    borders: Sequence[TileBorder], starts: Int64, low: int, high: int, axis: int
) -> _Wall:
    edges, joinable = [], []
    for tile, code in ((low, 2 * axis + 1), (high, 2 * axis)):
        border = borders[tile]
        edges.append(border.edges[border.walls == code].astype(np.int64) + starts[tile])
        joinable.append(np.setdiff1d(edges[-1], border.apart + starts[tile]))
    side = np.repeat([0, 1], [len(each) for each in edges]).astype(np.uint8)
    below, above = joinable
    return _Wall(low, high, axis, below, above, np.concatenate(edges), side)


def _at_lines(borders: Sequence[TileBorder], root: Int64) -> Bool:
    """Mark classes on lines where walls meet: a tile's border turns there, from wall to wall."""
    turns = []
    for border in borders:
        in_axis = np.zeros((len(border.rows), 3), dtype=np.bool_)
        in_axis[border.edges, border.walls[:, None] // 2] = True
        turns.append(in_axis.sum(axis=1) > 1)
    at_line = np.zeros(len(root), dtype=np.bool_)
    at_line[root[np.concatenate([np.zeros(0, np.bool_), *turns])]] = True
    return at_line


def _match(cells: Float64, wall: _Wall) -> tuple[Int64, Float64]:
    """Pairs of vertices (below, above) that are the same, and their distances."""
    plane = [axis for axis in range(3) if axis != wall.axis]
    low, high = cells[wall.low][:, plane], cells[wall.high][:, plane]
    pairs = _mutual(_on_edges(low), _on_edges(high), EDGE_REACH_CELLS)
    rest_low = np.setdiff1d(np.arange(len(low)), pairs[:, 0])
    rest_high = np.setdiff1d(np.arange(len(high)), pairs[:, 1])
    more = _mutual(low[rest_low], high[rest_high], PLANE_REACH_CELLS)
    pairs = np.concatenate([pairs, np.stack([rest_low[more[:, 0]], rest_high[more[:, 1]]], axis=1)])
    gaps = np.linalg.norm(low[pairs[:, 0]] - high[pairs[:, 1]], axis=1)
    return np.stack([wall.low[pairs[:, 0]], wall.high[pairs[:, 1]]], axis=1), gaps


def _on_edges(points: Float64) -> Float64:
    """Spread places (N, 2) so that only those on one edge of a lattice cell are near each other."""
    off = np.abs(points - np.round(points))
    axis = off.argmin(axis=1)
    rows = np.arange(len(points))
    line = np.round(points[rows, axis])
    along = points[rows, 1 - axis]
    apart = 4.0 * EDGE_REACH_CELLS
    return np.stack([axis * _FAR, line * apart, np.floor(along) * apart, along], axis=1)


def _mutual(low: Float64, high: Float64, reach: float) -> Int64:
    """Pairs that are each other's nearest within reach: (M, 2), by the first."""
    if not len(low) or not len(high):
        return np.zeros((0, 2), np.int64)
    gap, there = cKDTree(high).query(low, distance_upper_bound=reach)
    _, back = cKDTree(low).query(high, distance_upper_bound=reach)
    near = np.flatnonzero(np.isfinite(gap))
    near = near[back[there[near]] == near]
    return np.stack([near, there[near]], axis=1).astype(np.int64)


@numba.njit(cache=True)
def _classes(pairs: Int64, tile_of: Int64, count: int) -> Int64:  # pragma: no cover - compiled
    """Union of pairs in their order, refused where a class would hold two vertices of a tile.

    Returns the smallest member of every vertex's class.
    """
    # Invariant: a class is a linked list that starts at its lowest vertex, `root` of all of it, and
    # holds no two vertices of one tile: as many as tiles meet there, so walking it is cheap.
    root = np.arange(count)
    following = np.full(count, -1)
    for at in range(len(pairs)):
        a, b = root[pairs[at, 0]], root[pairs[at, 1]]
        if a == b:
            continue
        clash = False
        i = a
        while i >= 0 and not clash:
            j = b
            while j >= 0:
                if tile_of[i] == tile_of[j]:
                    clash = True
                    break
                j = following[j]
            i = following[i]
        if clash:
            continue
        if b < a:
            a, b = b, a
        last = a
        while following[last] >= 0:
            last = following[last]
        following[last] = b
        i = b
        while i >= 0:
            root[i] = a
            i = following[i]
    return root


def _uncancelled(walls: Sequence[_Wall], root: Int64) -> list[Bool]:
    """Mark each wall's edges that run once more one way than the other, over all tiles.

    Over all, because along the line where four cores meet the two faces of an edge may belong to
    tiles that share no wall.
    """
    if not walls:
        return []
    own = np.unique(np.concatenate([wall.edges for wall in walls]), axis=0)  # in two walls: once
    joined = root[own]
    _, which = np.unique(np.sort(joined, axis=1), axis=0, return_inverse=True)
    sign = np.where(joined[:, 0] < joined[:, 1], 1, -1)
    balance = np.bincount(which.ravel(), sign, minlength=1)[which.ravel()]
    base = int(own.max(initial=0)) + 1
    left = np.sort((own[:, 0] * base + own[:, 1])[balance != 0])
    marks = []
    for wall in walls:
        key = wall.edges[:, 0] * base + wall.edges[:, 1]
        marks.append(np.isin(key, left))
    return marks


def _assemble(
    borders: Sequence[TileBorder],
    starts: Int64,
    tile_of: Int64,
    cells: Float64,
    root: Int64,
    loops: Sequence[tuple[int, Int64]],
    gaps: Float64,
    unmatched: int,
    open_edges: int,
    held: Mapping[int, HeldBorder],
) -> Seams:
    """Give shared vertices their ids and hand everything to the tiles."""
    # (1) Which classes are shared: those of several vertices, those on a loop to be filled, and
    # those of what is held.
    # Invariant: `root` is the lowest vertex of each class, so ids ascend with the vertices.
    count = len(root)
    members = np.bincount(root, minlength=count)
    used = members > 1
    for _, loop in loops:
        used[loop] = True
    rows = np.concatenate([np.zeros(0, np.int32), *(border.rows for border in borders)])
    held_vertices = {}
    for tile, each in held.items():
        own = np.arange(starts[tile], starts[tile + 1])
        held_vertices[tile] = own[np.isin(rows[own], each.rows) | (rows[own] < 0)]
        used[root[held_vertices[tile]]] = True
    shared = np.flatnonzero(used[root])  # vertices whose class is shared
    heads = np.flatnonzero(used & (root == np.arange(count)))
    ids = np.full(count, -1, dtype=np.int64)
    ids[heads] = np.arange(len(heads))
    of_vertex = ids[root]
    # (2) Position of each shared vertex: the mean over its class.
    size = members[heads].astype(np.float64)
    middle = np.stack(
        [
            np.bincount(of_vertex[shared], cells[shared, axis], minlength=len(heads)) / size
            for axis in range(3)
        ],
        axis=1,
    )
    # The mean of equal numbers need not be that number: what is exact stays exact.
    exact = np.round(middle)
    middle = np.where(np.abs(middle - exact) < 1e-9, exact, middle)
    # (3) Its confidence: the lowest of its class.
    ratio = np.full(len(heads), np.inf, dtype=np.float32)
    all_ratio = np.concatenate([np.zeros(0, np.float32), *(border.ratio for border in borders)])
    np.minimum.at(ratio, of_vertex[shared], all_ratio[shared])
    for tile in sorted(held, reverse=True):  # the lowest last: it has its way
        middle[of_vertex[held_vertices[tile]]] = held[tile].cells
        ratio[of_vertex[held_vertices[tile]]] = held[tile].ratio
    # (4) Faces that fill loops, given to the tile of each loop.
    triangles: list[list[Int64]] = [[] for _ in borders]
    for tile, loop in loops:
        faces = fill_loop(middle[ids[loop]])
        triangles[tile].append(ids[loop][faces])
    # (5) What every tile needs: its rows, their ids, and ids that only its fillers use. What a
    # held tile had of both is among its own.
    tile_rows, tile_ids, fillers = [], [], []
    for tile in range(len(borders)):
        own = np.arange(starts[tile], starts[tile + 1])
        own = own[of_vertex[own] >= 0]
        mine = np.concatenate([np.zeros((0, 3), np.int64), *triangles[tile]])
        if tile in held:
            before = of_vertex[held_vertices[tile]][held[tile].fillers.reshape(-1, 3)]
            mine = np.concatenate([before, mine])
        guests = np.setdiff1d(mine, of_vertex[own])
        tile_rows.append(rows[own][rows[own] >= 0])
        tile_ids.append(np.concatenate([of_vertex[own], guests]))
        fillers.append(mine)
    return Seams(
        middle,
        ratio,
        tile_of[heads].astype(np.int32),
        rows[heads],
        tuple(tile_rows),
        tuple(tile_ids),
        tuple(fillers),
        gaps,
        unmatched,
        open_edges,
    )
