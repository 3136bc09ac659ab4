"""Debris: small pieces that touch nothing, gathered lest each becomes a segment.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from terraport_payload.types import Bool, Float32, Int32
from terraport_pipeline.geometry.clouds.near_filter import may_be_near
from terraport_pipeline.geometry.mesh.curve import morton_order
from terraport_pipeline.geometry.mesh.face_measures import dense_labels
from terraport_pipeline.geometry.segments.unit_graph import Units

__all__ = ["DebrisCounts", "join_debris"]


_DEBRIS_REACH: Final = 0.25
"""Debris joins a segment within this share of ``max_extent_m``: farther, the segment's box would
swell for nothing."""
_DEBRIS_CANDIDATES: Final = 8
"""Nearest faces looked at per debris face; the first segments among them whose bounds allow it take
the debris."""


@dataclass(frozen=True, slots=True)
class DebrisCounts:
    """How many debris units joined a segment or each other, and how many stayed alone."""

    joined: int = 0
    """Pieces that joined a segment or each other."""
    alone: int = 0
    """Pieces left as they were."""


def join_debris(
    labels: Int32,
    units: Units,
    touching: Bool,
    low: Float32,
    high: Float32,
    *,
    min_faces: int,
    max_faces: int,
    max_extent_m: float,
    threads: int = 1,
) -> tuple[Int32, DebrisCounts]:
    """Give debris to the nearest segment within reach, or to its likes nearby.

    Parameters
    ----------
    labels : ndarray of shape (F,), int32
        Unit of every face.
    units : Units
        The units.
    touching : ndarray of shape (U,), bool
        Whether the unit shares an edge with another.
    low, high : ndarray of shape (F, 3), float32
        Box of every face, metres.
    min_faces, max_faces : int
        Size bounds; debris is a unit below ``min_faces`` that touches nothing.
    max_extent_m : float
        Longest side of a segment's box, metres.
    threads : int
        Threads at most; they change nothing but the time.

    Returns
    -------
    labels : ndarray of shape (F,), int32
        Without gaps.
    counts : DebrisCounts

    Notes
    -----
    Debris is placed in order of its number; a segment that it would take over a bound is passed
    over for the next nearest. What finds no segment is strung along a Morton curve and gathered
    into clusters, each closed when it has ``min_faces`` or the next piece lies out of reach.
    """
    # (1) What is debris. Invariant from here on: size, least and most are those of a target with
    # all that has joined it, so no join breaks a bound.
    is_debris = (units.size < min_faces) & ~touching
    n_debris = int(np.count_nonzero(is_debris))
    if n_debris == 0:
        return labels, DebrisCounts()
    group = np.arange(len(units.size))
    size, least, most = units.size.copy(), units.low.copy(), units.high.copy()
    reach_m = _DEBRIS_REACH * max_extent_m

    def joins(unit: int, target: int) -> bool:
        joint_least = np.minimum(least[unit], least[target])
        joint_most = np.maximum(most[unit], most[target])
        side = float((joint_most - joint_least).max())
        if size[unit] + size[target] > max_faces or side > max_extent_m:
            return False
        size[target] += size[unit]
        least[target], most[target] = joint_least, joint_most
        group[unit] = target
        return True

    # (2) To the nearest segment that may take it.
    on_debris = is_debris[labels]
    if not on_debris.all():
        near = _near_segments(low, high, labels, on_debris, reach_m, threads)
        for unit, candidates in near:
            any(joins(unit, target) for target in candidates)  # stops at the first that may
    # (3) What found none, along a Morton curve: into the open cluster while it is small and near.
    # Invariant: `head` is the first piece of the open cluster, `heads` those that others joined.
    alone = np.flatnonzero(is_debris & (group == np.arange(len(group))))
    head = -1
    heads = set()
    for unit in alone[
        morton_order((units.low[alone] + units.high[alone]) * np.float32(0.5))
    ].tolist():
        if head >= 0 and size[head] < min_faces:
            gap = np.maximum(np.maximum(least[unit] - most[head], least[head] - most[unit]), 0.0)
            if float(np.sqrt((gap * gap).sum())) <= reach_m and joins(unit, head):
                heads.add(head)
                continue
        head = unit
    n_alone = sum(1 for unit in alone.tolist() if group[unit] == unit and unit not in heads)
    return dense_labels(group[labels]), DebrisCounts(n_debris - n_alone, n_alone)


def _near_segments(
    low: Float32,
    high: Float32,
    labels: Int32,
    on_debris: Bool,
    reach_m: float,
    threads: int,
) -> list[tuple[int, list[int]]]:
    """List for every debris unit the segments near it, nearest first; only units that have one."""
    centres = low + high
    centres *= np.float32(0.5)
    lost = np.flatnonzero(on_debris)
    lost_centres = centres[lost].astype(np.float64)
    near_lost = may_be_near(centres, lost_centres, np.full(len(lost), reach_m), threads=threads)
    kept = np.flatnonzero(near_lost & ~on_debris)
    if len(kept) == 0:
        return []
    k = min(_DEBRIS_CANDIDATES, len(kept))
    tree = cKDTree(centres[kept], balanced_tree=False, compact_nodes=False)
    distance, index = tree.query(
        lost_centres, k=k, distance_upper_bound=np.nextafter(reach_m, np.inf), workers=threads
    )
    distance, index = distance.reshape(len(lost), k), index.reshape(len(lost), k)
    in_reach = np.isfinite(distance)
    unit = np.repeat(labels[lost], k).reshape(index.shape)[in_reach]
    target = labels[kept[index[in_reach]]]
    order = np.lexsort((target, distance[in_reach], unit))
    near: dict[int, list[int]] = {}
    for u, t in zip(unit[order].tolist(), target[order].tolist(), strict=True):
        targets = near.setdefault(u, [])
        if t not in targets and len(targets) < _DEBRIS_CANDIDATES:
            targets.append(t)
    return list(near.items())
