"""Choose views, tile by tile: which photo colours which face of a tile.

The tile carries a band of its neighbours, so on both sides of a border the same is asked of nearly
the same faces; beyond the band the base stands for whatever may hide a face. What comes after:
``tiled_texture.py``. Memory: with its band about 450 bytes per face, and the photos that are kept.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from terraport_payload.types import Float32, Float64, Int32
from terraport_pipeline.engines.photos import OpenPhotos
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.geometry.cover.face_cells import CellGrid
from terraport_pipeline.geometry.mesh.mesh_blocks import mesh_blocks
from terraport_pipeline.geometry.textures.seam_levels import LevelGrid
from terraport_pipeline.geometry.tiles.tile_band import (
    Banded,
    TilePiece,
    faces_outside,
    piece_near,
    touching,
    with_band,
)
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages import choose_views as choosing
from terraport_pipeline.stages.contract import Context, Stored
from terraport_pipeline.stages.tiles.detail_tiles import DetailTiles
from terraport_pipeline.stages.tiles.scene_facts import TiledScene

__all__ = ["CHOOSE_BYTES_PER_FACE", "TextureScale", "banded", "choose"]

CHOOSE_BYTES_PER_FACE: Final = 600
"""Of the tile's own faces: the band is up to a third of them in a usual tile."""

_BAND_EDGES: Final = 32.0
"""Width of the band while photos are chosen, in mean edges: two of the cells whose faces begin with
one photo."""


@dataclass(frozen=True, slots=True, eq=False)
class TextureScale:
    """What is measured over all tiles, so that none goes by its own measure."""

    low: Float64
    """(3,) lowest corner of the scene."""
    extent_m: float
    edge_m: float
    """Mean length of the detail's edges, metres."""

    @classmethod
    def of(cls, scene: TiledScene) -> TextureScale:
        """Measure a scene: its edges are those of equal triangles of its area."""
        edge_m = math.sqrt(4.0 / math.sqrt(3.0) * scene.area_m2 / scene.face_count)
        return cls(scene.low, float((scene.high - scene.low).max()), edge_m)

    def recorded(self) -> dict[str, Any]:
        """Convert to plain values, for the keys of the passes."""
        return {"low": self.low.tolist(), "extent_m": self.extent_m, "edge_m": self.edge_m}

    @property
    def cells(self) -> CellGrid:
        """Cells of faces that are looked at together."""
        return CellGrid(self.low, self.edge_m)

    @property
    def levels(self) -> LevelGrid:
        """Grid of the cells that global levelling has an unknown for."""
        return LevelGrid.over(self.low, self.extent_m, self.edge_m)


def banded(tiles: DetailTiles, tile: int, reach_m: float) -> Banded:
    """Read a tile and a band of its neighbours; holds one neighbour at a time."""
    boxes = np.stack([tiles.box(number) for number in range(tiles.count)])
    numbers = sorted([tile, *touching(boxes, tile, reach_m)])

    def pieces() -> Iterator[TilePiece]:
        for number in numbers:
            mesh, border = tiles.load(number), tiles.border(number)
            box = None if number == tile else boxes[tile]
            yield piece_near(
                number, mesh.vertices, mesh.faces, mesh.colours, (border.rows, border.ids), box,
                reach_m,
            )  # fmt: skip

    return with_band(pieces(), tile)


def choose(
    tiles: DetailTiles,
    tile: int,
    base: Mesh,
    opened: OpenPhotos,
    gains: Float32,
    scale: TextureScale,
    segments: Int32,
    context: Context,
) -> Stored:
    """Choose a photo for every face of a tile.

    Parameters
    ----------
    tiles : DetailTiles
    tile : int
    base : Mesh
        Stands for what lies beyond the band.
    opened : OpenPhotos
    gains : ndarray of shape (views + 1, GAIN_COLUMNS), float32
    scale : TextureScale
    segments : ndarray of shape (F,), int32
        Segment of each of the tile's faces, from 0.
    context : Context

    Returns
    -------
    Stored
        Of the tile's own faces, for :func:`level` and :func:`draw`.
    """
    reach_m = _BAND_EDGES * scale.edge_m
    piece = banded(tiles, tile, reach_m)
    blocks = mesh_blocks(piece.vertices, piece.faces)
    # Half a band of both surfaces: from the tile's faces on, rays that rise by ten degrees have
    # left the base's deviation below them before they could meet it.
    far = faces_outside(base.vertices, base.faces, tiles.box(tile), 0.5 * reach_m)
    rays = RayScene(
        np.concatenate([piece.vertices, base.vertices]),
        np.concatenate([piece.faces, base.faces[far] + np.int32(len(piece.vertices))]),
        threads=context.threads,
    )
    # Charts end at segments, and segments at the tile; the band's are the neighbours' matter.
    of_face = np.full(len(piece.faces), -1, np.int32)
    of_face[piece.own] = segments
    labelling = choosing.choose_labels(
        blocks, piece.colours, opened.views, opened.photos, rays, gains, choosing.Options(),
        context.threads, context.progress, grid=scale.cells,
        segments=of_face[blocks.face_order],
    )  # fmt: skip
    own = blocks.face_places()[piece.own]
    seen = labelling.candidates.view[own]
    return Stored(
        {
            "view": labelling.view[own].astype(np.int16),
            "candidate_view": seen,
            "candidate_colour": labelling.candidates.colour[own],
        },
        {
            "faces_seen": int((seen[:, 0] >= 0).sum()),
            "faces_unseen": int((labelling.view[own] < 0).sum()),
            "rays": int(labelling.facts["rays"]),
            "faces_rated": int(labelling.facts["faces_rated"]),
            "outliers": int(labelling.facts.get("outliers", 0)),
            "faces_borrowed": int(labelling.borrowed[own].sum()),
        },
    )
