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

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from terraport_payload.types import AnyFloat, Float64, Int64
from terraport_store.tiles.placing import Placing

__all__ = ["Cell", "tile_coordinates", "tileset_document"]

_PIXELS: Final = 16.0
"""Error on the screen at which viewers refine by default (CesiumJS, Cesium for Unity, Unreal)."""

_PIXELS_PER_RADIAN: Final = 935.0
"""Of a picture of 1080 lines and 60 degrees: 1080 / 2 tan 30."""

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


def tileset_document(
    cells: Sequence[Cell],
    bounds: AnyFloat,
    placing: Placing,
    *,
    segment_uri: Callable[[int], str],
    part_uri: Callable[[int], str],
    version: str,
    radius_m: float | None = None,
) -> dict[str, Any]:
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
    radius_m : float, optional
        Full detail within this distance of the eye and base beyond. By ``viewerRequestVolume``, and
        for viewers that do not know it by the geometric error. None: by the base's error alone.

    Returns
    -------
    dict
        ``tileset.json``.
    """
    # (1) Cells, each with the matrix that is right in its middle.
    volumes = _volumes(bounds[:, :3], bounds[:, 3:])
    low = np.min([cell.low for cell in cells], axis=0)
    high = np.max([cell.high for cell in cells], axis=0)
    root_matrix = placing.matrix_at(tile_coordinates((low + high)[None] / 2)[0])
    to_root = np.linalg.inv(root_matrix)
    children: list[dict[str, Any]] = []
    corners: list[Float64] = []
    coarsest_m = 0.0
    for cell in cells:
        matrix = placing.matrix_at(tile_coordinates((cell.low + cell.high)[None] / 2)[0])
        inside = to_root @ matrix
        corners.append(_corners(cell.low, cell.high) @ inside[:3, :3].T + inside[:3, 3])
        placed = {} if placing.is_local else {"transform": inside.T.ravel().tolist()}
        error_m = cell.error_m
        if radius_m is not None:
            error_m = max(error_m, radius_m * _PIXELS / _PIXELS_PER_RADIAN)
        coarsest_m = max(coarsest_m, error_m)
        leaves = [_leaf(volumes[number], segment_uri(number)) for number in cell.segments.tolist()]
        if radius_m is not None:
            # One volume for all of a cell: a parent goes only when each of its children may be
            # asked for.
            asked = _volume(cell.low - radius_m, cell.high + radius_m)
            leaves = [{**leaf, "viewerRequestVolume": asked} for leaf in leaves]
        tile: dict[str, Any] = {
            "boundingVolume": _volume(cell.low, cell.high),
            "geometricError": error_m,
            "refine": "REPLACE",
            "children": leaves,
            **placed,
        }
        if cell.replaced is not None:
            tile["content"] = {"uri": part_uri(cell.replaced)}
        children.append(tile)
        if cell.kept is not None:
            kept = _leaf(_volume(cell.low, cell.high), part_uri(cell.kept))
            children.append({**kept, **placed})
    # (2) The root: nothing of its own to draw, refined wherever the scene is more than a dot.
    places = np.concatenate(corners)
    size_m = max(float(np.linalg.norm(np.ptp(places, axis=0))), 2 * coarsest_m)
    ends = places.min(axis=0) - _MARGIN_M, places.max(axis=0) + _MARGIN_M
    root: dict[str, Any] = {
        "boundingVolume": _boxes(ends[0][None], ends[1][None])[0],
        "geometricError": size_m,
        "refine": "REPLACE",
        "children": children,
    }
    if not placing.is_local:
        root["transform"] = root_matrix.T.ravel().tolist()
    return {
        "asset": {"version": "1.1", "generator": "terraport", "tilesetVersion": version},
        "geometricError": 2 * size_m,
        "root": root,
    }


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
