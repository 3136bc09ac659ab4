"""The detail in tiles, one or several: what every later stage works on.

Each face belongs to exactly one tile. A vertex that faces of several tiles use is there in each of
them, with the same bits of position, normal, colour and attributes, and with one number that they
share; so an edge of two shared vertices that one face of tile A and one face of tile B use is where
the two meet.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from terraport_payload.types import AnyArray, Float32, Float64, Int32, Int64
from terraport_pipeline.errors import WorkDirectoryError
from terraport_pipeline.model import Mesh

__all__ = ["Border", "DetailTiles", "StoredTiles"]


_FIELDS = ("vertices", "faces", "normals", "colours")


@dataclass(frozen=True, slots=True, eq=False)
class Border:
    """Vertices that a tile shares with others."""

    rows: Int32
    """(B,) rows of the tile's vertices, ascending."""
    ids: Int64
    """(B,) their numbers; equal numbers in two tiles are the same vertex."""


class DetailTiles(Protocol):
    """The detail's surface as a sequence of meshes. Picklable; reading changes nothing."""

    @property
    def count(self) -> int:
        """Number of tiles; each has at least one face."""
        ...

    @property
    def border_count(self) -> int:
        """Number of distinct shared vertices over all tiles."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """Name of every tile: a prefix and its number, the same for one place in every survey."""
        ...

    @property
    def attributes(self) -> tuple[str, ...]:
        """Names of the attributes, the same in every tile."""
        ...

    @property
    def digest(self) -> str:
        """Hash of all tiles' content."""
        ...

    def load(self, i: int) -> Mesh:
        """Read the mesh of tile `i`."""
        ...

    def digest_of(self, i: int) -> str:
        """Hash of the content of tile `i`."""
        ...

    def box(self, i: int) -> Float64:
        """Box of its vertices: (6,) x, y, z lowest, x, y, z highest, metres, scene frame."""
        ...

    def border(self, i: int) -> Border:
        """Vertices of tile `i` that it shares with others, and their common ids."""
        ...

    def face_count(self, i: int) -> int:
        """Count the faces of tile `i`, without reading it."""
        ...

    def vertex_count(self, i: int) -> int:
        """Count the vertices of tile `i`, without reading it."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class StoredTiles:
    """Tiles in a work directory, one folder of ``.npy`` files each."""

    folder: Path
    names: tuple[str, ...]
    """Name of every tile's result in the work directory."""
    boxes: Float64
    """(T, 6) metres."""
    faces: tuple[int, ...]
    vertices: tuple[int, ...]
    digests: tuple[str, ...]
    """Hash of every tile's content."""
    attributes: tuple[str, ...]
    border_count: int
    shared_ids: tuple[Int64, ...]
    """Per tile: numbers over all tiles of the vertices that ``border-shared`` names. Not among the
    tile's own arrays: they change with other tiles."""
    digest: str
    base_names: tuple[str, ...] = ()
    """Folders of the surface that the base is thinned from: also of tiles without detail."""
    base_faces: tuple[int, ...] = ()
    """Faces in each of those."""

    @property
    def count(self) -> int:
        """Number of tiles with at least one face."""
        return len(self.names)

    def base_part(self, i: int) -> tuple[Float32, Int32]:
        """Read vertices and faces of one part of the surface that the base is thinned from."""
        folder = self.folder / self.base_names[i]
        return _read(folder / "base-vertices.npy"), _read(folder / "base-faces.npy")

    def load(self, i: int) -> Mesh:
        """Read one tile.

        Raises
        ------
        WorkDirectoryError
            A file is missing or cut short.
        """
        arrays = {field: self._read(i, field) for field in _FIELDS}
        values = {name: self._read(i, f"attribute-{k}") for k, name in enumerate(self.attributes)}
        return Mesh(**arrays, attributes=values)

    def digest_of(self, i: int) -> str:
        """Hash of the tile's content."""
        return self.digests[i]

    def box(self, i: int) -> Float64:
        """Bounding box of the tile's vertices, (6,) metres, without reading it."""
        box: Float64 = self.boxes[i]
        return box

    def border(self, i: int) -> Border:
        """Read the vertices that the tile shares with others, and their common ids."""
        shared = self._read(i, "border-shared")
        return Border(self._read(i, "border-rows"), self.shared_ids[i][shared])

    def face_count(self, i: int) -> int:
        """Count the faces of the tile, without reading it."""
        return self.faces[i]

    def vertex_count(self, i: int) -> int:
        """Count the vertices of the tile, without reading it."""
        return self.vertices[i]

    def _read(self, i: int, field: str) -> AnyArray:
        _check(i, self.count)
        return _read(self.folder / self.names[i] / f"{field}.npy")


def vertex_box(vertices: Float32) -> Float64:
    """Box of vertices: (6,) lowest and highest x, y, z."""
    return np.concatenate([vertices.min(axis=0), vertices.max(axis=0)]).astype(np.float64)


def _read(path: Path) -> AnyArray:
    try:
        array: AnyArray = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise WorkDirectoryError(
            f"{path} cannot be read ({error}); build again with --no-resume"
        ) from None
    return array


def _check(i: int, count: int) -> None:
    if not 0 <= i < count:
        raise IndexError(f"tile {i}; there are {count}, from 0")
