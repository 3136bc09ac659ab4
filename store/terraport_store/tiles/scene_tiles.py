"""The tiles of an open scene: its cells, and the parts of its base as they are streamed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from terraport_payload import Cover, SegmentMesh
from terraport_payload.types import AnyFloat, Int64
from terraport_store.tiles.base_image import BaseImage
from terraport_store.tiles.cells import cells_of, part_faces
from terraport_store.tiles.tile_glb import TileFacts, encode_tile
from terraport_store.tiles.tileset import Cell

__all__ = ["SceneTiles"]


@dataclass(frozen=True, slots=True, eq=False)
class SceneTiles:
    """Cells of a scene, and which faces of the base its parts have."""

    base: SegmentMesh
    cells: list[Cell]
    parts: list[Int64]
    """Faces of the base by part, ascending: first those that segments replace, then the others."""

    @classmethod
    def of(
        cls, base: SegmentMesh, cover: Cover, bounds: AnyFloat, deviation_m: float
    ) -> SceneTiles:
        """Make the cells of a scene.

        Parameters
        ----------
        base : SegmentMesh
            The base, its faces in the order of the cover.
        cover : Cover
        bounds : ndarray of shape (S, 6)
            Boxes of the segments, metres, scene frame.
        deviation_m : float
            Measured distance of base and detail.
        """
        corners = base.positions[base.faces].astype(np.float64)
        edges_m = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean(axis=1)
        boxes = bounds.astype(np.float64)
        groups = cells_of(bounds)
        faces = part_faces(cover, groups, bounds, corners.mean(axis=1))
        parts: list[Int64] = []

        def number(of: Int64) -> int | None:
            if not len(of):
                return None
            parts.append(of)
            return len(parts) - 1

        replaced = [number(of) for of in faces.replaced]
        kept = [number(of) for of in faces.kept]
        cells = []
        for cell, segments in enumerate(groups):
            own = np.concatenate([faces.replaced[cell], faces.kept[cell]])
            places = np.concatenate(
                [boxes[segments, :3], boxes[segments, 3:], corners[own].reshape(-1, 3)]
            )
            # How coarse it looks: how far it lies beside the detail, or how long its edges are.
            edge_m = (
                float(edges_m[faces.replaced[cell]].mean()) if replaced[cell] is not None else 0
            )
            cells.append(
                Cell(
                    segments,
                    places.min(axis=0),
                    places.max(axis=0),
                    max(deviation_m, edge_m, 1e-3),
                    replaced[cell],
                    kept[cell],
                )
            )
        return cls(base, cells, parts)

    def encode_parts(self, facts: TileFacts) -> Iterator[bytes]:
        """Encode the parts of the base, one GLB after the other.

        Raises
        ------
        ModuleNotFoundError
            When the base has an image and Pillow is not installed.
        """
        image = None if self.base.texture is None else BaseImage(self.base.texture)
        for faces in self.parts:
            part = _cut(self.base, faces)
            yield encode_tile(part if image is None else image.cut(part), facts)


def _cut(mesh: SegmentMesh, faces: Int64) -> SegmentMesh:
    """Return some faces of a mesh, and the vertices that they use."""
    rows, corners = np.unique(mesh.faces[faces], return_inverse=True)

    return SegmentMesh(
        mesh.positions[rows],
        corners.reshape(-1, 3).astype(np.uint32),
        mesh.normals[rows],
        None if mesh.colours is None else mesh.colours[rows],
        None if mesh.region_ids is None else mesh.region_ids[rows],
        {name: values[rows] for name, values in mesh.attributes.items()},
        None if mesh.uvs is None else mesh.uvs[rows],
        mesh.texture,
    )
