"""Warnings about landings outside the scene.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import inspect
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import FrameType
from typing import Any, Final, Self

from terraport.frames import to_scene

__all__ = ["CallerLine", "SceneBox"]

Point = tuple[float, float, float]

_SKIPPED: Final = ("terraport", "asyncio")
"""Packages in which no line of an application is."""

_INSIDE_M = 1.0
"""Other readings of a place must lie in the box itself, but for what people round away."""


@dataclass(frozen=True, slots=True)
class SceneBox:
    """The box around all of a scene, base and detail; metres, scene frame."""

    low: Point
    high: Point
    origin: Point
    """Easting, northing, height of the scene frame's origin, metres."""
    survey_units: Mapping[str, Any] | None = None
    """As the manifest has it."""

    @classmethod
    def of(cls, manifest: Mapping[str, Any]) -> SceneBox:
        """Read it from a manifest (``spec/scene-format.md``, section 4)."""
        low, high = (_point(manifest["bounds"][end]) for end in ("min", "max"))
        return cls(low, high, _point(manifest["origin"]), manifest.get("survey_units"))

    def nearest(self, position: Sequence[float]) -> Point:
        """Return the place of the box that is nearest."""
        x, y, z = (
            min(max(value, low), high)
            for value, low, high in zip(position, self.low, self.high, strict=True)
        )
        return x, y, z

    def at_its_height(self, position: Sequence[float]) -> Point:
        """Return the place with the nearest height that the box has."""
        return position[0], self.nearest(position)[1], position[2]

    def distance_m(self, position: Sequence[float]) -> float:
        """Return how far away the box is; 0 inside.

        Examples
        --------
        >>> SceneBox((0, 0, 0), (10, 5, 10), (0, 0, 0)).distance_m((13, 9, 5))
        5.0
        """
        return math.dist(position, self.nearest(position))

    def explain(self, position: Sequence[float], radius_m: float) -> str:
        """Say that a place is out of reach, and by how much."""
        return (
            f"{_shown(position)} lies {_metres(self.distance_m(position))} outside the scene, "
            f"more than the radius of {radius_m:g} m: nothing of it is there. The scene "
            f"reaches from {_shown(self.low)} to {_shown(self.high)}; nearest is "
            f"{_shown(self.nearest(position))}"
        )

    def is_survey_place(self, position: Sequence[float]) -> bool:
        """Whether a place lies in the scene when read as the survey's easting, northing, height."""
        as_survey = to_scene(position, self.origin, self.survey_units)
        return self.distance_m(as_survey) <= _INSIDE_M

    def is_above_or_below(self, position: Sequence[float]) -> bool:
        """Whether only the height is wrong."""
        x, z = position[0], position[2]
        return self.low[0] <= x <= self.high[0] and self.low[2] <= z <= self.high[2]


@dataclass(frozen=True, slots=True)
class CallerLine:
    """A line of code that warnings point at."""

    filename: str
    number: int
    scope: dict[str, Any]
    """Globals of its module: Python notes there which warnings it has shown for the line."""

    @classmethod
    def find(cls) -> Self:
        """Return the innermost line outside this package and asyncio, else the current line."""
        frame = first = inspect.currentframe()
        while frame is not None and _is_skipped(frame):
            frame = frame.f_back
        frame = frame or first
        assert frame is not None, "CPython has frames"
        return cls(frame.f_code.co_filename, frame.f_lineno, frame.f_globals)

    def warn(self, text: str, category: type[Warning]) -> None:
        """Issue a warning that points at the line."""
        registry = self.scope.setdefault("__warningregistry__", {})
        module = self.scope.get("__name__")
        warnings.warn_explicit(
            text, category, self.filename, self.number, module=module, registry=registry
        )


def _is_skipped(frame: FrameType) -> bool:
    return str(frame.f_globals.get("__name__")).partition(".")[0] in _SKIPPED


def _point(values: Sequence[float]) -> Point:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _shown(position: Sequence[float]) -> str:
    # Plus 0: no -0.
    return "(" + ", ".join(f"{round(value, 1) + 0.0:.10g}" for value in position) + ")"


def _metres(distance: float) -> str:
    return f"{distance:,.1f} m" if distance < 100 else f"{distance:,.0f} m"
