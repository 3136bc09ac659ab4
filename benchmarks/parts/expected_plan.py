"""What a plan must be, by brute force and straight from spec/wire-protocol.md, section 6.

Written without looking at the server's way of doing it (no tree, no shared code): every box, one
loop, in the specification's words. It finds what a shared helper would hide.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from terraport_payload.types import AnyArray, Bool
from terraport_store import SegmentIndex
from terraport_wire import Land, Plan

__all__ = ["Expected", "differences", "expect"]


@dataclass(frozen=True)
class Expected:
    """Segments that a plan must name: to load (nearest first), to keep, and those nearby."""

    load: list[int]
    keep: list[int]
    nearby: list[int]


def expect(
    index: SegmentIndex,
    land: Land,
    *,
    is_held: Bool,
    release_factor: float,
    max_segments: int,
) -> Expected:
    """Compute load, keep and nearby of a landing.

    Parameters
    ----------
    index : SegmentIndex
        Of the scene.
    land : Land
        What was asked.
    held : ndarray of bool
        What the client held when the server planned.
    release_factor : float
        From ``welcome``.
    max_segments : int
        The smaller of the server's bound and the client's.
    """
    wide = index.bounds.astype(np.float64)
    centre = np.asarray(land.position, dtype=np.float64)
    gap = np.maximum(np.maximum(wide[:, :3] - centre, centre - wide[:, 3:]), 0.0)
    order = []
    for segment in range(len(index)):
        x, y, z = gap[segment].tolist()
        distance_m = math.sqrt(x * x + y * y + z * z)
        reach_m = land.radius_m * (release_factor if is_held[segment] else 1.0)
        if distance_m <= reach_m:
            order.append((distance_m, segment))
    order.sort()
    del order[max_segments:]
    within = [segment for distance_m, segment in order if distance_m <= land.radius_m]
    return Expected(
        load=[segment for segment in within if not is_held[segment]],
        keep=sorted(segment for segment in within if is_held[segment]),
        nearby=sorted(segment for distance_m, segment in order if distance_m > land.radius_m),
    )


def differences(plan: Plan, expected: Expected, index: SegmentIndex) -> list[str]:
    """Name what is wrong with a plan; empty where nothing is."""
    wrong: list[str] = []
    ids: AnyArray = plan.load["id"].astype(np.int64)
    for name, got in (
        ("load", ids.tolist()),
        ("keep", plan.keep.tolist()),
        ("nearby", plan.nearby.tolist()),
    ):
        want = getattr(expected, name)
        if got != want:
            wrong.append(f"{name}: got {len(got)} {got[:5]}, expected {len(want)} {want[:5]}")
    if not wrong and (
        (plan.load["length"] != index.length[ids]).any()
        or (plan.load["xxh3"] != index.xxh3[ids]).any()
        or plan.load_bytes != int(index.length[ids].sum(dtype=np.uint64))
    ):
        wrong.append("lengths, hashes or sums of load differ from the scene's index")
    return wrong
