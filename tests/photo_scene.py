"""A small place and photos of it, rendered by ray casting: what the tests of texturing look at.

Bumpy ground of 40 x 40 m with a block 6 m high on it, seen by six cameras. Each photo has its own
exposure, and in each a crate that is not in the mesh stands elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from terraport_payload.types import Float32, Float64, Int32, UInt8
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.geometry.mesh.vertex_normals import vertex_normals
from terraport_pipeline.geometry.photos.lens import Lens, View
from terraport_pipeline.model import Mesh

SIDE_M = 40.0
CELLS = 80
BLOCK = (14.0, 20.0, 16.0, 24.0)
"""Least and greatest x, least and greatest z of the block, metres."""
CRATE_M = 3.0
CRATE = (250, 30, 210)
"""A colour that nothing else has."""
EXPOSURES = (1.0, 0.8, 1.25, 1.1, 0.9, 0.75)
"""Factors in linear light."""
LENS = Lens(width=320, height=240, fx=300.0, fy=300.0, cx=160.0, cy=120.0, radial=(-0.05, 0.01))


def ground(cells: int = CELLS) -> tuple[Float32, Int32]:
    """Rolling ground with a block that stands out of it, as vertices and faces."""
    x, z = np.meshgrid(np.linspace(0, SIDE_M, cells + 1), np.linspace(0, SIDE_M, cells + 1))
    y = 0.4 * np.sin(x * 0.9) * np.cos(z * 0.7)
    inside = (x > BLOCK[0]) & (x < BLOCK[1]) & (z > BLOCK[2]) & (z < BLOCK[3])
    y = np.where(inside, 6.0, y)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    first = np.stack([corner, corner + cells + 1, corner + 1], axis=1)
    second = np.stack([corner + 1, corner + cells + 1, corner + cells + 2], axis=1)
    vertices = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    return vertices.astype(np.float32), np.concatenate([first, second]).astype(np.int32)


def paint(points: Float64) -> Float64:
    """True sRGB levels of places, (N, 3)."""
    x, y, z = points[:, 0], points[:, 1], points[:, 2]
    wave = np.sin(1.1 * x + 0.3 * z) + np.sin(0.9 * z - 0.4 * y) + 0.5 * np.sin(5.0 * x + 4.0 * z)
    return np.stack([125 + 18 * wave, 115 + 14 * wave + 0.5 * x, 95 + 10 * wave + 0.4 * z], axis=1)


def expose(levels: Float64, factor: float) -> Float64:
    """sRGB levels after a factor in linear light (IEC 61966-2-1)."""
    encoded = levels / 255.0
    light = (
        np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4) * factor
    )
    back = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.clip(255.0 * back, 0.0, 255.0)


def look_at(name: str, position: tuple[float, float, float], target: tuple[float, ...]) -> View:
    """A camera at a place that looks at another."""
    forward = np.subtract(target, position).astype(np.float64)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, -1.0))
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return View(name, LENS, rotation, np.array(position, np.float64))


def crate_place(number: int) -> tuple[float, float]:
    """Where the crate stands in a photo: middle, x and z."""
    return 5.0 + 5.0 * (number % 3), 6.0 + 4.0 * number


@dataclass(frozen=True)
class PhotoScene:
    """The mesh, the views, and the photos as a store of them."""

    mesh: Mesh
    views: list[View]
    photos: list[UInt8]

    def get(self, view_index: int, scale: int = 1) -> UInt8:
        """Photo, every scale-th pixel."""
        return self.photos[view_index][::scale, ::scale]

    @property
    def centres(self) -> Float64:
        """Middle of every face."""
        return self.mesh.vertices[self.mesh.faces].mean(axis=1, dtype=np.float64)


def photo_scene(*, exposures: tuple[float, ...] = EXPOSURES, crate: bool = True) -> PhotoScene:
    """Render the ground from six views, each with its exposure; a crate moves between them."""
    vertices, faces = ground()
    colours = np.rint(paint(vertices.astype(np.float64))).astype(np.uint8)
    mesh = Mesh(vertices, faces, vertex_normals(vertices, faces), colours)
    rays = RayScene(vertices, faces, threads=1)
    places = [(6, 10), (20, 10), (34, 10), (6, 30), (20, 30), (34, 30)]
    views = [
        look_at(f"{number}.jpg", (x, 38.0, z), (0.6 * x + 8.0, 0.0, 0.6 * z + 8.0))
        for number, (x, z) in enumerate(places)
    ]
    u, v = np.meshgrid(np.arange(LENS.width) + 0.5, np.arange(LENS.height) + 0.5)
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    photos = []
    for number, view in enumerate(views):
        rows = view.rays(pixels)
        distance, _ = rays.closest_hit(np.broadcast_to(view.position, rows.shape), rows)
        met = np.isfinite(distance)
        points = view.position + rows[met] * distance[met, None]
        levels = paint(points)
        if crate:
            x, z = crate_place(number)
            on = np.maximum(abs(points[:, 0] - x), abs(points[:, 2] - z)) < 0.5 * CRATE_M
            levels[on] = CRATE
        picture = np.full((len(pixels), 3), 200.0)
        picture[met] = expose(levels, exposures[number])
        photos.append(np.rint(picture).astype(np.uint8).reshape(LENS.height, LENS.width, 3))
    return PhotoScene(mesh, views, photos)
