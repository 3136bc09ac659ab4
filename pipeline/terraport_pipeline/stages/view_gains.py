"""View gains: what makes photos of different exposure agree, once per scene.

The base mesh stands for the surface: it is there whole, also where the detail comes in tiles, and
its faces are large enough that their mean colours do not depend on a pixel's error of the cameras.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from terraport_payload.types import Float32
from terraport_pipeline.geometry.mesh.chunks import in_chunks
from terraport_pipeline.geometry.mesh.mesh_blocks import MeshBlocks, mesh_blocks
from terraport_pipeline.geometry.photos.lens import View
from terraport_pipeline.geometry.photos.occlusion import Occluder
from terraport_pipeline.geometry.photos.photo_gains import MAX_VIEWS, Sightings, solve_gains
from terraport_pipeline.geometry.photos.photo_samples import neutral_gains
from terraport_pipeline.geometry.photos.view_candidates import SLOTS, face_radii
from terraport_pipeline.model import Mesh
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.stages.choose_views import Options, Photos, collect

__all__ = ["Gains", "find_gains", "view_gains"]

_MAX_FACES: Final = 200_000
"""Faces of the base that are looked at, evenly over it: 100 sightings a photo are enough, and this
gives thousands."""


@dataclass(frozen=True, slots=True, eq=False)
class Gains:
    """Exposure of every photo, and what was found on the way."""

    gains: Float32
    """(views + 1, GAIN_COLUMNS); see :mod:`terraport_pipeline.geometry.photos.photo_samples`."""
    facts: dict[str, Any] = field(default_factory=dict)


def view_gains(
    base: Mesh,
    views: Sequence[View],
    photos: Photos,
    rays: Occluder,
    *,
    vignetting: bool = True,
    threads: int = 1,
    progress: Progress | None = None,
) -> Float32:
    """Find every photo's exposure; the gains of :func:`find_gains`."""
    return find_gains(
        base, views, photos, rays, vignetting=vignetting, threads=threads, progress=progress
    ).gains


def find_gains(
    base: Mesh,
    views: Sequence[View],
    photos: Photos,
    rays: Occluder,
    *,
    vignetting: bool = True,
    threads: int = 1,
    progress: Progress | None = None,
) -> Gains:
    """Find every photo's exposure and every lens's vignetting.

    Parameters
    ----------
    base : Mesh
        Scene frame. Its colours are the reference, unless they are one colour throughout.
    views : sequence of View
        Views with equal lenses share their vignetting.
    photos : Photos
        Asked once for every view that sees anything.
    rays : Occluder
        The base itself.
    vignetting : bool
        Whether to find it.
    threads : int
        The result does not depend on it.
    progress : Progress, optional

    Returns
    -------
    Gains
        Neutral where there is nothing to compare, and for more than 4,096 views.
    """
    neutral = neutral_gains(len(views))
    if not views or not len(base.faces) or len(views) > MAX_VIEWS:
        return Gains(neutral)
    step = -(-len(base.faces) // _MAX_FACES)
    blocks = mesh_blocks(base.vertices, base.faces[::step])
    candidates, _ = collect(
        blocks, views, photos, rays, neutral, Options(), threads, progress or NullProgress()
    )
    sightings = _sightings(blocks, base, views, candidates.view, candidates.colour, threads)
    lenses = {view.lens: 0 for view in views}
    numbers = {lens: number for number, lens in enumerate(lenses)}
    lens_of_view = np.array([numbers[view.lens] for view in views], np.int32)
    exposures = solve_gains(sightings, len(views), lens_of_view, vignetting=vignetting)
    photos_only = exposures.gains[:-1, :3]
    facts = {
        "gain_sightings": exposures.sightings,
        "gain_spread_before": exposures.spread_before,
        "gain_spread_after": exposures.spread_after,
        "gain_least": float(photos_only.min()),
        "gain_most": float(photos_only.max()),
    }
    return Gains(exposures.gains, facts)


def _sightings(
    blocks: MeshBlocks,
    base: Mesh,
    views: Sequence[View],
    view: np.ndarray[Any, np.dtype[np.int16]],
    colour: np.ndarray[Any, np.dtype[np.uint8]],
    threads: int,
) -> Sightings:
    """Put the photos' and the cloud's colours of every face into one row."""
    n_faces = len(blocks.faces)
    views_of = np.full((n_faces, SLOTS + 1), -1, np.int16)
    views_of[:, :SLOTS] = view
    level = np.zeros((n_faces, SLOTS + 1, 3), np.uint8)
    level[:, :SLOTS] = colour
    radius = np.zeros((n_faces, SLOTS + 1), np.float32)
    packed = np.array([one.packed() for one in views])
    in_chunks(
        lambda begin, end: face_radii(
            packed, blocks.vertices, blocks.faces, views_of, radius, begin, end
        ),
        n_faces, threads=threads,
    )  # fmt: skip
    own = base.colours[blocks.vertex_order]
    if np.ptp(own, axis=0).max() > 0:
        corners = own[blocks.faces].astype(np.float32).mean(axis=1)
        level[:, SLOTS] = np.rint(corners).astype(np.uint8)
        views_of[:, SLOTS] = len(views)
    return Sightings(views_of, level, radius)
