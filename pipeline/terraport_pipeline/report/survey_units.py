"""Figures as the survey has them: lengths, areas and volumes in its own units.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from terraport_pipeline.survey_statement import METRES_PER_UNIT
from terraport_store import Manifest

__all__ = ["SurveyUnit", "digits"]


@dataclass(frozen=True, slots=True)
class SurveyUnit:
    """The units of a survey's eastings and northings, and of its heights.

    Examples
    --------
    >>> feet = SurveyUnit(0.3048, 0.3048)
    >>> feet.length(3.048), feet.area(0.09290304 * 5000), feet.volume(0.3048**3 * 12.34)
    ('10.0 ft', '5,000 ft²', '12 ft³')
    """

    plan_m: float = 1.0
    """Metres in a unit of easting and northing."""
    height_m: float = 1.0
    """Metres in a unit of height."""

    @classmethod
    def of(cls, manifest: Manifest) -> SurveyUnit:
        """Take them from a manifest, which leaves metres out."""
        units = manifest.survey_units
        return cls() if units is None else cls(units.horizontal_m, units.height_m)

    @property
    def name(self) -> str:
        """Short name of the unit of easting and northing."""
        return _short(self.plan_m)

    @property
    def height_name(self) -> str:
        """Short name of the unit of height."""
        return _short(self.height_m)

    @property
    def volume_name(self) -> str:
        """Name of the unit of volumes; of mixed units they are in that of the plan."""
        return f"{self.name}³"

    @property
    def full_name(self) -> str:
        """Say the units in words."""
        plan = _full(self.plan_m)
        return (
            plan if self.plan_m == self.height_m else f"{plan}, heights in {_full(self.height_m)}"
        )

    def length(self, metres: float) -> str:
        """Write a distance, to three figures."""
        return f"{digits(metres / self.plan_m)} {self.name}"

    def height(self, metres: float) -> str:
        """Write a height above the datum, to a tenth of a unit."""
        return f"{metres / self.height_m:,.1f}"

    def area(self, square_m: float) -> str:
        """Write an area with its unit."""
        return f"{self.area_value(square_m)} {self.name}²"

    def area_value(self, square_m: float) -> str:
        """Write an area without its unit: whole units, below ten tenths."""
        return _whole(square_m / self.plan_m**2)

    def volume(self, cubic_m: float) -> str:
        """Write a volume with its unit."""
        return f"{self.volume_value(cubic_m)} {self.volume_name}"

    def volume_value(self, cubic_m: float) -> str:
        """Write a volume without its unit: whole units, below ten tenths."""
        return _whole(cubic_m / self.plan_m**3)

    def density(self, per_square_m: float) -> str:
        """Write how many points an area holds."""
        return f"{digits(per_square_m * self.plan_m**2)} per {self.name}²"


def digits(value: float) -> str:
    """Write a number with three figures at least, and no more behind the point than they need.

    Examples
    --------
    >>> [digits(value) for value in (0.0, 0.01234, 1.5, 12.345, 1234.5, -0.5)]
    ['0', '0.0123', '1.50', '12.3', '1,234', '-0.500']
    """
    if value == 0.0 or not math.isfinite(value):
        return "0" if value == 0.0 else "-"
    places = max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:,.{min(places, 6)}f}"


def _whole(value: float) -> str:
    # + 0.0: no minus before a zero.
    return f"{value:,.0f}" if abs(value) >= 9.95 else f"{round(value, 1) + 0.0:,.1f}"


def _short(metres: float) -> str:
    """Name a unit; both feet are ``ft``, which the words beside the CRS tell apart."""
    if metres == 1.0:
        return "m"
    is_foot = any(abs(metres - METRES_PER_UNIT[name]) < 1e-9 for name in ("ft", "us-ft"))
    return "ft" if is_foot else "units"


def _full(metres: float) -> str:
    for name, key in (("metres", "m"), ("feet (international)", "ft"), ("US survey feet", "us-ft")):
        if abs(metres - METRES_PER_UNIT[key]) < 1e-9:
            return name
    return f"units of {metres:.9g} m"
