"""A window of a scene as seen from straight above: heights and colours at places.

The highest surface counts: a vertical ray from above meets it first, and none of what lies below an
overhang. Positions are about the window's own middle, so that float32, which rays have, is fine to
a hundredth of a millimetre however large the scene is.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Float32, Float64, Int32, UInt8
from terraport_pipeline.engines.rays import Hits, RayScene
from terraport_pipeline.engines.texturing import ImageCache, Texturing, textured_colours
from terraport_pipeline.export.pieces import Piece

__all__ = ["SeenFromAbove"]

_GREY: Final = 150
"""Where a scene has no colour, as in the report's pictures."""

_MARGIN_M: Final = 1.0
"""Rays start so far above the highest vertex."""


@dataclass(frozen=True, slots=True, eq=False)
class _Ground:
    """Pieces in one mesh."""

    vertices: Float32
    faces: Int32
    colours: UInt8
    texturing: Texturing | None


class SeenFromAbove:
    """Pieces of a scene, looked at from above.

    Parameters
    ----------
    pieces : iterable of Piece
        What can be seen; may be none.
    colours : bool
        Whether colours will be asked for.
    """

    def __init__(self, pieces: Iterable[Piece], *, colours: bool) -> None:
        listed = list(pieces)
        self._anchor = np.zeros(3)
        if listed:
            low = np.min([piece.positions.min(axis=0) for piece in listed], axis=0)
            high = np.max([piece.positions.max(axis=0) for piece in listed], axis=0)
            self._anchor = np.round((low + high) / 2)
            self._top = float(high[1] - self._anchor[1]) + _MARGIN_M
        self._ground = _joined(listed, self._anchor, colours=colours) if listed else None
        self._rays = None
        if self._ground is not None:
            self._rays = RayScene(self._ground.vertices, self._ground.faces)

    def heights(self, x: Float64, z: Float64) -> Float64:
        """Return y (metres, scene frame) of the highest surface at places (N,); NaN without one."""
        y = np.full(len(x), np.nan)
        if self._ground is None or len(x) == 0:
            return y
        hits = self._hits(x, z)
        met = np.flatnonzero(hits.face >= 0)
        corners = self._ground.vertices[self._ground.faces[hits.face[met]], 1].astype(np.float64)
        u, v = hits.u[met].astype(np.float64), hits.v[met].astype(np.float64)
        y[met] = corners[:, 0] * (1 - u - v) + corners[:, 1] * u + corners[:, 2] * v
        y[met] += self._anchor[1]
        return y

    def colours(self, x: Float64, z: Float64, pixel_m: float) -> tuple[Float32, Float32]:
        """Return sRGB levels (N, 3), 0..255, and whether there is a surface (N,), 0 or 1.

        ``pixel_m`` is the width that one place stands for: textures are read at its fineness.
        """
        levels = np.zeros((len(x), 3), np.float32)
        there = np.zeros(len(x), np.float32)
        ground = self._ground
        if ground is None or len(x) == 0:
            return levels, there
        hits = self._hits(x, z)
        met = np.flatnonzero(hits.face >= 0)
        if len(met) == 0:
            return levels, there
        met_hits = Hits(hits.t[met], hits.face[met], hits.u[met], hits.v[met])
        corners = ground.colours[ground.faces[met_hits.face]].astype(np.float32)
        u, v = met_hits.u[:, None], met_hits.v[:, None]
        bare = corners[:, 0] * (1 - u - v) + corners[:, 1] * u + corners[:, 2] * v
        if ground.texturing is not None:
            width = np.full(len(met), pixel_m)
            textured_colours(ground.texturing, ground.vertices, ground.faces, met_hits, width, bare)
        levels[met], there[met] = bare, 1.0
        return levels, there

    def _hits(self, x: Float64, z: Float64) -> Hits:
        assert self._rays is not None
        starts = np.empty((len(x), 3), np.float32)
        starts[:, 0] = x - self._anchor[0]
        starts[:, 1] = self._top
        starts[:, 2] = z - self._anchor[2]
        return self._rays.intersect(
            starts, np.broadcast_to(np.array([0, -1, 0], np.float32), starts.shape)
        )


def _joined(pieces: list[Piece], anchor: Float64, *, colours: bool) -> _Ground:
    """Put pieces into one mesh about the anchor."""
    starts = np.concatenate([[0], np.cumsum([len(piece.positions) for piece in pieces])])
    vertices = np.concatenate([(piece.positions - anchor).astype(np.float32) for piece in pieces])
    faces = np.concatenate(
        [piece.faces + np.int32(start) for piece, start in zip(pieces, starts, strict=False)]
    )
    levels = np.full((len(vertices) if colours else 0, 3), _GREY, np.uint8)
    if not colours:
        return _Ground(vertices, faces, levels, None)
    for piece, start in zip(pieces, starts, strict=False):
        if piece.colours is not None:
            levels[start : start + len(piece.positions)] = piece.colours
    return _Ground(vertices, faces, levels, _texturing(pieces, len(vertices)))


def _texturing(pieces: list[Piece], vertex_count: int) -> Texturing | None:
    """Textures of pieces, from the files in them; None where no piece has one that decodes."""
    uvs = np.zeros((vertex_count, 2), np.float32)
    image_of_face: list[Int32] = []
    files: dict[int, bytes] = {}
    sizes: dict[int, tuple[int, int]] = {}
    vertex = 0
    for piece in pieces:
        # Vertex colours stand in where nothing here decodes the image (KTX2).
        decodes = piece.texture is not None and piece.uvs is not None and piece.colours is not None
        if decodes and piece.texture is not None and piece.uvs is not None:
            files[piece.segment] = piece.texture.data
            sizes[piece.segment] = (piece.texture.width, piece.texture.height)
            uvs[vertex : vertex + len(piece.uvs)] = piece.uvs
        image_of_face.append(np.full(len(piece.faces), piece.segment if decodes else -1, np.int32))
        vertex += len(piece.positions)
    if not files:
        return None
    images = ImageCache(files.__getitem__, sizes)
    return Texturing(uvs, np.concatenate(image_of_face), images)
