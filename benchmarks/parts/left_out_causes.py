"""Why a left-out photo differs from the scene: what stands in front, and its development."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter

from terraport_payload.types import Bool, Float64, UInt8
from terraport_pipeline.engines.cameras import PhotoCamera
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.geometry.photos.lens import View

__all__ = ["STEP", "developed", "no_other_has", "small_means"]

STEP: Final = 4
"""Pixels between the places that are asked; means are over as many times four."""

FAR: Final = 20.0
"""Levels by which means of a place differ from those of every other photo."""

SAME_SURFACE_M: Final = 0.3
"""How much nearer than the place a photo's ray may end."""


def developed(picture: UInt8, photo: UInt8, hit: Bool) -> Float64:
    """Bring a picture to a photo by five numbers a channel; the pixels that are hit, (N, 3).

    Exposure (a gain and an offset), and how the gain falls off over the picture: with the square of
    the distance from its middle (vignetting), and along both sides.
    """
    rows, columns = np.nonzero(hit)
    height, width = hit.shape
    x, y = (columns - width / 2) / width, (rows - height / 2) / width
    ours, theirs = picture[hit].astype(np.float64), photo[hit].astype(np.float64)
    result = np.empty_like(ours)
    for channel in range(3):
        level = ours[:, channel]
        terms = np.stack(
            [level, np.ones_like(level), level * (x * x + y * y), level * x, level * y]
        )
        some = terms[:, ::7].T
        result[:, channel] = np.linalg.lstsq(some, theirs[::7, channel], rcond=None)[0] @ terms
    return result


def small_means(photo: UInt8) -> Float64:
    """Mean colours around every :data:`STEP`-th pixel, (H / STEP, W / STEP, 3)."""
    height, width = (side // STEP * STEP for side in photo.shape[:2])
    blocks = photo[:height, :width].reshape(height // STEP, STEP, width // STEP, STEP, 3)
    means: Float64 = uniform_filter(blocks.mean(axis=(1, 3)), (4, 4, 1))
    return means


def no_other_has(
    number: int,
    views: Sequence[View],
    means: Mapping[int, Float64],
    others: Sequence[int],
    rays: RayScene,
    hit: Bool,
) -> Bool:
    """Tell where no other photo that sees a place shows what this one shows there, (H, W).

    Each other photo is first brought to this one's light, by the median ratio of all places.
    """
    # (1) Places of the surface, every so many pixels.
    view, mine = views[number], means[number]
    high, wide = mine.shape[:2]
    rows, columns = np.mgrid[:high, :wide] * STEP + STEP // 2
    ground = hit[rows, columns].ravel()
    origins, headings = PhotoCamera(view).rays(hit.shape[1], hit.shape[0])
    pixels = (rows * hit.shape[1] + columns).ravel()[ground]
    along, _ = rays.closest_hit(origins[pixels], headings[pixels])
    places = origins[pixels].astype(np.float64) + headings[pixels] * along[:, None].astype(float)
    colours = mine.reshape(-1, 3)[ground]
    # (2) The least difference to any photo that sees the place; none sees it: nothing is like it.
    least = np.full(len(places), np.inf)
    for other in others:
        shown, depth = views[other].project(places)
        inside = (depth > 0) & np.isfinite(shown).all(axis=1) & (shown >= 0).all(axis=1)
        spots = (np.where(inside[:, None], shown, 0.0) / STEP).astype(np.int64)
        inside &= (spots < np.array(means[other].shape[1::-1])).all(axis=1)
        seen = np.flatnonzero(inside)
        away = places[seen] - views[other].position
        distance = np.linalg.norm(away, axis=1)
        start = np.broadcast_to(views[other].position, away.shape).astype(np.float32)
        first, _ = rays.closest_hit(start, (away / distance[:, None]).astype(np.float32))
        seen = seen[first > distance - SAME_SURFACE_M]
        if len(seen) == 0:
            continue
        theirs = means[other][spots[seen, 1], spots[seen, 0]]
        theirs = theirs * np.median((colours[seen] + 1) / (theirs + 1), axis=0)
        apart = np.sqrt(np.square(theirs - colours[seen]).mean(axis=1))
        least[seen] = np.minimum(least[seen], apart)
    # (3) Back to pixels.
    alone = np.zeros(high * wide, dtype=bool)
    alone[np.flatnonzero(ground)] = least > FAR
    whole = np.zeros(hit.shape, dtype=bool)
    large = np.kron(alone.reshape(high, wide), np.ones((STEP, STEP), dtype=bool))
    whole[: large.shape[0], : large.shape[1]] = large
    result: Bool = whole & hit
    return result
