"""``tileset.json`` of a scene: the tree of tiles.

::

    root, without content                     REPLACE
      cell: its part of the base              REPLACE, geometric error of the base
        segments of the cell                  geometric error 0
      part of the base that no segment covers geometric error 0

Content is in the scene's frame (glTF's, Y up), which 3D Tiles turns about X: tile coordinates are
(x, -z, y), east, north and up. Each cell has a matrix of its own: one for all would be wrong by
the fall of the Earth, 78 mm at a kilometre.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyFloat, Float64, Int64
from terraport_store.tiles.placing import Placing

__all__ = ["Cell", "Tileset", "tile_coordinates"]

_PIXELS: Final = 16.0
"""Error on the screen at which viewers refine by default (CesiumJS, Cesium for Unity, Unreal)."""

_PIXELS_PER_RADIAN: Final = 935.0
"""Of a picture of 1080 lines and 60 degrees: 1080 / 2 tan 30."""

_GAP: Final = b"\0"
"""Between tiles whose ends are not written yet: JSON has none."""

_MARGIN_M: Final = 1e-3
"""Around boxes that went through matrices: rounding must not leave content outside."""


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """Segments that are refined together, and what of the base stands for them until then."""

    segments: Int64
    low: Float64
    """(3,) least corner of segments and both parts, scene frame, metres."""
    high: Float64
    error_m: float
    """Geometric error of the part of the base, metres."""
    replaced: int | None
    """Number of the part that the segments replace; None: no base face lies under them."""
    kept: int | None
    """Number of the part that stays; None: there is none."""


def tile_coordinates(positions: AnyFloat) -> Float64:
    """Turn scene positions (N, 3) as 3D Tiles turns the content of tiles: Y up to Z up.

    Examples
    --------
    >>> tile_coordinates(np.array([[1.0, 2.0, 3.0]])).tolist()
    [[1.0, -3.0, 2.0]]
    """
    points = np.asarray(positions, dtype=np.float64)
    return np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class _WrittenCell:
    """A cell's tiles as JSON, but for what depends on the radius."""

    cell: Cell
    before: str
    """Of its tile: all that stands before the geometric error."""
    leaves: bytes
    """Its segments' tiles, `_GAP` between them and each without its last brace."""
    behind: str
    """What follows its children: matrix, content, and the part that stays as a tile of its own."""


@dataclass(frozen=True, slots=True, eq=False)
class Tileset:
    """The tileset of a scene, for any radius.

    What a radius changes is put in while it is written, a cell at a time. So a service keeps one
    text of a scene whatever radii it is asked for, and nobody who reads slowly holds a copy of it.
    """

    written: list[_WrittenCell]
    version: str
    ends: tuple[Float64, Float64]
    """Least and greatest corner of all cells in the root's coordinates, metres."""
    root_matrix: Float64 | None
    """None where the tileset is local."""

    @classmethod
    def of(
        cls,
        cells: Sequence[Cell],
        bounds: AnyFloat,
        placing: Placing,
        *,
        segment_uri: Callable[[int], str],
        part_uri: Callable[[int], str],
        version: str,
    ) -> Tileset:
        """Write the tileset of a scene.

        Parameters
        ----------
        cells : sequence of Cell
        bounds : ndarray of shape (S, 6)
            Boxes of the segments, metres, scene frame.
        placing : Placing
        segment_uri, part_uri : callable
            Address of a segment's payload and of a part of the base, by number, relative to the
            tileset's.
        version : str
            Of the scene.
        """
        volumes = _volumes(bounds[:, :3], bounds[:, 3:])
        low = np.min([cell.low for cell in cells], axis=0)
        high = np.max([cell.high for cell in cells], axis=0)
        root_matrix = placing.matrix_at(tile_coordinates((low + high)[None] / 2)[0])
        to_root = np.linalg.inv(root_matrix)
        written: list[_WrittenCell] = []
        corners: list[Float64] = []
        # Each cell with the matrix that is right in its middle.
        for cell in cells:
            matrix = placing.matrix_at(tile_coordinates((cell.low + cell.high)[None] / 2)[0])
            inside = to_root @ matrix
            corners.append(_corners(cell.low, cell.high) @ inside[:3, :3].T + inside[:3, 3])
            placed = {} if placing.is_local else {"transform": inside.T.ravel().tolist()}
            volume = _volume(cell.low, cell.high)
            behind = _members(placed)
            if cell.replaced is not None:
                behind += _members({"content": {"uri": part_uri(cell.replaced)}})
            behind += "}"
            if cell.kept is not None:
                behind += "," + _json({**_leaf(volume, part_uri(cell.kept)), **placed})
            leaves = [_leaf(volumes[one], segment_uri(one)) for one in cell.segments.tolist()]
            before = f'{{"boundingVolume":{_json(volume)}'
            texts = _GAP.join(_json(leaf)[:-1].encode() for leaf in leaves)
            written.append(_WrittenCell(cell, before, texts, behind))
        places = np.concatenate(corners)
        return cls(
            written,
            version,
            (places.min(axis=0), places.max(axis=0)),
            None if placing.is_local else root_matrix,
        )

    @property
    def size_bytes(self) -> int:
        """Of the text, without what a radius adds."""
        return sum(len(one.leaves) + len(one.before) + len(one.behind) for one in self.written)

    def pieces(self, radius_m: float | None = None) -> Iterator[bytes]:
        """Write ``tileset.json``, a piece for each cell.

        Parameters
        ----------
        radius_m : float, optional
            Full detail within this distance of the eye and base beyond. By ``viewerRequestVolume``,
            and for viewers that do not know it by the geometric error. None: by the base's error
            alone.
        """
        coarsest_m = max(_error_m(one.cell, radius_m) for one in self.written)
        # The root: nothing of its own to draw, refined wherever the scene is more than a dot.
        size_m = max(float(np.linalg.norm(self.ends[1] - self.ends[0])), 2 * coarsest_m)
        low, high = self.ends[0] - _MARGIN_M, self.ends[1] + _MARGIN_M
        root: dict[str, Any] = {
            "boundingVolume": _boxes(low[None], high[None])[0],
            "geometricError": size_m,
            "refine": "REPLACE",
        }
        if self.root_matrix is not None:
            root["transform"] = self.root_matrix.T.ravel().tolist()
        asset = {"version": "1.1", "generator": "terraport", "tilesetVersion": self.version}
        document = {"asset": asset, "geometricError": 2 * size_m, "root": root}
        yield (_json(document)[:-2] + ',"children":[').encode()
        for number, one in enumerate(self.written):
            error_m, ending = _error_m(one.cell, radius_m), b"}"
            if radius_m is not None:
                # One volume for all of a cell: a parent goes only when each of its children may be
                # asked for.
                asked = _volume(one.cell.low - radius_m, one.cell.high + radius_m)
                ending = (_members({"viewerRequestVolume": asked}) + "}").encode()
            before = f'{one.before},"geometricError":{error_m!r},"refine":"REPLACE","children":['
            yield b"%b%b%b%b]%b" % (
                b"," if number else b"",
                before.encode(),
                one.leaves.replace(_GAP, ending + b","),
                ending if one.leaves else b"",
                one.behind.encode(),
            )
        yield b"]}}"


def _error_m(cell: Cell, radius_m: float | None) -> float:
    """Return the geometric error of a cell's part of the base."""
    if radius_m is None:
        return float(cell.error_m)
    return float(max(cell.error_m, radius_m * _PIXELS / _PIXELS_PER_RADIAN))


def _json(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"))


def _members(value: dict[str, Any]) -> str:
    """Write members that follow others of an object."""
    return "," + _json(value)[1:-1] if value else ""


def _leaf(volume: dict[str, list[float]], uri: str) -> dict[str, Any]:
    return {"boundingVolume": volume, "geometricError": 0, "content": {"uri": uri}}


def _corners(low: Float64, high: Float64) -> Float64:
    """Return the 8 corners of a scene box in tile coordinates."""
    ends = np.stack([low, high])
    picks = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1)
    return tile_coordinates(np.stack([ends[picks[axis], axis] for axis in range(3)], axis=1))


def _volume(low: Float64, high: Float64) -> dict[str, list[float]]:
    """Return a scene box as a bounding volume."""
    return _volumes(low[None], high[None])[0]


def _volumes(low: AnyFloat, high: AnyFloat) -> list[dict[str, list[float]]]:
    """Return scene boxes (N, 3) as bounding volumes; all at once, for a scene has many."""
    ends = tile_coordinates(low), tile_coordinates(high)
    return _boxes(np.minimum(*ends), np.maximum(*ends))


def _boxes(low: Float64, high: Float64) -> list[dict[str, list[float]]]:
    """Return boxes along the axes of tile coordinates: middle, and half of each side."""
    rows = np.zeros((len(low), 12))
    rows[:, :3] = (low + high) / 2
    rows[:, 3::4] = (high - low) / 2
    return [{"box": row} for row in rows.tolist()]
