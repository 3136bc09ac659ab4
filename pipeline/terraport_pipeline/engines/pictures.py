"""Pictures without a display: meshes by ray casting, point clouds by splats.

Light: a sun from the upper left of a north-up picture, sky light from above, optional cast
shadows. Photographed colours already hold the light of the day, so they are shaded softly
(``relief`` below 1); flat colours (regions, segments) take the full range.

Measured, 1280 x 720 of a 1 M-face mesh with shadows on two busy cores: 0.8 s, with supersample 2
3 s.
"""

from __future__ import annotations

import io
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from os import cpu_count
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from terraport_payload.types import AnyFloat, Float32, Float64, Int32, UInt8
from terraport_pipeline.engines.cameras import Camera, PhotoCamera
from terraport_pipeline.engines.rays import Hits, RayScene
from terraport_pipeline.engines.texturing import Texturing, textured_colours

__all__ = [
    "Tint",
    "encode_jpeg",
    "encode_png",
    "reduced_jpeg",
    "render_mesh",
    "render_points",
    "save_png",
]

SUN: Final = np.array([-0.5507, 0.7208, -0.4205], dtype=np.float32)
"""Unit vector towards the sun: north-west, 46 degrees high (the cartographers' light)."""

SUN_LIGHT: Final = 0.95
SKY_LIGHT: Final = 0.38
"""Linear light on a surface that faces each; a surface facing both fully gets a bit over 1."""

HORIZON: Final = np.array([222, 230, 238], dtype=np.float32)
ZENITH: Final = np.array([134, 172, 214], dtype=np.float32)
NADIR: Final = np.array([196, 200, 204], dtype=np.float32)
"""Background colours by the direction looked in, sRGB."""

MAX_PIXELS: Final = 64_000_000
"""Largest picture including supersampling (the arrays need about 100 bytes a pixel)."""

BAND_ROWS: Final = 24
"""Rows of the finished picture drawn at once."""

MAX_THREADS: Final = 8

SHADOW_LIFT: Final = 2e-4
"""Shadow rays start this share of the scene's width off the face, or it would shadow itself."""

MAX_SPLAT_PX: Final = 6
"""Largest radius of a point: nearer points leave gaps rather than cost (2r + 1)^2 passes."""

DOME_RADIUS_PX: Final = 2
DOME_STRENGTH: Final = 160.0
"""Reach and depth of the eye-dome shading of point pictures."""


@dataclass(frozen=True, slots=True)
class Tint:
    """A colour mixed into some faces, to mark them."""

    first_face: int
    """This face and all after it are marked."""
    colour: tuple[float, float, float]
    """sRGB, 0..255."""
    share: float
    """0 leaves the faces, 1 paints over them."""


def render_mesh(
    vertices: Float32,
    faces: Int32,
    camera: Camera | PhotoCamera,
    size: tuple[int, int] = (1280, 720),
    *,
    colours: UInt8 | None = None,
    texturing: Texturing | None = None,
    tint: Tint | None = None,
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
    texturing : Texturing, optional
        Images for faces that have one; the others keep their vertex colours.
    tint : Tint, optional
        Faces that are marked.
    face_colours : ndarray of shape (F, 3), uint8, optional
        sRGB per face, flat; wins over ``colours`` and textures. Grey when neither is given.
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
    # (1) What is met by rays, and what becomes of it.
    width, height = _validate_size(size, supersample)
    rays = scene or RayScene(vertices, faces)
    lift = float(np.ptp(vertices, axis=0).max(initial=0.0)) * SHADOW_LIFT
    small = np.empty((size[1], size[0], 3), dtype=np.uint8)

    # (2) Bands of rows. Invariant: a band writes its own rows only, so bands may be drawn at
    # once.
    def draw(first_row: int) -> None:
        last_row = min(first_row + BAND_ROWS, size[1])
        band_rows = slice(first_row * supersample, last_row * supersample)
        origins, directions = camera.rays(width, height, band_rows)
        hits = rays.intersect(origins, directions)
        picture = np.empty((len(origins), 3), dtype=np.float32)
        missed = hits.face < 0
        picture[missed] = _sky(directions[missed], camera)
        # (3) Pixels that meet the mesh: light, colour, tint, in this order.
        met = np.flatnonzero(~missed)
        if len(met):
            met_hits = Hits(hits.t[met], hits.face[met], hits.u[met], hits.v[met])
            points = origins[met] + directions[met] * met_hits.t[:, None]
            flat = _face_normals(vertices, faces, met_hits.face, directions[met])
            shading = flat if normals is None else _smooth(normals, faces, met_hits, flat)
            lit = _sunlit(rays, points, flat, lift) if shadows else np.ones(len(met), np.float32)
            light = _light(shading, lit, relief)
            bare = _surface_colours(faces, met_hits, colours, face_colours)
            if texturing is not None and face_colours is None:
                pixel_m = camera.pixel_m(met_hits.t, height)
                textured_colours(texturing, vertices, faces, met_hits, pixel_m, bare)
            if tint is not None:
                marked = met_hits.face >= tint.first_face
                paint = np.array(tint.colour, dtype=np.float32)
                bare[marked] += tint.share * (paint - bare[marked])
            # (c^2.2 * light)^(1 / 2.2) = c * light^(1 / 2.2): the light is linear, colours sRGB.
            picture[met] = np.minimum(bare * np.power(light, 1 / 2.2)[:, None], 255)
        band = picture.reshape(-1, width, 3)
        small[first_row:last_row] = _shrink(band, supersample)

    # Bands keep the arrays in the cache, and NumPy and Embree let go of the lock.
    with ThreadPoolExecutor(max(1, min(cpu_count() or 1, MAX_THREADS))) as pool:
        list(pool.map(draw, range(0, size[1], BAND_ROWS)))
    return small


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
    # (1) Points in the picture, far to near.
    width, height = _validate_size(size, supersample)
    column, row, depth = camera.project(points, width, height)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    order = np.flatnonzero(inside)
    # Far to near: where an index repeats in an assignment, NumPy keeps the last, which is nearest.
    order = order[np.argsort(-depth[order], kind="stable")]
    picture = _sky(camera.rays(width, height)[1], camera)
    if len(order) == 0:
        return _shrink(picture.reshape(height, width, 3), supersample)
    # (2) Width of each splat.
    x, y = column[order].astype(np.int64), row[order].astype(np.int64)
    near = depth[order]
    scale = near if camera.kind == "perspective" else np.ones_like(near)
    reach = spacing_m / (2 * camera.half_height * scale) * height / 2
    radius = np.clip(np.ceil(reach), 0, MAX_SPLAT_PX).astype(np.int64)
    nearest = np.full(width * height, np.inf)
    shown = colours[order]
    largest = int(radius.max())
    # (3) One layer per pixel of the widest splat. Invariant: `nearest` and `picture` hold the
    # nearest splat of the layers so far.
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
    # (4) Edges darkened by the depth around them.
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


def reduced_jpeg(jpeg: bytes, width: int, quality: int) -> bytes:
    """Make a JPEG at most `width` pixels wide of another, its sides in proportion."""
    buffer = io.BytesIO()
    with Image.open(io.BytesIO(jpeg)) as image:
        image.thumbnail((width, width), Image.Resampling.LANCZOS)
        image.save(buffer, "JPEG", quality=quality, optimize=True, progressive=True)
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


def _sky(directions: Float32, camera: Camera | PhotoCamera) -> Float32:
    if camera.kind == "orthographic":
        return np.tile(HORIZON, (len(directions), 1))
    height = directions[:, 1:2]
    above = HORIZON + (ZENITH - HORIZON) * np.clip(height * 1.6, 0, 1)
    below = HORIZON + (NADIR - HORIZON) * np.clip(-height * 1.6, 0, 1)
    sky: Float32 = np.where(height >= 0, above, below)
    return sky


def _face_normals(vertices: Float32, faces: Int32, face: Int32, directions: Float32) -> Float32:
    """Compute unit normals of the faces hit, (R, 3), turned towards the viewer."""
    corner = faces[face]
    first = vertices[corner[:, 0]]
    ax, ay, az = (vertices[corner[:, 1]] - first).T
    bx, by, bz = (vertices[corner[:, 2]] - first).T
    normal = np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
    length = np.sqrt(np.einsum("ij,ij->i", normal, normal))[:, None]
    normal = np.where(length > 0, normal / np.maximum(length, 1e-30), -directions)
    away = np.einsum("ij,ij->i", normal, directions) > 0
    normal[away] *= -1
    unit: Float32 = normal.astype(np.float32, copy=False)
    return unit


def _smooth(normals: Float32, faces: Int32, hits: Hits, flat: Float32) -> Float32:
    """Interpolated normals, (R, 3), on the viewer's side of the face."""
    normal = _interpolate(normals, faces, hits)
    length = np.sqrt(np.einsum("ij,ij->i", normal, normal))[:, None]
    normal = np.where(length > 1e-6, normal / np.maximum(length, 1e-6), flat)
    away = np.einsum("ij,ij->i", normal, flat) < 0
    normal[away] *= -1
    return normal


def _interpolate(values: npt.NDArray[np.generic], faces: Int32, hits: Hits) -> Float32:
    corner = faces[hits.face]
    u, v = hits.u[:, None], hits.v[:, None]
    first, second, third = (values[corner[:, k]].astype(np.float32) for k in range(3))
    mixed: Float32 = first * (1 - u - v) + second * u + third * v
    return mixed


def _sunlit(rays: RayScene, points: Float32, flat: Float32, lift: float) -> Float32:
    """1 where the sun reaches the place, 0 in a cast shadow; (R,)."""
    lit = np.zeros(len(points), dtype=np.float32)
    facing = np.flatnonzero(flat @ SUN > 0)
    starts = points[facing] + flat[facing] * np.float32(lift)
    blocked = rays.closest_hit(starts, np.broadcast_to(SUN, starts.shape))[1]
    lit[facing[blocked < 0]] = 1.0
    return lit


def _light(normals: Float32, lit: Float32, relief: float) -> Float32:
    sun = SUN_LIGHT * np.clip(normals @ SUN, 0, None) * lit
    sky = SKY_LIGHT * (0.6 + 0.4 * normals[:, 1])
    # Linear light; relief 0 leaves the colour as it was photographed.
    light: Float32 = 1 + relief * (sun + sky - 1)
    return light


def _surface_colours(
    faces: Int32, hits: Hits, colours: UInt8 | None, face_colours: UInt8 | None
) -> Float32:
    if face_colours is not None:
        return face_colours[hits.face].astype(np.float32)
    if colours is not None:
        return _interpolate(colours, faces, hits)
    return np.full((len(hits.face), 3), 178, dtype=np.float32)


def _eye_dome(depth: Float64) -> Float64:
    """Darkening factor per pixel, (height, width): pixels behind their neighbours are darkened."""
    log_depth = np.log2(np.where(np.isfinite(depth), np.maximum(depth, 1e-3), np.nan))
    response = np.zeros_like(depth)
    for shift_y, shift_x in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        shift = (shift_y * DOME_RADIUS_PX, shift_x * DOME_RADIUS_PX)
        neighbour = np.roll(log_depth, shift, axis=(0, 1))
        response += np.nan_to_num(np.clip(log_depth - neighbour, 0, 0.05))
    return np.exp(-DOME_STRENGTH / 4 * response * 0.25)


def _shrink(picture: AnyFloat, supersample: int) -> UInt8:
    if supersample > 1:
        height, width = picture.shape[0] // supersample, picture.shape[1] // supersample
        blocks = picture.reshape(height, supersample, width, supersample, 3)
        picture = blocks.mean(axis=(1, 3))
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)
