"""Which segments a landing shows: a ball of the scene, cut by budgets (protocol 2, section 4).

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from terraport_payload import box_distances_m
from terraport_payload.types import AnyArray, Bool, Float64, Int64, UInt64
from terraport_server.session.interface import SceneView, SegmentTable
from terraport_server.session.planner import Budgets, budget_prefix
from terraport_wire import Budgets as AskedBudgets
from terraport_wire.protocol_2 import COARSER, FOLLOWS, SEGMENT_DTYPE, Plan

__all__ = ["Ball", "budgets_of", "choose", "plan_of", "table_of"]


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


def table_of(scene: SceneView) -> SegmentTable:
    """Return the segment table of a scene's one encoding."""
    return next(iter(scene.encodings.values()))


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
    table = table_of(scene)
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
    count, omitted_by = budget_prefix(table, rows, budgets)
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
    table, rows = table_of(scene), ball.rows
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
    assert scene.hidden_faces is not None
    return scene.hidden_faces.packed(rows % table_of(scene).segment_count)


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
