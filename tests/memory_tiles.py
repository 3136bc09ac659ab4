"""Tiles in memory, with the borders that they share: a mesh cut up for the tests."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import xxhash
from coloured_ground import cut_mesh

from terraport_payload.types import Bool, Float64, Int64
from terraport_pipeline.model import Mesh
from terraport_pipeline.stages.tiles.detail_tiles import Border, vertex_box


@dataclass(frozen=True)
class MemoryTiles:
    """A mesh in tiles; the shared vertices are numbered by the mesh's."""

    meshes: tuple[Mesh, ...]
    rows: tuple[Int64, ...]
    """Faces of the mesh that every tile has."""
    numbers: tuple[Int64, ...]
    """Vertex of the mesh of every tile's vertex."""
    shared: Bool
    attributes: tuple[str, ...] = ()
    digest: str = "t"
    digests: tuple[str, ...] = ()
    loads: list[int] = field(default_factory=list)

    @classmethod
    def of(cls, mesh: Mesh, along: int) -> MemoryTiles:
        """Cut a mesh into along x along tiles."""
        cut = cut_mesh(mesh, along)
        digests = tuple(digest_of_mesh(piece) for piece, _ in cut)
        numbers = tuple(np.unique(mesh.faces[rows]).astype(np.int64) for _, rows in cut)
        times = np.bincount(np.concatenate(numbers), minlength=len(mesh.vertices))
        return cls(
            tuple(piece for piece, _ in cut),
            tuple(rows for _, rows in cut),
            numbers,
            times > 1,
            tuple(mesh.attributes),
            "-".join(digests),
            digests,
        )

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"tile-{number:05d}" for number in range(self.count))

    @property
    def count(self) -> int:
        return len(self.meshes)

    @property
    def border_count(self) -> int:
        return int(self.shared.sum())

    def digest_of(self, i: int) -> str:
        return self.digests[i]

    def load(self, i: int) -> Mesh:
        self.loads.append(i)
        return self.meshes[i]

    def box(self, i: int) -> Float64:
        return vertex_box(self.meshes[i].vertices)

    def border(self, i: int) -> Border:
        rows = np.flatnonzero(self.shared[self.numbers[i]]).astype(np.int32)
        return Border(rows, self.numbers[i][rows])

    def face_count(self, i: int) -> int:
        return len(self.meshes[i].faces)

    def vertex_count(self, i: int) -> int:
        return len(self.meshes[i].vertices)


def digest_of_mesh(mesh: Mesh) -> str:
    arrays = (mesh.vertices, mesh.faces, mesh.normals, mesh.colours, *mesh.attributes.values())
    return xxhash.xxh3_128_hexdigest(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays))
