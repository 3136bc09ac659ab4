"""A landing to look at: where, what is loaded there, and the mixed model as a client draws it.

At the rim of what is loaded, base and detail overlap by up to one base face. A client draws the
base *pushed back* along the line of sight by the measured deviation of the two levels, so that it
never pokes through detail; pictures do the same. Why, and why not sunk: see
``docs/topics/hand-off.md``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload import box_distances_m
from terraport_payload.types import Bool, Float32, Float64, Int32, UInt8
from terraport_pipeline.engines.cameras import Camera, eye_level, oblique
from terraport_pipeline.engines.pictures import Tint
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.engines.texturing import Texturing
from terraport_pipeline.geometry.cover.handoff_rays import hidden_base_faces
from terraport_pipeline.published.scene_model import SceneModel

__all__ = [
    "Landing",
    "MixedMesh",
    "choose_landing",
    "mixed_mesh",
    "view_from_above",
    "view_from_eye",
]

EYE_HEIGHT_M: Final = 1.7
LARGEST_RADIUS_M: Final = 60.0
"""The default radius of a landing; small scenes take a fifth of their width."""

BASE_TINT: Final = (60.0, 120.0, 230.0)
_TINT_SHARE: Final = 0.45
"""Mixed into base faces so that one sees where the base is shown."""

CANDIDATES: Final = 7
"""Places tried along each side of the inner half of the scene."""

STRIDE_M: Final = 0.8
"""Ground is level where it rises less than 0.24 m over a stride."""

LOOKS: Final = 48
"""Bearings tried to find an open view."""


@dataclass(frozen=True, slots=True)
class Landing:
    """A place to stand, and what is loaded around it."""

    position: tuple[float, float, float]
    """On the ground, metres, scene frame."""
    radius_m: float
    loaded: Bool
    """(S,) True where the segment's box comes within the radius."""


@dataclass(frozen=True, slots=True)
class MixedMesh:
    """One mesh of loaded detail and shown base."""

    vertices: Float32
    faces: Int32
    colours: UInt8
    normals: Float32
    base_from: int
    """The first face that belongs to the base."""
    texturing: Texturing | None
    tint: Tint
    """Of the base's faces."""


def choose_landing(model: SceneModel, rays: RayScene) -> Landing:
    """Land where a visitor would: on level ground with a wide view, in the middle of the scene.

    Parameters
    ----------
    model : SceneModel
        The scene.
    rays : RayScene
        Its detail.

    Returns
    -------
    Landing
        The same for the same scene.
    """
    vertices = model.detail.vertices
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    width = float(np.max((high - low)[[0, 2]]))
    radius = min(LARGEST_RADIUS_M, max(width / 5, 1.0))
    spots = _standing_places(vertices, low, high, rays)
    scores = [_views(spot, radius, rays).max() for spot in spots]
    position = tuple(float(value) for value in spots[int(np.argmax(scores))])
    distance = box_distances_m(model.segment_bounds, np.array(position))
    return Landing((position[0], position[1], position[2]), radius, distance <= radius)


def _standing_places(vertices: Float32, low: Float32, high: Float32, rays: RayScene) -> Float64:
    """Places on level ground over the inner half of the scene, (P, 3); at least one."""
    share = (np.arange(CANDIDATES) + 0.5) / CANDIDATES * 0.5 + 0.25
    x, z = np.meshgrid(low[0] + (high - low)[0] * share, low[2] + (high - low)[2] * share)
    top = float(high[1]) + 1.0
    starts = np.stack([x.ravel(), np.full(x.size, top), z.ravel()], axis=1)
    # Three rays a stride apart: level where they agree.
    heights = []
    for shift in ((0, 0, 0), (STRIDE_M, 0, 0), (0, 0, STRIDE_M)):
        downwards = np.broadcast_to([0.0, -1.0, 0.0], starts.shape)
        t, _ = rays.closest_hit(starts + shift, downwards)
        heights.append(np.where(np.isfinite(t), top - t, np.nan))
    rise = np.max(np.abs(np.array(heights[1:]) - heights[0]), axis=0)  # NaN: not level
    level = np.flatnonzero(rise < 0.3 * STRIDE_M)
    if len(level):
        return np.stack([starts[level, 0], heights[0][level], starts[level, 2]], axis=1)
    # No such place (a cliff, a ring): the vertex nearest to the middle.
    middle = (low + high) / 2
    near = np.argmin(np.square(vertices[:, [0, 2]] - middle[[0, 2]]).sum(axis=1))
    nearest: Float64 = vertices[near][None].astype(np.float64)
    return nearest


def mixed_mesh(model: SceneModel, loaded: Bool, camera: Camera, aspect: float) -> MixedMesh:
    """Put together what a client shows in one picture, without shadows from outside it.

    Parameters
    ----------
    model : SceneModel
        The scene.
    loaded : ndarray of shape (S,), bool
        Segments that are loaded.
    camera : Camera
        From where it is looked at: the base is pushed back along its lines of sight.
    aspect : float
        Width over height of the picture. Faces beside it are left out: of millions few are in it.

    Returns
    -------
    MixedMesh
    """
    hidden = hidden_base_faces(model.cover.offsets, model.cover.segments, loaded)
    back = model.manifest.hand_off.deviation_m
    base_vertices = model.base.vertices.astype(np.float64)
    if camera.kind == "orthographic":
        base_vertices = base_vertices + np.array(camera.forward) * back
    else:
        sight = base_vertices - np.array(camera.eye)
        length = np.linalg.norm(sight, axis=1, keepdims=True)
        base_vertices = base_vertices + sight / np.maximum(length, 1e-6) * back
    base_vertices = base_vertices.astype(np.float32)
    detail, base = model.detail, model.base
    shown = loaded[model.segment_of_face] & camera.may_see(detail.vertices, detail.faces, aspect)
    shown_base = ~hidden & camera.may_see(base_vertices, base.faces, aspect)
    detail_faces = detail.faces[shown]
    base_faces = base.faces[shown_base] + np.int32(len(detail.vertices))
    textures = model.textures
    return MixedMesh(
        np.concatenate([detail.vertices, base_vertices]),
        np.concatenate([detail_faces, base_faces]),
        np.concatenate([detail.colours, base.colours]),
        np.concatenate([detail.normals, base.normals]),
        len(detail_faces),
        None if textures is None else textures.mixed(shown, shown_base),
        Tint(len(detail_faces), BASE_TINT, _TINT_SHARE),
    )


def view_from_eye(landing: Landing, rays: RayScene) -> Camera:
    """Look from eye height into the direction with the longest open view over ground.

    Parameters
    ----------
    landing : Landing
        Where to stand.
    rays : RayScene
        The full detail.

    Returns
    -------
    Camera
    """
    spread = _views(np.array(landing.position), landing.radius_m, rays)
    bearing = 360.0 / LOOKS * int(np.argmax(spread))
    eye = np.array(landing.position) + np.array([0.0, EYE_HEIGHT_M, 0.0])
    return eye_level(eye, azimuth_deg=bearing, pitch_deg=-8.0)


def view_from_above(landing: Landing, aspect: float) -> Camera:
    """Look down obliquely on the landing and its surroundings.

    Parameters
    ----------
    landing : Landing
        Where.
    aspect : float
        Width over height of the picture.

    Returns
    -------
    Camera
    """
    reach = landing.radius_m * 1.9
    turn = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    ring = np.stack([np.cos(turn), np.zeros(36), np.sin(turn)], axis=1) * reach
    return oblique(np.array(landing.position) + ring, aspect=aspect, elevation_deg=42.0)


def _views(position: Float64, radius_m: float, rays: RayScene) -> Float64:
    """How much there is to see from eye height at a place, per bearing; (LOOKS,)."""
    eye = position + np.array([0.0, EYE_HEIGHT_M, 0.0])
    bearing = np.repeat(np.arange(LOOKS) * 2 * np.pi / LOOKS, 5)
    pitch = np.tile(np.radians([-2.0, -5.0, -9.0, -14.0, -22.0]), LOOKS)
    headings = np.stack(
        [np.sin(bearing) * np.cos(pitch), np.sin(pitch), -np.cos(bearing) * np.cos(pitch)], axis=1
    )
    t, _ = rays.closest_hit(np.broadcast_to(eye, headings.shape), headings)
    # Sky counts nothing, near walls little: the logarithm keeps one far hit from deciding alone.
    worth = np.where(np.isfinite(t), np.log1p(np.minimum(t, 4 * radius_m)), 0.0)
    score = worth.reshape(LOOKS, 5).sum(axis=1)
    spread: Float64 = np.sum([np.roll(score, n) for n in range(-2, 3)], axis=0)
    return spread
