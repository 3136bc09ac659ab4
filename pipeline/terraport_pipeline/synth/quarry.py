"""A synthetic survey with truth: points, colours, grade, material, and the surface they came from.

A cloud is made in chunks of a fixed number of points, each with its own random stream, so a cloud
of 20 M points needs no more working memory than one of 1 M, and the bytes do not depend on how
many chunks anybody asked for. Within a chunk the points follow the triangles along a Morton curve
with stratified draws: neighbours in the file are neighbours on the ground (LAZ likes that), and
density is even to a fraction of what independent draws would give.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from pyproj import CRS
from scipy.spatial import cKDTree

from terraport_payload.types import Bool, Float32, Float64, Int32, Int64, UInt8
from terraport_pipeline.errors import OptionError
from terraport_pipeline.model import Crs, Survey
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.synth.appearance import Sunlight, grade, photographed
from terraport_pipeline.synth.materials import Material
from terraport_pipeline.synth.options import HALF_X, HALF_Y, QuarryOptions
from terraport_pipeline.synth.surface import SAMPLER_EDGE, Surface, SurfacePoints

__all__ = ["CHUNK_POINTS", "POINT_STEP_M", "Quarry", "QuarryChunk", "QuarryMaker", "synthesise"]

CHUNK_POINTS: Final = 250_000
"""Points made at once: about 150 MB of intermediate arrays."""

POINT_STEP_M: Final = 0.001
"""Coordinates are whole multiples of this about the origin, as a LAS file stores them."""

_MAX_REDRAWS: Final = 40
"""Rounds of replacing hidden points; each round leaves about a fiftieth of them."""


@dataclass(frozen=True, slots=True)
class QuarryChunk:
    """Consecutive points of a synthetic survey, with their material and true position."""

    ticks: Int32
    """(N, 3) coordinates in :data:`POINT_STEP_M` about the maker's origin."""
    colours: UInt8
    """(N, 3) sRGB."""
    grade: Float32
    """(N,) percent, at the true position."""
    material: UInt8
    """(N,) :class:`~.materials.Material`."""
    truth: Float32
    """(N, 3) metres about the maker's origin: the place on the surface, before noise."""


@dataclass(frozen=True, slots=True)
class Quarry:
    """A whole synthetic survey in memory."""

    survey: Survey
    """The cloud; its only attribute is ``grade``."""
    material: UInt8
    """(N,) :class:`~.materials.Material`."""
    truth: Float64
    """(N, 3) CRS frame: the place on the surface that each point was measured at. For an outlier,
    the place it would have been measured at."""
    options: QuarryOptions
    surface: Surface
    """The generator's own surface, design metres; see :meth:`surface_mesh`."""

    @property
    def material_names(self) -> dict[int, str]:
        """Name of every label that may occur."""
        return {int(material): material.name.lower() for material in Material}

    def surface_mesh(self, max_edge_m: float) -> tuple[Float64, Int64]:
        """Triangulate the true surface.

        Parameters
        ----------
        max_edge_m : float
            Bound on every edge, metres. Half of it costs four times as much.

        Returns
        -------
        vertices : ndarray of shape (V, 3), float64
            CRS frame, exactly on the surface.
        faces : ndarray of shape (F, 3), int64
            Counter-clockwise seen from outside. The ground is one sheet; each boulder and plant is
            a closed body that reaches into it.

        Raises
        ------
        OptionError
            When `max_edge_m` would give more than about 20 M triangles.
        """
        longest = max_edge_m / self.options.scale
        if not longest > 0.08:
            raise OptionError(
                f"max_edge_m is {max_edge_m!r}, expected more than {0.08 * self.options.scale:g}; "
                "take a smaller site for a finer mesh"
            )
        _, _, positions, faces = self.surface.triangles(longest)
        return positions * self.options.scale + _origin(self.options), faces

    def distance_m(self, points: Float64, *, max_edge_m: float | None = None) -> Float64:
        """Distance from each point to the true surface.

        Measured to the triangles of :meth:`surface_mesh` (the sixteen with the nearest centres),
        so the result is off by at most the mesh's own sag: about 0.02 max_edge_m on rough ground.

        Parameters
        ----------
        points : ndarray of shape (N, 3), float64
            CRS frame.
        max_edge_m : float, optional
            Resolution of the mesh; by default 1/500 of the site.

        Returns
        -------
        ndarray of shape (N,), float64
            Metres, not negative.
        """
        edge = self.options.size_m / 500.0 if max_edge_m is None else max_edge_m
        vertices, faces = self.surface_mesh(edge)
        origin = _origin(self.options)
        corners = (vertices - origin)[faces]
        tree = cKDTree(corners.mean(axis=1))
        local = np.asarray(points, dtype=np.float64) - origin
        _, near = tree.query(local, k=16, workers=-1)
        best = np.full(len(local), np.inf)
        for column in range(near.shape[1]):
            np.minimum(best, _triangle_distance(local, corners[near[:, column]]), out=best)
        return best


class QuarryMaker:
    """Makes the chunks of one quarry.

    Parameters
    ----------
    options : QuarryOptions
        What to make.

    Attributes
    ----------
    origin : ndarray of shape (3,), float64
        Easting, northing, height of the zero of ticks and truth, CRS frame.
    chunk_count : int
        Number of chunks; all but the last have :data:`CHUNK_POINTS` points.
    """

    def __init__(self, options: QuarryOptions) -> None:
        self.options = options
        self.surface = Surface(options)
        self.origin = _origin(options)
        self.chunk_count = -(-options.points // CHUNK_POINTS)
        self._sunlight = Sunlight(self.surface)
        self._holes = self._place_holes()
        middles = self.surface.triangle_middles
        weights = self.surface.triangle_areas * self._density(middles)
        weights *= self._surveyed(middles, SAMPLER_EDGE)
        self._cumulative = np.cumsum(weights)

    def chunks(self) -> Iterator[QuarryChunk]:
        """Yield the chunks in file order."""
        for index in range(self.chunk_count):
            yield self._make_chunk(index)

    def _make_chunk(self, index: int) -> QuarryChunk:
        options = self.options
        # A number more makes another stream: with sample 0 the bytes are those without the option.
        again = [options.sample_seed] if options.sample_seed else []
        rng = np.random.default_rng([options.seed, 1, index, *again])
        first = index * CHUNK_POINTS
        count = min(CHUNK_POINTS, options.points - first)
        points = self._draw(first, count, rng)
        colours = self._colour(points, rng)
        truth = points.positions * options.scale
        material = points.material.copy()
        measured = truth + rng.normal(0.0, 1.0, (count, 3)) * options.noise_m
        stray = rng.uniform(size=count) < options.outlier_fraction
        measured[stray] += _stray(int(stray.sum()), options.scale, rng)
        material[stray] = Material.OUTLIER
        ticks = np.rint(measured / POINT_STEP_M).astype(np.int32)
        return QuarryChunk(
            ticks, colours, grade(points.positions), material, truth.astype(np.float32)
        )

    # Drawing

    def _draw(self, first: int, count: int, rng: np.random.Generator) -> SurfacePoints:
        """Draw visible points: stratified along the curve; hidden ones are drawn again anywhere."""
        spot = (first + np.arange(count) + rng.uniform(size=count)) / self.options.points
        draws = [self._evaluate(spot, rng)]
        rows = [np.arange(count)]
        for _ in range(_MAX_REDRAWS):
            bad = np.flatnonzero(
                draws[-1].hidden
                | self._in_hole(draws[-1].positions)
                | ~self._surveyed(draws[-1].positions, 0.0)
            )
            if len(bad) == 0:
                break
            rows.append(rows[-1][bad])
            draws.append(self._evaluate(rng.uniform(size=len(bad)), rng))
        return _overlay(draws, rows)

    def _evaluate(self, spot: Float64, rng: np.random.Generator) -> SurfacePoints:
        triangle = np.searchsorted(self._cumulative, spot * self._cumulative[-1], side="right")
        triangle = np.minimum(triangle, len(self._cumulative) - 1)
        return self.surface.evaluate(triangle, rng.uniform(size=(len(spot), 2)))

    def _density(self, middles: Float64) -> Float64:
        """Relative points per area: patchy, thin on water, dense on the way if that is asked."""
        x, y, _ = middles.T
        patch = 0.5 + 1.3 * self.surface.noise(x, y, wavelength=60.0, octaves=3, field=30)
        density = 1.0 - self.options.uneven * np.clip(patch, 0.0, 1.0)
        ground = self.surface.terrain.sample(x, y)
        thin = np.where(ground.water > 0.0, 1.0 - 0.7 * (self.options.uneven > 0), 1.0)
        result: Float64 = thin * density * (1.0 + (self.options.way_density - 1.0) * ground.road)
        return result

    def _place_holes(self) -> Float64:
        """Choose (x, y, radius) of each hole."""
        rng = np.random.default_rng([self.options.seed, 2])
        centre = rng.uniform(-0.75, 0.75, (self.options.holes, 2)) * (HALF_X, HALF_Y)
        radius = rng.uniform(2.5, 6.0, (self.options.holes, 1))
        return np.concatenate([centre, radius], axis=1)

    def _surveyed(self, positions: Float64, margin: float) -> Bool:
        x, y, half_x, half_y = self.options.surveyed
        if not self.options.window_m:  # rough ground is warped over the site's edge, and stays
            return np.ones(len(positions), dtype=bool)
        east, north = np.abs(positions[:, 0] - x), np.abs(positions[:, 1] - y)
        inside: Bool = (east <= half_x + margin) & (north <= half_y + margin)
        return inside

    def _in_hole(self, positions: Float64) -> Bool:
        inside = np.zeros(len(positions), dtype=bool)
        for x, y, radius in self._holes:
            inside |= np.hypot(positions[:, 0] - x, positions[:, 1] - y) < radius
        return inside

    # Colour

    def _colour(self, points: SurfacePoints, rng: np.random.Generator) -> UInt8:
        return photographed(points, self.surface, self._sunlight, self.options, rng)


def synthesise(options: QuarryOptions, *, progress: Progress | None = None) -> Quarry:
    """Make a whole quarry in memory.

    Parameters
    ----------
    options : QuarryOptions
        What to make; equal options give equal arrays.
    progress : Progress, optional
        Told about points made.

    Returns
    -------
    Quarry
        70 bytes per point.

    Examples
    --------
    >>> quarry = synthesise(QuarryOptions(points=2_000, seed=1, size_m=90.0))
    >>> quarry.survey.points.shape, quarry.survey.crs.epsg
    ((2000, 3), 32735)
    """
    report = progress or NullProgress()
    report.start("synth: points", options.points, "points")
    maker = QuarryMaker(options)
    count = options.points
    points, truth = np.empty((count, 3)), np.empty((count, 3))
    colours = np.empty((count, 3), dtype=np.uint8)
    grades = np.empty(count, dtype=np.float32)
    material = np.empty(count, dtype=np.uint8)
    start = 0
    for chunk in maker.chunks():
        rows = slice(start, start + len(chunk.ticks))
        points[rows] = chunk.ticks * POINT_STEP_M + maker.origin
        truth[rows] = chunk.truth + maker.origin
        colours[rows], grades[rows], material[rows] = chunk.colours, chunk.grade, chunk.material
        start = rows.stop
        report.advance(len(chunk.ticks))
    report.done({"points": count})
    survey = Survey(points, colours, {"grade": grades}, crs_of(options), "las")
    return Quarry(survey, material, truth, options, maker.surface)


def crs_of(options: QuarryOptions) -> Crs:
    """Return the CRS that the options name."""
    crs = CRS.from_epsg(options.epsg)
    return Crs(crs.name, crs.to_wkt(), options.epsg)


def _origin(options: QuarryOptions) -> Float64:
    return np.array([options.easting_m, options.northing_m, options.elevation_m])


def _stray(count: int, scale: float, rng: np.random.Generator) -> Float64:
    """Displacements of outliers: above more often than below, and far."""
    away = rng.normal(0.0, 3.0, (count, 3))
    sign = np.where(rng.uniform(size=count) < 0.7, 1.0, -1.0)
    away[:, 2] = sign * rng.uniform(2.0, 25.0, count)
    result: Float64 = away * scale
    return result


def _overlay(draws: list[SurfacePoints], rows: list[Int64]) -> SurfacePoints:
    """Write later draws over the rows they replace."""
    whole = draws[0]
    for draw, at in zip(draws[1:], rows[1:], strict=True):
        whole.positions[at], whole.normals[at] = draw.positions, draw.normals
        whole.material[at], whole.lane[at] = draw.material, draw.lane
        whole.inside[at], whole.hidden[at] = draw.inside, draw.hidden
    return whole


def _triangle_distance(points: Float64, corners: Float64) -> Float64:
    """Distance from point n to triangle n: Ericson, "Real-Time Collision Detection", 5.1.5."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    length = np.maximum(np.linalg.norm(normal, axis=1), 1e-30)
    height = np.abs(np.einsum("ij,ij->i", points - a, normal)) / length
    over = np.ones(len(points), dtype=bool)
    best = np.full(len(points), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        along = end - start
        out = points - start
        over &= np.einsum("ij,ij->i", np.cross(along, out), normal) >= 0.0
        square = np.maximum(np.einsum("ij,ij->i", along, along), 1e-30)
        t = np.clip(np.einsum("ij,ij->i", out, along) / square, 0.0, 1.0)
        np.minimum(best, np.linalg.norm(out - t[:, None] * along, axis=1), out=best)
    result: Float64 = np.where(over, height, best)
    return result
