"""Points and files that lie too far from the others to be of one survey: left out, or refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Bool, Float64
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.errors import ReadError, SurveyError
from terraport_pipeline.stages.reading.spool import BLOCK_ROWS, Spooled, widen
from terraport_pipeline.survey.one_survey import FAR, refuse_far

__all__ = ["MAX_SPAN_M", "Near", "check_box", "leave_strays"]

MAX_SPAN_M: Final = 1e7
"""No survey is wider than a quarter of the Earth: larger spans are damaged coordinates."""

_MEDIAN_POINTS: Final = 1_000_000
"""Points that the survey's middle is the median of, about."""

_MOST_STRAYS: Final = 0.01
"""Share of points that may lie far from the others; more are another site, not a slip."""


@dataclass(frozen=True, slots=True)
class Near:
    """Where the survey is, when some points are so far away that they cannot be of it."""

    middle: Float64
    """(3,) median of all points."""

    def holds(self, points: Float64) -> Bool:
        """Tell which of some points (n, 3) are of the survey."""
        near: Bool = np.abs(points - self.middle).max(axis=1) <= FAR
        return near


def leave_strays(spooled: Sequence[Spooled]) -> Near | None:
    """Leave out the few points that lie hundreds of kilometres from all others, such as 0 0 0.

    Returns
    -------
    Near or None
        None where there is none, or where they are too many: then the survey is refused by
        :func:`check_box`. What the columns noted of them (greatest values) stays noted.
    """
    low = np.min([part.low for part in spooled], axis=0)
    high = np.max([part.high for part in spooled], axis=0)
    if float((high - low).max()) <= 2 * FAR:
        return None
    # (1) The median of at most a million points.
    total = sum(part.writer.rows for part in spooled)
    step = max(1, total // _MEDIAN_POINTS)
    chosen = [
        rows["position"][::step]
        for part in spooled
        for _, rows in NpyReader(part.path).blocks(BLOCK_ROWS)
    ]
    near = Near(np.median(np.concatenate(chosen), axis=0))
    # (2) How many there are of each file, and the box of the others.
    strays, boxes = [], []
    for part in spooled:
        count, box = 0, (np.full(3, np.inf), np.full(3, -np.inf))
        for _, rows in NpyReader(part.path).blocks(BLOCK_ROWS):
            inside = near.holds(rows["position"])
            count += len(rows) - int(inside.sum())
            widen(box, rows["position"][inside])
        strays.append(count)
        boxes.append(box)
    some_left = all(n < part.writer.rows for n, part in zip(strays, spooled, strict=True))
    if sum(strays) > _MOST_STRAYS * total or not some_left:
        return None
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
