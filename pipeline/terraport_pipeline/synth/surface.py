"""The true surface of a quarry: ground and bodies as one set of triangles to sample and measure.

Triangles only choose *where* to look: a sample takes a triangle by its area, a random place in its
parameters, and evaluates the exact surface there. Frame: design metres (see :mod:`.terrain`).
PURE.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Bool, Float64, Int64, UInt8
from terraport_pipeline.synth.blobs import BUSH, ROCK, Blobs
from terraport_pipeline.synth.materials import PILE_MATERIALS, Material
from terraport_pipeline.synth.noise import Noise
from terraport_pipeline.synth.options import HALF_X, HALF_Y, QuarryOptions
from terraport_pipeline.synth.targets import place_targets
from terraport_pipeline.synth.terrain import Terrain
from terraport_pipeline.synth.triangulate import grid_triangles, icosphere, refine

__all__ = ["GROUND", "SAMPLER_EDGE", "Surface", "SurfacePoints", "ground_material"]

GROUND: Final = -1
"""Body number of the ground."""

SAMPLER_EDGE: Final = 2.5
"""Longest edge of the sampler's triangles, design metres: fine enough that the area within one
is even, coarse enough that 60,000 points take no second."""

_NORMAL_STEP: Final = 0.06
"""Finite-difference step: well below the shortest wavelength of the ground (0.6)."""

_STEEP: Final = 0.62
"""Upward part of the normal below which bare ground is a rock face (52 degrees)."""


@dataclass(frozen=True, slots=True)
class SurfacePoints:
    """Points on the true surface, one row each."""

    positions: Float64
    """(N, 3) design metres."""
    normals: Float64
    """(N, 3) unit, outward."""
    material: UInt8
    """(N,) :class:`~.materials.Material`."""
    lane: Float64
    """(N,) -1..1 across the road; 0 elsewhere."""
    inside: Float64
    """(N,) distance inside the pit's rim; 0 on bodies."""
    hidden: Bool
    """(N,) inside another body or below the ground."""


class Surface:
    """Ground and bodies of one quarry.

    Parameters
    ----------
    options : QuarryOptions
        Shape and seed.

    Attributes
    ----------
    noise, terrain, blobs
        What it is made of.
    targets : ndarray of shape (T, 2), float64
        See :mod:`.targets`; empty without ``options.detail``.
    """

    def __init__(self, options: QuarryOptions) -> None:
        rng = np.random.default_rng([options.seed, 0])
        self.noise = Noise(rng)
        self.terrain = Terrain(options, self.noise, rng)
        self.blobs = Blobs(options, self.terrain, self.noise, rng)
        self.targets = np.empty((0, 2))
        if options.detail > 0.0:
            self.targets = place_targets(options.seed, self.terrain)
        self._build_sampler(SAMPLER_EDGE)

    # Triangles

    def triangles(
        self, longest: float, *, body_rounds: int = 2
    ) -> tuple[Int64, Float64, Float64, Int64]:
        """Triangulate everything.

        Parameters
        ----------
        longest : float
            Bound on every edge, design metres.
        body_rounds : int
            A body has at least 20 x 4^rounds faces, however small it is.

        Returns
        -------
        body : ndarray of shape (V,), int64
            Body of each vertex, :data:`GROUND` for the ground.
        parameters : ndarray of shape (V, 3), float64
            (u, v, 0) on the ground, a direction on bodies.
        positions : ndarray of shape (V, 3), float64
        faces : ndarray of shape (F, 3), int64
            Counter-clockwise seen from outside; no face joins two bodies.
        """
        step = min(longest / 1.42, 8.0)  # the diagonal of a cell on level ground just fits
        flat, faces = grid_triangles(HALF_X, HALF_Y, step)
        flat, positions, faces = refine(flat, faces, self._place_ground, longest)
        parameters = np.concatenate([flat, np.zeros((len(flat), 1))], axis=1)
        bodies = [np.full(len(flat), GROUND, dtype=np.int64)]
        parameter_arrays, position_arrays, triangles = [parameters], [positions], [faces]
        unit, corners = icosphere(body_rounds)
        count = len(flat)
        for body in range(len(self.blobs.kind)):
            to_surface = self._placer(body)
            directions, spots, pieces = refine(unit, corners, to_surface, longest)
            bodies.append(np.full(len(directions), body, dtype=np.int64))
            parameter_arrays.append(directions)
            position_arrays.append(spots)
            triangles.append(pieces + count)
            count += len(directions)
        return (
            np.concatenate(bodies),
            np.concatenate(parameter_arrays),
            np.concatenate(position_arrays),
            np.concatenate(triangles),
        )

    def _place_ground(self, parameters: Float64) -> Float64:
        return self.terrain.positions(parameters[:, 0], parameters[:, 1])

    def _placer(self, body: int) -> Callable[[Float64], Float64]:
        def to_surface(directions: Float64) -> Float64:
            return self.blobs.positions(np.full(len(directions), body), directions)

        return to_surface

    # Sampling

    def _build_sampler(self, longest: float) -> None:
        body, parameters, positions, faces = self.triangles(longest)
        corners = positions[faces]
        middle = corners.mean(axis=1)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = 0.5 * np.linalg.norm(normal, axis=1)
        order = np.argsort(_morton(middle), kind="stable")
        self.triangle_middles = middle[order]
        self.triangle_areas = area[order]
        self._body = body[faces[:, 0]][order]
        self._corners = parameters[faces][order]
        self._near_body = self._find_near(self.triangle_middles)

    def _find_near(self, middles: Float64) -> Bool:
        """Say which triangles may touch a body (only there are points tested against bodies)."""
        if len(self.blobs.kind) == 0:
            self._tree = None
            return np.zeros(len(middles), dtype=bool)
        self._tree = cKDTree(self.blobs.centres[:, :2])
        self._widest = float(self.blobs.radii.max()) * 1.5
        distance, _ = self._tree.query(middles[:, :2], distance_upper_bound=self._widest + 2.0)
        near: Bool = np.isfinite(distance)
        return near

    def evaluate(self, triangle: Int64, fractions: Float64) -> SurfacePoints:
        """Evaluate the surface within triangles of the sampler.

        Parameters
        ----------
        triangle : ndarray of shape (N,), int64
            Rows of :attr:`triangle_areas`.
        fractions : ndarray of shape (N, 2), float64
            Uniform in [0, 1): give a uniform place in the triangle.
        """
        root = np.sqrt(fractions[:, :1])
        w = np.concatenate(
            [1.0 - root, root * (1.0 - fractions[:, 1:]), root * fractions[:, 1:]], axis=1
        )
        corners = self._corners[triangle]
        parameters = np.einsum("ni,nij->nj", w, corners)
        return self._evaluate(self._body[triangle], parameters, self._near_body[triangle])

    def evaluate_at(self, body: Int64, parameters: Float64) -> SurfacePoints:
        """Evaluate the surface at parameters, such as those of :meth:`triangles`.

        Parameters
        ----------
        body : ndarray of shape (N,), int64
            Body of each place, :data:`GROUND` for the ground.
        parameters : ndarray of shape (N, 3), float64
            (u, v, 0) on the ground, a direction of any length on bodies.
        """
        return self._evaluate(body, parameters, np.ones(len(body), dtype=bool))

    def _evaluate(self, body: Int64, parameters: Float64, near_body: Bool) -> SurfacePoints:
        count = len(body)
        positions, normals = np.empty((count, 3)), np.empty((count, 3))
        material = np.empty(count, dtype=np.uint8)
        lane, inside = np.zeros(count), np.zeros(count)
        hidden = np.zeros(count, dtype=bool)
        on = np.flatnonzero(body == GROUND)
        off = np.flatnonzero(body != GROUND)
        u, v = parameters[on, 0], parameters[on, 1]
        ground = self.terrain.sample(u, v)
        positions[on], lane[on], inside[on] = ground.positions, ground.lane, ground.inside
        du = self.terrain.positions(u + _NORMAL_STEP, v) - ground.positions
        dv = self.terrain.positions(u, v + _NORMAL_STEP) - ground.positions
        normals[on] = _unit(np.cross(du, dv))
        material[on] = ground_material(
            normals[on, 2], ground.road, ground.water, ground.pile, ground.inside
        )
        hidden[on] = self._inside_bodies(ground.positions, near_body[on])
        positions[off] = self.blobs.positions(body[off], parameters[off])
        normals[off] = self.blobs.normals(body[off], parameters[off])
        kinds = np.array([Material.BOULDER, Material.TREE, Material.BUSH], dtype=np.uint8)
        material[off] = kinds[self.blobs.kind[body[off]]]
        below = self.terrain.positions(positions[off, 0], positions[off, 1])[:, 2]
        hidden[off] = positions[off, 2] < below
        return SurfacePoints(positions, normals, material, lane, inside, hidden)

    def _inside_bodies(self, positions: Float64, candidates: Bool) -> Bool:
        """Say which points lie inside one of the three nearest bodies."""
        inside = np.zeros(len(positions), dtype=bool)
        rows = np.flatnonzero(candidates)
        if self._tree is None or len(rows) == 0:
            return inside
        nearest = min(3, len(self.blobs.kind))
        _, bodies = self._tree.query(positions[rows, :2], k=range(1, nearest + 1))
        for column in range(nearest):
            inside[rows] |= self.blobs.contain(positions[rows], bodies[:, column])
        return inside

    # Coarse heights, for shadows

    def height_map(self, step: float) -> Float64:
        """Return the upper height over a grid, (rows along y, columns along x), bodies included.

        Row 0 lies at ``-HALF_Y``, column 0 at ``-HALF_X``; `step` design metres apart.
        """
        columns, rows = int(2 * HALF_X / step) + 1, int(2 * HALF_Y / step) + 1
        x, y = np.meshgrid(np.arange(columns) * step - HALF_X, np.arange(rows) * step - HALF_Y)
        height = self.terrain.positions(x.ravel(), y.ravel())[:, 2].reshape(rows, columns)
        for centre, radii, kind in zip(
            self.blobs.centres, self.blobs.radii, self.blobs.kind, strict=True
        ):
            full = 0.8 if kind == ROCK else 0.9 if kind == BUSH else 1.0
            c0 = max(int((centre[0] - radii[0] + HALF_X) / step), 0)
            r0 = max(int((centre[1] - radii[1] + HALF_Y) / step), 0)
            c1 = int((centre[0] + radii[0] + HALF_X) / step) + 2
            r1 = int((centre[1] + radii[1] + HALF_Y) / step) + 2
            window = height[r0:r1, c0:c1]
            dx = (x[r0:r1, c0:c1] - centre[0]) / radii[0]
            dy = (y[r0:r1, c0:c1] - centre[1]) / radii[1]
            top = np.sqrt(np.maximum(full**2 - dx**2 - dy**2, 0.0))
            np.maximum(window, np.where(top > 0, centre[2] + radii[2] * top, -np.inf), out=window)
        return height


def ground_material(
    up: Float64, road: Float64, water: Float64, pile: Float64, inside: Float64
) -> UInt8:
    """Decide what the ground is made of, (N,), from its slope and what stands or lies there."""
    material = np.where(inside > -1.5, np.uint8(Material.BENCH), np.uint8(Material.GRASSLAND))
    material[(up < _STEEP) & (inside > -3.0)] = Material.ROCK_FACE
    material[(road > 0.5) & (up > _STEEP)] = Material.ROAD
    on_pile = pile >= 0
    kinds = np.array(PILE_MATERIALS, dtype=np.uint8)
    material[on_pile] = kinds[pile[on_pile].astype(np.int64) % len(kinds)]
    material[water > 0.0] = Material.WATER
    return material


def _unit(vectors: Float64) -> Float64:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    result: Float64 = vectors / np.maximum(length, 1e-12)
    return result


def _morton(positions: Float64) -> Int64:
    """Interleave the bits of x and y in cells of 4 design metres: neighbours get close numbers."""
    cell = ((positions[:, :2] + (HALF_X + 8.0, HALF_Y + 8.0)) / 4.0).astype(np.int64)
    cell = np.clip(cell, 0, 127)
    code = np.zeros(len(cell), dtype=np.int64)
    for bit in range(7):
        code |= ((cell[:, 0] >> bit) & 1) << (2 * bit)
        code |= ((cell[:, 1] >> bit) & 1) << (2 * bit + 1)
    return code
