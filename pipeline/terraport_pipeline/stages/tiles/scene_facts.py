"""What all tiles of a scene are measured and cut by: sums and bounds over all of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from terraport_payload.types import Float32, Float64
from terraport_pipeline.geometry.regions.region_roughness import automatic_roughness_scale
from terraport_pipeline.geometry.tiles.tile_seams import Seams
from terraport_pipeline.geometry.tiles.tiled_means import MeansScale

__all__ = ["AttributeRange", "TiledScene"]


@dataclass(frozen=True, slots=True)
class AttributeRange:
    """Least and largest value of one attribute, NaN left out, and whether all are whole."""

    low: float
    high: float
    """Below ``low`` where there is no value at all."""
    fraction: float | None
    """Some value that is no whole number; None when all are."""

    @classmethod
    def of(cls, values: Float32) -> AttributeRange:
        """Measure the range of one mesh's values."""
        valid = values[~np.isnan(values)]
        if not len(valid):
            return cls(1.0, 0.0, None)
        broken = valid[valid != np.rint(valid)]
        fraction = float(broken.min()) if len(broken) else None
        return cls(float(valid.min()), float(valid.max()), fraction)

    def plus(self, other: AttributeRange) -> AttributeRange:
        """Unite it with the range of another piece of the surface."""
        if self.high < self.low:
            return other
        if other.high < other.low:
            return self
        fractions = [f for f in (self.fraction, other.fraction) if f is not None]
        return AttributeRange(
            min(self.low, other.low), max(self.high, other.high), min(fractions, default=None)
        )

    def values(self) -> Float32:
        """Values that stand for all in the choice of a scale."""
        if self.high < self.low:
            return np.full(1, np.nan, np.float32)
        some = [self.low, self.high] + ([] if self.fraction is None else [self.fraction])
        return np.array(some, np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class TiledScene:
    """Sums and bounds over all tiles that the passes need before they start."""

    faces: tuple[int, ...]
    """Number of faces of every tile."""
    vertices: int
    area_m2: float
    low: Float64
    """(3,) least x, y, z."""
    high: Float64
    """(3,)"""
    seams: Seams
    attributes: dict[str, AttributeRange]
    scale: MeansScale
    """What the units of every tile are made by."""
    max_extent_m: float
    """Longest side of a segment's box: as asked for, or chosen by the density of faces."""

    @property
    def face_count(self) -> int:
        """Number of faces of the detail over all tiles."""
        return sum(self.faces)

    @property
    def roughness_scale_m(self) -> float:
        """Width of the cubes that roughness is measured in."""
        return automatic_roughness_scale(
            self.area_m2, self.face_count, float((self.high - self.low).max())
        )
