"""The frame of a plan: grid, coordinates, scale bar, in the survey's own units.

Everything is a share of the picture's width or height, so that page and PDF draw the same sheet.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from terraport_pipeline.report.survey_units import SurveyUnit

__all__ = ["GridLine", "PlanSheet", "nice_step", "plan_sheet"]

_LINES = 4
"""Grid lines that are wanted along the longer side."""

_BAR_SHARE = 0.28
"""Greatest length of the scale bar, of the picture's width."""


@dataclass(frozen=True, slots=True)
class GridLine:
    """A line of equal easting or northing."""

    share: float
    """Of the width from the west, or of the height from the north."""
    label: str
    """The coordinate, in the survey's unit."""


@dataclass(frozen=True, slots=True)
class PlanSheet:
    """What is drawn over and around a plan; north is up."""

    eastings: tuple[GridLine, ...]
    northings: tuple[GridLine, ...]
    bar_share: float
    """Length of the scale bar, of the width."""
    bar_label: str
    corners: tuple[tuple[str, str, str], ...]
    """Name, easting and northing of the south-western and the north-eastern corner."""
    width: float
    """Ground in the picture, in the survey's unit."""
    height: float


def nice_step(length: float, count: int) -> float:
    """Choose a step of 1, 2 or 5 by a power of ten that a length holds `count` times at most.

    Examples
    --------
    >>> nice_step(367.0, 4), nice_step(0.9, 4), nice_step(1000.0, 4)
    (100.0, 0.5, 500.0)
    """
    raw = max(length, 1e-9) / max(count, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    for nice in (1.0, 2.0, 5.0, 10.0):
        if nice * power >= raw * (1.0 - 1e-9):
            return nice * power
    raise AssertionError  # pragma: no cover - 10 always suffices


def plan_sheet(
    west_m: float, north_m: float, width_m: float, height_m: float, unit: SurveyUnit
) -> PlanSheet:
    """Lay out the frame of a plan.

    Parameters
    ----------
    west_m, north_m : float
        Easting and northing of the picture's north-western corner, metres.
    width_m, height_m : float
        Ground in the picture, metres.
    unit : SurveyUnit

    Examples
    --------
    >>> sheet = plan_sheet(641_020.0, 8_594_860.0, 360.0, 320.0, SurveyUnit())
    >>> [line.label for line in sheet.eastings], sheet.bar_label
    (['641100', '641200', '641300'], '100 m')
    """
    west, north = west_m / unit.plan_m, north_m / unit.plan_m
    width, height = width_m / unit.plan_m, height_m / unit.plan_m
    step = nice_step(max(width, height), _LINES)
    places = max(0, -math.floor(math.log10(step)))

    def lines(low: float, length: float, *, from_top: bool) -> tuple[GridLine, ...]:
        first = math.ceil(low / step - 1e-9)
        values = [n * step for n in range(first, first + math.floor(length / step) + 2)]
        return tuple(
            GridLine(
                1.0 - (value - low) / length if from_top else (value - low) / length,
                f"{value:.{places}f}",
            )
            for value in values
            if value <= low + length
        )

    bar = nice_step(width * _BAR_SHARE, 1)
    if bar > width * _BAR_SHARE:  # the next smaller of 1, 2, 5
        bar /= 2.5 if f"{bar:e}".startswith("5") else 2.0
    return PlanSheet(
        lines(west, width, from_top=False),
        lines(north - height, height, from_top=True),
        bar / width,
        f"{bar:g} {unit.name}",
        (
            ("SW", f"{west:,.1f}", f"{north - height:,.1f}"),
            ("NE", f"{west + width:,.1f}", f"{north:,.1f}"),
        ),
        width,
        height,
    )
