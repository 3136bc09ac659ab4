"""What a synthetic quarry is made of: one frozen value, checked on construction.

Lengths that describe the *site* are design metres: they hold for a site 360 m wide and everything
scales with :attr:`QuarryOptions.size_m`. Lengths that describe the *sensor* (noise, outliers) are
metres and do not scale.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final, Self

from terraport_pipeline.errors import OptionError

__all__ = ["DESIGN_SIZE_M", "MAX_POINTS", "MIN_POINTS", "QuarryOptions"]

DESIGN_SIZE_M: Final = 360.0
"""East-west side of the site for which the shape constants of :mod:`.terrain` are written."""

MIN_POINTS: Final = 1_000
"""Fewer points cannot show a bench."""

MAX_POINTS: Final = 200_000_000
"""Ten times the largest cloud asked for; beyond it the arrays alone pass 10 GB."""

_RANGES: Final[dict[str, tuple[float, float]]] = {
    "points": (MIN_POINTS, MAX_POINTS),
    "seed": (0, 2**63 - 1),
    "size_m": (20.0, 5000.0),
    "benches": (2, 8),
    "bench_height_m": (3.0, 15.0),
    "berm_width_m": (3.0, 10.0),
    "face_angle_deg": (50.0, 82.0),
    "overhangs": (0, 12),
    "stockpiles": (0, 12),
    "rocks": (0, 2000),
    "trees": (0, 2000),
    "bushes": (0, 4000),
    "noise_m": (0.0, 1.0),
    "colour_noise": (0.0, 64.0),
    "outlier_fraction": (0.0, 0.2),
    "holes": (0, 50),
    "shadows": (0.0, 1.0),
    "contrast": (0.0, 2.0),
    "texture": (0.0, 2.0),
    "detail": (0.0, 2.0),
    "pixel_m": (0.0, 10.0),
    "uneven": (0.0, 0.95),
    "easting_m": (100_000.0, 900_000.0),
    "northing_m": (0.0, 10_000_000.0),
    "elevation_m": (-500.0, 9000.0),
    "epsg": (1024, 32767),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class QuarryOptions:
    """Everything that decides a synthetic quarry; equal options give equal bytes.

    Raises
    ------
    OptionError
        When a value is out of its range; the text names the field, the value and the range.

    Examples
    --------
    >>> QuarryOptions(points=60_000, seed=1).size_m
    360.0
    """

    points: int = 300_000
    """Points in the cloud, exactly; 1,000 to 200,000,000."""
    seed: int = 7
    """Decides everything random: shape, stones, colours, sensor."""
    size_m: float = DESIGN_SIZE_M
    """East-west side of the site; north-south is 8/9 of it. The whole site scales with it."""
    benches: int = 5
    """Benches from rim to floor."""
    bench_height_m: float = 9.0
    """Height of one bench (design metres)."""
    berm_width_m: float = 6.5
    """Level width between two bench faces (design metres)."""
    face_angle_deg: float = 75.0
    """Slope of a bench face."""
    overhangs: int = 6
    """Notches cut into the highwall, each with a roof that hangs over."""
    stockpiles: int = 8
    """Piles on the plateau and the floor; the materials take turns."""
    rocks: int = 120
    """Boulders on berms, floor and plateau."""
    trees: int = 70
    """Trees on the plateau."""
    bushes: int = 160
    """Bushes on the plateau and a few on the berms."""
    noise_m: float = 0.015
    """Standard deviation of the position error, per axis, metres."""
    colour_noise: float = 4.0
    """Standard deviation of the colour error, grey levels of 255 (common to R, G and B in half)."""
    outlier_fraction: float = 0.0005
    """Share of points that lie nowhere near the surface (birds, dust, bad matches)."""
    holes: int = 2
    """Round areas on dry ground without a single point."""
    shadows: float = 0.45
    """0: albedo only; 1: unlit ground is black. Cast shadows and slope shading alike."""
    contrast: float = 1.0
    """Differences between the materials' mean colours are multiplied by this; 0: all alike."""
    texture: float = 1.0
    """Patterns within a material (grain, strata, dry grass, rust) are multiplied by this."""
    detail: float = 0.0
    """Gravel, cracks and targets finer than a cloud's spacing; 1 for photos (see
    :mod:`.fine_pattern`), 0 as clouds without photos always had it."""
    pixel_m: float = 0.0
    """Width of the photo's pixel that a point has its colour from; averages the fine pattern."""
    uneven: float = 0.35
    """0: even density by area; towards 1: patches with (1 - uneven) times the density."""
    easting_m: float = 641_200.0
    """Easting of the site's centre in the CRS."""
    northing_m: float = 8_594_700.0
    """Northing of the site's centre in the CRS."""
    elevation_m: float = 1_287.0
    """Height of the plateau around the pit."""
    epsg: int = 32735
    """Projected CRS in metres; WGS 84 / UTM zone 35S by default."""

    def __post_init__(self) -> None:
        for name, (least, most) in _RANGES.items():
            value = getattr(self, name)
            if not least <= value <= most:  # also refuses NaN
                raise OptionError(
                    f"{name} is {value!r}, expected {least:,} to {most:,}; give another value"
                )
        deep = self.benches * (self.bench_height_m + self.berm_width_m)
        if deep > 110.0:
            raise OptionError(
                f"{self.benches} benches of {self.bench_height_m:g} m height and "
                f"{self.berm_width_m:g} m berm do not fit into the pit; take fewer benches or "
                f"smaller ones (their sum must be at most 110 m, it is {deep:g} m)"
            )

    @property
    def scale(self) -> float:
        """Metres per design metre: how much the quarry's plan is enlarged."""
        return self.size_m / DESIGN_SIZE_M

    @property
    def depth_design_m(self) -> float:
        """Depth of the pit in design metres."""
        return self.benches * self.bench_height_m

    def to_dict(self) -> dict[str, Any]:
        """Return the options as plain values, by field name."""
        return asdict(self)

    @classmethod
    def from_json(cls, path: Path) -> Self:
        """Read options from a JSON file such as ``data/sample_quarry.json``.

        Raises
        ------
        OptionError
            When the file is not a JSON object or names a field that does not exist.
        """
        try:
            values = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
            raise OptionError(f"{path}: cannot be read as JSON: {error}") from error
        if not isinstance(values, dict):
            raise OptionError(f"{path}: expected a JSON object of options")
        types = {field.name: field.type for field in fields(cls)}
        unknown = sorted(set(values) - set(types))
        if unknown:
            raise OptionError(
                f"{path}: unknown option {', '.join(unknown)}; known are {', '.join(sorted(types))}"
            )
        for name, value in values.items():
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise OptionError(f"{path}: {name} is {value!r}, expected a number")
            if types[name] == "int" and not isinstance(value, int):
                raise OptionError(f"{path}: {name} is {value!r}, expected a whole number")
        return cls(**values)
