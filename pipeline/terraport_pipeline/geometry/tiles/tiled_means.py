"""Regions by mean colour over tiles: the rounds of ``mean_colour.py`` for a mesh never held whole.

1. Every tile's colours are added up: the limits, which
   ``mean_colour.py`` takes from the scene's colours, are the whole scene's (:class:`MeansScale`).
2. In every tile faces are united up to the level of fine pools (:func:`tile_units`), but for those
   within a few faces of another tile, which are left single: a unit that has stopped at a tile's
   border would draw that border.
3. The units of all tiles, with their borders inside and across tiles, are united on
   (:func:`join_tiles`), from the first level again: what was held back near the tiles' borders
   goes on there as if there were none. Then small ones join, as in ``mean_colour.py``.

With one tile the result is that of :class:`~.mean_colour.MeanColourSegmenter` to the last bit. With
more, the order of unions within the two lowest levels differs somewhat near tile borders.

PURE: no I/O, no clock. Step 2 takes about 350 bytes per face of one tile; step 3 some 150 bytes per
unit: a few hundred per million faces, and the faces near tile borders (about 40 per edge of the
border).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numba
import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import AnyInt, Bool, Float32, Float64, Int32, Int64, UInt8
from terraport_pipeline.geometry.mesh.face_measures import (
    edge_steps,
    face_centres,
    steps_of_lengths,
)
from terraport_pipeline.geometry.mesh.unit_rows import combine_rows, rows_of_labels, rows_of_pairs
from terraport_pipeline.geometry.regions.colour import face_lab
from terraport_pipeline.geometry.regions.mean_colour import (
    FINE_LEVEL,
    LAB_STEPS,
    LEVELS,
    MeanColourSegmenter,
)
from terraport_pipeline.geometry.regions.mean_scale import ColourTotals
from terraport_pipeline.geometry.regions.mean_units import MeanUnits, unite
from terraport_pipeline.geometry.regions.pool_refine import number_by_first
from terraport_pipeline.geometry.tiles.tile_seams import Seams

__all__ = [
    "RING",
    "JoinedRegions",
    "MeansScale",
    "TileUnits",
    "colours_of_faces",
    "join_tiles",
    "tile_units",
]


_SAMPLE_EVERY: Final = 64
"""Every so many faces one stands for its place when an island looks for the nearest region; the
first face of every unit does too. At 100 M faces 40 MB."""


RING: Final = 12
"""Steps from face to face within which faces at another tile are left single. On a quarry of 1.6 M
faces in 9 tiles, 0 drew regions along 3.8 % of the tiles' borders, 12 along 0.40 %, against 0.38 %
of the same edges in the whole; 24 and 40 did no better (``benchmarks/tiled_regions.py``)."""


@dataclass(frozen=True, slots=True, eq=False)
class MeansScale:
    """What every tile must know of the whole scene."""

    segmenter: MeanColourSegmenter
    totals: ColourTotals
    longest_m: float
    """Longest edge between two faces: lengths are whole steps of it."""
    ring: int = RING
    """Steps from face to face within which faces at another tile are left single."""

    @property
    def limit(self) -> float:
        """Final limit of the difference, CIELAB units."""
        return self.segmenter.limit(self.totals, self.segmenter.weights())

    @property
    def least(self) -> int:
        """Number of faces below which a region is small and joins another."""
        return self.segmenter.least_faces(self.totals.faces)


@dataclass(frozen=True, slots=True, eq=False)
class TileUnits:
    """Units of one tile, united up to the fine pools, and their graph within the tile."""

    labels: Int32
    """(F,) unit of every face, numbered by first face."""
    offsets: Int64
    """(U + 1,) row starts of the units' neighbours within the tile."""
    neighbours: Int32
    """(E,)"""
    border: Int64
    """(E,) steps."""
    sums: Int64
    """(U, 3) summed colours, in steps."""
    faces: Int64
    """(U,) number of faces."""
    first: Int32
    """(U,) lowest face within the tile."""
    edge_steps: tuple[int, int]
    """Summed length of the edges between two faces of the tile, in steps, and their number."""
    centres: Float32
    """(K, 3) centres of some faces, metres."""
    centre_unit: Int32
    """(K,) their units."""


@dataclass(frozen=True, slots=True, eq=False)
class JoinedRegions:
    """Region and fine pool of every tile's units, numbered over all tiles."""

    region: tuple[Int32, ...]
    """For every tile (U,) the region of its units; numbered by first face in order of the tiles."""
    fine: tuple[Int32, ...]
    """For every tile (U,) the fine pool of its units, numbered over all tiles."""
    count: int
    """Number of regions."""
    fine_count: int
    """Number of fine pools."""
    pools: int
    """Units left when no colours were alike any more."""
    islands: int
    """Units that stayed small because they touch no other."""
    unions: Int32 = field(default_factory=lambda: np.zeros((0, 2), np.int32))
    """(M, 2) what unites regions to coarser pieces, cheapest first: regions, or ``count`` and the
    number of a union before; engines without a tree have none."""
    union_costs: Float64 = field(default_factory=lambda: np.zeros(0))
    """(M,) above 1, rising."""


def colours_of_faces(colours: UInt8, faces: AnyInt) -> Int32:
    """Colour of every face as it is compared: CIELAB in steps, (F, 3)."""
    return face_lab(colours, faces, LAB_STEPS).astype(np.int32)


def tile_units(
    vertices: Float32,
    faces: Int32,
    colours: UInt8,
    pairs: tuple[Int32, Int32],
    seams: tuple[Int32, Float64],
    scale: MeansScale,
) -> TileUnits:
    """Unite the faces of one tile up to the fine pools.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres.
    faces : ndarray of shape (F, 3), int32
        F >= 1.
    colours : ndarray of shape (V, 3), uint8
        sRGB.
    pairs : pair of ndarray
        ``face_pairs`` of the tile.
    seams : (face (K,), length (K,))
        Edges with other tiles, metres: :meth:`~.tile_seams.Seams.of`.
    scale : MeansScale

    Returns
    -------
    TileUnits
    """
    # (1) Faces near a seam are held back: what they would join may lie in the next tile. Their
    # borders count as outer ones, which unite nothing but lengthen the perimeter.
    n_faces = len(faces)
    neighbours, edges = pairs
    steps = edge_steps(vertices, edges, longest=scale.longest_m)
    near = _near_seams(n_faces, neighbours, seams[0], scale.ring)
    outer = np.zeros(n_faces, np.int64)
    np.add.at(outer, seams[0], steps_of_lengths(seams[1], scale.longest_m))
    held = near[neighbours].any(axis=1)
    for side in (0, 1):
        np.add.at(outer, neighbours[held, side], steps[held])
    # (2) The rounds up to the fine pools, on all other edges.
    units = MeanUnits(
        np.arange(n_faces, dtype=np.int32),
        rows_of_pairs(n_faces, neighbours[~held], steps[~held]),
        colours_of_faces(colours, faces).astype(np.int64),
        np.ones(n_faces, np.int64),
        np.arange(n_faces, dtype=np.int32),
        outer,
    )
    del held, outer, near
    weight, segmenter = scale.segmenter.weights(), scale.segmenter
    for level in range(1, FINE_LEVEL + 1):
        limit = scale.limit * level / LEVELS
        units = unite(units, weight, limit, scale.least, segmenter.leak, 0)
    # (3) The units' graph, held edges included, for the join of all tiles.
    rows = combine_rows(*rows_of_labels(units.labels, len(units.faces), neighbours, steps))
    shown = np.unique(np.concatenate([units.name, np.arange(0, n_faces, _SAMPLE_EVERY)]))
    return TileUnits(
        units.labels, *rows, units.sums, units.faces, units.name,
        (int(steps.sum()), len(steps)),
        face_centres(vertices, faces[shown]).astype(np.float32), units.labels[shown],
    )  # fmt: skip


def join_tiles(
    tiles: Sequence[TileUnits],
    seam_units: Int32,
    seams: Seams,
    scale: MeansScale,
    *,
    threads: int = 1,
) -> JoinedRegions:
    """Unite the units of all tiles to regions.

    Parameters
    ----------
    tiles : sequence of TileUnits
        In order of the tiles; their labels are not looked at (and may be empty).
    seam_units : ndarray of shape (S, 2), int32
        Units, numbered within their tiles, on both sides of every seam.
    seams : Seams
    scale : MeansScale
    threads : int
        Threads at most; they change nothing but the time.

    Returns
    -------
    JoinedRegions
    """
    # (1) Numbers over all tiles: units and faces of a tile follow those of the tiles before it.
    segmenter, weight = scale.segmenter, scale.segmenter.weights()
    counts = np.array([len(tile.faces) for tile in tiles])
    starts = np.concatenate([[0], np.cumsum(counts)])
    n_faces = np.array([int(tile.faces.sum()) for tile in tiles])
    first_face = np.concatenate([[0], np.cumsum(n_faces)])[:-1]
    seam_steps = steps_of_lengths(seams.length_m, scale.longest_m)
    pairs = (seam_units + starts[seams.tiles]).astype(np.int32)
    units = MeanUnits(
        np.arange(starts[-1], dtype=np.int32),
        _all_rows(tiles, starts, pairs, seam_steps),
        np.concatenate([tile.sums for tile in tiles]),
        np.concatenate([tile.faces for tile in tiles]),
        np.concatenate(
            [tile.first + np.int32(at) for tile, at in zip(tiles, first_face, strict=True)]
        ),
    )
    # (2) The rounds of the whole mesh, from the tiles' units on: levels, then small units.
    names, fine, fine_count = units.name, units.labels, 0
    for level in range(1, LEVELS + 1):
        limit = scale.limit * level / LEVELS
        units = unite(units, weight, limit, scale.least, segmenter.leak, 0)
        if level == FINE_LEVEL:
            fine, fine_count = units.labels, len(units.faces)
    pools = len(units.faces)
    length = int(seam_steps.sum()) + sum(tile.edge_steps[0] for tile in tiles)
    mean_step = length // max(len(seam_steps) + sum(tile.edge_steps[1] for tile in tiles), 1)
    units = unite(units, weight, np.inf, scale.least, 0.0, mean_step)
    # (3) What is still small touches nothing larger: to the nearest region.
    small = units.faces < scale.least
    islands = int(np.count_nonzero(small))
    labels = units.labels
    if islands and islands < len(small):
        labels = _join_nearest(tiles, starts, labels, small, threads)
    # (4) Numbers by first face, which do not depend on how the mesh was tiled.
    order = np.argsort(names, kind="stable")
    numbered, count = number_by_first(labels[order])
    region = np.empty(len(labels), np.int32)
    region[order] = numbered
    return JoinedRegions(
        tuple(np.split(region, starts[1:-1])),
        tuple(np.split(fine, starts[1:-1])),
        count,
        fine_count,
        pools,
        islands,
    )


def _all_rows(
    tiles: Sequence[TileUnits], starts: Int64, pairs: Int32, steps: Int64
) -> tuple[Int64, Int32, Int64]:
    """Rows of all units: those within the tiles, and those across seams."""
    count = int(starts[-1])
    across = rows_of_labels(np.arange(count, dtype=np.int32), count, pairs, steps)
    lengths = np.concatenate([np.diff(tile.offsets) for tile in tiles])
    inside = np.concatenate(
        [tile.neighbours + np.int32(at) for tile, at in zip(tiles, starts, strict=False)]
    )
    border = np.concatenate([tile.border for tile in tiles])
    offsets = np.concatenate([[0], np.cumsum(lengths + np.diff(across[0]))])
    neighbours = np.empty(offsets[-1], np.int32)
    weight = np.empty(offsets[-1], np.int64)
    # Each row: its neighbours within the tile, then those across seams.
    at_inside = np.repeat(offsets[:-1] - np.cumsum(lengths) + lengths, lengths)
    at_inside += np.arange(len(inside))
    neighbours[at_inside], weight[at_inside] = inside, border
    more = np.diff(across[0])
    at_across = np.repeat(offsets[:-1] + lengths - np.cumsum(more) + more, more)
    at_across += np.arange(len(across[1]))
    neighbours[at_across], weight[at_across] = across[1], across[2]
    return combine_rows(offsets, neighbours, weight)


def _join_nearest(
    tiles: Sequence[TileUnits],
    starts: Int64,
    labels: Int32,
    small: Bool,
    threads: int,
) -> Int32:
    """Give every small union the union of the nearest place that is not small (tie: lower)."""
    centroids = np.concatenate([tile.centres for tile in tiles]).astype(np.float64)
    union = labels[
        np.concatenate(
            [tile.centre_unit + np.int32(at) for tile, at in zip(tiles, starts, strict=False)]
        )
    ]
    lost = small[union]
    kept = np.flatnonzero(~lost)
    lost_rows = np.flatnonzero(lost)
    tree = cKDTree(centroids[kept], balanced_tree=False, compact_nodes=False)
    distance, nearest = tree.query(centroids[lost_rows], workers=threads)
    order = np.lexsort((nearest, distance, union[lost_rows]))
    owner = union[lost_rows][order]
    chosen = order[np.concatenate([[True], owner[1:] != owner[:-1]])]
    mapping = np.arange(len(small), dtype=np.int32)
    mapping[union[lost_rows[chosen]]] = union[kept[nearest[chosen]]]
    joined: Int32 = mapping[labels]
    return joined


@numba.njit(cache=True, nogil=True)
def _near_seams(n_faces: int, pairs: Int32, at_seam: Int32, steps: int) -> Bool:
    """Whether a face is within so many steps of one at a seam (those are within 1 step), (F,)."""
    reached = np.zeros(n_faces, np.int32)
    if steps > 0:
        for f in at_seam:
            reached[f] = 1
    for step in range(1, steps):
        for i in range(len(pairs)):
            a, b = pairs[i, 0], pairs[i, 1]
            if reached[a] == step and reached[b] == 0:
                reached[b] = step + 1
            elif reached[b] == step and reached[a] == 0:
                reached[a] = step + 1
    return reached > 0
