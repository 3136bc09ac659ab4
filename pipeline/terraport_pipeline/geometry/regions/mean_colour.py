"""Regions by mean colour: neighbours whose mean colours are alike are united.

The engine for landscapes. What tells materials apart outdoors is hue and chroma over some area: not
lightness, which shadows change, and not the colour of single triangles, which noise and texture
change. So the difference of two neighbouring units is the distance of their *mean* CIELAB colours,
lightness weighing a quarter, times two factors:

- a unit below the least size counts less, by the root of its share of that size: the mean of few
  faces is uncertain by that root, and what is small must go somewhere;
- a short border counts more: (perimeter of the unit with the shorter one / common border) to the
  power ``leak``. Two fields that touch at one corner are two fields.

1. Starting from single faces, units are united in rounds of rising limit, an eighth of the final
   one at a time. The final limit is a share of the scene's own spread of colours, so a grey quarry
   is told apart as finely as a green valley, within what the eye can see and what is surely two.
   Fine pools are the units at a quarter of it.
2. Units below ``small_share`` of all faces join the neighbour of nearest mean colour, and so do
   units less than two edges wide: where two materials meet, colours blend, and the blend is no
   region however long it is. Small units that touch nothing join the region of the nearest face.

A round: every unit chooses the neighbour of least difference (ties: lower scramble of the units'
lowest faces, ``merge_order.py``). Units that choose each other are united, and a unit joins its
choice where that has at least four times its faces, so is hardly moved by it, and does not itself
join another in that way.

All sums are whole numbers: nothing depends on the numbering of the vertices.

PURE: no I/O, no clock. Each round is linear in what is left; peak about 350 bytes per face
(measured at 5 M faces).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import Float32, Float64, Int32
from terraport_pipeline.geometry.mesh.face_measures import edge_steps
from terraport_pipeline.geometry.mesh.unit_rows import rows_of_pairs
from terraport_pipeline.geometry.regions.colour import face_lab
from terraport_pipeline.geometry.regions.engine_options import (
    MEANS_LEAK,
    MEANS_LIGHTNESS,
    MEANS_SMALL_SHARE,
    MEANS_SPREAD,
)
from terraport_pipeline.geometry.regions.mean_scale import ColourTotals, axis_index
from terraport_pipeline.geometry.regions.mean_units import MeanUnits, unite
from terraport_pipeline.geometry.regions.pool_refine import join_nearest, number_by_first
from terraport_pipeline.geometry.regions.segmenter import Segmentation, SegmenterMesh

__all__ = [
    "FINE_LEVEL",
    "LAB_STEPS",
    "LEAST_LIMIT",
    "LEVELS",
    "MOST_LIMIT",
    "MeanColourSegmenter",
]


LAB_STEPS: Final = 64.0
"""Steps in one unit of CIELAB, far below the width of an 8-bit grey level (0.4)."""
LEAST_LIMIT: Final = 2.3
"""Least automatic limit, CIELAB units: the difference that the eye just notices (M. Mahy, L. Van
Eycken, A. Oosterlinck, Color Research and Application 19(2), 1994). A scene of one colour falls
into no regions."""
MOST_LIMIT: Final = 12.0
"""Greatest automatic limit: colours farther apart are two materials however colourful the scene
(a village under trees has a spread of 23, and 0.95 of it would unite roofs and grass)."""
LEVELS: Final = 8
"""Steps of the rising limit; 16 changed 1 - RI by less than 0.002, 3 by 0.004."""
FINE_LEVEL: Final = 2
"""Level whose units are the fine pools."""
_SCALAR_RANGE: Final = 100.0
"""A scalar is scaled to 0 to this, as lightness runs."""


@dataclass(frozen=True, slots=True)
class MeanColourSegmenter:
    """Region growing: unites neighbouring units of like mean colour in rounds."""

    spread: float = MEANS_SPREAD
    """Limit of the difference over the root of the summed variances of the faces' weighed colours.
    Lower tells more materials apart, and more of the patterns within one. The limit stays within
    2.3 and 12 CIELAB units. > 0."""
    difference: float | None = None
    """The limit itself, CIELAB units; None: from ``spread``."""
    small_share: float = MEANS_SMALL_SHARE
    """Regions below this share of all faces join a neighbour. 0..1."""
    lightness: float = MEANS_LIGHTNESS
    """Weight of lightness against a* and b*. Lower ignores shadows, and tells greys less apart.
    0..10."""
    leak: float = MEANS_LEAK
    """Power of (perimeter / common border); 0 ignores how far two units touch. 0..2."""
    threads: int = 1
    """Threads at most; they change nothing but the time."""

    def __post_init__(self) -> None:
        """Refuse values outside their range before any work."""
        for name, low, high in (
            ("spread", np.nextafter(0, 1), 100.0),
            ("difference", np.nextafter(0, 1), 1000.0),
            ("small_share", 0.0, 1.0),
            ("lightness", 0.0, 10.0),
            ("leak", 0.0, 2.0),
        ):
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                msg = f"{name} is {value}, expected a number in {low:g}..{high:g}"
                raise ValueError(msg)

    @property
    def name(self) -> str:
        """Name of the engine in options and manifests: ``"means"``."""
        return "means"

    def limit(self, totals: ColourTotals, weight: Float64) -> float:
        """Choose the final limit of the difference, CIELAB units, by the whole scene's colours."""
        automatic = self.spread * totals.spread(weight)
        return self.difference or min(max(automatic, LEAST_LIMIT), MOST_LIMIT)

    def least_faces(self, n_faces: int) -> int:
        """Choose the faces below which a region is small."""
        return max(int(np.ceil(self.small_share * n_faces)), 1)

    def weights(self) -> Float64:
        """Weights of L*, a* and b* in the distance of two means, (3,), per quantisation step."""
        return np.array([self.lightness, 1.0, 1.0]) / LAB_STEPS

    def segment(self, mesh: SegmenterMesh) -> Segmentation:
        """Cut the mesh into regions and fine pools; see :class:`~.segmenter.Segmenter`.

        Where the mesh has a scalar, it is compared instead of colours; where it has neither, every
        face is alike.
        """
        n_faces = len(mesh.faces)
        pairs, edges = mesh.edge_pairs()
        colour, weight, index = _compared(mesh, self.weights())
        limit = self.limit(ColourTotals.of(colour), weight)
        least = self.least_faces(n_faces)
        steps = edge_steps(mesh.vertices, edges)
        mean_step = int(steps.sum()) // max(len(steps), 1)
        units = MeanUnits(
            np.arange(n_faces, dtype=np.int32),
            rows_of_pairs(n_faces, pairs, steps),
            colour.astype(np.int64),
            np.ones(n_faces, np.int64),
            np.arange(n_faces, dtype=np.int32),
        )
        # (1) rising limit
        fine = units.labels
        for level in range(1, LEVELS + 1):
            units = unite(
                units, weight, limit * level / LEVELS, least, self.leak, 0, threads=self.threads
            )
            if level == FINE_LEVEL:
                fine = units.labels
        # (2) what is left small
        pools = len(units.faces)
        units = unite(units, weight, np.inf, least, 0.0, mean_step, threads=self.threads)
        small = units.faces < least
        islands = int(np.count_nonzero(small))
        labels = units.labels
        if islands and islands < len(small):
            labels = join_nearest(mesh.vertices, mesh.faces, labels, small)
        regions, count = number_by_first(labels)
        return Segmentation(
            regions=regions,
            region_count=count,
            fine=number_by_first(fine)[0],
            similarity=index,
            facts={"region_limit": limit, "region_pools": pools, "region_islands": islands},
        )


def _compared(mesh: SegmenterMesh, weight: Float64) -> tuple[Int32, Float64, Float32]:
    """Choose what is compared: steps (F, C), weights (C,) per step, one index per face."""
    n_faces = len(mesh.faces)
    if mesh.scalar is not None:
        value = mesh.scalar.astype(np.float64)
        if not np.isfinite(value).all():
            bad = int(np.flatnonzero(~np.isfinite(value))[0])
            msg = f"scalar of face {bad} is {value[bad]}, expected a finite number"
            raise ValueError(msg)
        if n_faces:
            value -= value.min()
            value *= _SCALAR_RANGE / float(value.max()) if value.max() > 0.0 else 0.0
        steps = np.rint(value * LAB_STEPS).astype(np.int32)[:, None]
        return steps, np.array([1.0 / LAB_STEPS]), (value / _SCALAR_RANGE).astype(np.float32)
    if mesh.colours is None:
        return np.zeros((n_faces, 1), np.int32), np.ones(1), np.zeros(n_faces, np.float32)
    lab = face_lab(mesh.colours, mesh.faces, LAB_STEPS).astype(np.int32)
    if n_faces == 0:
        return lab, weight, np.zeros(0, np.float32)
    # Pools of like index are merged to segments: the colour's place on its own main axis.
    return lab, weight, axis_index(lab, ColourTotals.of(lab), weight)
