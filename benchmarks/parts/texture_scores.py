"""Colours of a textured mesh against the truth of a synthetic quarry; see textures.py."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from terraport_payload.types import AnyFloat, Float32, Float64, Int32, UInt8
from terraport_pipeline.engines.cameras import PhotoCamera
from terraport_pipeline.engines.pictures import render_mesh
from terraport_pipeline.engines.rays import Hits, RayScene
from terraport_pipeline.engines.texturing import Texturing, textured_colours
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.synth.camera_eye import NOTHING, TRUCK, CameraEye

__all__ = ["ColouredMesh", "Score", "ghost_share", "score_surface", "score_views"]

APART = 60.0
"""Grey levels (sum over channels) by which truck and ground must differ to be told apart."""


@dataclass(frozen=True, slots=True, eq=False)
class ColouredMesh:
    """What one method made, scene frame of the truth."""

    vertices: Float32
    faces: Int32
    colours: UInt8
    texturing: Texturing | None = None


@dataclass(frozen=True, slots=True)
class Score:
    """How far colours are from the truth."""

    psnr_db: float
    """Of all pixels and channels, sRGB."""
    matched_db: float
    """After one factor per channel on the whole: exposure is a matter of taste."""
    median_db: float
    """PSNR of the median absolute error after that factor: what most of the surface looks like."""
    seen: float
    """Share of the true pixels that the mesh covers."""


def score_views(
    mesh: ColouredMesh,
    views: Sequence[View],
    truths: Sequence[tuple[Float32, UInt8]],
) -> tuple[Score, list[UInt8]]:
    """Draw a mesh from cameras whose photos it never saw, and compare.

    Returns the score over all views and the pictures.
    """
    scene = RayScene(mesh.vertices, mesh.faces)
    errors, pictures, real, hit = [], [], 0, 0
    for view, (colours, what) in zip(views, truths, strict=True):
        size = (view.lens.width, view.lens.height)
        camera = PhotoCamera(view)
        picture = render_mesh(
            mesh.vertices,
            mesh.faces,
            camera,
            size,
            colours=mesh.colours,
            texturing=mesh.texturing,
            relief=0.0,
            shadows=False,
            supersample=2,
            scene=scene,
        )
        origins, headings = camera.rays(*size)
        met = scene.closest_hit(origins, headings)[1].reshape(size[1], size[0]) >= 0
        in_truth = what != NOTHING
        both = met & in_truth
        real, hit = real + int(in_truth.sum()), hit + int(both.sum())
        errors.append((picture[both].astype(np.float32), colours[both]))
        pictures.append(picture)
    rendered = np.concatenate([pair[0] for pair in errors])
    true = np.concatenate([pair[1] for pair in errors])
    return _score(rendered, true, hit / max(real, 1)), pictures


def score_surface(
    mesh: ColouredMesh, eye: CameraEye, *, count: int, texel_m: float, seed: int = 0
) -> Score:
    """Compare at places spread evenly over the mesh, seen by nobody in particular."""
    rng = np.random.default_rng(seed)
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    total = np.cumsum(length)
    spot = (np.arange(count) + rng.uniform(size=count)) / count * total[-1]
    face = np.minimum(np.searchsorted(total, spot), len(total) - 1)
    root, along = np.sqrt(rng.uniform(size=count)), rng.uniform(size=count)
    u, v = root * (1 - along), root * along
    places = (
        corners[face, 0] * (1 - u - v)[:, None]
        + corners[face, 1] * u[:, None]
        + corners[face, 2] * v[:, None]
    )
    unit = normal[face] / np.maximum(length[face], 1e-12)[:, None]
    reach = 10.0 * texel_m
    nearest = eye.rays.intersect(places + reach * unit, -unit)
    near = np.flatnonzero((nearest.face >= 0) & (np.abs(nearest.t - reach) < reach))
    true = eye.colours_at(
        Hits(nearest.t[near], nearest.face[near], nearest.u[near], nearest.v[near]), texel_m
    )
    here = Hits(
        np.ones(len(near), np.float32),
        face[near].astype(np.int32),
        u[near].astype(np.float32),
        v[near].astype(np.float32),
    )
    rendered = _colours(mesh, here, np.full(len(near), texel_m, np.float32))
    return _score(rendered, true.astype(np.float32), len(near) / count)


def ghost_share(
    mesh: ColouredMesh,
    eye: CameraEye,
    views: Sequence[View],
    photos: Sequence[UInt8],
    masks: Sequence[UInt8],
) -> float:
    """Share of the trucks' pixels that a texture kept.

    In every photo, at every pixel of its truck: the ground behind it, coloured by the mesh, is a
    ghost where that colour is nearer to the photo's truck than to the true ground (where these two
    can be told apart).
    """
    scene = RayScene(mesh.vertices, mesh.faces)
    ghosts = judged = 0
    for view, photo, mask in zip(views, photos, masks, strict=True):
        row, column = np.nonzero(mask == 255)
        if len(row) == 0:
            continue
        pixels = np.stack([column + 0.5, row + 0.5], axis=1)
        rays = view.rays(pixels).astype(np.float32)
        hits = scene.intersect(np.broadcast_to(view.position, rays.shape), rays)
        met = np.flatnonzero(hits.face >= 0)
        met_hits = Hits(hits.t[met], hits.face[met], hits.u[met], hits.v[met])
        rendered = _colours(mesh, met_hits, met_hits.t / np.float32(view.lens.fx))
        truck = photo[row[met], column[met]].astype(np.float32)
        ground = eye.colours_along(view, pixels[met])
        apart = np.abs(truck - ground).sum(axis=1) > APART
        nearer = np.abs(rendered - truck).sum(axis=1) < np.abs(rendered - ground).sum(axis=1)
        ghosts += int((apart & nearer).sum())
        judged += int(apart.sum())
    return ghosts / max(judged, 1)


def _colours(mesh: ColouredMesh, hits: Hits, pixel_m: AnyFloat) -> Float32:
    corner = mesh.faces[hits.face]
    u, v = hits.u[:, None], hits.v[:, None]
    a, b, c = (mesh.colours[corner[:, k]].astype(np.float32) for k in range(3))
    colours: Float32 = a * (1 - u - v) + b * u + c * v
    if mesh.texturing is not None:
        textured_colours(mesh.texturing, mesh.vertices, mesh.faces, hits, pixel_m, colours)
    return colours


def _score(rendered: Float32, true: Float32, seen: float) -> Score:
    rendered, true = rendered.astype(np.float64), true.astype(np.float64)
    factor = (rendered * true).sum(axis=0) / np.maximum((rendered * rendered).sum(axis=0), 1e-9)
    matched = rendered * factor - true
    return Score(
        _db(float(np.mean(np.square(rendered - true)))),
        _db(float(np.mean(np.square(matched)))),
        _db(float(np.median(np.abs(matched).mean(axis=1))) ** 2),
        seen,
    )


def _db(square: float) -> float:
    return float(10 * np.log10(255.0**2 / max(square, 1e-9)))


def truth_of(eye: CameraEye, views: Sequence[View]) -> list[tuple[Float32, UInt8]]:
    """Return what the views see in the day's light, without truck or camera errors."""
    seen: list[tuple[Float32, UInt8]] = []
    for view in views:
        picture = eye.look(view)
        assert not (picture.what == TRUCK).any()
        seen.append((picture.colours, picture.what))
    return seen


def undistort(photo: UInt8, view: View, focal: float) -> UInt8:
    """Turn a photo into a pinhole's: what engines that know no distortion want."""
    width, height = view.lens.width, view.lens.height
    column, row = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack(
        [(column - width / 2) / focal, (row - height / 2) / focal, np.ones_like(column)], axis=-1
    ).reshape(-1, 3)
    pixels: Float64 = view.lens.project(rays) - 0.5
    x = np.nan_to_num(pixels[:, 0], nan=-1.0)
    y = np.nan_to_num(pixels[:, 1], nan=-1.0)
    x, y = np.clip(x, 0, width - 1.001), np.clip(y, 0, height - 1.001)
    left, top = x.astype(np.int64), y.astype(np.int64)
    s, t = (x - left)[:, None], (y - top)[:, None]
    mixed = (photo[top, left] * (1 - s) + photo[top, left + 1] * s) * (1 - t)
    mixed += (photo[top + 1, left] * (1 - s) + photo[top + 1, left + 1] * s) * t
    return np.round(mixed).astype(np.uint8).reshape(height, width, 3)
