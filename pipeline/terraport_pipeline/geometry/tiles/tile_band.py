"""A tile with a band of its neighbours around it, as one mesh.

What a face becomes depends on the faces some rings around it; a tile that carries a band of its
neighbours sees at its border what they see. Faces and vertices stand in the order of the tiles, so
whatever depends on an order comes out alike on both sides of a border.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from terraport_payload.types import AnyInt, Bool, Float32, Float64, Int32, Int64, UInt8

__all__ = ["Banded", "TilePiece", "faces_outside", "piece_near", "touching", "with_band"]


@dataclass(frozen=True, slots=True, eq=False)
class TilePiece:
    """Some faces of a tile, with only the vertices that they use."""

    tile: int
    rows: Int32
    """(K,) which faces of the tile."""
    vertices: Float32
    """(V, 3) those that the faces use, in the tile's order; metres, scene frame."""
    faces: Int32
    """(K, 3) into these vertices."""
    colours: UInt8
    """(V, 3)"""
    ids: Int64
    """(V,) numbers that vertices share with other tiles; -1 where they do not."""


@dataclass(frozen=True, slots=True, eq=False)
class Banded:
    """One mesh of a tile and of the faces of its neighbours that lie near it."""

    vertices: Float32
    """(V, 3) metres, scene frame."""
    faces: Int32
    """(F, 3)"""
    colours: UInt8
    """(V, 3)"""
    own: slice
    """The tile's own faces, in their order."""
    rows_of_tiles: tuple[tuple[int, Int32], ...]
    """Tiles in their order, and which of their faces stand here, one tile behind the other."""

    @property
    def is_own(self) -> Bool:
        """Say of every face whether it is the tile's own, (F,)."""
        own = np.zeros(len(self.faces), np.bool_)
        own[self.own] = True
        return own


def touching(boxes: Float64, tile: int, reach_m: float) -> list[int]:
    """Find the other tiles within reach of a tile's box.

    Parameters
    ----------
    boxes : ndarray of shape (T, 6), float64
        Lowest x, y, z and highest x, y, z of every tile.
    tile : int
    reach_m : float

    Returns
    -------
    list of int
        Ascending.
    """
    low, high = boxes[tile, :3] - reach_m, boxes[tile, 3:] + reach_m
    near = np.all((boxes[:, 3:] >= low) & (boxes[:, :3] <= high), axis=1)
    near_tiles: list[int] = np.flatnonzero(near).tolist()
    return [other for other in near_tiles if other != tile]


def piece_near(
    tile: int,
    vertices: Float32,
    faces: Int32,
    colours: UInt8,
    border: tuple[AnyInt, Int64],
    box: Float64 | None = None,
    reach_m: float = 0.0,
) -> TilePiece:
    """Take the faces of a tile that reach into the surroundings of a box.

    Parameters
    ----------
    tile : int
    vertices : ndarray of shape (V, 3), float32
    faces : ndarray of shape (F, 3), int32
    colours : ndarray of shape (V, 3), uint8
    border : pair of ndarray
        Rows of the vertices that the tile shares, and their numbers.
    box : ndarray of shape (6,), float64, optional
        All faces by default.
    reach_m : float

    Returns
    -------
    TilePiece
    """
    ids = np.full(len(vertices), -1, np.int64)
    ids[border[0]] = border[1]
    if box is None:
        return TilePiece(tile, np.arange(len(faces), dtype=np.int32), vertices, faces, colours, ids)
    inside = (vertices >= box[:3] - reach_m) & (vertices <= box[3:] + reach_m)
    near = np.flatnonzero(inside.all(axis=1))
    rows = np.flatnonzero(np.isin(faces, near).any(axis=1)).astype(np.int32)
    used, corner = np.unique(faces[rows], return_inverse=True)
    local = corner.reshape(-1, 3).astype(np.int32)
    return TilePiece(tile, rows, vertices[used], local, colours[used], ids[used])


def with_band(pieces: Iterable[TilePiece], tile: int) -> Banded:
    """Make one mesh of a tile and parts of others.

    Parameters
    ----------
    pieces : iterable of TilePiece
        In the order of the tiles; all faces of the tile itself.
    tile : int

    Returns
    -------
    Banded
        Vertices of one number are one vertex.
    """
    shared_ids, shared_rows = np.zeros(0, np.int64), np.zeros(0, np.int64)
    vertices: list[Float32] = []
    colours: list[UInt8] = []
    faces: list[Int32] = []
    listed: list[tuple[int, Int32]] = []
    count, face_count, own = 0, 0, slice(0, 0)
    for piece in pieces:
        # (1) Vertices that an earlier piece brought are used again. Invariant: shared_ids is
        # sorted, and shared_rows[i] is where the vertex of shared_ids[i] stands.
        row = np.empty(len(piece.vertices), np.int64)
        at = np.searchsorted(shared_ids, piece.ids)
        at[at == len(shared_ids)] = 0
        is_shared = np.zeros(len(row), np.bool_)
        if len(shared_ids):
            is_shared = (piece.ids >= 0) & (shared_ids[at] == piece.ids)
            row[is_shared] = shared_rows[at[is_shared]]
        row[~is_shared] = count + np.arange(int((~is_shared).sum()))
        count += int((~is_shared).sum())
        # (2) Append what is new, and the faces in the new numbers.
        vertices.append(piece.vertices[~is_shared])
        colours.append(piece.colours[~is_shared])
        faces.append(row.astype(np.int32)[piece.faces])
        listed.append((piece.tile, piece.rows))
        if piece.tile == tile:
            own = slice(face_count, face_count + len(piece.faces))
        face_count += len(piece.faces)
        # (3) Remember the new shared vertices.
        new = ~is_shared & (piece.ids >= 0)
        ids, rows = (
            np.concatenate([shared_ids, piece.ids[new]]),
            np.concatenate([shared_rows, row[new]]),
        )
        order = np.argsort(ids, kind="stable")
        shared_ids, shared_rows = ids[order], rows[order]
    return Banded(
        np.concatenate(vertices),
        np.concatenate(faces),
        np.concatenate(colours),
        own,
        tuple(listed),
    )


def faces_outside(vertices: Float32, faces: Int32, box: Float64, reach_m: float) -> Int32:
    """Find the faces that stay clear of a box and its surroundings, (K,) ascending."""
    corners = vertices[faces]
    low, high = corners.min(axis=1), corners.max(axis=1)
    apart = (high < box[:3] - reach_m) | (low > box[3:] + reach_m)
    return np.flatnonzero(apart.any(axis=1)).astype(np.int32)
