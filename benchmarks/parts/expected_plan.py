"""What a plan must be, by brute force and straight from spec/protocol.md, section 4.

Written without looking at the server's way of doing it (no tree, no shared code): every box, one
loop, in the specification's words. It finds what a shared helper would hide.
"""

from __future__ import annotations

import math

import numpy as np

from terraport_store import SegmentIndex
from terraport_wire import FOLLOWS, Land, Plan

__all__ = ["differences", "expect"]


def expect(index: SegmentIndex, land: Land, *, max_segments: int) -> list[int]:
    """Compute the segments that a landing shows, nearest first.

    Parameters
    ----------
    index : SegmentIndex
        Of the scene.
    land : Land
        What was asked.
    max_segments : int
        Most that the service plans.
    """
    wide = index.bounds.astype(np.float64)
    centre = np.asarray(land.position, dtype=np.float64)
    gap = np.maximum(np.maximum(wide[:, :3] - centre, centre - wide[:, 3:]), 0.0)
    order = []
    for segment in range(len(index)):
        x, y, z = gap[segment].tolist()
        distance_m = math.sqrt(x * x + y * y + z * z)
        if distance_m <= land.radius_m:
            order.append((distance_m, segment))
    return [segment for _, segment in sorted(order)[:max_segments]]


def differences(plan: Plan, expected: list[int], land: Land, index: SegmentIndex) -> list[str]:
    """Name what is wrong with a plan; empty where nothing is."""
    ids = plan.show["id"].tolist()
    if ids != expected:
        got = f"got {len(ids)} {ids[:5]}"
        return [f"show: {got}, expected {len(expected)} {expected[:5]}"]
    wrong = [
        f"{name}: not that of the scene's index"
        for name, column in (
            ("key", index.xxh3),
            ("bytes", index.length),
            ("faces", index.face_count),
            ("vertices", index.vertex_count),
        )
        if (plan.show[name] != column[ids]).any()
    ]
    follows = ~np.isin(plan.show["key"], land.have)
    if (((plan.show["flags"] & FOLLOWS) > 0) != follows).any():
        wrong.append("flags: not what `have` said")
    return wrong
