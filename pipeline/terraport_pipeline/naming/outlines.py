"""Cut regions along what was drawn: which face belongs to which outline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from terraport_payload.types import Float64, Int32, Int64
from terraport_pipeline.errors import PlanError
from terraport_pipeline.geometry.regions.small_pieces import absorb_small
from terraport_pipeline.naming.drawings import Drawing, Drawings
from terraport_pipeline.naming.recut import Cut
from terraport_pipeline.published.ground import Ground

__all__ = ["Outlined", "PlaceFinder", "cut_along", "with_width"]

_CELLS: Final = 512
"""Squares along each side of the ground by which faces near an outline are found."""


_CRUMB_FACES: Final = 20
"""What is left of a region in fewer faces, along an outline, is nobody's meaning."""


@dataclass(frozen=True, slots=True)
class Outlined:
    """A cut along outlines, and what came of each of them."""

    cut: Cut
    empty: tuple[str, ...]
    """Outlines with no face of their own: outside, or under smaller ones."""
    shared_m2: float
    """Ground within more than one outline."""


def with_width(drawings: Drawings, buffer_m: float | None) -> tuple[Drawing, ...]:
    """Make areas of lines.

    Parameters
    ----------
    drawings : Drawings
    buffer_m : float, optional
        How far the area of a line reaches to either side.

    Raises
    ------
    PlanError
        There are lines and no width.
    """
    lines = [d for d in drawings.drawings if shapely.get_dimensions(d.shape) < 2]
    if lines and buffer_m is None:
        raise PlanError(
            drawings.path,
            f"{len(lines)} of {len(drawings.drawings)} features are open lines (the first is "
            f"{_called(lines[0])})",
            "add --buffer-m METRES, half the width of what they stand for, or close them",
        )
    return tuple(
        Drawing(d.number, d.name, shapely.buffer(d.shape, buffer_m))
        if shapely.get_dimensions(d.shape) < 2
        else d
        for d in drawings.drawings
    )


def cut_along(ground: Ground, path: str, drawings: Sequence[Drawing]) -> Outlined:
    """Cut the regions of a scene along areas seen from above.

    A face belongs to the area that its centre lies in; of several to the smallest (a stockpile
    lies in a pit), of equally large ones to the last. Each area becomes one region, whatever
    regions it lies across; what no area has stays with the region that it was in, but for crumbs
    of fewer than 20 faces along an outline, which go to what they touch most.

    Parameters
    ----------
    ground : Ground
    path : str
        What the drawings came from, for messages.
    drawings : sequence of Drawing
        Areas.

    Raises
    ------
    PlanError
        No face lies in any of them.
    """
    plan = ground.centres[:, [0, 2]]
    finder = PlaceFinder(plan)
    first = int(ground.region_of_face.max()) + 1
    pieces = ground.region_of_face.copy()
    times = np.zeros(len(pieces), np.uint8)
    areas_m2 = np.array([d.shape.area for d in drawings])
    for at in np.argsort(-areas_m2, kind="stable").tolist():
        inside = finder.inside(drawings[at].shape)
        pieces[inside] = first + at
        times[inside] = np.minimum(times[inside], 1) + 1
    pieces = _without_crumbs(ground, pieces, first)
    used = np.zeros(first + len(drawings), np.bool_)
    used[pieces] = True
    names = {
        first + at: d.name
        for at, d in enumerate(drawings)
        if d.name is not None and used[first + at]
    }
    empty = tuple(_called(d) for at, d in enumerate(drawings) if not used[first + at])
    if len(empty) == len(drawings):
        (x0, z0), (x1, z1) = plan.min(axis=0), plan.max(axis=0)
        left, top, right, bottom = shapely.total_bounds([d.shape for d in drawings]).tolist()
        raise PlanError(
            path,
            f"nothing of the scene lies in its {len(drawings)} outlines: about the scene's origin "
            f"they reach from {left:,.0f} to {right:,.0f} m east and {-bottom:,.0f} to {-top:,.0f} "
            f"m north, the scene from {x0:,.0f} to {x1:,.0f} and {-z1:,.0f} to {-z0:,.0f}",
            "check the coordinate reference system (--crs) and the unit",
        )
    return Outlined(Cut(pieces, names), empty, float(ground.area[times > 1].sum()))


def _without_crumbs(ground: Ground, pieces: Int32, first: int) -> Int32:
    """Give crumbs of regions that were cut to what lies beside them; areas begin at `first`."""
    neighbours, _ = ground.pairs
    cut = np.zeros(first, np.bool_)
    cut[ground.region_of_face[pieces >= first]] = True
    left = (pieces < first) & cut[ground.region_of_face]
    # (1) The grid put corners of the smallest faces at one place: such a one has no neighbour, and
    # goes with a face at its corner.
    faces = ground.mesh.faces
    alone = np.ones(len(pieces), np.bool_)
    alone[neighbours] = False
    at_corner = np.full(len(ground.mesh.vertices), -1, np.int32)
    at_corner[faces[~alone].reshape(-1)] = np.repeat(pieces[~alone], 3)
    beside = at_corner[faces[:, 0]]
    pieces = np.where(left & alone & (beside >= 0), beside, pieces).astype(np.int32)
    # (2) Bits of few faces go to what they touch most.
    ones = np.ones(len(pieces), np.int64)
    return absorb_small(
        pieces,
        ground.pairs,
        ground.mesh.vertices,
        ones,
        _CRUMB_FACES,
        movable=left & (pieces < first),
    )


class PlaceFinder:
    """Places on the ground; squares of it keep the search inside a shape to those nearby.

    Parameters
    ----------
    plan : ndarray of shape (F, 2), float64
        x and z of the places.
    """

    def __init__(self, plan: Float64) -> None:
        self._plan = plan
        self._low = plan.min(axis=0)
        self._side = np.maximum((plan.max(axis=0) - self._low) / _CELLS, 1e-9)
        column, row = self._cell(plan).T
        keys = row * _CELLS + column
        self._order: Int64 = np.argsort(keys, kind="stable")
        self._keys = keys[self._order]

    def _cell(self, places: Float64) -> Int64:
        cell: Int64 = np.clip((places - self._low) // self._side, 0, _CELLS - 1).astype(np.int64)
        return cell

    def inside(self, shape: shapely.Geometry) -> Int64:
        """Return the places within a shape, ascending; one on its edge is not within."""
        left, top, right, bottom = shape.bounds
        (c0, r0), (c1, r1) = self._cell(np.array([[left, top], [right, bottom]]))
        rows = np.arange(r0, r1 + 1) * _CELLS
        begins = np.searchsorted(self._keys, rows + c0)
        ends = np.searchsorted(self._keys, rows + c1 + 1)
        near = np.concatenate(
            [self._order[begin:end] for begin, end in zip(begins, ends, strict=True)]
        )
        shapely.prepare(shape)
        inside = shapely.contains_xy(shape, self._plan[near, 0], self._plan[near, 1])
        found: Int64 = np.sort(near[inside])
        return found


def _called(drawing: Drawing) -> str:
    return f"feature {drawing.number}" if drawing.name is None else f"{drawing.name!r}"
