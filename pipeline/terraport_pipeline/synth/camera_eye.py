"""What a camera sees of the quarry: rays to the true surface, its colour at every hit.

The truth mesh only says where a ray ends; the colour there is the procedural one, evaluated at the
hit, so a photo shows patterns far finer than the mesh. Pixels on an outline (another material,
another body, a jump in depth) take four rays more.

Frame: scene metres about the quarry's origin (x east, y up, z south); colours sRGB in 0..255.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from os import cpu_count
from typing import Final

import numpy as np

from terraport_payload.types import Bool, Float32, Float64, Int32, Int64, UInt8
from terraport_pipeline.engines.rays import Hits, RayScene
from terraport_pipeline.geometry.photos.lens import Lens, View
from terraport_pipeline.synth._photo_kernels import FIELDS, fields_at
from terraport_pipeline.synth.appearance import SUN, Sunlight, lit_colours
from terraport_pipeline.synth.blobs import ROCK, TREE
from terraport_pipeline.synth.materials import Material
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.surface import GROUND, Surface, SurfacePoints, ground_material
from terraport_pipeline.synth.truck import REACH, Truck

__all__ = ["NOTHING", "TRUCK", "TRUCK_SHADOW", "CameraEye", "Seen"]

NOTHING: Final = 253
TRUCK: Final = 254
"""Stand beside the materials in :attr:`Seen.what`."""
TRUCK_SHADOW: Final = 252

_CHUNK: Final = 250_000
"""Vertices evaluated at once."""

_BAND_PIXELS: Final = 120_000
"""Pixels drawn at once by one thread: about 40 MB of intermediate arrays."""

_DEPTH_JUMP: Final = 0.02
"""Neighbouring pixels whose depths differ by more than this share lie on an outline."""

_AROUND: Final = ((-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125))
"""Rays of a pixel on an outline, pixels off its middle: the rotated grid."""

_HAZE: Final = np.array([168.0, 172.0, 164.0])
_HAZE_DISTANCE: Final = 900.0
"""Colour of the distance, and design metres in which two thirds of the light come from it."""

_SUN_SCENE: Final = np.array([SUN[0], SUN[2], -SUN[1]])
_MAX_THREADS: Final = 8


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What one camera sees, before its own errors."""

    colours: Float32
    """(H, W, 3) sRGB, 0..255."""
    what: UInt8
    """(H, W) :class:`~.materials.Material`, :data:`TRUCK`, :data:`TRUCK_SHADOW` or
    :data:`NOTHING`, at the pixel's middle."""
    distance_m: Float32
    """(H, W) along the ray; ``inf`` where there is nothing."""


class CameraEye:
    """Looks at one quarry.

    Parameters
    ----------
    options : QuarryOptions
    edge_m : float
        Bound on the truth mesh's edges, metres. Time and memory (about 250 bytes a face) grow with
        its inverse square.
    threads : int, optional
        Threads that draw; the result does not depend on it.

    Attributes
    ----------
    surface : Surface
    rays : RayScene
        The truth mesh.
    vertices, faces : ndarray
        Of the truth mesh, scene metres.
    """

    def __init__(
        self, options: QuarryOptions, edge_m: float, *, threads: int | None = None
    ) -> None:
        self.options = options
        self.surface = Surface(options)
        self._sunlight = Sunlight(self.surface)
        body, parameters, positions, faces = self.surface.triangles(edge_m / options.scale)
        self._table = _vertex_table(self.surface, body, parameters)
        self.faces: Int32 = faces.astype(np.int32)
        self._body = body[faces[:, 0]].astype(np.int32)
        x, y, z = (positions * options.scale).astype(np.float32).T
        self.vertices: Float32 = np.ascontiguousarray(np.stack([x, z, -y], axis=1))
        # Bands run in parallel: each traces on its own thread.
        self.rays = RayScene(self.vertices, self.faces, threads=1)
        self._threads = max(1, min(threads or cpu_count() or 1, _MAX_THREADS))
        kinds = self.surface.blobs.kind
        self._kind = np.where(
            kinds == ROCK, Material.BOULDER, np.where(kinds == TREE, Material.TREE, Material.BUSH)
        ).astype(np.uint8)
        self._lens_rays: tuple[Lens, Float32] | None = None

    def look(self, view: View, truck: Truck | None = None) -> Seen:
        """Draw what a view sees.

        Parameters
        ----------
        view : View
        truck : Truck, optional
            Stands in the scene, with its shadow.

        Returns
        -------
        Seen
            60 bytes a pixel while it is made, 17 after.
        """
        lens = view.lens
        width, height = lens.width, lens.height
        local = self._rays_of(lens)
        colours = np.empty((height * width, 3), dtype=np.float32)
        what = np.empty(height * width, dtype=np.uint8)
        body = np.empty(height * width, dtype=np.int32)
        distance = np.empty(height * width, dtype=np.float32)
        step = max(1, _BAND_PIXELS // width) * width

        def draw(first: int) -> None:
            chunk = slice(first, first + step)
            headings = local[chunk] @ view.rotation.astype(np.float32)
            traced = self._trace(view, headings, truck)
            colours[chunk], what[chunk], body[chunk], distance[chunk] = traced

        def refine(rows: Int64) -> None:
            total = colours[rows].astype(np.float64)
            column, row = rows % width, rows // width
            for across, down in _AROUND:
                pixels = np.stack([column + (0.5 + across), row + (0.5 + down)], axis=1)
                total += self._trace(view, view.rays(pixels).astype(np.float32), truck)[0]
            colours[rows] = total / (1 + len(_AROUND))

        # One ray a pixel, then more along outlines only, where one ray would leave steps.
        with ThreadPoolExecutor(self._threads) as pool:
            list(pool.map(draw, range(0, height * width, step)))
            edge = np.flatnonzero(_outline(what, body, distance, height, width))
            list(pool.map(refine, np.array_split(edge, max(1, len(edge) // 60_000))))
        return Seen(
            colours.reshape(height, width, 3),
            what.reshape(height, width),
            distance.reshape(height, width),
        )

    def colours_along(self, view: View, pixels: Float64) -> Float32:
        """Return what single pixels (R, 2) of a view see, (R, 3) sRGB; one ray each, no truck."""
        return self._trace(view, view.rays(pixels).astype(np.float32), None)[0]

    def colours_at(self, hits: Hits, footprint_m: float) -> Float64:
        """Return the true colours of places on the truth mesh.

        Parameters
        ----------
        hits : Hits
            R meetings with :attr:`rays`, all on a face.
        footprint_m : float
            Width of what one colour averages.

        Returns
        -------
        ndarray of shape (R, 3), float64
            sRGB, 0..255, in the day's light.
        """
        return lit_colours(
            self._points(hits.face, hits.u, hits.v),
            self.surface,
            self._sunlight,
            self.options,
            footprint=footprint_m / self.options.scale,
        )

    def _rays_of(self, lens: Lens) -> Float32:
        """Directions of all pixels, camera frame; kept for the next photo of the same lens."""
        if self._lens_rays is None or self._lens_rays[0] != lens:
            column, row = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
            pixels = np.stack([column.ravel(), row.ravel()], axis=1)
            self._lens_rays = (lens, lens.unproject(pixels).astype(np.float32))
        return self._lens_rays[1]

    def _trace(
        self, view: View, headings: Float32, truck: Truck | None
    ) -> tuple[Float32, UInt8, Int32, Float32]:
        count = len(headings)
        origin = view.position.astype(np.float32)
        # (1) What meets nothing shows the land around or the sky.
        hits = self.rays.intersect(np.broadcast_to(origin, headings.shape), headings)
        colours = np.empty((count, 3), dtype=np.float32)
        missed = np.flatnonzero(hits.face < 0)
        colours[missed] = self._beyond(view, headings[missed])
        what = np.full(count, NOTHING, dtype=np.uint8)
        body = np.full(count, -2, dtype=np.int32)
        distance = hits.t.copy()
        # (2) Material and light of what is met, by the width of a pixel there.
        met = np.flatnonzero(hits.face >= 0)
        if len(met):
            face = hits.face[met]
            points = self._points(face, hits.u[met], hits.v[met])
            body[met] = self._body[face]
            facing = np.abs(np.einsum("ij,ij->i", headings[met] @ _TO_DESIGN, points.normals))
            wide = hits.t[met] / view.lens.fx / np.sqrt(np.maximum(facing, 0.1))
            what[met] = points.material
            free: float | Float64 = 1.0
            if truck is not None:
                free = _sun_past(truck, points.positions * self.options.scale)
                what[met[free < 1.0]] = TRUCK_SHADOW
            colours[met] = lit_colours(
                points,
                self.surface,
                self._sunlight,
                self.options,
                footprint=wide / self.options.scale,
                unblocked=free,
            )
        # (3) The truck in front of it.
        if truck is not None:
            self._draw_truck(view, headings, truck, colours, what, body, distance)
        return colours, what, body, distance

    def _points(self, face: Int32, u: Float32, v: Float32) -> SurfacePoints:
        fields = fields_at(self._table, self.faces, face, u, v)
        positions, normals = np.ascontiguousarray(fields[:, :3]), fields[:, 3:6]
        lane, inside, road, water, pile = fields[:, 6:].T
        material = ground_material(normals[:, 2], road, water, pile, inside)
        body = self._body[face]
        off = body != GROUND
        material[off] = self._kind[body[off]]
        return SurfacePoints(
            positions, normals, material, lane, inside, np.zeros(len(face), dtype=bool)
        )

    def _beyond(self, view: View, headings: Float32) -> Float64:
        """Colours where the site ends: level grassland without end, then haze, (R, 3).

        What is not surveyed is in the photos all the same.
        """
        colours = np.tile(_HAZE, (len(headings), 1))
        down = np.flatnonzero(headings[:, 1] < -0.02)
        t = view.position[1] / -headings[down, 1].astype(np.float64)
        on_plain = (view.position + headings[down] * t[:, None]) / self.options.scale
        count, zero = len(down), np.zeros(len(down))
        points = SurfacePoints(
            np.stack([on_plain[:, 0], -on_plain[:, 2], zero], axis=1),
            np.tile([0.0, 0.0, 1.0], (count, 1)),
            np.full(count, Material.GRASSLAND, dtype=np.uint8),
            zero,
            np.full(count, -50.0),
            np.zeros(count, dtype=bool),
        )
        wide = t / view.lens.fx / np.sqrt(np.maximum(-headings[down, 1], 0.1))
        seen = lit_colours(
            points,
            self.surface,
            self._sunlight,
            self.options,
            footprint=wide / self.options.scale,
        )
        clear = np.exp(-t / (_HAZE_DISTANCE * self.options.scale))[:, None]
        colours[down] += clear * (seen - colours[down])
        return colours

    def _draw_truck(
        self,
        view: View,
        headings: Float32,
        truck: Truck,
        colours: Float32,
        what: UInt8,
        body: Int32,
        distance: Float32,
    ) -> None:
        """Draw the truck over the rays that pass near it, in place."""
        towards = truck.position - view.position
        away = float(np.linalg.norm(towards))
        cosine = headings @ (towards / away).astype(np.float32)
        near = np.flatnonzero(cosine > np.cos(np.arctan2(8.0 * truck.scale, away)))
        if len(near) == 0:
            return
        rays = headings[near].astype(np.float64)
        t, paint, normals = truck.intersect(np.broadcast_to(view.position, rays.shape), rays)
        front = t < distance[near]
        rows = near[front]
        light = 0.22 * (0.5 + 0.5 * normals[front, 1])
        light += 0.78 * np.clip(normals[front] @ _SUN_SCENE, 0.0, 1.0)
        dark = self.options.shadows * (1.0 - light)
        colours[rows] = paint[front] * (1.0 - dark)[:, None]
        what[rows], body[rows] = TRUCK, -3
        distance[rows] = t[front]


_TO_DESIGN: Final = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], dtype=np.float32)
"""Rows of scene vectors times this are design vectors: x, -z, y."""


def _sun_past(truck: Truck, positions: Float64) -> Float64:
    """0 where the truck stands between a place (metres, x east, y north) and the sun, (N,)."""
    free = np.ones(len(positions))
    scene = np.stack([positions[:, 0], positions[:, 2], -positions[:, 1]], axis=1)
    reach = REACH * truck.scale
    near = np.flatnonzero((np.abs(scene - truck.position) < reach).all(axis=1))
    if len(near):
        t, _, _ = truck.intersect(scene[near], np.broadcast_to(_SUN_SCENE, (len(near), 3)))
        free[near[np.isfinite(t)]] = 0.0
    return free


def _vertex_table(surface: Surface, body: Int64, parameters: Float64) -> Float32:
    table = np.empty((len(body), FIELDS), dtype=np.float32)
    for first in range(0, len(body), _CHUNK):
        chunk = slice(first, first + _CHUNK)
        points = surface.evaluate_at(body[chunk], parameters[chunk])
        table[chunk, :3], table[chunk, 3:6] = points.positions, points.normals
        table[chunk, 6], table[chunk, 7] = points.lane, points.inside
        table[chunk, 8:10], table[chunk, 10] = 0.0, -1.0
        ground = first + np.flatnonzero(body[chunk] == GROUND)
        sample = surface.terrain.sample(parameters[ground, 0], parameters[ground, 1])
        table[ground, 8], table[ground, 9] = sample.road, sample.water
        table[ground, 10] = sample.pile
    return table


def _outline(what: UInt8, body: Int32, distance: Float32, height: int, width: int) -> Bool:
    """Mark pixels that differ from a neighbour, (H * W,)."""
    edge = np.zeros((height, width), dtype=bool)
    kind, thing = what.reshape(height, width), body.reshape(height, width)
    depth = np.minimum(distance, np.float32(1e6)).reshape(height, width)
    for a, b in (
        ((slice(None), slice(1, None)), (slice(None), slice(None, -1))),
        ((slice(1, None), slice(None)), (slice(None, -1), slice(None))),
    ):
        jump = np.abs(depth[a] - depth[b]) > _DEPTH_JUMP * np.minimum(depth[a], depth[b])
        differ = (kind[a] != kind[b]) | (thing[a] != thing[b]) | jump
        edge[a] |= differ
        edge[b] |= differ
    return edge.ravel()
