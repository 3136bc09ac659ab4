"""The cover of the base by tiles of the detail: each tile against the base near it, then united.

What a tile is covered by depends on the base near it alone (:func:`near_faces`).

A base face's list is the union of what every tile puts on it. That keeps the proof of ``cover.py``
rule by rule: a vertical line that meets detail meets it in some tile, and that tile's columns enter
the segment at every base face the line meets (rule 1); a face far from the base is judged against
all base within reach of it (rule 2). Rule 3 looks at what lies beside a cell and would need all
tiles at once; it is left out, as a build does, which publishes no base beyond the detail.

PURE: no I/O, no clock. Memory: that of ``cover.py`` for one tile; 8 bytes per entry for the union.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float64, Int32, Int64, UInt32
from terraport_pipeline.geometry.cover.cover import build_cover
from terraport_pipeline.geometry.cover.far_detail import FAR_BASE_EDGES, FAR_TOLERANCES

__all__ = ["TileCover", "cover_reach_m", "near_faces", "tile_cover", "unite_covers"]


@dataclass(frozen=True, slots=True, eq=False)
class TileCover:
    """Which of one tile's segments lie over which base faces."""

    base_face: Int32
    """(N,) base faces by their rows among those that were given, ascending."""
    segment: Int32
    """(N,) segments, numbered within the tile, ascending for each base face."""
    far_faces: int
    """Detail faces far from the base near them."""
    baseless_faces: int
    """Of these, faces with no base in their column."""


def tile_cover(
    base_vertices: AnyFloat,
    base_faces: AnyInt,
    vertices: AnyFloat,
    faces: AnyInt,
    segment_of_face: AnyInt,
    *,
    tolerance_m: float,
    threads: int = 1,
) -> TileCover:
    """Find the base faces under one tile's segments.

    Parameters
    ----------
    base_vertices, base_faces : ndarray
        The base near the tile.
    vertices, faces : ndarray
        One tile of the detail, F >= 1.
    segment_of_face : ndarray of shape (F,), integer
        Segment of every face, numbered within the tile.
    tolerance_m : float
        Usual deviation of base from detail, metres, > 0.
    threads : int
        Threads at most; they change nothing but the time.

    Returns
    -------
    TileCover
    """
    cover = build_cover(
        base_vertices, base_faces, vertices, faces, segment_of_face,
        tolerance_m=tolerance_m, hide_partly_covered=True, threads=threads,
    )  # fmt: skip
    offsets = cover.offsets.astype(np.int64)
    rows = np.repeat(np.arange(len(base_faces), dtype=np.int32), offsets[1:] - offsets[:-1])
    return TileCover(
        rows, cover.segments.astype(np.int32), cover.far_detail_faces, cover.baseless_detail_faces
    )


def cover_reach_m(tolerance_m: float, base_edge_m: float, detail_edge_m: float) -> float:
    """Say how far a cover looks: for the base nearest to far detail, and a few columns; metres.

    Parameters
    ----------
    tolerance_m : float
        Of the cover.
    base_edge_m, detail_edge_m : float
        Median edges.
    """
    return max(FAR_TOLERANCES * tolerance_m, FAR_BASE_EDGES * base_edge_m) + 4.0 * detail_edge_m


def unite_covers(tiles: Sequence[tuple[Int32, Int32]], base_faces: int) -> tuple[UInt32, UInt32]:
    """Unite what all tiles put over the base.

    Parameters
    ----------
    tiles : sequence of (base_face (N,), segment (N,))
        Segments by their numbers in the scene; no segment in two tiles.
    base_faces : int
        Faces of the base.

    Returns
    -------
    offsets : ndarray of shape (base_faces + 1,), uint32
    segments : ndarray of shape (M,), uint32
        Ascending within a row.
    """
    face = np.concatenate([np.zeros(0, np.int32), *(tile[0] for tile in tiles)])
    segment = np.concatenate([np.zeros(0, np.int32), *(tile[1] for tile in tiles)])
    order = np.lexsort((segment, face))
    offsets = np.searchsorted(face[order], np.arange(base_faces + 1))
    return offsets.astype(np.uint32), segment[order].astype(np.uint32)


def near_faces(base_vertices: AnyFloat, base_faces: AnyInt, box: Float64, reach_m: float) -> Int64:
    """Find base faces whose box, seen from above, comes within a distance of a tile's box.

    Parameters
    ----------
    base_vertices, base_faces : ndarray
        The whole base.
    box : ndarray of shape (6,), float64
        Lowest and highest x, y, z of the tile, metres.
    reach_m : float
        See :func:`cover_reach_m`.

    Returns
    -------
    ndarray of shape (B,), int64
        Ascending.
    """
    plan = (0, 2)
    corner = base_vertices[:, plan][base_faces].astype(np.float64)
    low, high = box[[0, 2]] - reach_m, box[[3, 5]] + reach_m
    inside = (corner.max(axis=1) >= low).all(axis=1) & (corner.min(axis=1) <= high).all(axis=1)
    return np.flatnonzero(inside)
