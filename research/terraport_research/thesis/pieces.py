"""Pieces of landscape whose regions are known: cut out of synthetic quarries.

The thesis cut sections out of its reconstruction of the Swiss quarry and drew their regions by
hand. Those meshes and drawings were not published; these pieces have their truth from the
generator, and colours with the noise and the shadows of a photographed survey.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from terraport_payload.types import Float32, Int32, UInt8
from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.geometry.mesh.mesh_edges import edge_facts
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.truth_mesh import TruthMesh, truth_mesh
from terraport_pipeline.synth.truth_regions import true_regions

__all__ = ["Piece", "closed_below", "thesis_pieces"]

_EDGE_M: Final = 1.6
_SIDE_M: Final = 110.0
_PLACES: Final = ((120.0, 100.0), (-120.0, -100.0), (0.0, -20.0))
"""Middle of each piece, x and z in metres: of squares on a grid of 40 m, far apart, those whose
truth is most varied (1 - RI of all as one region)."""
_QUARRY_SEED: Final = 11
_LEAST_SHARE: Final = 0.01
"""Of the piece: a smaller region nobody would draw."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A coloured piece of ground with its true regions."""

    title: str
    vertices: Float32
    """(V, 3) metres, Y up."""
    faces: Int32
    """(F, 3)"""
    colours: UInt8
    """(V, 3) sRGB."""
    regions: Int32
    """(F,) the truth, by materials that can be told apart by colour."""

    @cached_property
    def pairs(self) -> tuple[Int32, Int32]:
        """Faces over edges, and the edges."""
        return face_pairs(self.faces, len(self.vertices))


def thesis_pieces(seed: int) -> tuple[Piece, ...]:
    """Cut three pieces, *scene 1* to *scene 3*, out of a quarry of 250,000 faces.

    `seed` is that of the colours' noise.
    """
    options = QuarryOptions(seed=_QUARRY_SEED, sample_seed=seed)
    whole = truth_mesh(options, _EDGE_M)
    return tuple(_cut(whole, place, number) for number, place in enumerate(_PLACES, 1))


def _cut(whole: TruthMesh, place: tuple[float, float], number: int) -> Piece:
    middles = whole.vertices[whole.faces].mean(axis=1)[:, [0, 2]]
    kept = (np.abs(middles - np.array(place, np.float32)) < _SIDE_M / 2).all(axis=1)
    # The ground alone, as one surface: boulders and plants are bodies of their own there, and no
    # reconstruction leaves them so.
    chosen = np.flatnonzero(kept)
    pairs, _ = face_pairs(whole.faces[chosen], len(whole.vertices))
    surfaces, _ = components(len(chosen), pairs)
    chosen = chosen[surfaces == np.bincount(surfaces).argmax()]
    used, corners = np.unique(whole.faces[chosen], return_inverse=True)
    faces = corners.reshape(-1, 3).astype(np.int32)
    piece = TruthMesh(whole.vertices[used], faces, whole.colours[used], whole.material[chosen])
    pairs, edges = face_pairs(faces, len(used))
    regions = true_regions(piece, pairs, edges, least_share=_LEAST_SHARE)
    return Piece(f"scene {number}", piece.vertices, faces, piece.colours, regions)


def closed_below(piece: Piece) -> tuple[Float32, Int32]:
    """Close a piece by walls and a floor; its own faces come first.

    What measures how thick a body is meets nothing below open ground.
    """
    vertices, faces = piece.vertices, piece.faces
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    floor = vertices.copy()
    floor[:, 1] = low[1] - 0.1 * float((high - low)[[0, 2]].max())
    below = np.int32(len(vertices))
    # An open edge, in the direction in which its one face runs along it.
    along = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    open_keys = {tuple(edge) for edge in np.sort(edge_facts(faces).open_edges, axis=1).tolist()}
    keys = np.sort(along, axis=1).tolist()
    rim = along[[tuple(key) in open_keys for key in keys]]
    a, b = rim.T
    walls = np.concatenate(
        [np.stack([b, a, a + below], axis=1), np.stack([b, a + below, b + below], axis=1)]
    )
    bottom = faces[:, [0, 2, 1]] + below
    return (
        np.concatenate([vertices, floor]),
        np.concatenate([faces, walls, bottom]).astype(np.int32),
    )
