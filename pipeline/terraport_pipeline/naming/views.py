"""Where to stand to see a region: what "take me to the stockpile" lands on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Float64, Int32, Int64
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.published.ground import Ground

__all__ = ["best_views"]

_EYE_M: Final = 1.7
"""Height of the eye over the ground."""

_CANDIDATES: Final = 16
"""Places tried within a region, and as many around it."""

_SAMPLES: Final = 48
"""Places of a region that should be seen."""

_LIFT_M: Final = 0.15
"""Rays end so far above the surface, which they would else graze."""

_LEVEL: Final = 0.94
"""Upward part of the normal of ground that one stands on: 20 degrees."""

_MOST_LEVEL: Final = 400_000
"""Level faces that are stood on, evenly taken where there are more."""

_RADII_M: Final = (20.0, 120.0)
"""Least and greatest radius of a landing at a region."""

_MOST_REGIONS: Final = 2_000
"""Regions that get a view, largest first; the others are landed on in their middle."""

_SEED: Final = 7


def best_views(ground: Ground, regions: Int32, wanted: Iterable[int]) -> dict[int, dict[str, Any]]:
    """Choose the best view of regions.

    Parameters
    ----------
    ground : Ground
    regions : ndarray of shape (F,), int32
    wanted : iterable of int
        Numbers of regions.

    Returns
    -------
    dict of int to dict
        By region ``position`` (on the ground, metres, scene frame), ``heading_deg`` (clockwise from
        north) and ``radius_m``: what regions.json has as ``place``. Of level places in and around
        the region the one from whose eye height most of it is in sight, and near. Regions
        without any level place nearby have none.
    """
    mesh, centres = ground.mesh, ground.centres
    chosen = _largest(ground, regions, wanted)
    if not chosen:
        return {}
    a, b, c = (mesh.vertices[mesh.faces[:, corner]].astype(np.float64) for corner in range(3))
    normal = np.cross(b - a, c - a)
    up = normal[:, 1] / np.maximum(np.linalg.norm(normal, axis=1), 1e-30)
    level = np.flatnonzero(up > _LEVEL)
    level = level[:: len(level) // _MOST_LEVEL + 1]
    if not len(level):
        return {}
    rays = RayScene(mesh.vertices, mesh.faces)
    tree = cKDTree(centres[level][:, [0, 2]])
    order = np.argsort(regions, kind="stable")
    starts = np.searchsorted(regions[order], np.arange(int(regions.max()) + 2))
    rng = np.random.default_rng(_SEED)
    views = {}
    for number in chosen:
        faces = order[starts[number] : starts[number + 1]]
        seen = centres[faces[:: len(faces) // _SAMPLES + 1]]
        reach_m = float(np.sqrt(max(ground.area[faces].sum(), 1e-6) / np.pi))
        middle = seen.mean(axis=0)
        near = level[tree.query_ball_point(middle[[0, 2]], 1.5 * reach_m + 10.0)]
        if not len(near):
            continue
        inside = near[regions[near] == number]
        around = near[regions[near] != number]
        places = centres[np.concatenate([_some(inside, rng), _some(around, rng)])]
        views[number] = _best(places, seen, reach_m, rays)
    return views


def _largest(ground: Ground, regions: Int32, wanted: Iterable[int]) -> list[int]:
    area = np.bincount(regions, ground.area)
    ordered = sorted(set(wanted), key=lambda number: (-area[number], number))
    return sorted(ordered[:_MOST_REGIONS])


def _some(faces: Int64, rng: np.random.Generator) -> Int64:
    if len(faces) <= _CANDIDATES:
        return faces
    return np.sort(rng.choice(faces, _CANDIDATES, replace=False))


def _best(places: Float64, seen: Float64, reach_m: float, rays: RayScene) -> dict[str, Any]:
    """Look from all places at all samples, and take the place that sees most."""
    eyes = places + np.array([0.0, _EYE_M, 0.0])
    targets = seen + np.array([0.0, _LIFT_M, 0.0])
    sight = targets[None] - eyes[:, None]
    distance = np.maximum(np.linalg.norm(sight, axis=2), 1e-9)
    flat = (sight / distance[:, :, None]).reshape(-1, 3)
    t, _ = rays.closest_hit(np.repeat(eyes, len(targets), axis=0), flat)
    free = np.asarray(t).reshape(distance.shape) >= distance
    # What is far fills less of the view; what lies under one's feet is no view either.
    far = distance / (3.0 * reach_m)
    worth = free * np.minimum(distance / 2.0, 1.0) / (1.0 + far * far)
    at = int(np.argmax(worth.sum(axis=1)))
    counted = free[at] if free[at].any() else np.ones(len(seen), np.bool_)
    x, _, z = sight[at, counted].mean(axis=0).tolist()
    radius_m = float(np.clip(distance[at, counted].max() * 1.1, *_RADII_M))
    return {
        "position": np.round(places[at], 3).tolist(),
        "heading_deg": round(float(np.degrees(np.arctan2(x, -z)) % 360.0), 1),
        "radius_m": round(radius_m, 1),
    }
