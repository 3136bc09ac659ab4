"""The proof of the hand-off: rays against full detail, base and mixed models of random subsets.

A mixed model is the detail of the loaded segments plus every base face that the cover rule does not
hide. It is never built: a ray is cast at the full detail (and the full base), and cast again from
behind each face that is not shown. That finds a surface that is shown, though in rare cases not the
first one, so a ray that passes would pass all the more exactly. Rays that fail are judged again
against a mixed model that *is* built, so nothing is called a hole for a rounding of the re-cast.

The definition of a hole and its reasons: ``docs/topics/hand-off.md``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from terraport_payload.types import AnyFloat, AnyInt, Bool, Float32, Float64, Int32, Int64
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.cover.handoff_rays import (
    STEEP_WEIGHT,
    RayKind,
    Rays,
    aim_rays,
    border_base_faces,
    cumulative_face_area,
    grazing_rays,
    hidden_base_faces,
    random_places,
    random_subsets,
    rim_base_faces,
    strict_misses,
)
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.published.mixed_model import (
    BuiltModel,
    HandOffModel,
    MixedModel,
    ShownFaces,
    face_normals,
)
from terraport_pipeline.validate.handoff_judge import MEASURE_REACH, Judge, Meetings
from terraport_pipeline.validate.handoff_report import (
    HandOffOptions,
    HandOffReport,
    KindReport,
    WorstRay,
)

__all__ = ["check_hand_off", "check_hand_off_in_windows"]

MAX_EXACT_SUBSETS: Final = 16
"""Mixed models that are really built; failing rays of further subsets count as holes unverified."""

_PLACES_FAR_FROM_BASE: Final = 200_000
"""Number of points on the detail that are tried, to find those without base nearby."""

_LEAST_SUBSETS: Final = 6
"""Of a window: none, all, and one of each random sort but one."""


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
    tally = _Tally()
    watcher.start("hand-off: rays", chosen.rays, "rays")
    _look_at(model, chosen, tally, watcher, detail_rays, base_rays)
    report = tally.report(model.tolerance_m, chosen.seed)
    watcher.done({"holes": report.holes, "p99.9 m": report.distance_m["p99.9"]})
    return report


def check_hand_off_in_windows(
    windows: Sequence[Int64],
    open_window: Callable[[Int64], HandOffModel],
    faces: Sequence[int],
    options: HandOffOptions | None = None,
    *,
    progress: Progress | None = None,
) -> HandOffReport:
    """Look for holes window by window, in a scene too large to be held.

    Parameters
    ----------
    windows : sequence of ndarray of int64
        Segments of every window: :func:`~.scene_windows.scene_windows`.
    open_window : callable
        Gives the model of some segments, which are numbered 0.. in it.
    faces : sequence of int
        Faces of every window: rays and subsets are shared out by them.
    options, progress
        As for :func:`check_hand_off`; every window gets at least a few subsets.

    Returns
    -------
    HandOffReport
        Of all windows together; segments are named by the scene's numbers.
    """
    chosen = options or HandOffOptions()
    watcher = progress or NullProgress()
    tally = _Tally()
    share = np.array(faces, np.float64) / max(1, sum(faces))
    tolerance_m = 0.0
    for number, segments in enumerate(windows):
        subsets = max(_LEAST_SUBSETS, round(chosen.subsets * float(share[number])))
        rays = max(subsets, round(chosen.rays * float(share[number])))
        model = open_window(segments)
        tolerance_m = model.tolerance_m
        watcher.start(f"hand-off: rays, window {number + 1} of {len(windows)}", float(rays), "rays")
        window_options = HandOffOptions(rays, min(subsets, rays), chosen.seed + number)
        tally.segments = segments
        _look_at(model, window_options, tally, watcher)
        del model
        watcher.done({"holes": int(tally.counts[:, 3].sum())})
    return tally.report(tolerance_m, chosen.seed, len(windows))


def _look_at(
    model: HandOffModel,
    options: HandOffOptions,
    tally: _Tally,
    watcher: Progress,
    detail_rays: RayScene | None = None,
    base_rays: RayScene | None = None,
) -> None:
    if model.segment_count < 1 or len(model.detail_faces) < 1:
        raise OptionError(
            f"received {model.segment_count} segments with {len(model.detail_faces)} faces; "
            "expected at least one of each to prove a hand-off"
        )
    prover = _Prover(model, options, tally, detail_rays, base_rays)
    for index in range(options.subsets):
        watcher.advance(prover.look(index))
    tally.subsets += options.subsets


@dataclass(slots=True)
class _Tally:
    """What is found, added up over subsets and windows."""

    counts: Int64 = field(default_factory=lambda: np.zeros((len(RayKind), 4), dtype=np.int64))
    subsets: int = 0
    holes_hidden: int = 0
    holes_uncovered: int = 0
    unverified: int = 0
    base_misses: int = 0
    smoothed: int = 0
    under_base: int = 0
    overlaps: int = 0
    distances: list[Float32] = field(default_factory=list)
    down: list[Float32] = field(default_factory=list)
    worst: WorstRay | None = None
    worst_score: float = -1.0
    segments: Int64 | None = None
    """The scene's numbers of the model's segments; None: the same."""

    def named(self, segments: AnyInt) -> AnyInt:
        """Give segments of the model the scene's numbers."""
        return segments if self.segments is None else self.segments[segments]

    def report(self, tolerance_m: float, seed: int, windows: int = 1) -> HandOffReport:
        """Turn the counts and distances of all rays into a report."""
        kinds = tuple(
            KindReport(kind.name.lower(), *(int(n) for n in self.counts[kind])) for kind in RayKind
        )
        return HandOffReport(
            rays=sum(kind.rays for kind in kinds),
            subsets=self.subsets,
            seed=seed,
            tolerance_m=tolerance_m,
            hits=sum(kind.hits for kind in kinds),
            strict_misses=sum(kind.strict_misses for kind in kinds),
            base_misses=self.base_misses,
            under_base=self.under_base,
            smoothed=self.smoothed,
            holes_hidden=self.holes_hidden,
            holes_uncovered=self.holes_uncovered,
            unverified=self.unverified,
            distance_m=_percentiles(self.distances),
            down_distance_m=_percentiles(self.down),
            overlap=self.overlaps / max(1, sum(kind.hits for kind in kinds)),
            kinds=kinds,
            worst=self.worst,
            windows=windows,
        )


class _Prover:
    """Goes through the subsets and adds up what it finds."""

    def __init__(
        self,
        model: HandOffModel,
        options: HandOffOptions,
        tally: _Tally,
        detail_rays: RayScene | None,
        base_rays: RayScene | None,
    ) -> None:
        self._model = model
        self._options = options
        self._tally = tally
        self._detail = detail_rays or RayScene(model.detail_vertices, model.detail_faces)
        self._base = base_rays or RayScene(model.base_vertices, model.base_faces)
        self._rng = np.random.default_rng(options.seed)
        self._judge = Judge(model, self._detail, self._base)
        self._subsets = random_subsets(_segment_centres(model), options.subsets, self._rng)
        self._area = cumulative_face_area(model.detail_vertices, model.detail_faces)
        self._top_m = float(model.detail_vertices[:, 1].max())
        self._far = self._places_far_from_base(min(_PLACES_FAR_FROM_BASE, options.rays))
        self._built = 0

    def look(self, index: int) -> int:
        """Cast one subset's rays; returns how many."""
        model, tolerance = self._model, self._model.tolerance_m
        loaded = self._subsets[index]
        hidden = hidden_base_faces(model.cover_offsets, model.cover_segments, loaded)
        rays = self._choose_rays(index, loaded, hidden)
        met = self._judge.meetings(rays)
        detail = ShownFaces(self._detail, loaded[model.segment_of_face])
        base = ShownFaces(self._base, ~hidden)
        detail_t = detail.closest(rays.origins, rays.directions, met.detail)
        base_t = base.closest(rays.origins, rays.directions, met.base_first)
        mixed_t, mixed = np.minimum(detail_t, base_t), MixedModel(detail, base)
        first_t = met.detail[0]
        hit = np.isfinite(first_t)
        missed = strict_misses(first_t, met.base[0], mixed_t, tolerance)
        rows = np.flatnonzero(hit)
        hits = self._judge.hit_places(met, rows)
        distance = hits.distance(mixed, mixed_t[rows], MEASURE_REACH * tolerance)
        suspects, smoothed = self._judge.holes(met, mixed, mixed_t, rows[distance > tolerance])
        self._tally.smoothed += len(smoothed)
        if len(suspects):
            suspects = self._verify(met, suspects, loaded, hidden)
        holes = np.zeros(len(hit), dtype=np.bool_)
        holes[suspects] = True
        bare = int(self._judge.without_base(met, suspects).sum())
        self._tally.holes_uncovered += bare
        self._tally.holes_hidden += len(suspects) - bare
        self._count(rays, hit, missed, holes)
        strict = np.flatnonzero(missed)
        self._tally.base_misses += int((~np.isfinite(met.base_first[0][strict])).sum())
        self._tally.under_base += int(self._judge.under_base(met, mixed, strict).sum())
        whole = loaded[model.segment_of_face[met.detail[1][rows]]]
        self._tally.overlaps += int((whole & (base_t[rows] < first_t[rows])).sum())
        # Grazing rays search for detail that the base lacks: they would dominate the percentiles.
        self._tally.distances.append(distance[rays.kind[rows] != RayKind.GRAZING])
        down = rays.kind[rows] == RayKind.DOWN
        self._tally.down.append(np.abs(mixed_t[rows] - first_t[rows])[down])
        lost = missed & np.isfinite(met.base_first[0])
        self._keep_worst(rays, first_t, rows, distance, (holes, lost), loaded)
        return len(rays.kind)

    def _choose_rays(self, index: int, loaded: Bool, hidden: Bool) -> Rays:
        """Choose the rays: half at random points, a quarter at the rim of the loaded segments.

        The last quarter grazes: along the border between hidden and shown base, and past detail
        that is not loaded and that the base lacks.
        """
        model, options = self._model, self._options
        count = options.rays // options.subsets + (index < options.rays % options.subsets)
        rim = rim_base_faces(model.cover_offsets, model.cover_segments, loaded)
        at_rim = count // 4 if len(rim) else 0
        border = self._border_places(hidden, count // 8)
        absent = np.flatnonzero(~loaded[model.segment_of_face[self._far[1]]])
        chosen = self._rng.choice(absent, count // 8) if len(absent) else absent
        targets = np.concatenate([border[0], self._far[0][chosen]])
        faces = np.concatenate([border[1], self._far[1][chosen]])
        normals = face_normals(model.detail_vertices, model.detail_faces, faces)
        grazing = self._from_over_base(grazing_rays(targets, normals, self._free_m, self._rng))
        places = [
            random_places(
                model.detail_vertices,
                model.detail_faces,
                count - at_rim - len(grazing.kind),
                self._rng,
                cumulative_area=self._area,
            )[0]
        ]
        if at_rim:
            places.append(
                random_places(model.base_vertices, model.base_faces[rim], at_rim, self._rng)[0]
            )
        aimed = aim_rays(np.concatenate(places), self._top_m, self._rng, ground_m=self._ground_m)
        return Rays(
            np.concatenate([aimed.origins, grazing.origins]),
            np.concatenate([aimed.directions, grazing.directions]),
            np.concatenate([aimed.kind, grazing.kind]),
        )

    def _from_over_base(self, rays: Rays) -> Rays:
        """Leave out rays that start below the base: they are not views from outside the ground."""
        model = self._model
        over = np.ones(len(rays.kind), np.bool_)
        up = np.tile(np.array([0, 1, 0], np.float32), (len(rays.kind), 1))
        for heading in (rays.directions, up):
            face = self._base.closest_hit(rays.origins, heading)[1]
            normals = face_normals(model.base_vertices, model.base_faces, np.maximum(face, 0))
            over &= (face < 0) | ((normals * heading).sum(axis=1) < 0)
        return Rays(rays.origins[over], rays.directions[over], rays.kind[over])

    def _border_places(self, hidden: Bool, count: int) -> tuple[Float32, Int32]:
        """Choose points of the detail over the border of the hidden base, and their faces.

        Steep base faces are preferred.
        """
        model = self._model
        border = border_base_faces(model.base_faces, hidden)
        if not len(border):
            return np.zeros((0, 3), np.float32), np.zeros(0, np.int32)
        faces = model.base_faces[border]
        weight = cumulative_face_area(model.base_vertices, faces, steep_weight=STEEP_WEIGHT)
        drawn = random_places(model.base_vertices, faces, count, self._rng, cumulative_area=weight)
        points = drawn[0].astype(np.float32)
        inward = -face_normals(model.base_vertices, faces, drawn[1])
        reach = np.float32(MEASURE_REACH * model.tolerance_m)
        starts = points - inward * reach
        t, face = self._detail.closest_hit(starts, inward)
        near = np.flatnonzero(t <= 2 * reach)
        return starts[near] + inward[near] * t[near, None], face[near]

    def _places_far_from_base(self, count: int) -> tuple[Float32, Int32]:
        """Find points of the detail without base nearby, and their faces.

        Steep faces are preferred.
        """
        model = self._model
        vertices, faces = model.detail_vertices, model.detail_faces
        weight = cumulative_face_area(vertices, faces, steep_weight=STEEP_WEIGHT)
        drawn = random_places(vertices, faces, count, self._rng, cumulative_area=weight)
        places, face = drawn[0].astype(np.float32), drawn[1]
        far = np.flatnonzero(~self._judge.base_stands_near(places, face))
        return places[far], face[far]

    def _free_m(self, points: Float32, directions: Float32) -> Float32:
        """Return the distance to the detail from points on it, ignoring the point's own face."""
        past = np.float32(1e-2 * self._model.tolerance_m)
        return self._detail.closest_hit(points + directions * past, directions)[0] + past

    def _ground_m(self, points: Float64) -> Float64:
        """Height of the full detail at some places, seen from above; NaN where there is none."""
        starts = points.copy()
        starts[:, 1] = self._top_m + 1.0
        down = np.broadcast_to(np.array([0.0, -1.0, 0.0]), starts.shape)
        t = self._detail.closest_hit(starts, down)[0].astype(np.float64)
        return np.where(np.isfinite(t), self._top_m + 1.0 - t, np.nan)

    def _verify(self, met: Meetings, suspects: AnyInt, loaded: Bool, hidden: Bool) -> AnyInt:
        """Judge suspects again against the mixed model itself; returns those that stay holes."""
        if self._built >= MAX_EXACT_SUBSETS:
            self._tally.unverified += len(suspects)
            return suspects
        self._built += 1
        built = BuiltModel(self._model, loaded, hidden)
        t = np.full(len(met.rays.kind), np.inf, dtype=np.float32)
        t[suspects] = built.closest(met.rays.origins[suspects], met.rays.directions[suspects])
        return self._judge.holes(met, built, t, suspects)[0]

    def _count(self, rays: Rays, hit: Bool, missed: Bool, holes: Bool) -> None:
        for kind in RayKind:
            of_kind = rays.kind == kind
            self._tally.counts[kind] += [
                int(of_kind.sum()),
                int((of_kind & hit).sum()),
                int((of_kind & missed).sum()),
                int((of_kind & holes).sum()),
            ]

    def _keep_worst(
        self,
        rays: Rays,
        detail_t: Float32,
        rows: AnyInt,
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
        # Grazing rays search for holes; what they see beside is outlines.
        rank[(rays.kind[rows] == RayKind.GRAZING) & ~marks[0][rows]] = -1.0
        at = int(np.argmax(rank))
        row, score = int(rows[at]), float(rank[at])
        if score <= self._tally.worst_score:
            return
        self._tally.worst_score = score
        is_hole, length = bool(marks[0][row]), float(distance[at])
        origin, heading = rays.origins[row], rays.directions[row]
        self._tally.worst = WorstRay(
            origin=_triple(origin),
            direction=_triple(heading),
            target=_triple(origin + heading * detail_t[row]),
            distance_m=length,
            hole=is_hole,
            verdict="hole" if is_hole else "excused" if marks[1][row] else "distance",
            kind=RayKind(int(rays.kind[row])).name.lower(),
            loaded=tuple(self._tally.named(np.flatnonzero(loaded)).tolist()),
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


def _percentiles(chunks: list[Float32]) -> dict[str, float]:
    values = np.concatenate(chunks) if chunks else np.empty(0, np.float32)
    if len(values) == 0:
        return {"p50": 0.0, "p99": 0.0, "p99.9": 0.0, "max": 0.0}
    # "lower" never averages a finite distance with an infinite one.
    p50, p99, p999 = np.percentile(values, [50, 99, 99.9], method="lower")
    return {"p50": float(p50), "p99": float(p99), "p99.9": float(p999), "max": float(values.max())}


def _triple(vector: AnyFloat) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])
