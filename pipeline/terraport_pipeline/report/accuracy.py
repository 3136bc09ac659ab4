"""How far the mesh lies from the survey's points: percentiles, bias, and a map.

Every distance is that of a point to the nearest place on the mesh, whichever way it lies, and not
the height difference: a highwall counts as the ground does. Points are a sample, spread evenly over
the survey as it was read, outliers with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload import SegmentMesh
from terraport_payload.types import Float32, Float64, UInt8
from terraport_pipeline.engines.palettes import ramp_colours
from terraport_pipeline.geometry.mesh.point_sweep import PointSweep
from terraport_pipeline.model import Mesh
from terraport_pipeline.report.plan_view import PAPER, Plan

__all__ = ["MAX_SAMPLES", "Accuracy", "AccuracyMeter", "draw_distances"]

MAX_SAMPLES: Final = 200_000
"""Points that are measured: a 95th percentile of so many is good to 0.5 % or so."""

PERCENTILES: Final = (50, 90, 95, 99)

REACH_SPACINGS: Final = 5.0
"""Distance up to which the mesh in full detail is looked for, in spacings of the survey; further
away a thinned one is as good."""

POINTS_PER_CELL: Final = 12
"""Mean of the map's cells: fewer, and chance speckles it."""

SHADE: Final = 0.35
"""Share of the plan's light and dark in the map's colours."""


@dataclass(frozen=True, slots=True, eq=False)
class Accuracy:
    """Distances of the survey's points to the mesh."""

    points: Float32
    """(N, 3) the points that were measured, scene frame."""
    signed_m: Float64
    """(N,) metres; positive where the mesh lies above, or outside of, the point."""
    total: int
    """Points of the survey."""

    @property
    def distance_m(self) -> Float64:
        """(N,) metres, without sign."""
        lengths: Float64 = np.abs(self.signed_m)
        return lengths

    def percentile_m(self, percent: float) -> float:
        """Distance that so many per cent of the points do not exceed."""
        return float(np.percentile(self.distance_m, percent))

    @property
    def largest_m(self) -> float:
        """Largest distance of the points that were measured."""
        return float(self.distance_m.max())

    @property
    def bias_m(self) -> float:
        """Mean of the signed distances."""
        return float(self.signed_m.mean())

    @property
    def rms_m(self) -> float:
        """Root of the mean square."""
        return float(np.sqrt(np.mean(self.signed_m**2)))

    def share_beyond(self, distance_m: float) -> float:
        """Share of the points further from the mesh than that."""
        return float((self.distance_m > distance_m).mean())


class AccuracyMeter:
    """Measures points against a mesh that comes segment by segment, or whole.

    Parameters
    ----------
    points : ndarray of shape (P, 3), float32
        Points of the survey, scene frame; more than :data:`MAX_SAMPLES` are thinned evenly.
    spacing_m : float
        Of the survey.
    total : int
        Points of the survey, of which these may be a part.
    """

    def __init__(self, points: Float32, spacing_m: float, total: int) -> None:
        finite = points[np.isfinite(points).all(axis=1)]
        rows = np.linspace(0, len(finite) - 1, min(len(finite), MAX_SAMPLES)).round()
        self._points = np.ascontiguousarray(finite[rows.astype(np.int64)])
        self._total = total
        self._sweep = PointSweep(self._points, REACH_SPACINGS * spacing_m)
        self._has_looked = False

    def add(self, mesh: SegmentMesh) -> None:
        """Look at one segment in full detail."""
        self._sweep.pass_by(mesh.positions, mesh.faces)
        self._has_looked = True

    def finish(self, mesh: Mesh) -> Accuracy | None:
        """Measure what is not measured yet by the whole mesh, which may be thinned.

        None where there are no points, or no mesh.
        """
        if not len(self._points) or not len(mesh.faces):
            return None
        if not self._has_looked:
            self._sweep.pass_by(mesh.vertices, mesh.faces)
        while self._sweep.farther():
            self._sweep.pass_by(mesh.vertices, mesh.faces)
        return Accuracy(self._points, -self._sweep.distance_m, self._total)


def draw_distances(accuracy: Accuracy, plan: Plan) -> tuple[UInt8, float]:
    """Draw the mean distance of each cell's points over the plan.

    Returns
    -------
    image : ndarray of shape (height, width, 3), uint8
        sRGB, of the plan's size; grey where no point was measured, white where no ground is.
    top_m : float
        Distance of the ramp's last colour: the 98th percentile of the cells.
    """
    # (1) Cells of several pixels, each with points enough.
    height, width = plan.image.shape[:2]
    wide_m, high_m = plan.size_m
    cells = max(1.0, len(accuracy.points) / POINTS_PER_CELL)
    ground_px = max(1.0, plan.area_m2 / (wide_m * high_m) * width * height)
    side = max(2, int(np.ceil(np.sqrt(ground_px / cells))))
    rows, columns = -(-height // side), -(-width // side)
    column = np.floor((accuracy.points[:, 0] - plan.west_m) / wide_m * width / side)
    row = np.floor((accuracy.points[:, 2] - plan.north_m) / high_m * height / side)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    key = (row[inside] * columns + column[inside]).astype(np.int64)
    counts = np.bincount(key, minlength=rows * columns)
    sums = np.bincount(key, accuracy.distance_m[inside], minlength=rows * columns)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = sums / counts
    # (2) Colours, shaded by the plan so that benches are seen.
    finite = means[np.isfinite(means)]
    top_m = float(np.percentile(finite, 98)) if len(finite) else 0.0
    colours = ramp_colours(means, 0.0, top_m).reshape(rows, columns, 3)
    flat = np.repeat(np.repeat(colours, side, axis=0), side, axis=1)[:height, :width]
    light = plan.image.astype(np.float32).mean(axis=2, keepdims=True)
    bare = (plan.image == PAPER).all(axis=2)
    middle = float(np.median(light[~bare])) if (~bare).any() else 128.0
    shade = np.clip(1.0 + SHADE * (light / max(middle, 1.0) - 1.0), 0.6, 1.25)
    image = np.clip(flat * shade, 0, 255).astype(np.uint8)
    image[bare] = PAPER
    return image, top_m
