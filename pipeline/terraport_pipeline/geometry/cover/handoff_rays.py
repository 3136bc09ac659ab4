"""The proof of the hand-off, its pure part: which subsets, which rays, and what counts as a hole.

The definition and its reasons stand in ``docs/topics/hand-off.md``. In short, a ray that meets the
full detail at ``p`` finds a *hole* in a mixed model when the mixed model has no surface on the ray
up to ``p`` plus the tolerance, nor at the place ``p`` on its normal or its vertical, and either the
full base does have surface at ``p``, or the ray goes on past where it meets the full base with
nothing there to replace it, or there is no ground at all on the vertical through ``p``.

PURE: no I/O, no clock. Scene frame: metres, Y up.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from terraport_payload.types import AnyInt, Bool, Float32, Float64, Int32, Int64, UInt8

__all__ = [
    "RayKind",
    "Rays",
    "aim_rays",
    "border_base_faces",
    "cumulative_face_area",
    "grazing_rays",
    "hidden_base_faces",
    "random_places",
    "random_subsets",
    "rim_base_faces",
    "strict_misses",
]

EYE_HEIGHT_M: Final = 1.7
"""A visitor's eyes above the ground."""

EYE_REACH_M: Final = (1.0, 80.0)
"""How far from the aimed place a visitor stands; beyond 80 m detail is rarely loaded."""

CLEARANCE_M: Final = 5.0
"""Rays from above start this far over the highest point."""

OBLIQUE_DEG: Final = (15.0, 80.0)
"""Below the horizon, for rays from above."""


GRAZING_DEG: Final = (1.0, 60.0)
"""Range of angles between a grazing ray and its target face, degrees; small angles are more
frequent."""

GRAZING_REACH_M: Final = (0.5, 80.0)
"""Range of distances from a grazing ray's start to its target, metres; less if ground is in
between."""

NEAREST_EYE_M: Final = 0.1
"""Minimum distance of a grazing ray's start to its target, metres: the viewers' near plane. Nothing
nearer is drawn, so nobody sees a surface from a crevice of noise one centimetre away."""

STEEP_WEIGHT: Final = 4.0
"""Additional weight of a vertical face: five rays for one at a horizontal face of equal area."""


class RayKind(IntEnum):
    """Vantage point of a ray: straight above, obliquely above, at eye height, or grazing."""

    DOWN = 0
    """Straight down from over the scene."""
    ABOVE = 1
    """Oblique from over the scene."""
    EYE = 2
    """From eye height above the ground."""
    GRAZING = 3
    """At a small angle to a face where the hand-off can fail, from a point that sees the face."""


@dataclass(frozen=True, slots=True)
class Rays:
    """R rays; all arrays have one row per ray."""

    origins: Float32
    """(R, 3) metres."""
    directions: Float32
    """(R, 3) unit."""
    kind: UInt8
    """(R,) :class:`RayKind`."""


def random_subsets(centres: Float64, count: int, rng: np.random.Generator) -> Bool:
    """Choose sets of loaded segments, of the sorts that a client can come to hold.

    In turn: a landing (all within a random radius of a random segment), a landing of which a tenth
    has not arrived, every segment by the toss of a biased coin, all but a few, and one alone. The
    first two are none and all.

    Parameters
    ----------
    centres : ndarray of shape (S, 3), float64
        Middles of the segments' boxes, metres. S >= 1.
    count : int
        How many sets, >= 1.
    rng : numpy.random.Generator
        The same state gives the same sets.

    Returns
    -------
    ndarray of shape (count, S), bool
        True where the segment is loaded.
    """
    segments = len(centres)
    loaded = np.zeros((count, segments), dtype=np.bool_)
    for index in range(count):
        sort = (index - 2) % 5
        if index == 0:
            continue
        if index == 1:
            loaded[index] = True
        elif sort in {0, 1}:
            distance = np.linalg.norm(centres - centres[rng.integers(segments)], axis=1)
            # Few to most of the segments, small shares more often, as landings go.
            share = 0.01 + 0.74 * rng.random() ** 2
            loaded[index] = distance <= np.quantile(distance, share)
            if sort == 1:
                loaded[index] &= rng.random(segments) > 0.1
        elif sort == 2:
            loaded[index] = rng.random(segments) < rng.random()
        elif sort == 3:
            loaded[index] = True
            loaded[index, rng.integers(segments, size=int(rng.integers(1, 6)))] = False
        else:
            loaded[index, rng.integers(segments)] = True
    return loaded


def hidden_base_faces(offsets: AnyInt, segments: AnyInt, loaded: Bool) -> Bool:
    """Apply the cover rule: a base face hides iff it is covered and all segments over it loaded.

    Parameters
    ----------
    offsets : ndarray of shape (B + 1,), integer
        Where each base face's segments begin and end in `segments`.
    segments : ndarray of shape (offsets[-1],), integer
        Segment ids.
    loaded : ndarray of shape (S,), bool
        True where the segment is loaded.

    Returns
    -------
    ndarray of shape (B,), bool
        True where the base face is hidden.

    Examples
    --------
    >>> offsets, segments = np.array([0, 1, 3, 3]), np.array([0, 0, 1])
    >>> hidden_base_faces(offsets, segments, np.array([True, False])).tolist()
    [True, False, False]
    """
    total, present = _cover_counts(offsets, segments, loaded)
    hidden: Bool = (total > 0) & (present == total)
    return hidden


def rim_base_faces(offsets: AnyInt, segments: AnyInt, loaded: Bool) -> Int64:
    """Find the base faces at the rim: those over which some, but not all, segments are loaded.

    Parameters
    ----------
    offsets, segments, loaded : ndarray
        As for :func:`hidden_base_faces`.

    Returns
    -------
    ndarray of shape (K,), int64
        Base face indices, ascending.
    """
    total, present = _cover_counts(offsets, segments, loaded)
    return np.flatnonzero((present > 0) & (present < total))


def border_base_faces(base_faces: Int32, hidden: Bool) -> Int64:
    """Find the base faces on either side of the border between hidden and shown ones.

    Parameters
    ----------
    base_faces : ndarray of shape (B, 3), int32
        Vertex indices.
    hidden : ndarray of shape (B,), bool

    Returns
    -------
    ndarray of shape (K,), int64
        Faces with a vertex that a hidden and a shown face share, ascending.

    Examples
    --------
    >>> faces = np.array([[0, 1, 2], [2, 1, 3], [3, 4, 5]], np.int32)
    >>> border_base_faces(faces, np.array([True, False, False])).tolist()
    [0, 1]
    """
    of_hidden, of_shown = (np.zeros(int(base_faces.max(initial=-1)) + 1, np.bool_) for _ in "ab")
    of_hidden[base_faces[hidden]] = True
    of_shown[base_faces[~hidden]] = True
    return np.flatnonzero((of_hidden & of_shown)[base_faces].any(axis=1))


def random_places(
    vertices: Float32,
    faces: Int32,
    count: int,
    rng: np.random.Generator,
    *,
    cumulative_area: Float64 | None = None,
) -> tuple[Float64, Int32]:
    """Choose random points, evenly distributed over the surface of a mesh.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres.
    faces : ndarray of shape (F, 3), int32
        F >= 1.
    count : int
        Number of points.
    rng : numpy.random.Generator
        Random number generator.
    cumulative_area : ndarray of shape (F,), float64, optional
        Cumulative weights of the faces, for repeated calls; areas by default.

    Returns
    -------
    points : ndarray of shape (count, 3), float64
        Points on faces, metres.
    faces : ndarray of shape (count,), int32
        Face of each point.
    """
    running = cumulative_face_area(vertices, faces) if cumulative_area is None else cumulative_area
    drawn = rng.random(count) * running[-1]
    face = np.minimum(np.searchsorted(running, drawn, side="right"), len(faces) - 1)
    corner = vertices[faces[face]].astype(np.float64)
    # Uniform over a triangle: square root of the first number (Turk 1990).
    first, second = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    points: Float64 = (
        corner[:, 0] * (1 - first)
        + corner[:, 1] * first * (1 - second)
        + corner[:, 2] * first * second
    )
    return points, face.astype(np.int32)


def cumulative_face_area(vertices: Float32, faces: Int32, *, steep_weight: float = 0.0) -> Float64:
    """Return the cumulative sum of face areas, for :func:`random_places`.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float32
        Metres.
    faces : ndarray of shape (F, 3), int32
        F >= 1.
    steep_weight : float
        A vertical face gets this multiple of its area in addition; other faces get less.

    Returns
    -------
    ndarray of shape (F,), float64
        Cumulative area, square metres; for a mesh without area the number of faces.
    """
    corner = vertices[faces]
    edge, other = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    normal = np.cross(edge, other).astype(np.float64)
    area = np.linalg.norm(normal, axis=1) / 2
    if steep_weight:
        area += steep_weight * np.hypot(normal[:, 0], normal[:, 2]) / 2
    running: Float64 = np.cumsum(area)
    if not running[-1] > 0:
        running = np.arange(1, len(faces) + 1, dtype=np.float64)
    return running


def aim_rays(
    targets: Float64,
    top_m: float,
    rng: np.random.Generator,
    *,
    ground_m: Callable[[Float64], Float64] | None = None,
) -> Rays:
    """Look at places, a third straight down, a third obliquely from above, a third at eye height.

    Parameters
    ----------
    targets : ndarray of shape (R, 3), float64
        What is looked at, metres. Something nearer may stand in the way; that is meant.
    top_m : float
        Height of the highest point.
    rng : numpy.random.Generator
        Source of chance.
    ground_m : callable, optional
        Heights of the ground at places of shape (N, 3), NaN where there is none. With it a visitor
        stands on the ground; without it, or where there is none, as high as what he looks at.

    Returns
    -------
    Rays
        One per place, in the order given; kinds alternate.
    """
    count = len(targets)
    kind = (np.arange(count) % 3).astype(np.uint8)
    bearing = rng.uniform(0, 2 * np.pi, count)
    dip = np.radians(rng.uniform(*OBLIQUE_DEG, count))
    dip[kind == RayKind.DOWN] = np.pi / 2
    heading = np.stack(
        [np.cos(dip) * np.sin(bearing), -np.sin(dip), -np.cos(dip) * np.cos(bearing)], axis=1
    )
    heading[kind == RayKind.DOWN] = (0.0, -1.0, 0.0)
    rise = top_m + CLEARANCE_M - targets[:, 1]
    origins = targets - heading * (rise / -heading[:, 1])[:, None]
    # The eye stands near the place; where the ground rises between them the ray meets that ground
    # instead.
    eye = kind == RayKind.EYE
    away = rng.uniform(*EYE_REACH_M, int(eye.sum()))
    stand = targets[eye].copy()
    stand[:, 0] -= np.sin(bearing[eye]) * away
    stand[:, 2] += np.cos(bearing[eye]) * away
    if ground_m is not None:
        ground = ground_m(stand)
        stand[:, 1] = np.where(np.isnan(ground), stand[:, 1], ground)
    stand[:, 1] += EYE_HEIGHT_M
    origins[eye] = stand
    sight = targets[eye] - stand
    heading[eye] = sight / np.linalg.norm(sight, axis=1, keepdims=True)
    return Rays(origins.astype(np.float32), heading.astype(np.float32), kind)


def grazing_rays(
    targets: Float32,
    normals: Float32,
    free_m: Callable[[Float32, Float32], Float32],
    rng: np.random.Generator,
) -> Rays:
    """Create rays that meet points from their front at small angles, from where they are visible.

    Parameters
    ----------
    targets, normals : ndarray of shape (R, 3), float32
        Points, metres, and the unit normals of the faces there.
    free_m : callable
        Returns distances from points in directions to the first surface, ``inf`` without one.
    rng : numpy.random.Generator
        Random number generator.

    Returns
    -------
    Rays
        In the given order, without points that nobody sees from :data:`NEAREST_EYE_M`.
    """
    count = len(targets)
    along = rng.normal(size=(count, 3))
    along -= (along * normals).sum(axis=1, keepdims=True) * normals
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    angle = np.radians(_log_uniform(GRAZING_DEG, count, rng))[:, None]
    outward = (np.cos(angle) * along + np.sin(angle) * normals).astype(np.float32)
    away = _log_uniform(GRAZING_REACH_M, count, rng).astype(np.float32)
    away = np.minimum(away, np.float32(0.9) * free_m(targets, outward))
    seen = np.flatnonzero(away >= NEAREST_EYE_M)
    origins = (targets + outward * away[:, None]).astype(np.float32)[seen]
    return Rays(origins, -outward[seen], np.full(len(seen), RayKind.GRAZING, np.uint8))


def _log_uniform(limits: tuple[float, float], count: int, rng: np.random.Generator) -> Float64:
    """Draw random numbers between two limits, uniform in their logarithm."""
    low, high = (float(np.log(limit)) for limit in limits)
    drawn: Float64 = np.exp(rng.uniform(low, high, count))
    return drawn


def strict_misses(detail_t: Float32, base_t: Float32, mixed_t: Float32, tolerance_m: float) -> Bool:
    """Find rays that meet the full detail, but no surface of the mixed model where one is due.

    Parameters
    ----------
    detail_t, base_t, mixed_t : ndarray of shape (R,), float32
        Metres to the full detail, the full base and the mixed model; ``inf`` where not met.
    tolerance_m : float
        How much further than both of the first two the mixed model may lie.

    Returns
    -------
    ndarray of shape (R,), bool
        True where the mixed model is met beyond detail *and* base, or not at all. Rays that meet
        the detail alone (the base is not met) are judged by the detail.

    Examples
    --------
    >>> inf = np.inf
    >>> detail = np.float32([5, 5, 5, 5, inf])
    >>> base = np.float32([6, 6, inf, 6, 6])
    >>> mixed = np.float32([6, 9, inf, inf, inf])
    >>> strict_misses(detail, base, mixed, 0.5).tolist()
    [False, True, True, True, False]
    """
    met = np.isfinite(detail_t)
    base = np.where(np.isfinite(base_t), base_t, -np.inf)
    return met & ~(mixed_t <= np.maximum(detail_t, base) + tolerance_m)


def _cover_counts(offsets: AnyInt, segments: AnyInt, loaded: Bool) -> tuple[Int64, Int64]:
    """Count, per base face, the segments over it and those of them that are loaded."""
    edges = offsets.astype(np.int64)
    running = np.concatenate([[0], np.cumsum(loaded[segments], dtype=np.int64)])
    return np.diff(edges), running[edges[1:]] - running[edges[:-1]]
