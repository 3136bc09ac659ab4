"""Which segments a landing shows: a ball of the scene, cut by budgets.

PURE: no I/O, no clock. Section numbers are those of spec/protocol.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from terraport_payload import box_distances_m
from terraport_payload.types import AnyArray, Bool, Float64, Int64, UInt64
from terraport_server.session.interface import SceneView, SegmentTable
from terraport_wire import COARSER, FOLLOWS, SEGMENT_DTYPE, Plan
from terraport_wire import Budgets as AskedBudgets

__all__ = ["Ball", "Budgets", "budgets_of", "choose", "gpu_bytes", "hidden_under", "plan_of"]

_MOST_OF_SHORT_INDICES: Final = 65534
"""Maximum vertices with 16-bit indices: 65535 is a restart index on some GPUs."""

_LONG_FACE_BYTES: Final = 12
"""Bytes of a triangle with 32-bit indices."""


@dataclass(frozen=True, slots=True)
class Budgets:
    """Upper bounds on what a plan shows; ``None`` means no bound."""

    max_triangles: int | None = None
    max_bytes: int | None = None
    max_segments: int | None = None
    max_gpu_bytes: int | None = None
    gpu_vertex_bytes: int = 24
    """Bytes of a vertex on the client's GPU."""
    gpu_face_bytes: int = 6
    """Bytes of a triangle's indices on it."""


@dataclass(frozen=True, slots=True)
class Ball:
    """What a landing shows."""

    rows: Int64
    """Rows of the segment table, nearest first."""
    distances_m: Float64
    effective_radius_m: float
    """Everything nearer is among the rows."""
    omitted: int
    """Segments that a budget left out."""
    omitted_by: str | None
    looked_at: int
    """Segments that were examined: the cost."""
    left_out: Int64
    """Rows that the client said it cannot use."""


def budgets_of(asked: AskedBudgets, max_plan_segments: int) -> Budgets:
    """Return a client's budgets, cut to what the service plans at most."""
    given = {
        name: value
        for name in Budgets.__dataclass_fields__
        if (value := getattr(asked, name)) is not None
    }
    most = min(max_plan_segments, given.get("max_segments", max_plan_segments))
    return replace(Budgets(**given), max_segments=most)


def choose(
    scene: SceneView,
    centre: Sequence[float],
    radius_m: float,
    *,
    coarse_radius_m: float | None = None,
    without: UInt64 | None = None,
    budgets: Budgets,
) -> Ball:
    """Choose the segments of a landing.

    Parameters
    ----------
    scene
    centre
        Scene frame, metres.
    radius_m
        Full detail within.
    coarse_radius_m
        The coarser level beyond ``radius_m`` up to it, where the scene has one.
    without
        Keys that are left out.
    budgets
        The longest beginning of the order (distance, segment) that exceeds none is chosen.

    Notes
    -----
    O(n log n) in the number of segments within the larger radius.
    """
    table = scene.table
    outer_m = radius_m
    if coarse_radius_m is not None and table.levels > 1:
        outer_m = coarse_radius_m
    segments = scene.within(centre, outer_m)
    distances = box_distances_m(table.bounds[segments], centre)
    rows = np.where(distances <= radius_m, segments, segments + table.segment_count)
    left_out = rows[:0]
    if without is not None and len(without):
        is_usable = ~np.isin(table.hashes[rows], without)
        left_out = rows[~is_usable]
        rows, segments, distances = rows[is_usable], segments[is_usable], distances[is_usable]
    order = np.lexsort((segments, distances))
    rows, distances = rows[order], distances[order]
    count, omitted_by = _budget_prefix(table, rows, budgets)
    omitted = len(rows) - count
    return Ball(
        rows=rows[:count],
        distances_m=distances[:count],
        effective_radius_m=float(distances[count]) if omitted else outer_m,
        omitted=omitted,
        omitted_by=omitted_by if omitted else None,
        looked_at=len(order),
        left_out=left_out,
    )


def plan_of(
    scene: SceneView,
    ball: Ball,
    generation: int,
    *,
    follows: Bool | None = None,
    inner_radius_m: float | None = None,
    offsets: UInt64 | None = None,
    pack: str | None = None,
) -> Plan:
    """Return the plan message of a ball.

    Parameters
    ----------
    follows
        For each row whether the client does not have it; None: it has none.
    inner_radius_m
        Of the set that may be shown first.
    offsets, pack
        Over HTTP: where payloads begin in the pack, by row of the table, and its address.
    """
    table, rows = scene.table, ball.rows
    inner_count = inner_hidden = None
    if inner_radius_m is not None:
        inner_count = int(np.count_nonzero(ball.distances_m <= inner_radius_m))
        inner_hidden = hidden_under(scene, rows[:inner_count])
    return Plan(
        generation=generation,
        show=_show(table, rows, np.ones(len(rows), bool) if follows is None else follows),
        hidden=hidden_under(scene, rows),
        inner_count=inner_count,
        inner_hidden=inner_hidden,
        effective_radius_m=ball.effective_radius_m,
        omitted=ball.omitted,
        omitted_by=ball.omitted_by,
        pack=pack,
        offsets=None if offsets is None else offsets[rows],
    )


def hidden_under(scene: SceneView, rows: Int64) -> bytes:
    """Return the base faces that are hidden when these rows are shown, as in a plan."""
    return scene.hidden_faces.packed(rows % scene.table.segment_count)


def _show(table: SegmentTable, rows: Int64, follows: Bool) -> AnyArray:
    show = np.empty(len(rows), dtype=SEGMENT_DTYPE)
    show["key"] = table.hashes[rows]
    show["id"] = rows % table.segment_count
    show["bytes"] = table.lengths[rows]
    show["faces"] = table.faces[rows]
    show["vertices"] = table.vertices[rows]
    show["flags"] = follows * FOLLOWS + (rows >= table.segment_count) * COARSER
    show.setflags(write=False)
    return show


def _budget_prefix(table: SegmentTable, rows: Int64, budgets: Budgets) -> tuple[int, str | None]:
    """Return the length of the longest beginning within all budgets, and the budget that ended it.

    If two budgets end at the same segment, the first in this order is returned: segments,
    triangles, bytes, GPU bytes.
    """
    count, omitted_by = len(rows), None
    if budgets.max_segments is not None and budgets.max_segments < count:
        count, omitted_by = budgets.max_segments, "max_segments"
    for name, sizes_of, limit in (
        ("max_triangles", lambda: table.faces[rows], budgets.max_triangles),
        ("max_bytes", lambda: table.lengths[rows], budgets.max_bytes),
        ("max_gpu_bytes", lambda: gpu_bytes(table, rows, budgets), budgets.max_gpu_bytes),
    ):
        if limit is None:
            continue
        running = np.cumsum(sizes_of(), dtype=np.int64)
        fits = int(np.searchsorted(running, limit, side="right"))
        if fits < count:
            count, omitted_by = fits, name
    return count, omitted_by


def gpu_bytes(table: SegmentTable, rows: Int64, budgets: Budgets) -> Int64:
    """Return the bytes of each segment on a client's GPU (section 4, rule 2)."""
    vertices, faces = table.vertices[rows].astype(np.int64), table.faces[rows].astype(np.int64)
    face_bytes = np.where(
        vertices > _MOST_OF_SHORT_INDICES,
        max(budgets.gpu_face_bytes, _LONG_FACE_BYTES),
        budgets.gpu_face_bytes,
    )
    textures = table.texture_bytes[rows].astype(np.int64)
    total: Int64 = vertices * budgets.gpu_vertex_bytes + faces * face_bytes + textures
    return total
