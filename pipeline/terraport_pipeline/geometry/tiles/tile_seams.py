"""Where the tiles of one surface meet: open edges of each, matched by their end points.

Tiles of a mesh repeat the vertices on their common border, equal to the last bit. An edge that only
one face of a tile has is *open* there; the same edge, open in another tile, is the *seam* over
which the two faces are neighbours. Ends are compared by their positions, so nobody has to number
the border's vertices. Open edges without a partner are the surface's own rim.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Float32, Float64, Int32

__all__ = ["OpenEdges", "Seams", "match_seams", "open_edges"]


@dataclass(frozen=True, slots=True, eq=False)
class OpenEdges:
    """Edges of one tile that only one of its faces has."""

    ends: Float32
    """(K, 6) positions of both ends, the lower one (by x, then y, then z) first; metres."""
    face: Int32
    """(K,) face of the tile."""

    def lengths_m(self) -> Float64:
        """Length of every open edge, (K,), metres."""
        along = self.ends[:, 3:].astype(np.float64) - self.ends[:, :3]
        length: Float64 = np.sqrt((along * along).sum(axis=1))
        return length


@dataclass(frozen=True, slots=True, eq=False)
class Seams:
    """Pairs of faces in different tiles that share an edge."""

    tiles: Int32
    """(S, 2) their tiles, lower first."""
    faces: Int32
    """(S, 2) their numbers within the tiles."""
    length_m: Float64
    """(S,) length of the shared edge."""

    def of(self, tile: int) -> tuple[Int32, Float64]:
        """Faces of one tile at its seams, and the length of each edge."""
        first, second = self.tiles[:, 0] == tile, self.tiles[:, 1] == tile
        return (
            np.concatenate([self.faces[first, 0], self.faces[second, 1]]),
            np.concatenate([self.length_m[first], self.length_m[second]]),
        )


def open_edges(
    vertices: AnyFloat,
    faces: AnyInt,
    pairs: tuple[Int32, Int32],
) -> OpenEdges:
    """Find the edges that only one face has.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float
        Metres.
    faces : ndarray of shape (F, 3), integer
        Vertex indices.
    pairs : pair of ndarray
        ``face_pairs`` of the mesh.

    Returns
    -------
    OpenEdges
        In order of the faces. A face whose three edges are all shared is not looked at, so an open
        edge of a face that has two neighbours over another edge (not a surface there) can be
        missed.

    Examples
    --------
    >>> from terraport_pipeline.geometry.mesh.adjacency import face_pairs
    >>> square = np.array([[0, 1, 2], [2, 1, 3]])
    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], np.float32)
    >>> open_edges(corners, square, face_pairs(square, 4)).face.tolist()
    [0, 0, 1, 1]
    """
    neighbours, shared = pairs
    at_rim = np.bincount(neighbours.ravel(), minlength=len(faces)) < 3
    face = np.flatnonzero(at_rim)
    edges = np.stack([faces[face], np.roll(faces[face], -1, axis=1)], axis=2).reshape(-1, 2)
    edges = np.sort(edges, axis=1).astype(np.int64)
    face = np.repeat(face, 3)
    closed = shared[at_rim[neighbours].any(axis=1)].astype(np.int64)
    span = len(vertices)
    is_open = edges[:, 0] != edges[:, 1]
    is_open &= ~np.isin(edges[:, 0] * span + edges[:, 1], closed[:, 0] * span + closed[:, 1])
    ends = np.asarray(vertices, np.float32)[edges[is_open]]
    ends = ends + np.float32(0.0)  # -0.0 and 0.0 are one place
    return OpenEdges(_lower_first(ends), face[is_open].astype(np.int32))


def match_seams(tiles: Sequence[OpenEdges]) -> Seams:
    """Match the open edges of all tiles.

    Parameters
    ----------
    tiles : sequence of OpenEdges

    Returns
    -------
    Seams
        Sorted by the edge. Where more than two faces of different tiles share one edge, each is
        paired with the next.
    """
    count = [len(tile.face) for tile in tiles]
    ends = np.concatenate([np.zeros((0, 6), np.float32), *(tile.ends for tile in tiles)])
    face = np.concatenate([np.zeros(0, np.int32), *(tile.face for tile in tiles)])
    tile = np.repeat(np.arange(len(tiles), dtype=np.int32), count)
    order = np.lexsort((face, tile, *ends.T[::-1]))
    ends, face, tile = ends[order], face[order], tile[order]
    alike = (ends[1:] == ends[:-1]).all(axis=1) & (tile[1:] != tile[:-1])
    first = np.flatnonzero(alike)
    both = np.stack([first, first + 1], axis=1)
    return Seams(tile[both], face[both], OpenEdges(ends[first], face[first]).lengths_m())


def _lower_first(ends: Float32) -> Float32:
    """Turn (K, 2, 3) ends into (K, 6) with the lower end first."""
    a, b = ends[:, 0], ends[:, 1]
    differs = a != b
    axis = np.argmax(differs, axis=1)  # the first axis that tells them apart
    row = np.arange(len(ends))
    swap = a[row, axis] > b[row, axis]
    sorted_ends = np.where(swap[:, None, None], ends[:, ::-1], ends)
    return np.ascontiguousarray(sorted_ends.reshape(-1, 6))
