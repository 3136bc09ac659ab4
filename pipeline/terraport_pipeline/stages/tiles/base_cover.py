"""The base under every tile's segments: which base faces a tile looks at, and what it puts there.

A tile's cover is kept with base faces numbered among those near the tile, so that it stays what it
was where the base there did, whatever became of the base elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import xxhash

from terraport_payload.types import AnyFloat, Float32, Float64, Int32, Int64
from terraport_pipeline.geometry.cover.far_detail import median_edge
from terraport_pipeline.geometry.mesh.kernel_input import as_kernel_input
from terraport_pipeline.geometry.tiles.tiled_cover import cover_reach_m, near_faces, tile_cover
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages.contract import Context, Facts, Form, Stored

__all__ = ["COVER_BYTES_PER_FACE", "SCALE_FORM", "CoverScale", "NearBase", "cover"]

COVER_BYTES_PER_FACE: Final = 150

_MOST_DEVIATION: Final = 1.25
"""Deviation over the tolerance that a cover was decided by: the margins of ``cover.py`` are whole
tolerances and cells."""

_LEAST_DEVIATION: Final = 0.5
"""Below, bases would be shown twice as long as they need be."""

_MOST_EDGE: Final = 2.0
"""Times by which the base's median edge may differ."""


@dataclass(frozen=True, slots=True)
class CoverScale:
    """What every tile's cover is measured by."""

    tolerance_m: float
    """Usual deviation of base from detail."""
    base_edge_m: float
    """Median edge of the base."""

    @classmethod
    def measure(cls, base: Mesh, tolerance_m: float) -> CoverScale:
        """Measure a base."""
        edge_m = median_edge(
            as_kernel_input(base.vertices, np.float64), as_kernel_input(base.faces, np.int32)
        )
        return cls(tolerance_m, edge_m)

    def stands(self, measured: CoverScale) -> bool:
        """Say whether another base can be covered by it."""
        shorter, longer = sorted((self.base_edge_m, measured.base_edge_m))
        return (
            _LEAST_DEVIATION * self.tolerance_m
            <= measured.tolerance_m
            <= _MOST_DEVIATION * self.tolerance_m
        ) and longer <= _MOST_EDGE * shorter


SCALE_FORM: Final[Form[CoverScale]] = Form(
    store=lambda scale: Stored(
        {}, {"tolerance_m": scale.tolerance_m, "base_edge_m": scale.base_edge_m}
    ),
    restore=lambda stored, _facts: CoverScale(**stored.values),
    facts=lambda scale: Facts({"tolerance_m": scale.tolerance_m}),
)


@dataclass(frozen=True, slots=True, eq=False)
class NearBase:
    """The base near every tile."""

    base: Mesh
    rows: tuple[Int64, ...]
    """Faces of the base near every tile, ascending."""

    @classmethod
    def of(
        cls, base: Mesh, boxes: Sequence[Float64], edges_m: Sequence[float], scale: CoverScale
    ) -> NearBase:
        """Find the base near every tile.

        Parameters
        ----------
        base : Mesh
        boxes : sequence of ndarray of shape (6,), float64
            Of every tile: lowest and highest x, y, z, metres.
        edges_m : sequence of float
            Median edge of every tile.
        scale : CoverScale
        """
        rows = []
        for box, edge_m in zip(boxes, edges_m, strict=True):
            reach_m = cover_reach_m(scale.tolerance_m, scale.base_edge_m, edge_m)
            rows.append(near_faces(base.vertices, base.faces, box, reach_m))
        return cls(base, tuple(rows))

    def piece(self, tile: int) -> tuple[Float32, Int32]:
        """Cut the base near a tile out: vertices in their order, and faces."""
        faces = self.base.faces[self.rows[tile]]
        used, corner = np.unique(faces, return_inverse=True)
        return self.base.vertices[used], corner.reshape(-1, 3).astype(np.int32)

    def digest(self, tile: int) -> str:
        """Hash of :meth:`piece`, for the keys of the covers."""
        vertices, faces = self.piece(tile)
        digest = xxhash.xxh3_128(np.ascontiguousarray(vertices).data)
        digest.update(np.ascontiguousarray(faces).data)
        return digest.hexdigest()


def cover(
    base: tuple[AnyFloat, Int32], mesh: Mesh, segments: Int32, scale: CoverScale, context: Context
) -> Stored:
    """Lay one tile's segments over the base near it.

    Parameters
    ----------
    base : pair of ndarray
        From :meth:`NearBase.piece`.
    mesh : Mesh
        The tile.
    segments : ndarray of shape (F,), int32
        Segment of every face, numbered within the tile.
    scale : CoverScale
    context : Context

    Returns
    -------
    Stored
        ``base_face``, by its row among those near the tile, and ``segment``.
    """
    covered = tile_cover(
        *base,
        mesh.vertices,
        mesh.faces,
        segments,
        tolerance_m=scale.tolerance_m,
        threads=context.threads,
    )
    return Stored(
        {"base_face": covered.base_face, "segment": covered.segment},
        {"far_faces": covered.far_faces, "baseless_faces": covered.baseless_faces},
    )
