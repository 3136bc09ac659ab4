"""Points and files that do not belong to the survey by their position: left out, or refused.

These are heights that mean "no data", and points too far from all others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Bool, Float64, Int64
from terraport_pipeline.engines.readers.height_edges import HeightEdges
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.errors import ReadError, SurveyError
from terraport_pipeline.stages.reading.spool import BLOCK_ROWS, Spooled, widen
from terraport_pipeline.survey.one_survey import FAR, refuse_far

__all__ = ["MAX_SPAN_M", "PointFilter", "check_box", "leave_strays", "leave_void_heights"]

MAX_SPAN_M: Final = 1e7
"""No survey is wider than a quarter of the Earth: larger spans are damaged coordinates."""

_MEDIAN_POINTS: Final = 1_000_000
"""Points that the survey's middle is the median of, about."""

_MOST_STRAYS: Final = 0.01
"""Share of points that may lie far from the others; more are another site, not a slip."""

_VOID_GAP: Final = 50.0
"""Minimum distance, in the file's unit, of a height that means "no data" from all others. Below it,
a shared height may be still water under a canopy, or a roof."""

_VOID_SHARE: Final = 0.001
"""Minimum share of points with such a height; fewer are outliers that the cleaning stage
removes."""

_IMPOSSIBLE_HEIGHT: Final = 9000.0
_IMPOSSIBLE_GAP: Final = 1000.0
"""A height beyond the first, and at least the second away from all others, cannot be ground."""

_SCATTERED: Final = 0.5
"""Minimum share of points with a shared height that have other points in their plan cell; below it,
they may be a surface (still water at the foot of a cliff)."""

_RIM: Final = 5
"""Percentile of the coordinates that bounds the middle of a survey; cells cover three times its
sides."""

_CELL_POINTS: Final = 16
_MOST_CELLS: Final = 1 << 22

_SUSPECT_GAP: Final = 10.0
_SUSPECT_SPREAD: Final = 0.5
"""A shared height that is kept gives a warning if it is at least this far from the others, in units
and as a share of their range."""


@dataclass(frozen=True, slots=True)
class PointFilter:
    """Criteria for points that belong to the survey."""

    middle: Float64 | None = None
    """(3,) median of all points, if some are too far away to belong to the survey."""
    voids: tuple[float, ...] = ()
    """Heights that mean "no data"."""

    def holds(self, points: Float64) -> Bool:
        """Tell which of some points (n, 3) are of the survey."""
        taken: Bool = ~np.isin(points[:, 2], self.voids)
        if self.middle is not None:
            taken &= np.abs(points - self.middle).max(axis=1) <= FAR
        return taken


def leave_void_heights(spooled: Sequence[Spooled]) -> tuple[PointFilter, tuple[str, ...]]:
    """Leave out points whose height means "no data", such as -9999, or 0 in mountains.

    Many points share such a height, it is far below or above all others, and its points are
    scattered among others in plan; an exactly flat surface (still water) covers an area of its own.
    In doubt the points are kept, with a warning.

    Returns
    -------
    taken : PointFilter
    warnings : tuple of str
        Heights that are left out, and heights that perhaps should be.
    """
    edges = HeightEdges.joined(part.heights for part in spooled)
    total = sum(part.kept for part in spooled)
    voids: list[float] = []
    warnings: list[str] = []
    for counts in (edges.lowest, edges.highest):
        for heights, gap in _far_heights(list(counts)):
            count = sum(counts[height] for height in heights)
            shared = _VOID_SHARE * total <= count <= total / 2
            shared &= min(counts[height] for height in heights) > 1
            is_void = gap >= _IMPOSSIBLE_GAP and min(map(abs, heights)) >= _IMPOSSIBLE_HEIGHT
            if not is_void and shared and gap >= _VOID_GAP:
                is_void = _scattered_share(spooled, heights) >= _SCATTERED
            one_left = all(part.kept > part.heights.count(heights) for part in spooled)
            listed = " and ".join(f"{height:,.15g}" for height in heights)
            what = f"{count:,} of {total:,} points have the height {listed}, {gap:,.0f} away from "
            if is_void and one_left:
                voids += heights
                warnings.append(f"{what}all others, which stands for no data: they are left out.")
            elif shared and gap >= _SUSPECT_SPREAD * _range_of(edges, heights):
                warnings.append(
                    f"{what}all others: they are kept. If it stands for no data, remove them first "
                    "(PDAL: filters.expression)."
                )
    taken = PointFilter(voids=tuple(voids))
    if voids:
        _, boxes = _outside(spooled, taken.holds)
        for part, (least, most) in zip(spooled, boxes, strict=True):
            part.voids += part.heights.count(voids)
            part.kept -= part.heights.count(voids)
            part.low, part.high = least, most
            part.samples = [some[taken.holds(some)] for some in part.samples]
    return taken, tuple(warnings)


def _far_heights(heights: Sequence[float]) -> list[tuple[list[float], float]]:
    """Group the heights at an end of the survey, and return the distance of each group to the next.

    The last group, where all other heights begin, is omitted.
    """
    groups: list[tuple[list[float], float]] = []
    first = 0
    for at in range(1, len(heights)):
        gap = abs(heights[at] - heights[at - 1])
        if gap >= _SUSPECT_GAP:
            groups.append((list(heights[first:at]), gap))
            first = at
    return groups


def _range_of(edges: HeightEdges, heights: Sequence[float]) -> float:
    """Return the range of the heights without some at an end."""
    others = [h for h in (*edges.lowest, *edges.highest) if h not in heights]
    return max(others) - min(others)


def _scattered_share(spooled: Sequence[Spooled], heights: Sequence[float]) -> float:
    """Return the share of points with given heights that have other points in their plan cell."""
    # (1) Cells over nearly all points: an outlier must not make them as wide as the survey.
    some = _some_points(spooled)[:, :2]
    low, high = np.percentile(some, (_RIM, 100 - _RIM), axis=0)
    low, high = 2 * low - high, 2 * high - low
    sides = np.maximum(high - low, 1e-9)
    rows = sum(part.writer.rows for part in spooled)
    cells = min(max(1, 9 * rows // _CELL_POINTS), _MOST_CELLS)
    cell = max(float(np.sqrt(sides[0] * sides[1] / cells)), float(sides.max()) / cells)
    columns, lines = (int(side / cell) + 1 for side in sides)
    # (2) The points in each cell.
    shared: Int64 = np.zeros(columns * lines, np.int64)
    others = np.zeros(columns * lines, bool)
    for part in spooled:
        for _, block in NpyReader(part.path).blocks(BLOCK_ROWS):
            points = block["position"]
            points = points[((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1)]
            column, line = ((points[:, :2] - low) / cell).astype(np.int64).T
            number = line * columns + column
            is_shared = np.isin(points[:, 2], heights)
            shared += np.bincount(number[is_shared], minlength=len(shared))
            others[number[~is_shared]] = True
    return float(shared[others].sum() / max(1, shared.sum()))


def _some_points(spooled: Sequence[Spooled]) -> Float64:
    """Read about a million points at most, the same share of all files."""
    step = max(1, sum(part.writer.rows for part in spooled) // _MEDIAN_POINTS)
    chosen: Float64 = np.concatenate(
        [
            rows["position"][::step]
            for part in spooled
            for _, rows in NpyReader(part.path).blocks(BLOCK_ROWS)
        ]
    )
    return chosen


def _outside(
    spooled: Sequence[Spooled], holds: Callable[[Float64], Bool]
) -> tuple[list[int], list[tuple[Float64, Float64]]]:
    """Count the points of each file that a rule leaves out, and find the box of the others."""
    counts, boxes = [], []
    for part in spooled:
        count, box = 0, (np.full(3, np.inf), np.full(3, -np.inf))
        for _, rows in NpyReader(part.path).blocks(BLOCK_ROWS):
            inside = holds(rows["position"])
            count += len(rows) - int(inside.sum())
            widen(box, rows["position"][inside])
        counts.append(count)
        boxes.append(box)
    return counts, boxes


def leave_strays(spooled: Sequence[Spooled], taken: PointFilter) -> PointFilter:
    """Leave out the few points that are hundreds of kilometres from all others, such as 0 0 0.

    Parameters
    ----------
    spooled : sequence of Spooled
    taken : PointFilter
        Criteria that already leave out points.

    Returns
    -------
    PointFilter
        Unchanged if there are no such points, or too many: then :func:`check_box` refuses the
        survey. The statistics of columns (largest values) still include these points.
    """
    low = np.min([part.low for part in spooled], axis=0)
    high = np.max([part.high for part in spooled], axis=0)
    if float((high - low).max()) <= 2 * FAR:
        return taken
    # (1) The median of at most a million points.
    total = sum(part.writer.rows for part in spooled)
    chosen = _some_points(spooled)
    near = PointFilter(np.median(chosen[taken.holds(chosen)], axis=0), taken.voids)
    # (2) How many there are of each file, and the box of the others.
    before, _ = _outside(spooled, taken.holds)
    counts, boxes = _outside(spooled, near.holds)
    strays = [count - void for count, void in zip(counts, before, strict=True)]
    some_left = all(n < part.writer.rows for n, part in zip(counts, spooled, strict=True))
    if sum(strays) > _MOST_STRAYS * total or not some_left:
        return taken
    for part, count, (least, most) in zip(spooled, strays, boxes, strict=True):
        part.kept, part.strays, part.low, part.high = part.kept - count, count, least, most
        part.samples = [some[near.holds(some)] for some in part.samples]
    return near


def check_box(spooled: Sequence[Spooled], low: Float64, high: Float64) -> None:
    """Refuse damaged coordinates, and files that lie far from the others."""
    span = float((high - low).max())
    if span > MAX_SPAN_M:
        wide = max(spooled, key=lambda part: float(np.abs([part.low, part.high]).max()))
        raise ReadError(
            wide.file.path,
            f"the coordinates span {span:.3g}, expected less than {MAX_SPAN_M:.0e} metres",
            "some are damaged: remove them or export the survey again",
        )
    names = [part.file.name for part in spooled]
    refuse_far(names, [((part.low + part.high) / 2).tolist() for part in spooled])
    if span > 2 * FAR:
        raise SurveyError(
            f"the points lie up to {span / 1000:,.0f} km apart, more than {_MOST_STRAYS:.0%} of "
            "them far from the others; expected one site: cut one out with --extent, or remove "
            "the stray points"
        )
