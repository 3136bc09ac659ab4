"""What counts as a hole: one ray's meeting with the full detail, held against a mixed model.

The definition and its reasons: ``docs/topics/hand-off.md``, "What a hole is".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload.types import AnyInt, Bool, Float32, Int32
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.geometry.cover.cover import STAND_IN_TOLERANCES
from terraport_pipeline.geometry.cover.handoff_rays import Rays, strict_misses
from terraport_pipeline.model import UP
from terraport_pipeline.published.mixed_model import (
    HandOffModel,
    Places,
    ShownFaces,
    TracedModel,
    face_normals,
)

__all__ = ["MEASURE_REACH", "Judge", "Meetings"]

MEASURE_REACH: Final = STAND_IN_TOLERANCES
"""Distances are measured up to this many tolerances; what lies further counts by its ray."""

_MAX_PASSES: Final = 16
"""Maximum number of points in the air behind which a ray is judged again; more make it a hole."""

_STEP_PAST: Final = 1e-3
"""Distance behind such a point at which the ray restarts, in tolerances."""

Hit = tuple[Float32, Int32]


@dataclass(frozen=True, slots=True)
class Meetings:
    """Where R rays meet the two full levels; distances are ``inf`` where they do not."""

    rays: Rays
    detail: Hit
    """First meeting with the full detail."""
    base: Hit
    """First meeting with the full base that is not well before the detail."""
    base_first: Hit
    """First meeting with the full base, wherever."""


class Judge:
    """Knows the two full levels of a scene.

    Parameters
    ----------
    model : HandOffModel
        The scene.
    detail, base : RayScene
        Its two full meshes.
    """

    def __init__(self, model: HandOffModel, detail: RayScene, base: RayScene) -> None:
        self._model, self._detail, self._base = model, detail, base
        self._all_detail = ShownFaces(detail, np.ones(len(model.detail_faces), np.bool_))
        self._all_base = ShownFaces(base, np.ones(len(model.base_faces), np.bool_))

    def meetings(self, rays: Rays) -> Meetings:
        """Cast rays at both full levels.

        Base that lies further before the detail than the tolerance is no substitute for it: where
        the full detail shows nothing there, hiding it is right.
        """
        detail = self._detail.closest_hit(rays.origins, rays.directions)
        first = self._base.closest_hit(rays.origins, rays.directions)
        t, face = first[0].copy(), first[1].copy()
        from_t = detail[0] - np.float32(self._model.tolerance_m)
        before = np.flatnonzero(np.isfinite(from_t) & (t < from_t))
        starts = rays.origins[before] + rays.directions[before] * from_t[before, None]
        further, face[before] = self._base.closest_hit(starts, rays.directions[before])
        t[before] = from_t[before] + further
        return Meetings(rays, detail, (t, face), first)

    def hit_places(self, met: Meetings, rows: AnyInt) -> Places:
        """Gather where some rays meet the full detail."""
        model = self._model
        normals = face_normals(model.detail_vertices, model.detail_faces, met.detail[1][rows])
        rays = met.rays
        return Places(rays.origins[rows], rays.directions[rows], met.detail[0][rows], normals)

    def base_stands_near(self, points: Float32, faces: Int32) -> Bool:
        """Return whether the full base crosses the normal or the vertical of points on the detail.

        Parameters
        ----------
        points : ndarray of shape (R, 3), float32
        faces : ndarray of shape (R,), int32
            The detail faces that they are on.
        """
        model = self._model
        normals = face_normals(model.detail_vertices, model.detail_faces, faces)
        still = np.zeros_like(points)
        places = Places(points, still, np.zeros(len(points), np.float32), normals)
        reach = MEASURE_REACH * model.tolerance_m
        return np.isfinite(places.distance(self._all_base, np.float32(np.inf), reach))

    def holes(
        self, met: Meetings, mixed: TracedModel, mixed_t: Float32, rows: AnyInt
    ) -> tuple[AnyInt, AnyInt]:
        """Tell which rays find a hole.

        Parameters
        ----------
        met : Meetings
            R rays.
        mixed : TracedModel
            What is shown.
        mixed_t : ndarray of shape (R,), float32
            Where the rays meet it.
        rows : ndarray of int
            Rays to judge; all of them meet the detail.

        Returns
        -------
        holes : ndarray of int
            Those of `rows` that find one.
        smoothed : ndarray of int
            Those that are excused because the base never had what they look at.
        """
        # Invariant: `ray[i]` is the ray of row i of `met`; `met` shrinks to rays that passed.
        ray = np.arange(len(mixed_t))
        found, smoothed = [], []
        for _ in range(_MAX_PASSES):
            holes, bare, passing = self._judge_once(met, mixed, mixed_t, rows)
            found.append(ray[holes])
            smoothed.append(ray[bare])
            met, mixed_t = self._behind_base(met, mixed_t, passing)
            ray = ray[passing]
            ahead = np.isfinite(met.detail[0])
            smoothed.append(ray[~ahead])  # nothing is behind it in the full detail either
            rows = np.flatnonzero(ahead)
            if not len(rows):
                break
        found.append(ray[rows])
        return np.sort(np.concatenate(found)), np.sort(np.concatenate(smoothed))

    def _judge_once(
        self, met: Meetings, mixed: TracedModel, mixed_t: Float32, rows: AnyInt
    ) -> tuple[AnyInt, AnyInt, AnyInt]:
        """Judge rays at the first p and q: holes, smoothed, and rays that pass q in the air."""
        tolerance = self._model.tolerance_m
        rows = rows[mixed_t[rows] > met.detail[0][rows] + tolerance]
        # (1) at the place p: within the tolerance, or as near as the full base
        now, due = self._nearness(self.hit_places(met, rows), mixed, self._all_base)
        left = ~_whole(now, due, tolerance)
        # Where the base stands near p, what is shown must stand there too, give or take the
        # tolerance: nothing further along the ray is an excuse.
        lost = np.isfinite(due) & ~(now <= due + tolerance)
        certain, open_rows = rows[left & lost], rows[left & ~lost]
        # (2) the base has nothing at p: on the ray, as far as the base behind it; or at q
        missed = strict_misses(
            met.detail[0][open_rows], met.base[0][open_rows], mixed_t[open_rows], tolerance
        )
        open_rows = open_rows[missed]
        open_rows = open_rows[~self._base_is_replaced(met, mixed, open_rows)]
        # (3) the base is nowhere on the ray, or q is in the air: ground above or below p is no
        # hole, the base smoothed the thing away; no ground at any height is one, whoever is to
        # blame
        off_base = ~np.isfinite(met.base[0][open_rows])
        excused = off_base | self._in_air(met, open_rows)
        excused[excused] = self.hit_places(met, open_rows[excused]).meets_vertical(mixed)
        holes = np.concatenate([certain, open_rows[~excused]])
        return holes, open_rows[excused & off_base], open_rows[excused & ~off_base]

    def _in_air(self, met: Meetings, rows: AnyInt) -> Bool:
        """Return whether no detail is near q and the ray has left the ground again before q.

        This follows from the last detail before q: the ray meets its back side when it leaves the
        ground. A ray that is under the ground at q is a hole, as a hidden q would let it pass.
        """
        in_air = np.isfinite(met.base[0][rows])
        at = rows[in_air]
        places = self._base_places(met, at)
        near = places.distance(
            self._all_detail, np.float32(np.inf), MEASURE_REACH * self._model.tolerance_m
        )
        rays, model = met.rays, self._model
        points = rays.origins[at] + rays.directions[at] * met.base[0][at, None]
        face = self._detail.closest_hit(points, -rays.directions[at])[1]
        normals = face_normals(model.detail_vertices, model.detail_faces, np.maximum(face, 0))
        left_ground = (face >= 0) & ((normals * rays.directions[at]).sum(axis=1) > 0)
        in_air[in_air] = ~np.isfinite(near) & left_ground
        return in_air

    def _behind_base(
        self, met: Meetings, mixed_t: Float32, rows: AnyInt
    ) -> tuple[Meetings, Float32]:
        """Restart some rays behind the points q; return what they meet, one row per ray."""
        shift = met.base[0][rows] + np.float32(_STEP_PAST * self._model.tolerance_m)
        rays = met.rays
        origins = rays.origins[rows] + rays.directions[rows] * shift[:, None]
        behind = Rays(origins, rays.directions[rows], rays.kind[rows])
        return self.meetings(behind), mixed_t[rows] - shift

    def without_base(self, met: Meetings, rows: AnyInt) -> Bool:
        """Tell where there is no base at any height over or under the detail, (len(rows),)."""
        return ~self.hit_places(met, rows).meets_vertical(self._all_base)

    def under_base(self, met: Meetings, mixed: TracedModel, rows: AnyInt) -> Bool:
        """Tell which rays start below the mixed model and not below the full detail."""
        starts = met.rays.origins[rows]
        up = np.tile(np.array(UP, dtype=np.float32), (len(rows), 1))
        below = np.isfinite(mixed.closest(starts, up))
        is_under: Bool = below & ~np.isfinite(self._all_detail.closest(starts, up))
        return is_under

    def _base_is_replaced(self, met: Meetings, mixed: TracedModel, rows: AnyInt) -> Bool:
        """Tell where the mixed model has surface at the place q where the ray meets the base."""
        near = np.zeros(len(rows), dtype=np.bool_)
        at = np.flatnonzero(np.isfinite(met.base[0][rows]))
        on_base = self._base_places(met, rows[at])
        # Where a base face hides, it is the detail that stands for it.
        near[at] = _whole(
            *self._nearness(on_base, mixed, self._all_detail), self._model.tolerance_m
        )
        return near

    def _base_places(self, met: Meetings, rows: AnyInt) -> Places:
        """Return the points where some rays meet the full base."""
        model, rays = self._model, met.rays
        normals = face_normals(model.base_vertices, model.base_faces, met.base[1][rows])
        return Places(rays.origins[rows], rays.directions[rows], met.base[0][rows], normals)

    def _nearness(
        self, points: Places, mixed: TracedModel, standing_in: TracedModel
    ) -> tuple[Float32, Float32]:
        """Measure how near the mixed model, and what stands in for it, are to some places."""
        nothing, reach = np.float32(np.inf), MEASURE_REACH * self._model.tolerance_m
        return (
            points.distance(mixed, nothing, reach),
            points.distance(standing_in, nothing, reach),
        )


def _whole(now: Float32, due: Float32, tolerance_m: float) -> Bool:
    """Tell where a surface is within the tolerance, or as near as what stands in for it."""
    whole: Bool = (now <= tolerance_m) | (np.isfinite(now) & (now <= due + tolerance_m * 1e-2))
    return whole
