"""The proof of levels: random mixes of levels and base, and rays that look for holes in them.

A client shows each segment at one level, whichever, and the base where a segment is not loaded.
The rays are those of the hand-off (``docs/topics/hand-off.md``); half are aimed at the borders
between segments, where alone two levels meet. A ray that meets the full detail in a segment that is
not loaded is judged as there. In one that is shown at its coarser level it finds a *hole* where the
mix has no surface at the place on the ray, the normal or the vertical: within the tolerance, or as
near as the coarser level by itself is, without any mix. So what the level smooths is no hole, and a
gap beside it is one, however narrow: the lines have no width.

A scene larger than memory is looked at in windows, as for the hand-off (:mod:`.scene_windows`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from terraport_payload.types import AnyInt, Bool, Float32, Float64, Int32, Int64
from terraport_pipeline.engines.coarser import odd_edges
from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.cover.handoff_rays import (
    aim_rays,
    hidden_base_faces,
    random_places,
    random_subsets,
)
from terraport_pipeline.progress import NullProgress, Progress
from terraport_pipeline.published.mixed_model import HandOffModel
from terraport_pipeline.published.scene_model import load_scene_model
from terraport_pipeline.validate.handoff_judge import Judge, Meetings
from terraport_pipeline.validate.scene_windows import scene_windows
from terraport_store import Scene

__all__ = ["DEFAULT_MIXES", "LevelMixReport", "check_level_mixes"]

DEFAULT_RAYS: Final = 1_000_000
DEFAULT_MIXES: Final = 24

_LEAST_MIXES: Final = 6
"""Of a window: none loaded, all, and one of each random sort but one."""

MAX_HOLE_PLACES: Final = 16
"""Places of holes that a report names."""

_REACH_M: Final = 2.0
"""How far the coarser level is looked for around a place."""


@dataclass(frozen=True, slots=True)
class LevelMixReport:
    """What the rays found."""

    rays: int
    mixes: int
    hits: int
    """Rays that meet the full detail."""
    holes: int
    hole_places: tuple[tuple[float, float, float], ...]
    """Where rays that found a hole meet the full detail, metres; the first few."""
    distance_m: dict[str, float]
    """Percentiles of the distance from where a ray meets the full detail to the mix, in segments
    that are shown at the coarser level; ``inf`` where there were none."""


@dataclass(frozen=True, slots=True)
class _Level:
    vertices: Float32
    faces: Int32
    segment_of_face: Int32


@dataclass(slots=True)
class _Tally:
    hits: int = 0
    holes: int = 0
    rays: int = 0
    mixes: int = 0
    places: list[tuple[float, float, float]] = field(default_factory=list)
    distances: list[Float32] = field(default_factory=list)

    def add_holes(self, met: Meetings, rows: AnyInt) -> None:
        self.holes += len(rows)
        rows = rows[: MAX_HOLE_PLACES - len(self.places)]
        rays, t = met.rays, met.detail[0][rows]
        points = rays.origins[rows] + rays.directions[rows] * t[:, None]
        self.places += [(float(x), float(y), float(z)) for x, y, z in points]


class _Mixed:
    """One mix, built."""

    def __init__(self, parts: list[tuple[Float32, Int32]]) -> None:
        starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
        self._rays = RayScene(
            np.concatenate([vertices for vertices, _ in parts]),
            np.concatenate(
                [faces + np.int32(at) for (_, faces), at in zip(parts, starts[:-1], strict=True)]
            ),
        )

    def closest(self, origins: Float32, directions: Float32) -> Float32:
        """Distance along each ray to the nearest face, (R,); infinite where it meets none."""
        return self._rays.closest_hit(origins, directions)[0]


def check_level_mixes(
    scene: Scene,
    *,
    rays: int = DEFAULT_RAYS,
    mixes: int = DEFAULT_MIXES,
    seed: int = 0,
    progress: Progress | None = None,
) -> LevelMixReport:
    """Look for holes in random mixes of levels.

    Parameters
    ----------
    scene : Scene
        Open, with two levels.
    rays, mixes : int
        In all; rays are shared evenly. Every window of a scene larger than memory gets a few mixes,
        and rays by its faces.
    seed : int
    progress : Progress, optional
        Advances by rays.

    Returns
    -------
    LevelMixReport
        The same for the same scene, numbers and machine type.

    Raises
    ------
    OptionError
        The scene has one level.
    """
    if scene.manifest.levels < 2:
        raise OptionError("the scene has one level; expected two, to mix them")
    watcher = progress or NullProgress()
    windows = scene_windows(scene)
    faces = [int(scene.index.face_count[window].sum(dtype=np.int64)) for window in windows]
    rng = np.random.default_rng(seed)
    watcher.start("levels: rays", float(rays), "rays")
    tally = _Tally()
    for number, segments in enumerate(windows):
        before, behind = sum(faces[:number]), sum(faces[: number + 1])
        here = rays * behind // sum(faces) - rays * before // sum(faces)
        few = mixes if len(windows) == 1 else max(_LEAST_MIXES, mixes // len(windows))
        _look_at_window(scene, segments, min(few, here), here, tally, rng, watcher)
    watcher.done({"holes": tally.holes})
    distances = np.concatenate([*tally.distances, np.empty(0, np.float32)])
    marks = [np.inf] * 4
    if len(distances):
        marks = np.percentile(distances, [50, 99, 99.9, 100], method="lower").tolist()
    return LevelMixReport(
        tally.rays,
        tally.mixes,
        tally.hits,
        tally.holes,
        tuple(tally.places),
        dict(zip(("p50", "p99", "p99.9", "max"), marks, strict=True)),
    )


def _look_at_window(
    scene: Scene,
    segments: Int64,
    mixes: int,
    rays: int,
    tally: _Tally,
    rng: np.random.Generator,
    watcher: Progress,
) -> None:
    """Cast rays at mixes of some segments, as if there were no others."""
    model = load_scene_model(scene, segments=segments).hand_off_model(segments)
    prover = _Prover(model, _load_level(scene, 1, segments), rng)
    loaded = random_subsets(prover.centres, max(mixes, 1), rng)
    loaded[::3] = True
    for mix in range(mixes):
        count = rays // mixes + (mix < rays % mixes)
        prover.look(tally, loaded[mix], prover.levels_of(mix), count)
        watcher.advance(count)


def _load_level(scene: Scene, level: int, segments: Int64) -> _Level:
    start = level * len(scene.index)
    meshes = [scene.mesh(start + segment) for segment in segments.tolist()]
    starts = np.cumsum([0, *(len(mesh.positions) for mesh in meshes)])
    return _Level(
        np.concatenate([mesh.positions for mesh in meshes]),
        np.concatenate(
            [
                mesh.faces.astype(np.int32) + np.int32(at)
                for mesh, at in zip(meshes, starts[:-1], strict=True)
            ]
        ),
        np.repeat(np.arange(len(segments)), [len(mesh.faces) for mesh in meshes]).astype(np.int32),
    )


class _Prover:
    """Casts rays at mixes."""

    def __init__(self, model: HandOffModel, coarse: _Level, rng: np.random.Generator) -> None:
        self.model, self.coarse, self.rng = model, coarse, rng
        self._detail = RayScene(model.detail_vertices, model.detail_faces)
        self._judge = Judge(model, self._detail, RayScene(model.base_vertices, model.base_faces))
        self._all_coarse = _Mixed([(coarse.vertices, coarse.faces)])
        self._top_m = float(model.detail_vertices[:, 1].max())
        self._edges = _borders(model)
        corners = model.detail_vertices[model.detail_faces].mean(axis=1, dtype=np.float64)
        counts = np.bincount(model.segment_of_face, minlength=model.segment_count)
        sums = [
            np.bincount(model.segment_of_face, corners[:, axis], minlength=model.segment_count)
            for axis in range(3)
        ]
        self.centres: Float64 = np.stack(sums, axis=1) / np.maximum(counts, 1)[:, None]

    def levels_of(self, mix: int) -> Bool:
        """Choose which segments are coarse: beyond a radius as at a landing, or by a coin."""
        if mix % 2:
            return np.asarray(self.rng.random(len(self.centres)) < self.rng.random(), np.bool_)
        middle = self.centres[self.rng.integers(len(self.centres))]
        distance = np.linalg.norm(self.centres - middle, axis=1)
        return np.asarray(distance > np.quantile(distance, 0.5 * self.rng.random()), np.bool_)

    def look(self, tally: _Tally, loaded: Bool, is_coarse: Bool, count: int) -> None:
        """Cast rays at one mix."""
        model, coarse = self.model, self.coarse
        hidden = hidden_base_faces(model.cover_offsets, model.cover_segments, loaded)
        fine = (loaded & ~is_coarse)[model.segment_of_face]
        rough = (loaded & is_coarse)[coarse.segment_of_face]
        mixed = _Mixed(
            [
                (model.detail_vertices, model.detail_faces[fine]),
                (coarse.vertices, coarse.faces[rough]),
                (model.base_vertices, model.base_faces[~hidden]),
            ]
        )
        anywhere, _ = random_places(
            model.detail_vertices, model.detail_faces, count - count // 2, self.rng
        )
        targets = np.concatenate([anywhere, self._on_borders(count // 2)])
        rays = aim_rays(targets, self._top_m, self.rng, ground_m=self._ground_m)
        met = self._judge.meetings(rays)
        mixed_t = mixed.closest(rays.origins, rays.directions)
        rows: AnyInt = np.flatnonzero(np.isfinite(met.detail[0]))
        tally.rays += len(rays.kind)
        tally.hits += len(rows)
        at = model.segment_of_face[met.detail[1][rows]]
        tally.mixes += 1
        tally.add_holes(met, self._judge.holes(met, mixed, mixed_t, rows[~loaded[at]])[0])
        tally.add_holes(met, self._gaps(met, mixed, mixed_t, rows[loaded[at]], tally))

    def _gaps(
        self, met: Meetings, mixed: _Mixed, mixed_t: Float32, rows: AnyInt, tally: _Tally
    ) -> AnyInt:
        """Find holes in what is loaded, at whichever level: rows of rays."""
        places = self._judge.hit_places(met, rows)
        now = places.distance(mixed, mixed_t[rows], _REACH_M)
        tally.distances.append(now)
        tolerance_m = self.model.tolerance_m
        passes = (
            mixed_t[rows] > met.detail[0][rows] + tolerance_m
        )  # nothing stands before the place
        rows, now = rows[passes & (now > tolerance_m)], now[passes & (now > tolerance_m)]
        places = self._judge.hit_places(met, rows)
        alone_t = self._all_coarse.closest(met.rays.origins[rows], met.rays.directions[rows])
        due = places.distance(self._all_coarse, alone_t, _REACH_M)
        # Further than the reach lies what is behind the place: then the level by itself has nothing
        # here, and what it smooths is no gap while there is ground at any height.
        is_gap = (due <= _REACH_M) & ~(now <= due + tolerance_m * 1e-2)
        is_gap |= (now > _REACH_M) & ~places.meets_vertical(mixed)
        return rows[is_gap]

    def _on_borders(self, count: int) -> Float64:
        chosen = self._edges[self.rng.integers(len(self._edges), size=count)]
        ends = self.model.detail_vertices[chosen].astype(np.float64)
        share = self.rng.random((count, 1))
        places: Float64 = ends[:, 0] * share + ends[:, 1] * (1 - share)
        return places

    def _ground_m(self, points: Float64) -> Float64:
        starts = points.copy()
        starts[:, 1] = self._top_m + 1.0
        down = np.broadcast_to(np.array([0.0, -1.0, 0.0]), starts.shape)
        t = self._detail.closest_hit(starts, down)[0].astype(np.float64)
        return np.where(np.isfinite(t), self._top_m + 1.0 - t, np.nan)


def _borders(model: HandOffModel) -> Int64:
    """Edges at the borders of segments: each has vertices of its own, split by region at most."""
    _, first, place = np.unique(
        np.column_stack([model.detail_vertices, np.zeros(len(model.detail_vertices))]),
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    faces = place.reshape(-1)[model.detail_faces]
    keyed = faces.astype(np.int64) + model.segment_of_face[:, None].astype(np.int64) * len(first)
    ends, owners = np.unique(
        np.sort(odd_edges(keyed) % len(first), axis=1), axis=0, return_counts=True
    )
    # At the scene's own border a line through the place just misses any surface, or does not.
    edges: Int64 = first[ends[owners > 1]]
    return edges
