"""Pictures without a display: meshes by ray casting, point clouds by splats.

Light: a sun from the upper left of a north-up picture, sky light from above, optional cast
shadows. Photographed colours already hold the light of the day, so they are shaded softly
(``relief`` below 1); flat colours (regions, segments) take the full range.

Measured, 1280 x 720 of a 1 M-face mesh with shadows, two cores: 1.0 s.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from terraport_pipeline.engines.cameras import Camera
from terraport_pipeline.engines.rays import Hits, RayScene
from terraport_pipeline.model import Float32, Float64, Int32, UInt8

__all__ = ["encode_jpeg", "encode_png", "render_mesh", "render_points", "save_png"]

SUN: Final = np.array([-0.55, 0.72, -0.42]) / np.linalg.norm([-0.55, 0.72, -0.42])
"""Unit vector towards the sun: north-west, 46 degrees high (the cartographers' light)."""

SUN_LIGHT: Final = 0.95
SKY_LIGHT: Final = 0.38
"""Linear light on a surface that faces each; a surface facing both fully gets a bit over 1."""

HORIZON: Final = np.array([222.0, 230.0, 238.0])
ZENITH: Final = np.array([134.0, 172.0, 214.0])
NADIR: Final = np.array([196.0, 200.0, 204.0])
"""Background colours by the direction looked in, sRGB."""

MAX_PIXELS: Final = 64_000_000
"""Largest picture including supersampling (the arrays need about 100 bytes a pixel)."""

MAX_SPLAT_PX: Final = 6
"""Largest radius of a point: nearer points leave gaps rather than cost (2r + 1)^2 passes."""

DOME_RADIUS_PX: Final = 2
DOME_STRENGTH: Final = 160.0
"""Reach and depth of the eye-dome shading of point pictures."""


def render_mesh(
    vertices: Float32,
    faces: Int32,
    camera: Camera,
    size: tuple[int, int] = (1280, 720),
    *,
    colours: UInt8 | None = None,
    face_colours: UInt8 | None = None,
    normals: Float32 | None = None,
    relief: float = 1.0,
    shadows: bool = True,
    supersample: int = 1,
    scene: RayScene | None = None,
) -> UInt8:
    """Draw a mesh.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres, scene frame.
    faces : ndarray of shape (F, 3), int32
        Vertex indices; both sides are drawn.
    camera : Camera
        See :mod:`terraport_pipeline.engines.cameras`.
    size : (int, int)
        Width and height in pixels.
    colours : ndarray of shape (V, 3), uint8, optional
        sRGB per vertex, interpolated over the face.
    face_colours : ndarray of shape (F, 3), uint8, optional
        sRGB per face, flat; wins over ``colours``. Grey when neither is given.
    normals : ndarray of shape (V, 3), float32, optional
        Unit normals for smooth shading; without them each face is shaded flat, which shows it.
    relief : float
        0 draws the bare colours, 1 the full light and shadow.
    shadows : bool
        Cast shadows (one more ray per lit pixel).
    supersample : int
        Rays per pixel and axis, 1..4.
    scene : RayScene, optional
        The same mesh, already built, to draw it again without building it again.

    Returns
    -------
    ndarray of shape (height, width, 3), uint8
        sRGB.

    Raises
    ------
    ValueError
        For a size that is not positive or too large.
    """
    width, height = _validate_size(size, supersample)
    rays = scene or RayScene(vertices, faces)
    origins, directions = camera.rays(width, height)
    hits = rays.intersect(origins, directions)
    picture = np.empty((width * height, 3))
    missed = hits.face < 0
    picture[missed] = _sky(directions[missed], camera)
    met = np.flatnonzero(~missed)
    if len(met):
        hits = Hits(hits.t[met], hits.face[met], hits.u[met], hits.v[met])
        places = origins[met] + directions[met] * hits.t[:, None]
        flat = _face_normals(vertices, faces, hits.face, directions[met])
        shading = flat if normals is None else _smooth(normals, faces, hits, flat)
        lit = _sunlit(rays, places, flat, vertices) if shadows else np.ones(len(met))
        light = _light(shading, lit, relief)
        bare = _surface_colours(faces, hits, colours, face_colours)
        # (c^2.2 * light)^(1 / 2.2) = c * light^(1 / 2.2): the light is linear, the colours sRGB.
        picture[met] = np.minimum(bare * np.power(light, 1 / 2.2)[:, None], 255)
    return _shrink(picture.reshape(height, width, 3), supersample)


def render_points(
    points: Float32,
    colours: UInt8,
    camera: Camera,
    size: tuple[int, int] = (1280, 720),
    *,
    spacing_m: float,
    supersample: int = 1,
) -> UInt8:
    """Draw a point cloud: each point a square splat as wide as the spacing, nearest in front.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float32
        Metres, scene frame.
    colours : ndarray of shape (N, 3), uint8
        sRGB.
    camera : Camera
        See :mod:`terraport_pipeline.engines.cameras`.
    size : (int, int)
        Width and height in pixels.
    spacing_m : float
        Typical distance between neighbouring points.
    supersample : int
        Pixels per pixel and axis, 1..4.

    Returns
    -------
    ndarray of shape (height, width, 3), uint8
        sRGB, edges darkened by eye-dome lighting (Boucheny 2009), so that shapes show without
        normals.
    """
    width, height = _validate_size(size, supersample)
    column, row, depth = camera.project(points, width, height)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    order = np.flatnonzero(inside)
    # Far to near: where an index repeats in an assignment, NumPy keeps the last, which is nearest.
    order = order[np.argsort(-depth[order], kind="stable")]
    picture = _sky(camera.rays(width, height)[1], camera)
    if len(order) == 0:
        return _shrink(picture.reshape(height, width, 3), supersample)
    x, y = column[order].astype(np.int64), row[order].astype(np.int64)
    near = depth[order]
    scale = near if camera.kind == "perspective" else np.ones_like(near)
    reach = spacing_m / (2 * camera.half_height * scale) * height / 2
    radius = np.clip(np.ceil(reach), 0, MAX_SPLAT_PX).astype(np.int64)
    nearest = np.full(width * height, np.inf)
    shown = colours[order]
    largest = int(radius.max())
    for shift_y in range(-largest, largest + 1):
        for shift_x in range(-largest, largest + 1):
            wide = radius >= max(abs(shift_x), abs(shift_y))
            px, py = x[wide] + shift_x, y[wide] + shift_y
            ok = (px >= 0) & (px < width) & (py >= 0) & (py < height)
            pixel = (py * width + px)[ok]
            layer = np.full(width * height, np.inf)
            layer[pixel] = near[wide][ok]
            front = layer < nearest
            paint = np.zeros((width * height, 3), np.uint8)
            paint[pixel] = shown[wide][ok]
            picture[front] = paint[front]
            nearest[front] = layer[front]
    shade = _eye_dome(nearest.reshape(height, width))
    drawn = np.isfinite(nearest)
    picture[drawn] *= shade.reshape(-1, 1)[drawn]
    return _shrink(picture.reshape(height, width, 3), supersample)


def encode_png(image: UInt8) -> bytes:
    """Write a picture as PNG bytes (lossless; flat colours).

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        sRGB.

    Returns
    -------
    bytes
    """
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "PNG")
    return buffer.getvalue()


def encode_jpeg(image: UInt8, quality: int = 85) -> bytes:
    """Write a picture as JPEG bytes (photographic content; about a tenth of the PNG).

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        sRGB.
    quality : int
        1..95.

    Returns
    -------
    bytes
    """
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "JPEG", quality=quality, optimize=True, progressive=True)
    return buffer.getvalue()


def save_png(image: UInt8, path: Path) -> None:
    """Write a picture to a PNG file.

    Parameters
    ----------
    image : ndarray of shape (height, width, 3), uint8
        sRGB.
    path : Path
        Overwritten if it exists.
    """
    path.write_bytes(encode_png(image))


def _validate_size(size: tuple[int, int], supersample: int) -> tuple[int, int]:
    if not 1 <= supersample <= 4:
        raise ValueError(f"received supersample {supersample}, expected 1..4")
    width, height = size[0] * supersample, size[1] * supersample
    if width < 1 or height < 1 or width * height > MAX_PIXELS:
        raise ValueError(
            f"received a picture of {size[0]} x {size[1]} with supersample {supersample}, "
            f"expected at least 1 x 1 and at most {MAX_PIXELS} rays"
        )
    return width, height


def _sky(directions: Float32, camera: Camera) -> Float64:
    if camera.kind == "orthographic":
        return np.tile(HORIZON, (len(directions), 1))
    height = directions[:, 1:2].astype(np.float64)
    above = HORIZON + (ZENITH - HORIZON) * np.clip(height * 1.6, 0, 1)
    below = HORIZON + (NADIR - HORIZON) * np.clip(-height * 1.6, 0, 1)
    sky: Float64 = np.where(height >= 0, above, below)
    return sky


def _face_normals(vertices: Float32, faces: Int32, face: Int32, directions: Float32) -> Float64:
    """Compute unit normals of the faces hit, (R, 3), turned towards the viewer."""
    corner = faces[face]
    first = vertices[corner[:, 0]]
    ax, ay, az = (vertices[corner[:, 1]] - first).T.astype(np.float64)
    bx, by, bz = (vertices[corner[:, 2]] - first).T.astype(np.float64)
    normal = np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.where(length > 0, normal / np.maximum(length, 1e-30), -directions)
    away = np.einsum("ij,ij->i", normal, directions) > 0
    normal[away] *= -1
    return normal


def _smooth(normals: Float32, faces: Int32, hits: Hits, flat: Float64) -> Float64:
    """Interpolated normals, (R, 3), on the viewer's side of the face."""
    normal = _interpolate(normals.astype(np.float64), faces, hits)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.where(length > 1e-6, normal / np.maximum(length, 1e-6), flat)
    away = np.einsum("ij,ij->i", normal, flat) < 0
    normal[away] *= -1
    return normal


def _interpolate(values: npt.NDArray[np.floating], faces: Int32, hits: Hits) -> Float64:
    corner = faces[hits.face]
    u, v = hits.u[:, None].astype(np.float64), hits.v[:, None].astype(np.float64)
    mixed: Float64 = (
        values[corner[:, 0]] * (1 - u - v) + values[corner[:, 1]] * u + values[corner[:, 2]] * v
    )
    return mixed


def _sunlit(rays: RayScene, places: Float32, flat: Float64, vertices: Float32) -> Float64:
    """1 where the sun reaches the place, 0 in a cast shadow; (R,)."""
    lit = np.zeros(len(places))
    facing = np.flatnonzero(flat @ SUN > 0)
    # Lifted off the face by 1/5000 of the scene, or the face would shadow itself.
    lift = float(np.ptp(vertices, axis=0).max()) * 2e-4
    starts = (places[facing] + flat[facing] * lift).astype(np.float32)
    blocked = rays.closest_hit(starts, np.broadcast_to(SUN.astype(np.float32), starts.shape))[1]
    lit[facing[blocked < 0]] = 1.0
    return lit


def _light(normals: Float64, lit: Float64, relief: float) -> Float64:
    sun = SUN_LIGHT * np.clip(normals @ SUN, 0, None) * lit
    sky = SKY_LIGHT * (0.6 + 0.4 * normals[:, 1])
    # Linear light; relief 0 leaves the colour as it was photographed.
    light: Float64 = 1 + relief * (sun + sky - 1)
    return light


def _surface_colours(
    faces: Int32, hits: Hits, colours: UInt8 | None, face_colours: UInt8 | None
) -> Float64:
    if face_colours is not None:
        return face_colours[hits.face].astype(np.float64)
    if colours is not None:
        return _interpolate(colours.astype(np.float64), faces, hits)
    return np.full((len(hits.face), 3), 178.0)


def _eye_dome(depth: Float64) -> Float64:
    """Darkening factor per pixel, (height, width): pixels behind their neighbours are darkened."""
    log_depth = np.log2(np.where(np.isfinite(depth), np.maximum(depth, 1e-3), np.nan))
    response = np.zeros_like(depth)
    for shift_y, shift_x in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        shift = (shift_y * DOME_RADIUS_PX, shift_x * DOME_RADIUS_PX)
        neighbour = np.roll(log_depth, shift, axis=(0, 1))
        response += np.nan_to_num(np.clip(log_depth - neighbour, 0, 0.05))
    return np.exp(-DOME_STRENGTH / 4 * response * 0.25)


def _shrink(picture: Float64, supersample: int) -> UInt8:
    if supersample > 1:
        height, width = picture.shape[0] // supersample, picture.shape[1] // supersample
        blocks = picture.reshape(height, supersample, width, supersample, 3)
        picture = blocks.mean(axis=(1, 3))
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)
