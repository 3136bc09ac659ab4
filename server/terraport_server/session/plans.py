"""What one client's landings and aims come to, as the messages that tell it.

PURE: no I/O, no clock. spec/wire-protocol.md, sections 6.1 to 6.3 and 7.
"""

from __future__ import annotations

import numpy as np

from terraport_payload import box_distances_m
from terraport_payload.types import AnyArray, Float64, Int64, UInt32
from terraport_server.session.actions import PullView, SceneView, SessionLimits
from terraport_server.session.id_set import IdSet
from terraport_server.session.selection import (
    NO_BUDGETS,
    Budgets,
    SegmentTable,
    Selection,
    find_candidates,
    select,
)
from terraport_wire import BLOCK_BYTES, ID_DTYPE, LOAD_DTYPE, Aim, Hello, Land, Plan, Prefetch

__all__ = ["Planner", "budgets_of"]


class Planner:
    """Plans for one client in one scene.

    Parameters
    ----------
    scene
        What is served.
    limits
        What the client may do.
    hello
        What the client can take.
    """

    def __init__(self, scene: SceneView, limits: SessionLimits, hello: Hello) -> None:
        self.table: SegmentTable = scene.encodings[hello.encoding]
        self.release_factor = hello.release_factor or limits.release_factor
        """Release radius / load radius in use."""
        self._within = scene.within
        self._pull = scene.pull if hello.delivery == "pull" else None
        self._budgets = budgets_of(hello, limits)

    def choose(self, wanted: Land | Aim, held: IdSet) -> tuple[Selection, int]:
        """Return the plan's segments, and how many were looked at to choose them."""
        release_radius_m = outer_release_m = wanted.radius_m * self.release_factor
        coarse = None
        if wanted.coarse_radius_m is not None and self.table.levels > 1:
            outer_release_m = wanted.coarse_radius_m * self.release_factor
            coarse = (wanted.coarse_radius_m, outer_release_m)
            around = self._within(wanted.position, wanted.coarse_radius_m)
            is_near = self._distances_m(around, wanted) <= wanted.radius_m
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

    def _distances_m(self, segments: Int64, wanted: Land | Aim) -> Float64:
        return box_distances_m(self.table.bounds[segments], wanted.position)

    def plan(self, land: Land, chosen: Selection) -> Plan:
        """Return the ``plan`` of a landing, its table in the order in which segments are sent.

        To a client that pulls it says where it fetches them.
        """
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
        """Return the ``prefetch`` of an aim, its table in the order in which segments are sent."""
        rows = _load_table(chosen, self.table)
        return Prefetch.trusted(
            generation=aim.generation,
            segments=rows,
            bytes=chosen.load_bytes,
            blocks=_blocks(chosen, self._pull),
        )


def budgets_of(hello: Hello, limits: SessionLimits) -> Budgets:
    """Return what bounds every plan of a client: its own budgets and the server's."""
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
