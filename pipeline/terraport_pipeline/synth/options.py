"""What a synthetic quarry is made of: one frozen value, checked on construction.

Lengths that describe the *site* are design metres: they hold for a site 360 m wide and everything
scales with :attr:`QuarryOptions.size_m`. Lengths that describe the *sensor* (noise, outliers) are
metres and do not scale.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Self

from terraport_pipeline.errors import OptionError
from terraport_pipeline.option import COMMON, COUNT, Option, check_options, option_fields

__all__ = [
    "DESIGN_SIZE_M",
    "HALF_X",
    "HALF_Y",
    "MAX_PHOTOS",
    "MAX_PIXELS",
    "MAX_POINTS",
    "MIN_POINTS",
    "FlightOptions",
    "QuarryOptions",
]

DESIGN_SIZE_M: Final = 360.0
"""East-west side of the site for which the shape constants of :mod:`.terrain` are written."""

HALF_X: Final = DESIGN_SIZE_M / 2
HALF_Y: Final = 160.0
"""The site reaches this far from its centre, design metres."""

MIN_POINTS: Final = 1_000
"""Fewer points cannot show a bench."""

MAX_POINTS: Final = 200_000_000
"""Ten times the largest cloud asked for; beyond it the arrays alone pass 10 GB."""

MAX_PHOTOS: Final = 2_000
MAX_PIXELS: Final = 64_000_000
"""Pixels of a photo at most: rendering needs about 60 bytes for each."""

_SHAPE: Final = "Shape of the site"
_SENSOR: Final = "Points and colours"
_PLACE: Final = "Place"


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

    points: Annotated[
        int, Option(heading=COMMON, least=MIN_POINTS, most=MAX_POINTS, notation=COUNT)
    ] = 300_000
    """Points in the cloud, exactly: 300k, 5M; 50k to 20M is sensible."""
    seed: Annotated[int, Option(heading=COMMON, least=0, most=2**63 - 1)] = 7
    """Decides everything random: shape, stones, colours, sensor."""
    sample_seed: Annotated[int, Option(heading=_SENSOR, least=0, most=2**63 - 1)] = 0
    """Another number draws another sample of the same ground: as if it were flown again."""
    size_m: Annotated[
        float, Option(heading=COMMON, least=20.0, most=5000.0, flags=("--size",), unit="m")
    ] = DESIGN_SIZE_M
    """East-west side of the site; north-south is 8/9 of it. The whole site scales with it."""
    benches: Annotated[int, Option(heading=_SHAPE, least=2, most=8)] = 5
    """Benches from rim to floor."""
    bench_height_m: Annotated[float, Option(heading=_SHAPE, least=3.0, most=15.0, unit="m")] = 9.0
    """Height of one bench (design metres)."""
    berm_width_m: Annotated[float, Option(heading=_SHAPE, least=3.0, most=10.0, unit="m")] = 6.5
    """Level width between two bench faces (design metres)."""
    face_angle_deg: Annotated[
        float, Option(heading=_SHAPE, least=50.0, most=82.0, unit="degrees")
    ] = 75.0
    """Slope of a bench face."""
    overhangs: Annotated[int, Option(heading=_SHAPE, least=0, most=12)] = 6
    """Notches cut into the highwall, each with a roof that hangs over."""
    stockpiles: Annotated[int, Option(heading=_SHAPE, least=0, most=12)] = 8
    """Piles on the plateau and the floor; the materials take turns."""
    rocks: Annotated[int, Option(heading=_SHAPE, least=0, most=2000)] = 120
    """Boulders on berms, floor and plateau."""
    trees: Annotated[int, Option(heading=_SHAPE, least=0, most=2000)] = 70
    """Trees on the plateau."""
    bushes: Annotated[int, Option(heading=_SHAPE, least=0, most=4000)] = 160
    """Bushes on the plateau and a few on the berms."""
    noise_m: Annotated[
        float, Option(heading=_SENSOR, least=0.0, most=1.0, flags=("--noise",), unit="m")
    ] = 0.015
    """Standard deviation of the position error, per axis, metres."""
    colour_noise: Annotated[float, Option(heading=_SENSOR, least=0.0, most=64.0)] = 4.0
    """Standard deviation of the colour error, grey levels of 255 (common to R, G and B in half)."""
    outlier_fraction: Annotated[
        float, Option(heading=_SENSOR, least=0.0, most=0.2, flags=("--outliers",))
    ] = 0.0005
    """Share of points that lie nowhere near the surface (birds, dust, bad matches)."""
    holes: Annotated[int, Option(heading=_SENSOR, least=0, most=50)] = 2
    """Round areas on dry ground without a single point."""
    shadows: Annotated[float, Option(heading=_SENSOR, least=0.0, most=1.0)] = 0.45
    """0: albedo only; 1: unlit ground is black. Cast shadows and slope shading alike."""
    contrast: Annotated[float, Option(heading=_SENSOR, least=0.0, most=2.0)] = 1.0
    """Differences between the materials' mean colours are multiplied by this; 0: all alike."""
    texture: Annotated[float, Option(heading=_SENSOR, least=0.0, most=2.0)] = 1.0
    """Patterns within a material (grain, strata, dry grass, rust) are multiplied by this."""
    detail: Annotated[float, Option(heading=_SENSOR, least=0.0, most=2.0)] = 0.0
    """Gravel, cracks and targets finer than a cloud's spacing; with photos 1 unless stated."""
    pixel_m: Annotated[float, Option(heading=_SENSOR, least=0.0, most=10.0, unit="m")] = 0.0
    """Width of the photo's pixel that a point has its colour from; averages the fine pattern."""
    uneven: Annotated[float, Option(heading=_SENSOR, least=0.0, most=0.95)] = 0.35
    """0: even density by area; towards 1: patches with (1 - uneven) times the density."""
    way_density: Annotated[float, Option(heading=_SENSOR, least=1.0, most=20.0)] = 1.0
    """Points per area on the haul road, times those elsewhere: it is looked at from nearest by."""
    window_m: Annotated[float, Option(heading=_SENSOR, least=0.0, most=5000.0, unit="m")] = 0.0
    """Side of the square that is surveyed, and flown over low; 0: the whole site."""
    window_east_m: Annotated[
        float, Option(heading=_SENSOR, least=-2500.0, most=2500.0, unit="m")
    ] = 0.0
    """The square's middle, east of the site's."""
    window_north_m: Annotated[
        float, Option(heading=_SENSOR, least=-2500.0, most=2500.0, unit="m")
    ] = 0.0
    """The square's middle, north of the site's."""
    easting_m: Annotated[
        float, Option(heading=_PLACE, least=100_000.0, most=900_000.0, unit="m")
    ] = 641_200.0
    """Easting of the site's centre in the CRS."""
    northing_m: Annotated[float, Option(heading=_PLACE, least=0.0, most=10_000_000.0, unit="m")] = (
        8_594_700.0
    )
    """Northing of the site's centre in the CRS."""
    elevation_m: Annotated[float, Option(heading=_PLACE, least=-500.0, most=9000.0, unit="m")] = (
        1_287.0
    )
    """Height of the plateau around the pit."""
    epsg: Annotated[int, Option(heading=_PLACE, least=1024, most=32767)] = 32735
    """Projected CRS in metres; 32735 is WGS 84 / UTM zone 35S."""

    def __post_init__(self) -> None:
        check_options(self)
        deep = self.benches * (self.bench_height_m + self.berm_width_m)
        if deep > 110.0:
            raise OptionError(
                f"{self.benches} benches of {self.bench_height_m:g} m height and "
                f"{self.berm_width_m:g} m berm do not fit into the pit; take fewer benches or "
                f"smaller ones (their sum must be at most 110 m, it is {deep:g} m)"
            )

        half_x, half_y = (half * self.scale for half in (HALF_X, HALF_Y))
        if abs(self.window_east_m) > half_x or abs(self.window_north_m) > half_y:
            raise OptionError(
                f"the window's middle is {self.window_east_m:g} m east and "
                f"{self.window_north_m:g} m north of the site's, expected at most {half_x:g} and "
                f"{half_y:g} m either way"
            )

    @property
    def scale(self) -> float:
        """Metres per design metre: how much the quarry's plan is enlarged."""
        return self.size_m / DESIGN_SIZE_M

    @property
    def surveyed(self) -> tuple[float, float, float, float]:
        """Middle (x, y) and half sides (x, y) of what is surveyed, design metres."""
        if not self.window_m:
            return 0.0, 0.0, HALF_X, HALF_Y
        half = self.window_m / 2
        values = (self.window_east_m, self.window_north_m, half, half)
        x, y, half_x, half_y = (value / self.scale for value in values)
        return x, y, half_x, half_y

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
        types = {field.name: field.type for field in option_fields(cls)}
        unknown = sorted(set(values) - set(types))
        if unknown:
            raise OptionError(
                f"{path}: unknown option {', '.join(unknown)}; known are {', '.join(sorted(types))}"
            )
        for name, value in values.items():
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise OptionError(f"{path}: {name} is {value!r}, expected a number")
            if types[name] is int and not isinstance(value, int):
                raise OptionError(f"{path}: {name} is {value!r}, expected a whole number")
        return cls(**values)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightOptions:
    """How the photos are taken; equal options give equal bytes.

    Raises
    ------
    OptionError
        When a value is out of its range.
    """

    count: Annotated[int, Option(flags=("--photo-count",), least=1, most=MAX_PHOTOS)] = 60
    """Photos of the flight, straight down and oblique."""
    width: int = 2000
    height: int = 1500
    """Height of a photo, pixels."""
    overlap: Annotated[float, Option(least=0, most=0.95)] = 0.7
    """Overlap of neighbouring photos straight down on the plateau, along and across the flight."""
    way_share: Annotated[float, Option(flags=("--photo-way",), least=0, most=0.9)] = 0.0
    """Share of the photos that follow the haul road, low over it: finer pixels where one walks."""
    exposure_drift_ev: Annotated[float, Option(flags=("--exposure-drift",), least=0, most=3)] = 0.35
    """Largest exposure error of a photo, in stops: 0.35 is a factor of 1.27 in light."""
    vignetting: Annotated[float, Option(least=0, most=0.9)] = 0.18
    """Share of the light that is lost in a photo's corner."""
    sensor_noise: Annotated[float, Option(least=0, most=64)] = 1.2
    """Noise of the sensor: standard deviation in grey levels of 255."""
    quality: Annotated[int, Option(flags=("--photo-quality",), least=1, most=100)] = 92
    """Quality of the JPEG files."""
    truck: Annotated[bool, Option()] = True
    """A truck drives through the scene: in every photo at another place, but for those that follow
    the haul road; so low, nobody drives below."""

    def __post_init__(self) -> None:
        check_options(self)
        if not all(64 <= side <= 16_384 for side in (self.width, self.height)):
            raise OptionError(
                f"a photo of {self.width} x {self.height} pixels; expected sides of 64 to 16,384"
            )
        if self.width * self.height > MAX_PIXELS:
            raise OptionError(
                f"a photo of {self.width} x {self.height} pixels is too large, expected at most "
                f"{MAX_PIXELS:,} pixels; take a smaller --photo-size"
            )
