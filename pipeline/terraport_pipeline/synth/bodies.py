"""Closed bodies with sharp edges, as a CAD program would make them: truth to reconstruct.

Each is about a metre wide, centred, Y up, counter-clockwise seen from outside, without open edges.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from terraport_payload.types import Float64, Int32, Int64
from terraport_pipeline.synth.triangulate import icosphere

__all__ = ["BODIES", "block", "gear", "sphere", "stairs", "torus"]

Body = tuple[Float64, Int32]

_ROUND: Final = 192
"""Corners of a circle."""


def sphere() -> Body:
    """Make a sphere of half a metre radius."""
    unit, faces = icosphere(5)
    return 0.5 * unit, faces.astype(np.int32)


def torus() -> Body:
    """Make a torus: radii 0.36 and 0.14 metres."""
    n, m = _ROUND, _ROUND // 2
    around, across = np.meshgrid(
        np.arange(n) * 2 * np.pi / n, np.arange(m) * 2 * np.pi / m, indexing="ij"
    )
    radius = 0.36 + 0.14 * np.cos(across)
    vertices = np.stack(
        [radius * np.cos(around), 0.14 * np.sin(across), radius * np.sin(around)], axis=-1
    )
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    a, b = i * m + j, (i + 1) % n * m + j
    c, d = i * m + (j + 1) % m, (i + 1) % n * m + (j + 1) % m
    faces = np.stack([a, c, b, b, c, d], axis=-1).reshape(-1, 3)
    return vertices.reshape(-1, 3), faces.astype(np.int32)


def block() -> Body:
    """Make a cube with a round hole through it."""
    angle = np.arange(_ROUND) * 2 * np.pi / _ROUND
    side = 0.4 / np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle)))
    return _extruded(side, 0.2, height=0.8)


def gear() -> Body:
    """Make a gear wheel of 12 teeth with a round hole."""
    angle = np.arange(4 * _ROUND) * np.pi / (2 * _ROUND)
    # Flanks a twelfth of a tooth wide: steep, but a function of the angle.
    rise = np.clip(np.cos(12 * angle) * 4, -1, 1)
    return _extruded(0.42 + 0.08 * rise, 0.16, height=0.3)


def stairs() -> Body:
    """Make three steps of a stair, as a closed body."""
    outline = np.array([[0, 0], [3, 0], [3, 1], [2, 1], [2, 2], [1, 2], [1, 3], [0, 3]], np.float64)
    outline = (outline - 1.5) / 3.2
    count = len(outline)
    middle = np.array([[-0.3, -0.3]])  # sees the whole outline
    rim = np.arange(count)
    following = (rim + 1) % count
    plan = np.concatenate([outline, middle])
    size = len(plan)
    vertices = np.concatenate(
        [np.column_stack([plan, np.full(size, z)]) for z in (-0.4, 0.4)]
    )  # lower, then upper end along z
    front = np.stack([rim, following, np.full(count, count)], axis=1) + size
    back = front[:, [1, 0, 2]] - size
    walls = np.concatenate(
        [
            np.stack([rim, following, following + size], axis=1),
            np.stack([rim, following + size, rim + size], axis=1),
        ]
    )
    return vertices, np.concatenate([front, back, walls]).astype(np.int32)


def _extruded(outer: Float64, hole_radius: float, *, height: float) -> Body:
    """Push a ring up: an outline around the origin by its radii, less a round hole."""
    n = len(outer)
    angle = np.arange(n) * 2 * np.pi / n
    unit = np.stack([np.cos(angle), np.zeros(n), np.sin(angle)], axis=1)
    rings = []
    for radius in (outer[:, None], np.full((n, 1), hole_radius)):
        for y in (-height / 2, height / 2):
            ring = radius * unit
            ring[:, 1] = y
            rings.append(ring)
    low_out, high_out, low_in, high_in = (np.arange(n, dtype=np.int64) + k * n for k in range(4))

    def strip(first: Int64, second: Int64) -> Int64:
        """Quads from one ring to the next: outward where `first` is below and angles grow left."""
        turn = np.roll(np.arange(n), -1)
        a, b, c, d = first, first[turn], second[turn], second
        return np.concatenate([np.stack([a, d, c], axis=1), np.stack([a, c, b], axis=1)])

    faces = np.concatenate(
        [
            strip(low_out, high_out),
            strip(high_out, high_in),
            strip(high_in, low_in),
            strip(low_in, low_out),
        ]
    )
    return np.concatenate(rings), faces.astype(np.int32)


BODIES: Final[dict[str, Callable[[], Body]]] = {
    "block": block,
    "gear": gear,
    "stairs": stairs,
    "torus": torus,
    "sphere": sphere,
}
"""Every body by its name."""
