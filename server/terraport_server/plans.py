"""A selection as the messages that tell a client of it.

PURE: no I/O, no clock. spec/wire-protocol.md, sections 6.3 and 7.
"""

from __future__ import annotations

import numpy as np

from terraport_payload.types import AnyArray
from terraport_server.actions import SessionLimits
from terraport_server.selection import Budgets, SegmentTable, Selection
from terraport_wire import LOAD_DTYPE, Aim, Hello, Land, Plan, Prefetch

__all__ = ["budgets_of", "make_plan", "make_prefetch"]


def budgets_of(hello: Hello, limits: SessionLimits) -> Budgets:
    """Return what bounds every plan of a client: its own budgets and the server's."""
    asked = hello.budgets
    most = limits.max_plan_segments
    if asked.max_segments is not None:
        most = min(most, asked.max_segments)
    return Budgets(max_triangles=asked.max_triangles, max_bytes=asked.max_bytes, max_segments=most)


def make_plan(
    land: Land, chosen: Selection, table: SegmentTable, *, release_radius_m: float
) -> Plan:
    """Return the ``plan`` of a landing, its table in the order in which segments are sent."""
    return Plan.trusted(
        generation=land.generation,
        position=land.position,
        radius_m=land.radius_m,
        release_radius_m=release_radius_m,
        effective_radius_m=chosen.effective_radius_m,
        inner_count=len(chosen.inner),
        load=_load_table(chosen, table),
        keep=chosen.keep,
        nearby=chosen.nearby,
        load_bytes=chosen.load_bytes,
        load_triangles=chosen.load_triangles,
        total_bytes=chosen.total_bytes,
        total_triangles=chosen.total_triangles,
        omitted_segments=chosen.omitted_segments,
        omitted_by=chosen.omitted_by,
    )


def make_prefetch(aim: Aim, chosen: Selection, table: SegmentTable) -> Prefetch:
    """Return the ``prefetch`` of an aim, its table in the order in which segments are sent."""
    rows = _load_table(chosen, table)
    return Prefetch.trusted(generation=aim.generation, segments=rows, bytes=chosen.load_bytes)


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
