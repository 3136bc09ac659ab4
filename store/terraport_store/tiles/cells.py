"""Which segments are refined together, and the parts of the base that they replace.

A viewer of 3D Tiles knows one rule of hand-off: ``REPLACE``, a tile goes when its children are
there. So the segments are put together in cells, each with the part of the base below it as parent.
A base face over which segments of several cells lie stands in each of their parts: it then goes
when the last of these cells is refined. That is the scene's own rule (a base face is hidden if and
only if every segment over it is shown) for the sets that such a viewer shows, and so no ray falls
through where none does by that rule. Twice the same triangle in the same place shows as one.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload import Cover
from terraport_payload.types import AnyFloat, Float64, Int64

__all__ = ["CELL_RADIUS_M", "CELL_SEGMENTS", "MAX_CELLS", "BaseParts", "cells_of", "part_faces"]

CELL_SEGMENTS: Final = 12
"""Most segments of a cell, of scenes with few enough. Fewer: more borders where base faces stand
twice. More: more is loaded far from the eye."""

MAX_CELLS: Final = 256
"""Cells of a scene, while none is wider than its radius: each is a request for a part of the base,
whose faces do not become more with the scene."""

CELL_RADIUS_M: Final = 100.0
"""Half the diagonal of a cell of several segments. One matrix for it is right to 0.8 mm then: the
Earth falls off by d^2 / 2R."""


@dataclass(frozen=True, slots=True, eq=False)
class BaseParts:
    """Faces of the base by cell, ascending; a face over several cells stands in each of them."""

    replaced: list[Int64]
    """By cell: what goes when the cell's segments are there. May be empty."""
    kept: list[Int64]
    """By cell: faces over which no segment lies, near its middle. They never go."""


def cells_of(bounds: AnyFloat) -> list[Int64]:
    """Put neighbouring segments together.

    Halves the longest side of the segments' middles until cells are small enough.

    Parameters
    ----------
    bounds : ndarray of shape (S, 6)
        Least and greatest corner of each segment, metres, scene frame. S >= 1.

    Returns
    -------
    list of ndarray of int64
        Segment ids, ascending, each in one cell.
    """
    boxes = bounds.astype(np.float64)
    middles = (boxes[:, :3] + boxes[:, 3:]) / 2
    most = max(CELL_SEGMENTS, -(-len(boxes) // MAX_CELLS))
    cells: list[Int64] = []
    waiting = [np.arange(len(boxes), dtype=np.int64)]
    while waiting:
        segments = waiting.pop()
        low = boxes[segments, :3].min(axis=0)
        high = boxes[segments, 3:].max(axis=0)
        is_wide = float(np.linalg.norm(high - low)) / 2 > CELL_RADIUS_M
        if len(segments) <= most and not (is_wide and len(segments) > 1):
            cells.append(np.sort(segments))
            continue
        spread = np.ptp(middles[segments], axis=0)
        # Stable: the same scene, the same cells.
        order = segments[np.argsort(middles[segments, int(spread.argmax())], kind="stable")]
        # Second half first out of the stack: cells come in the order of the ground.
        waiting += [order[len(order) // 2 :], order[: len(order) // 2]]
    return cells


def part_faces(cover: Cover, cells: list[Int64], bounds: AnyFloat, middles: Float64) -> BaseParts:
    """Give the faces of the base to cells.

    Parameters
    ----------
    cover : Cover
        Segments over each of B base faces.
    cells : list of ndarray of int64
        From :func:`cells_of`.
    bounds : ndarray of shape (S, 6)
        Of the segments, as there.
    middles : ndarray of shape (B, 3), float64
        Middle of each base face, metres, scene frame.

    Returns
    -------
    BaseParts
    """
    cell_of = np.empty(len(bounds), dtype=np.int64)
    for number, segments in enumerate(cells):
        cell_of[segments] = number
    offsets = cover.offsets.astype(np.int64)
    counts = offsets[1:] - offsets[:-1]
    face_of_entry = np.repeat(np.arange(cover.base_faces), counts)
    # A face once in each cell, however many of the cell's segments lie over it.
    pairs = np.unique(cell_of[cover.segments] * cover.base_faces + face_of_entry)
    replaced = _by_cell(pairs // cover.base_faces, pairs % cover.base_faces, len(cells))

    alone = np.flatnonzero(counts == 0)
    nearest = np.zeros(len(alone), dtype=np.int64)
    least = np.full(len(alone), np.inf)
    for number, segments in enumerate(cells):
        low = bounds[segments, :3].min(axis=0).astype(np.float64)
        high = bounds[segments, 3:].max(axis=0).astype(np.float64)
        distance = np.square(middles[alone] - (low + high) / 2).sum(axis=1)
        is_nearer = distance < least
        nearest[is_nearer], least[is_nearer] = number, distance[is_nearer]
    order = np.argsort(nearest, kind="stable")
    return BaseParts(replaced, _by_cell(nearest[order], alone[order], len(cells)))


def _by_cell(cell: Int64, faces: Int64, count: int) -> list[Int64]:
    """Split faces by their cells, which ascend."""
    return np.split(faces, np.searchsorted(cell, np.arange(1, count)))
