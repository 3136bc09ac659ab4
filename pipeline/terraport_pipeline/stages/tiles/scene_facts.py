"""What all tiles of a scene are measured and cut by: sums over all of them, and a scale.

Sums are measured anew in every build. The scale is decided once: what tiles are cut by must not
change with what lies far from them, or a change in one tile would cut every segment of the next
survey over the scene in another way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Float32, Float64
from terraport_pipeline.geometry.mesh.face_measures import extent_of_area
from terraport_pipeline.geometry.regions.mean_scale import ColourTotals
from terraport_pipeline.geometry.regions.region_roughness import automatic_roughness_scale
from terraport_pipeline.geometry.tiles.tile_seams import Seams
from terraport_pipeline.stages.contract import Facts, Form, Stored

__all__ = ["SCALE_FORM", "AttributeRange", "SceneScale", "TiledScene"]

_MOST_GROWTH: Final = 8
"""Faces of a scene over those that its scale was decided by, or the reverse: beyond, regions of at
least so many faces, and a limit by so many colours, are those of another scene."""

_LONGEST_EDGES: Final = 1024
"""Times the edge that lengths are steps of which an edge may be: sums over 2^33 edges still fit."""


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
    """Sums and bounds over all tiles."""

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
    colours: ColourTotals
    longest_m: float
    """Longest edge between two faces, metres."""
    median_edges_m: tuple[float, ...]
    """Median edge of every tile, metres."""

    @property
    def face_count(self) -> int:
        """Number of faces of the detail over all tiles."""
        return sum(self.faces)

    @property
    def is_grey(self) -> bool:
        """Whether all faces have one colour."""
        return self.colours.spread(np.ones(3)) == 0.0


@dataclass(frozen=True, slots=True, eq=False)
class SceneScale:
    """What regions and segments of every tile are measured by."""

    colours: ColourTotals
    """Colours of the scene that it was decided by."""
    longest_m: float
    """Longest edge between two faces there: lengths are whole steps of it."""
    max_extent_m: float
    """Longest side of a segment's box: as asked for, or chosen by the density of faces."""
    roughness_scale_m: float
    """Width of the cubes that roughness is measured in."""
    width_m: float
    """Root of the surface's area."""

    @classmethod
    def decide(cls, sums: TiledScene, max_extent_m: float | None, max_faces: int) -> SceneScale:
        """Choose the scale of a new scene.

        Parameters
        ----------
        sums : TiledScene
        max_extent_m : float or None
            As asked for.
        max_faces : int
            Of a segment.
        """
        widest_m = float((sums.high - sums.low).max())
        return cls(
            sums.colours,
            sums.longest_m,
            max_extent_m or extent_of_area(sums.area_m2, sums.face_count, widest_m, max_faces),
            automatic_roughness_scale(sums.area_m2, sums.face_count, widest_m),
            math.sqrt(sums.area_m2),
        )

    def stands(self, sums: TiledScene) -> bool:
        """Say whether another survey of the scene can be measured by it."""
        was_grey = self.colours.spread(np.ones(3)) == 0.0
        fewer, more = sorted((sums.face_count, self.colours.faces))
        return (
            was_grey == sums.is_grey
            and more <= _MOST_GROWTH * fewer
            and sums.longest_m <= _LONGEST_EDGES * self.longest_m
        )


SCALE_FORM: Final[Form[SceneScale]] = Form(
    store=lambda scale: Stored(
        {"whole": scale.colours.whole, "products": scale.colours.products},
        {
            "faces": scale.colours.faces,
            "longest_m": scale.longest_m,
            "max_extent_m": scale.max_extent_m,
            "roughness_scale_m": scale.roughness_scale_m,
            "width_m": scale.width_m,
        },
    ),
    restore=lambda stored, _facts: SceneScale(
        ColourTotals(
            int(stored.values["faces"]),
            np.asarray(stored.arrays["whole"], np.int64),
            np.asarray(stored.arrays["products"], np.int64),
        ),
        float(stored.values["longest_m"]),
        float(stored.values["max_extent_m"]),
        float(stored.values["roughness_scale_m"]),
        float(stored.values["width_m"]),
    ),
    facts=lambda scale: Facts({"max_extent_m": scale.max_extent_m}),
)
