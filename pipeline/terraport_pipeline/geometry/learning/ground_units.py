"""What ground looks like around every place, at several scales in metres.

Faces are taken together in *units*: squares of the ground seen from above, each with its level and
its steep faces apart. Sums over the squares are smoothed by Gaussians, divided by the smoothed
area: means of what is there, whatever is missing. What a unit gets is named by
:func:`feature_names`; lengths are metres and angles degrees, so that a forest that was grown on one
survey reads the next.

PURE: no I/O, no clock. Memory: some 30 numbers per unit and 60 bytes per square; squares are at
most :data:`MAX_CELLS`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.ndimage import gaussian_filter

from terraport_payload.types import AnyFloat, Float32, Float64, Int32, Int64, UInt8
from terraport_pipeline.geometry.regions.colour import face_lab

__all__ = [
    "MAX_CELLS",
    "GroundUnits",
    "cell_size_m",
    "feature_names",
    "ground_features",
    "ground_units",
]

MAX_CELLS: Final = 25_000_000
"""Squares over the box of a scene: 12 bytes each for every sum that is smoothed at a time."""

_FACES_PER_SQUARE: Final = 3.0

_STEEP_DEG: Final = 50.0
"""Faces above it are units of their own: a wall is not the floor at its foot."""

_SCALES: Final = (1.0, 2.0)
"""Widths of the surroundings that are looked at, in squares: deviations of the Gaussians. Wider
ones tell the forest where on the site it is, and not what is there: with 2, 6 and 18 squares of
twice the side three strokes named .64 of the ground of two quarries, with these .79
(seeds 3 and 4)."""

_HEIGHT_SCALE: Final = 8.0
"""And of those over which a place stands or lies: piles and pits are wide."""

_LEAST_WEIGHT: Final = 1e-12
"""Square metres; squares without any surface near are read by nobody."""

_LAB_STEPS: Final = 64.0

_OWN: Final = ("lightness", "a", "b", "lightness_deviation", "slope_deg", "slope_deviation_deg")
_AROUND: Final = (
    "lightness", "a", "b", "lightness_deviation", "slope_deg", "height_above_m", "roughness_m",
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class GroundUnits:
    """Units of a surface."""

    of_face: Int32
    """(F,) unit of every face, 0.. in the order of their squares."""
    square: Int64
    """(U,) row * columns + column."""
    steep: UInt8
    """(U,) 1 of steep faces."""
    rows: int
    columns: int
    cell_m: float
    corner_m: tuple[float, float]
    """Least x and z; square (0, 0) begins there."""

    @property
    def count(self) -> int:
        """Number of units."""
        return len(self.square)

    def middles(self) -> Float64:
        """Return x and z of the middle of every unit's square, (U, 2) metres."""
        row, column = np.divmod(self.square, self.columns)
        return np.stack([column + 0.5, row + 0.5], axis=1) * self.cell_m + self.corner_m


def cell_size_m(area_m2: float, faces: int) -> float:
    """Choose the side of the squares: three faces or more in each, 1, 2 or 5 of a power of ten.

    Examples
    --------
    >>> cell_size_m(10_000.0, 30_000)
    1.0
    """
    wanted = max(np.sqrt(_FACES_PER_SQUARE * area_m2 / max(faces, 1)), 1e-3)
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(next(k * power for k in (1.0, 2.0, 5.0, 10.0) if k * power >= wanted * 0.99))


def feature_names(cell_m: float, attributes: Sequence[str]) -> tuple[str, ...]:
    """Name the features of a unit, in their order."""
    names = list(_OWN)
    for scale in _SCALES:
        names += [f"{name}@{scale * cell_m:g}m" for name in _AROUND]
    names.append(f"height_above_m@{_HEIGHT_SCALE * cell_m:g}m")
    for attribute in attributes:
        names += [f"{attribute}", f"{attribute}@{_SCALES[1] * cell_m:g}m"]
    return tuple(names)


def ground_units(centres: Float64, slope_deg: Float64, cell_m: float) -> GroundUnits:
    """Take faces together.

    Parameters
    ----------
    centres : ndarray of shape (F, 3), float64
        Metres, Y up.
    slope_deg : ndarray of shape (F,), float64
        0 level, 90 vertical.
    cell_m : float

    Raises
    ------
    ValueError
        More than :data:`MAX_CELLS` squares.
    """
    plan = centres[:, [0, 2]]
    # Squares begin at whole multiples, so that the next survey's are the same.
    low = np.floor(plan.min(axis=0) / cell_m)
    columns, rows = (np.floor(plan.max(axis=0) / cell_m) - low + 1).astype(np.int64).tolist()
    if rows * columns > MAX_CELLS:
        msg = f"{columns} x {rows} squares of {cell_m:g} m, expected at most {MAX_CELLS:,}"
        raise ValueError(msg)
    column, row = (np.floor(plan / cell_m) - low).astype(np.int64).T
    keys = (row * columns + column) * 2 + (slope_deg > _STEEP_DEG)
    # By a table, not by sorting: there are more faces than squares.
    there = np.zeros(rows * columns * 2, np.bool_)
    there[keys] = True
    number = np.cumsum(there, dtype=np.int32) - np.int32(1)
    unit_keys = np.flatnonzero(there)
    return GroundUnits(
        number[keys],
        unit_keys // 2,
        (unit_keys % 2).astype(np.uint8),
        rows,
        columns,
        cell_m,
        (float(low[0] * cell_m), float(low[1] * cell_m)),
    )


def ground_features(
    units: GroundUnits,
    faces: Int32,
    colours: UInt8,
    centres: Float64,
    area: Float64,
    slope_deg: Float64,
    attributes: Mapping[str, Float32],
) -> Float32:
    """Measure every unit and what surrounds it.

    Parameters
    ----------
    units : GroundUnits
    faces : ndarray of shape (F, 3), int32
    colours : ndarray of shape (V, 3), uint8
        sRGB.
    centres : ndarray of shape (F, 3), float64
    area, slope_deg : ndarray of shape (F,), float64
    attributes : mapping of str to ndarray of shape (V,), float32
        Per vertex; NaN is no value.

    Returns
    -------
    ndarray of shape (U, len(feature_names)), float32
        Finite. Deviations are those between faces within a unit, and between units around it.
        Height above is that of the unit over the mean of the surroundings; roughness the deviation
        of heights from such a mean. An attribute without any value around is 0.
    """
    of_face, count = units.of_face, units.count
    weight = np.maximum(area, 1e-9)
    total: Float64 = np.bincount(of_face, weight, minlength=count).astype(np.float64)

    def mean(values: Any) -> Float64:
        sums = np.bincount(of_face, weight * values, minlength=count).astype(np.float64)
        averages: Float64 = sums / total
        return averages

    # (1) Of the units themselves.
    lab = face_lab(colours, faces, _LAB_STEPS).astype(np.float64) / _LAB_STEPS
    lightness, a, b = (mean(lab[:, axis]) for axis in range(3))
    light_dev = _deviation(mean(lab[:, 0] ** 2), lightness)
    slope = mean(slope_deg)
    slope_dev = _deviation(mean(slope_deg**2), slope)
    height = mean(centres[:, 1])
    columns: list[Any] = [lightness, a, b, light_dev, slope, slope_dev]
    # (2) Of what surrounds them, scale by scale. Heights about their mean, for float32.
    around = _Surroundings(units)
    level = float(np.average(height, weights=total))
    for scale in _SCALES:
        weights = np.maximum(around.smoothed(total, scale), _LEAST_WEIGHT)

        def near(values: Any, scale: float = scale, weights: Any = weights) -> Float64:
            return around.at_units(around.smoothed(values * total, scale) / weights)

        light = near(lightness)
        columns += [light, near(a), near(b)]
        columns.append(_deviation(near(lightness**2 + light_dev**2), light))
        columns.append(near(slope))
        above = height - level - near(height - level)
        columns.append(above)
        columns.append(np.sqrt(np.maximum(near(above**2), 0.0)))
    weights = np.maximum(around.smoothed(total, _HEIGHT_SCALE), _LEAST_WEIGHT)
    wide = around.smoothed((height - level) * total, _HEIGHT_SCALE) / weights
    columns.append(height - level - around.at_units(wide))
    # (3) The survey's attributes.
    for values in attributes.values():
        of_corners = values[faces]
        finite = np.isfinite(of_corners)
        known = finite.any(axis=1)
        value = np.where(finite, of_corners, 0.0).sum(axis=1, dtype=np.float64)
        value /= np.maximum(finite.sum(axis=1), 1)
        there = np.bincount(of_face, weight * known, minlength=count)
        sums = np.bincount(of_face, weight * value, minlength=count)
        columns.append(sums / np.maximum(there, _LEAST_WEIGHT))
        smooth = around.smoothed(sums, _SCALES[1])
        smooth_there = around.smoothed(there, _SCALES[1])
        columns.append(around.at_units(smooth / np.maximum(smooth_there, _LEAST_WEIGHT)))
    return np.stack(columns, axis=1).astype(np.float32)


class _Surroundings:
    """Sums of units on their squares, and their smoothing."""

    def __init__(self, units: GroundUnits) -> None:
        self._units = units

    def smoothed(self, sums: Any, scale: float) -> Float32:
        """Smooth sums over units; 0 where nothing is near."""
        units = self._units
        grid = np.bincount(units.square, sums, minlength=units.rows * units.columns)
        image = grid.reshape(units.rows, units.columns).astype(np.float32)
        smooth: Float32 = gaussian_filter(image, scale, mode="constant", truncate=3.0)
        return smooth

    def at_units(self, image: AnyFloat) -> Float64:
        """Read an image at the units."""
        values: Float64 = image.reshape(-1)[self._units.square].astype(np.float64)
        return values


def _deviation(mean_square: Float64, mean: Float64) -> Float64:
    deviation: Float64 = np.sqrt(np.maximum(mean_square - mean * mean, 0.0))
    return deviation
