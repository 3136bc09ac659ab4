"""The proof of the hand-off: rays against full detail, base and mixed models of random subsets.

A mixed model is the detail of the loaded segments plus every base face that the cover rule does not
hide. It is never built: a ray is cast at the full detail (and the full base), and cast again from
behind each face that is not shown. That finds a surface that is shown, though in rare cases not the
first one, so a ray that passes would pass all the more exactly. Rays that fail are judged again
against a mixed model that *is* built, so nothing is called a hole for a rounding of the re-cast.

The definition of a hole and its reasons: ``docs/topics/hand-off.md``.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.handoff_rays import (
    RayKind,
    Rays,
    aim_rays,
    cumulative_face_area,
    hidden_base_faces,
    random_places,
    random_subsets,
    rim_base_faces,
    strict_misses,
)
from terraport_pipeline.handoff_report import (
    HandOffOptions,
    HandOffReport,
    KindReport,
    WorstRay,
)
from terraport_pipeline.mixed_model import (
    BuiltModel,
    HandOffModel,
    MixedModel,
    Places,
    ShownFaces,
    TracedModel,
    face_normals,
)
from terraport_pipeline.model import Float32, Float64, Int32
from terraport_pipeline.progress import NullProgress, Progress

__all__ = ["check_hand_off"]

MAX_EXACT_SUBSETS: Final = 16
"""Mixed models that are really built; failing rays of further subsets count as holes unverified."""

MEASURE_REACH: Final = 4.0
"""Distances are measured up to this many tolerances; what lies further counts by its ray."""

Bool = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.signedinteger]
Hit = tuple[Float32, Int32]


def check_hand_off(
    model: HandOffModel,
    options: HandOffOptions | None = None,
    *,
    progress: Progress | None = None,
    detail_rays: RayScene | None = None,
    base_rays: RayScene | None = None,
) -> HandOffReport:
    """Look for holes in mixed models of random subsets.

    Parameters
    ----------
    model : HandOffModel
        At least one segment and one detail face.
    options : HandOffOptions, optional
        The defaults: 10^6 rays over 100 subsets.
    progress : Progress, optional
        Advances by rays.
    detail_rays, base_rays : RayScene, optional
        The two meshes, where they are built already.

    Returns
    -------
    HandOffReport
        The same for the same model, options and machine type.

    Raises
    ------
    OptionError
        When the model has no segments or faces to look at.
    """
    chosen = options or HandOffOptions()
    watcher = progress or NullProgress()
    if model.segment_count < 1 or len(model.detail_faces) < 1:
        raise OptionError(
            f"received {model.segment_count} segments with {len(model.detail_faces)} faces; "
            "expected at least one of each to prove a hand-off"
        )
    watcher.start("hand-off: rays", chosen.rays, "rays")
    prover = _Prover(model, chosen, detail_rays, base_rays)
    for index in range(chosen.subsets):
        watcher.advance(prover.look(index))
    report = prover.report()
    watcher.done({"holes": report.holes, "p99.9 m": report.distance_m["p99.9"]})
    return report


class _Prover:
    """Goes through the subsets and adds up what it finds."""

    def __init__(
        self,
        model: HandOffModel,
        options: HandOffOptions,
        detail_rays: RayScene | None,
        base_rays: RayScene | None,
    ) -> None:
        self._model = model
        self._options = options
        self._detail = detail_rays or RayScene(model.detail_vertices, model.detail_faces)
        self._base = base_rays or RayScene(model.base_vertices, model.base_faces)
        self._rng = np.random.default_rng(options.seed)
        self._all_detail = ShownFaces(self._detail, np.ones(len(model.detail_faces), np.bool_))
        self._all_base = ShownFaces(self._base, np.ones(len(model.base_faces), np.bool_))
        self._subsets = random_subsets(_segment_centres(model), options.subsets, self._rng)
        self._area = cumulative_face_area(model.detail_vertices, model.detail_faces)
        self._top_m = float(model.detail_vertices[:, 1].max())
        self._counts = np.zeros((len(RayKind), 4), dtype=np.int64)
        self._holes_hidden = self._holes_uncovered = self._unverified = 0
        self._base_misses = self._smoothed = 0
        self._overlaps = self._built = 0
        self._distances: list[Float32] = []
        self._down: list[Float32] = []
        self._worst: WorstRay | None = None
        self._worst_score = -1.0

    def look(self, index: int) -> int:
        """Cast one subset's rays; returns how many."""
        model, tolerance = self._model, self._model.tolerance_m
        loaded = self._subsets[index]
        hidden = hidden_base_faces(model.cover_offsets, model.cover_segments, loaded)
        rays = self._choose_rays(index, loaded)
        detail_first = self._detail.closest_hit(rays.origins, rays.directions)
        base_first = self._base.closest_hit(rays.origins, rays.directions)
        detail = ShownFaces(self._detail, loaded[model.segment_of_face])
        base = ShownFaces(self._base, ~hidden)
        detail_t = detail.closest(rays.origins, rays.directions, detail_first)
        base_t = base.closest(rays.origins, rays.directions, base_first)
        mixed_t = np.minimum(detail_t, base_t)
        hit = np.isfinite(detail_first[0])
        base_first = self._standing_in(rays, detail_first, base_first)
        missed = strict_misses(detail_first[0], base_first[0], mixed_t, tolerance)
        rows = np.flatnonzero(hit)
        places = self._detail_places(rays, detail_first, rows)
        mixed = MixedModel(detail, base)
        distance = places.distance(mixed, mixed_t[rows], MEASURE_REACH * tolerance)
        holes = np.zeros(len(rays.kind), dtype=np.bool_)
        suspects = rows[missed[rows] & (distance > tolerance)]
        suspects = suspects[~self._detail_is_replaced(mixed, rays, detail_first, suspects)]
        suspects = suspects[~self._base_is_replaced(mixed, rays, base_first, suspects)]
        holes[suspects] = True
        bare = self._sort_out(rays, detail_first, base_first, mixed, holes)
        suspects = np.flatnonzero(holes)
        if len(suspects):
            holes[:] = False
            holes[self._verify(rays, detail_first, base_first, suspects, loaded, hidden)] = True
        self._holes_uncovered += int((holes & bare).sum())
        self._holes_hidden += int((holes & ~bare).sum())
        self._count(rays, hit, missed, holes)
        self._base_misses += int((missed & ~np.isfinite(base_first[0])).sum())
        whole = loaded[model.segment_of_face[detail_first[1][rows]]]
        self._overlaps += int((whole & (base_t[rows] < detail_first[0][rows])).sum())
        self._distances.append(distance)
        down = rays.kind[rows] == RayKind.DOWN
        self._down.append(np.abs(mixed_t[rows] - detail_first[0][rows])[down])
        lost = missed & np.isfinite(base_first[0])
        self._keep_worst(rays, detail_first[0], rows, distance, (holes, lost), loaded)
        return len(rays.kind)

    def report(self) -> HandOffReport:
        """Sum up."""
        kinds = tuple(
            KindReport(kind.name.lower(), *(int(n) for n in self._counts[kind])) for kind in RayKind
        )
        return HandOffReport(
            rays=sum(kind.rays for kind in kinds),
            subsets=self._options.subsets,
            seed=self._options.seed,
            tolerance_m=self._model.tolerance_m,
            hits=sum(kind.hits for kind in kinds),
            strict_misses=sum(kind.strict_misses for kind in kinds),
            base_misses=self._base_misses,
            smoothed=self._smoothed,
            holes_hidden=self._holes_hidden,
            holes_uncovered=self._holes_uncovered,
            unverified=self._unverified,
            distance_m=_percentiles(self._distances),
            down_distance_m=_percentiles(self._down),
            overlap=self._overlaps / max(1, sum(kind.hits for kind in kinds)),
            kinds=kinds,
            worst=self._worst,
        )

    def _choose_rays(self, index: int, loaded: Bool) -> Rays:
        """Half of the rays at places anywhere, half at the rim of what is loaded."""
        model, options = self._model, self._options
        count = options.rays // options.subsets + (index < options.rays % options.subsets)
        rim = rim_base_faces(model.cover_offsets, model.cover_segments, loaded)
        at_rim = count // 2 if len(rim) else 0
        places = [
            random_places(
                model.detail_vertices,
                model.detail_faces,
                count - at_rim,
                self._rng,
                cumulative_area=self._area,
            )
        ]
        if at_rim:
            places.append(
                random_places(model.base_vertices, model.base_faces[rim], at_rim, self._rng)
            )
        return aim_rays(np.concatenate(places), self._top_m, self._rng)

    def _standing_in(self, rays: Rays, detail_first: Hit, base_first: Hit) -> Hit:
        """Find where the full base stands in for the detail: not well before it.

        Base that lies further before the detail than the tolerance is no substitute for it: where
        the full detail shows nothing there, hiding it is right.
        """
        t, face = base_first[0].copy(), base_first[1].copy()
        from_t = detail_first[0] - np.float32(self._model.tolerance_m)
        before = np.flatnonzero(np.isfinite(from_t) & (t < from_t))
        starts = rays.origins[before] + rays.directions[before] * from_t[before, None]
        further, face[before] = self._base.closest_hit(starts, rays.directions[before])
        t[before] = from_t[before] + further
        return t, face

    def _base_is_replaced(self, mixed: TracedModel, rays: Rays, first: Hit, rows: Rows) -> Bool:
        """Tell where the mixed model has surface at the place where the ray meets the base."""
        near = np.zeros(len(rows), dtype=np.bool_)
        met = np.flatnonzero(np.isfinite(first[0][rows]))
        # Where a base face hides, it is the detail that stands for it.
        near[met] = self._whole(self._base_places(rays, first, rows[met]), mixed, self._all_detail)
        return near

    def _detail_is_replaced(self, mixed: TracedModel, rays: Rays, first: Hit, rows: Rows) -> Bool:
        """Tell where the mixed model has surface at the place where the ray meets the detail."""
        # Where detail is not loaded, it is the base that stands for it.
        return self._whole(self._detail_places(rays, first, rows), mixed, self._all_base)

    def _whole(self, places: Places, mixed: TracedModel, standing_in: TracedModel) -> Bool:
        """Tell where the mixed model is within the tolerance, or as near as what stands in."""
        tolerance = self._model.tolerance_m
        nothing, reach = np.float32(np.inf), MEASURE_REACH * tolerance
        now, due = (places.distance(one, nothing, reach) for one in (mixed, standing_in))
        whole: Bool = (now <= tolerance) | (np.isfinite(now) & (now <= due + tolerance * 1e-2))
        return whole

    def _verify(
        self,
        rays: Rays,
        detail_first: Hit,
        base_first: Hit,
        suspects: Rows,
        loaded: Bool,
        hidden: Bool,
    ) -> Rows:
        """Judge suspects again against the mixed model itself; returns those that stay holes."""
        if self._built >= MAX_EXACT_SUBSETS:
            self._unverified += len(suspects)
            return suspects
        self._built += 1
        tolerance = self._model.tolerance_m
        built = BuiltModel(self._model, loaded, hidden)
        t = built.closest(rays.origins[suspects], rays.directions[suspects])
        missed = strict_misses(detail_first[0][suspects], base_first[0][suspects], t, tolerance)
        left = suspects[missed]
        left = left[~self._detail_is_replaced(built, rays, detail_first, left)]
        return left[~self._base_is_replaced(built, rays, base_first, left)]

    def _sort_out(
        self, rays: Rays, detail_first: Hit, base_first: Hit, mixed: TracedModel, holes: Bool
    ) -> Bool:
        """Clear holes that are none; returns where the full base has no ground at all, (R,)."""
        rows = np.flatnonzero(holes)
        # What the base alone would have shown: on the ray, or at the place within the tolerance.
        bare = rows[~np.isfinite(base_first[0][rows])]
        reach = self._model.tolerance_m
        places = self._detail_places(rays, detail_first, bare)
        absent = places.distance(self._all_base, np.float32(np.inf), reach) > reach
        bare, places = bare[absent], self._detail_places(rays, detail_first, bare[absent])
        # The base has nothing near. Ground above or below is no hole: the base smoothed the thing
        # away. No ground at any height is one, whoever is to blame.
        ground = places.meets_vertical(mixed)
        holes[bare[ground]] = False
        self._smoothed += int(ground.sum())
        open_sky = np.zeros(len(holes), dtype=np.bool_)
        open_sky[bare[~ground & ~places.meets_vertical(self._all_base)]] = True
        return open_sky

    def _detail_places(self, rays: Rays, first: Hit, rows: Rows) -> Places:
        """Gather where some rays meet the full detail."""
        faces = self._model.detail_faces
        normals = face_normals(self._model.detail_vertices, faces, first[1][rows])
        return Places(rays.origins[rows], rays.directions[rows], first[0][rows], normals)

    def _base_places(self, rays: Rays, first: Hit, rows: Rows) -> Places:
        """Gather where some rays meet the full base."""
        faces = self._model.base_faces
        normals = face_normals(self._model.base_vertices, faces, first[1][rows])
        return Places(rays.origins[rows], rays.directions[rows], first[0][rows], normals)

    def _count(self, rays: Rays, hit: Bool, missed: Bool, holes: Bool) -> None:
        for kind in RayKind:
            of_kind = rays.kind == kind
            self._counts[kind] += [
                int(of_kind.sum()),
                int((of_kind & hit).sum()),
                int((of_kind & missed).sum()),
                int((of_kind & holes).sum()),
            ]

    def _keep_worst(
        self,
        rays: Rays,
        detail_t: Float32,
        rows: Rows,
        distance: Float32,
        marks: tuple[Bool, Bool],
        loaded: Bool,
    ) -> None:
        """Keep the ray that fared worst: holes first, then what hid base to no avail, then far."""
        if len(rows) == 0:
            return
        # Further than the reach lie outlines and what the base smooths away: not the hand-off's.
        reach = MEASURE_REACH * self._model.tolerance_m
        rank = np.where(distance <= reach, distance / reach, -1.0) + sum(
            weight * mark[rows] for weight, mark in zip((4, 2), marks, strict=True)
        )
        at = int(np.argmax(rank))
        row, score = int(rows[at]), float(rank[at])
        if score <= self._worst_score:
            return
        self._worst_score = score
        is_hole, length = bool(marks[0][row]), float(distance[at])
        origin, heading = rays.origins[row], rays.directions[row]
        self._worst = WorstRay(
            origin=_triple(origin),
            direction=_triple(heading),
            target=_triple(origin + heading * detail_t[row]),
            distance_m=length,
            hole=is_hole,
            kind=RayKind(int(rays.kind[row])).name.lower(),
            loaded=tuple(int(i) for i in np.flatnonzero(loaded)),
        )


def _segment_centres(model: HandOffModel) -> Float64:
    """Mean face centre of each segment, (S, 3); the origin for a segment without faces."""
    centre = model.detail_vertices[model.detail_faces].mean(axis=1, dtype=np.float64)
    count = np.bincount(model.segment_of_face, minlength=model.segment_count)
    sums = [
        np.bincount(model.segment_of_face, weights=centre[:, axis], minlength=model.segment_count)
        for axis in range(3)
    ]
    return np.stack(sums, axis=1) / np.maximum(count, 1)[:, None]


def _percentiles(parts: list[Float32]) -> dict[str, float]:
    values = np.concatenate(parts) if parts else np.empty(0, np.float32)
    if len(values) == 0:
        return {"p50": 0.0, "p99": 0.0, "p99.9": 0.0, "max": 0.0}
    # "lower" never averages a finite distance with an infinite one.
    p50, p99, p999 = np.percentile(values, [50, 99, 99.9], method="lower")
    return {"p50": float(p50), "p99": float(p99), "p99.9": float(p999), "max": float(values.max())}


def _triple(vector: npt.NDArray[np.floating]) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])
