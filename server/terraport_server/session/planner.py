"""Which segments a landing or an aim needs: arrays in, one plan message out.

PURE: no I/O, no clock. spec/wire-protocol.md, sections 6.1 to 6.3 and 7.

The distance of a segment is the Euclidean distance, in metres and in float64, from the landing to
the nearest point of its axis-aligned box (0 inside). All choices use the order (distance, id), so
the result never depends on the order of the input, and a budget keeps a *prefix* of it: an omitted
segment is never nearer than an included one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from terraport_payload import box_distances_m
from terraport_payload.types import AnyArray, AnyInt, Bool, Int64, UInt32
from terraport_server.session.id_set import IdSet
from terraport_server.session.interface import PullView, SceneView, SegmentTable, SessionLimits
from terraport_wire import BLOCK_BYTES, ID_DTYPE, LOAD_DTYPE, Aim, Hello, Land, Plan, Prefetch

__all__ = [
    "NO_BUDGETS",
    "Budgets",
    "Planner",
    "Selection",
    "budget_prefix",
    "find_candidates",
    "gpu_bytes",
    "select",
]


@dataclass(frozen=True, slots=True)
class Budgets:
    """Upper bounds on the segments that a plan makes resident: loaded, kept and nearby together.

    ``None`` means no bound.
    """

    max_triangles: int | None = None
    max_bytes: int | None = None
    max_segments: int | None = None
    max_gpu_bytes: int | None = None
    gpu_vertex_bytes: int = 24
    """Bytes of a vertex on the client's GPU."""
    gpu_face_bytes: int = 6
    """Bytes of a triangle's indices on it."""


NO_BUDGETS = Budgets()

_MOST_OF_SHORT_INDICES: Final = 65534
"""Maximum vertices with 16-bit indices: 65535 is a restart index on some GPUs."""

_LONG_FACE_BYTES: Final = 12
"""Bytes of a triangle with 32-bit indices."""


@dataclass(frozen=True, slots=True)
class Selection:
    """Result of :func:`select`; ``load`` and ``keep`` are disjoint and together the plan."""

    load: UInt32
    """Ids to send, nearest first."""
    keep: UInt32
    """Ids within the radius that the client holds, ascending."""
    nearby: UInt32
    """Held ids beyond the radius and within the release radius: kept but not shown; ascending."""
    plan: IdSet
    """Ids of ``load`` and ``keep``."""
    order: UInt32
    """Ids of the plan, nearest first."""
    inner: UInt32
    """Ids of the plan within ``inner_radius_m``, nearest first; empty without that radius."""
    effective_radius_m: float
    """The plan contains every segment nearer than this; the requested radius if none is omitted."""
    load_bytes: int
    load_triangles: int
    total_bytes: int
    """Payload bytes of ``load`` and ``keep``."""
    total_triangles: int
    total_gpu_bytes: int | None
    """Bytes of ``load``, ``keep`` and ``nearby`` on the client's GPU; ``None`` without a budget."""
    omitted_segments: int
    """Number of segments within the radius that a budget omitted."""
    omitted_by: str | None
    """Field name in :class:`Budgets` of the budget that omitted them; ``None`` if none did."""


class Planner:
    """Planner for one client in one scene."""

    def __init__(self, scene: SceneView, limits: SessionLimits, hello: Hello) -> None:
        self.table: SegmentTable = scene.encodings[hello.encoding]
        self.release_factor = hello.release_factor or limits.release_factor
        """Release radius / load radius in use."""
        self._within = scene.within
        self._pull = scene.pull if hello.delivery == "pull" else None
        self._budgets = _budgets_of(hello, limits)

    def choose(self, wanted: Land | Aim, held: IdSet) -> tuple[Selection, int]:
        """Return the selected segments and the number of segments examined."""
        release_radius_m = outer_release_m = wanted.radius_m * self.release_factor
        coarse = None
        if wanted.coarse_radius_m is not None and self.table.levels > 1:
            outer_release_m = wanted.coarse_radius_m * self.release_factor
            coarse = (wanted.coarse_radius_m, outer_release_m)
            around = self._within(wanted.position, wanted.coarse_radius_m)
            distances = box_distances_m(self.table.bounds[around], wanted.position)
            is_near = distances <= wanted.radius_m
            near = np.concatenate([around[is_near], around[~is_near] + self.table.segment_count])
        else:
            near = self._within(wanted.position, wanted.radius_m)
        candidates, is_held = find_candidates(
            self.table, near, held, wanted.position, outer_release_m
        )
        chosen = select(
            self.table,
            candidates,
            wanted.position,
            wanted.radius_m,
            release_radius_m=release_radius_m,
            inner_radius_m=wanted.inner_radius_m if isinstance(wanted, Land) else None,
            held=is_held,
            coarse=coarse,
            budgets=self._budgets,
        )
        return chosen, len(near) + len(held)

    def plan(self, land: Land, chosen: Selection) -> Plan:
        """Return the ``plan`` of a landing; rows are in sending order, with blocks for pull."""
        return Plan.trusted(
            generation=land.generation,
            position=land.position,
            radius_m=land.radius_m,
            release_radius_m=land.radius_m * self.release_factor,
            effective_radius_m=chosen.effective_radius_m,
            inner_count=len(chosen.inner),
            load=_load_table(chosen, self.table),
            keep=chosen.keep,
            nearby=chosen.nearby,
            load_bytes=chosen.load_bytes,
            load_triangles=chosen.load_triangles,
            total_bytes=chosen.total_bytes,
            total_triangles=chosen.total_triangles,
            omitted_segments=chosen.omitted_segments,
            omitted_by=chosen.omitted_by,
            total_gpu_bytes=chosen.total_gpu_bytes,
            blocks=_blocks(chosen, self._pull),
        )

    def prefetch(self, aim: Aim, chosen: Selection) -> Prefetch:
        """Return the ``prefetch`` of an aim; rows are in sending order."""
        rows = _load_table(chosen, self.table)
        return Prefetch.trusted(
            generation=aim.generation,
            segments=rows,
            bytes=chosen.load_bytes,
            blocks=_blocks(chosen, self._pull),
        )


def find_candidates(
    table: SegmentTable,
    near: Int64,
    held: IdSet,
    centre: Sequence[float],
    release_radius_m: float,
) -> tuple[Int64, Bool]:
    """Return the candidates of a plan: all near segments, and held ones within the release radius.

    Beyond the load radius only held segments are examined, never the whole scene: a ball of four
    times the radius contains sixteen times as many segments.

    ``near`` are the rows within the load radius, ascending. The result is unique rows, and for each
    of them whether it is held.
    """
    ids = held.array()
    if not len(ids):  # skip a dozen NumPy calls
        return near, np.zeros(len(near), dtype=np.bool_)
    # Filter by axis, because most of a large cache is far away. The margin covers rounding; select
    # computes the exact distances.
    for axis in (0, 2):
        at_m = np.float64(centre[axis])  # not a float, which would be rounded to float32
        reach_m = release_radius_m + 1e-12 * (release_radius_m + abs(at_m)) + 1e-30
        low_m, high_m = table.bounds[ids, axis], table.bounds[ids, axis + 3]
        ids = ids[(low_m <= at_m + reach_m) & (high_m >= at_m - reach_m)]
    positions = np.searchsorted(near, ids)
    positions[positions == len(near)] = 0
    further = ids[near[positions] != ids] if len(near) else ids
    candidates = np.concatenate((near, further))
    is_held = np.ones(len(candidates), dtype=np.bool_)
    is_held[: len(near)] = held.contains(near)
    return candidates, is_held


def select(
    table: SegmentTable,
    candidates: AnyInt,
    centre: Sequence[float],
    radius_m: float,
    *,
    release_radius_m: float,
    inner_radius_m: float | None,
    held: Bool,
    budgets: Budgets = NO_BUDGETS,
    coarse: tuple[float, float] | None = None,
) -> Selection:
    """Select the segments of one landing.

    The plan contains each segment within ``radius_m``, and beyond it the coarser level of each
    segment within ``coarse``. Held segments further away, within their level's release radius, are
    kept nearby. Budgets keep a prefix in the order (distance, id) of the plan, then of the nearby
    segments, so that nearby segments are dropped first. spec/wire-protocol.md, sections 6.1 to 6.3.

    Parameters
    ----------
    candidates
        Unique rows: each one within its radius and each held one within its level's release
        radius; more rows do no harm.
    centre
        Position of the landing in metres, scene frame.
    inner_radius_m
        Radius of the inner set; ``None``: no inner set.
    held
        True for each candidate that the client holds.
    coarse
        Radius and release radius of the coarser level, each at least that of full detail; ``None``:
        no coarser level.

    Notes
    -----
    O(C log C) in the number of candidates, independent of the scene's size; O(C) plus sorting the
    result where a budget of segments omits most candidates.
    """
    # Wanted rows: within the radius, or held and within the release radius; one level per segment.
    ids = np.asarray(candidates, dtype=np.int64)
    distances = box_distances_m(table.bounds[ids], centre)
    in_radius = distances <= radius_m
    is_kept = ~in_radius & (distances <= release_radius_m)
    if coarse is not None or table.levels > 1:
        coarse_m, coarse_release_m = coarse or (-1.0, -1.0)
        coarser = ids >= table.segment_count
        in_ring = ~in_radius & (distances <= coarse_m)
        is_kept[coarser] = ((distances > coarse_m) & (distances <= coarse_release_m))[coarser]
        in_radius[coarser] = in_ring[coarser]
    wanted = np.flatnonzero(in_radius | (held & is_kept))

    # Rows beyond the budget of segments need not be sorted.
    omitted = 0
    most, inside = budgets.max_segments, np.flatnonzero(in_radius)
    if most is not None and len(inside) > 2 * (most + 1):
        head = distances[inside] <= np.partition(distances[inside], most)[most]
        omitted = int(np.count_nonzero(~head))
        wanted = inside[head]

    # Longest prefix within all budgets. Shown rows first: a kept row may be nearer than the ring.
    order = wanted[np.lexsort((ids[wanted], distances[wanted], ~in_radius[wanted]))]
    ids, distances, in_radius, held = ids[order], distances[order], in_radius[order], held[order]
    count, omitted_by = budget_prefix(table, ids, budgets)

    within = int(np.count_nonzero(in_radius))
    nearby = ids[within:count]
    omitted += max(within - count, 0)
    outer_m = radius_m if coarse is None else coarse[0]
    effective_radius_m = float(outer_m if within <= count else distances[count])

    # Load and keep.
    count = min(within, count)
    plan, plan_distances = ids[:count], distances[:count]
    load, keep = plan[~held[:count]], plan[held[:count]]
    plan_order = plan.astype(np.uint32)
    inner = plan_order[:0]
    if inner_radius_m is not None:
        inner = plan_order[plan_distances <= inner_radius_m]
    load_bytes, load_triangles = _totals(table, load)
    keep_bytes, keep_triangles = _totals(table, keep)
    return Selection(
        load=load.astype(np.uint32),
        keep=np.sort(keep).astype(np.uint32),
        nearby=np.sort(nearby).astype(np.uint32),
        plan=IdSet.of_sorted(np.sort(plan_order)),
        order=plan_order,
        inner=inner,
        effective_radius_m=effective_radius_m,
        load_bytes=load_bytes,
        load_triangles=load_triangles,
        total_bytes=load_bytes + keep_bytes,
        total_triangles=load_triangles + keep_triangles,
        total_gpu_bytes=(
            None
            if budgets.max_gpu_bytes is None
            else int(gpu_bytes(table, np.concatenate((plan, nearby)), budgets).sum())
        ),
        omitted_segments=omitted,
        omitted_by=omitted_by if omitted else None,
    )


def gpu_bytes(table: SegmentTable, ids: Int64, budgets: Budgets) -> Int64:
    """Return the bytes of each segment on a client's GPU; spec/wire-protocol.md, section 6.2."""
    vertices, faces = table.vertices[ids].astype(np.int64), table.faces[ids].astype(np.int64)
    face_bytes = np.where(
        vertices > _MOST_OF_SHORT_INDICES,
        max(budgets.gpu_face_bytes, _LONG_FACE_BYTES),
        budgets.gpu_face_bytes,
    )
    textures = table.texture_bytes[ids].astype(np.int64)
    total: Int64 = vertices * budgets.gpu_vertex_bytes + faces * face_bytes + textures
    return total


def _totals(table: SegmentTable, ids: Int64) -> tuple[int, int]:
    """Return payload bytes and triangles of segments."""
    if not len(ids):
        return 0, 0
    lengths, faces = table.lengths[ids], table.faces[ids]
    return int(lengths.sum(dtype=np.int64)), int(faces.sum(dtype=np.int64))


def budget_prefix(table: SegmentTable, ids: Int64, budgets: Budgets) -> tuple[int, str | None]:
    """Return the length of the longest prefix within all budgets, and the budget that ended it.

    If two budgets end at the same segment, the first in this order is returned: segments,
    triangles, bytes, GPU bytes.
    """
    count, omitted_by = len(ids), None
    if budgets.max_segments is not None and budgets.max_segments < count:
        count, omitted_by = budgets.max_segments, "max_segments"
    for name, sizes_of, limit in (
        ("max_triangles", lambda: table.faces[ids], budgets.max_triangles),
        ("max_bytes", lambda: table.lengths[ids], budgets.max_bytes),
        ("max_gpu_bytes", lambda: gpu_bytes(table, ids, budgets), budgets.max_gpu_bytes),
    ):
        if limit is None:
            continue
        running = np.cumsum(sizes_of(), dtype=np.int64)
        fits = int(np.searchsorted(running, limit, side="right"))
        if fits < count:
            count, omitted_by = fits, name
    return count, omitted_by


def _budgets_of(hello: Hello, limits: SessionLimits) -> Budgets:
    """Return the budgets of a client's plans: its own and the server's."""
    asked = hello.budgets
    most = limits.max_plan_segments
    if asked.max_segments is not None:
        most = min(most, asked.max_segments)
    return Budgets(
        max_triangles=asked.max_triangles,
        max_bytes=asked.max_bytes,
        max_segments=most,
        max_gpu_bytes=asked.max_gpu_bytes,
        gpu_vertex_bytes=asked.gpu_vertex_bytes or NO_BUDGETS.gpu_vertex_bytes,
        gpu_face_bytes=asked.gpu_face_bytes or NO_BUDGETS.gpu_face_bytes,
    )


def _blocks(chosen: Selection, pull: PullView | None) -> UInt32 | None:
    if pull is None:
        return None
    blocks = (pull.offsets[chosen.load] // BLOCK_BYTES).astype(ID_DTYPE)
    blocks.setflags(write=False)
    return blocks


def _load_table(chosen: Selection, table: SegmentTable) -> AnyArray:
    ids = chosen.load
    rows = np.empty(len(ids), dtype=LOAD_DTYPE)
    rows["id"] = ids
    rows["length"] = table.lengths[ids]
    rows["xxh3"] = table.hashes[ids]
    rows["faces"] = table.faces[ids]
    rows["vertices"] = table.vertices[ids]
    rows["bounds"] = table.bounds[ids]
    rows.setflags(write=False)  # the message then need not copy it
    return rows
