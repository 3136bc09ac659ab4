"""The rectangle on the ground that a scene is built from, where it is not all of the survey.

It is stated in the files' own coordinates: their CRS, their unit (feet stay feet), before anything
is converted. Points on its edges are within.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from typing import TYPE_CHECKING

from terraport_pipeline.errors import OptionError

if TYPE_CHECKING:  # not needed to print the command line's help
    from terraport_payload.types import Bool, Float64

__all__ = ["Extent"]


@dataclass(frozen=True, slots=True)
class Extent:
    """A rectangle along the axes of the survey's CRS, edges included.

    Raises
    ------
    OptionError
        A value is not finite, or a least one is not below the greatest.

    Examples
    --------
    >>> import numpy as np
    >>> pit = Extent(500, 1000, 600, 1100)
    >>> pit.holds(np.array([[500.0, 1100.0, 7.0], [499.999, 1050.0, 7.0]])).tolist()
    [True, False]
    """

    xmin: float
    """Least easting."""
    ymin: float
    """Least northing."""
    xmax: float
    """Greatest easting."""
    ymax: float
    """Greatest northing."""

    def __post_init__(self) -> None:
        for field in fields(self):
            # + 0.0 turns -0.0 into 0.0: one rectangle is recorded in one way.
            object.__setattr__(self, field.name, float(getattr(self, field.name)) + 0.0)
        if not all(map(math.isfinite, self.values)):
            raise OptionError(f"extent {self}; expected four finite numbers XMIN YMIN XMAX YMAX")
        for axis, low, high in (("X", self.xmin, self.xmax), ("Y", self.ymin, self.ymax)):
            if not low < high:
                raise OptionError(
                    f"extent {self}: {axis}MIN {low:.15g} is not below {axis}MAX {high:.15g}; "
                    "expected XMIN YMIN XMAX YMAX"
                )

    def __str__(self) -> str:
        return " ".join(f"{value:.15g}" for value in self.values)

    @property
    def values(self) -> tuple[float, float, float, float]:
        """The numbers in the order in which they are given."""
        xmin, ymin, xmax, ymax = astuple(self)
        return xmin, ymin, xmax, ymax

    def holds(self, points: Float64) -> Bool:
        """Tell which of some points (N, 2 or more) are within; those without a position are not."""
        x, y = points[:, 0], points[:, 1]
        within: Bool = (x >= self.xmin) & (x <= self.xmax) & (y >= self.ymin) & (y <= self.ymax)
        return within

    def touches(self, low: Sequence[float], high: Sequence[float], margin: float = 0.0) -> bool:
        """Whether a box, widened by a margin, shares a point with the rectangle."""
        return bool(
            low[0] - margin <= self.xmax
            and high[0] + margin >= self.xmin
            and low[1] - margin <= self.ymax
            and high[1] + margin >= self.ymin
        )

    def clipped(
        self, low: Sequence[float], high: Sequence[float]
    ) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Cut a box (x, y, z) to the rectangle; sides of what lies outside become 0."""
        bounds = ((self.xmin, self.xmax), (self.ymin, self.ymax))
        (a, c), (b, d) = (
            (min(max(low[axis], least), most), max(min(high[axis], most), least))
            for axis, (least, most) in enumerate(bounds)
        )
        return (a, b, low[2]), (max(a, c), max(b, d), high[2])

    def share(self, low: Sequence[float], high: Sequence[float]) -> float:
        """Part of a box's ground that is within, 0 to 1; all of a box without area."""
        area = (high[0] - low[0]) * (high[1] - low[1])
        (a, b, _), (c, d, _) = self.clipped(low, high)
        return (c - a) * (d - b) / area if area > 0 else 1.0
