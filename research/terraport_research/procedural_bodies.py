"""Bodies made here, cut by "people" made here: the evaluation without anybody's data.

Dumb-bells: two balls that overlap, as a surface r(direction), parted at the waist.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from terraport_research.princeton import Model

__all__ = ["WAISTS", "procedural_models"]

WAISTS: Final = (0.25, 0.3, 0.35, 0.4)
"""Radius of each body's waist; the balls are 1 wide and 2 long."""

_ROUND: Final = 48
_PEOPLE: Final = ((-0.3, 0.3), (0.0,))
"""Heights at which each person cuts: the waist apart, or in the middle of it."""


def procedural_models() -> Iterator[Model]:
    """Make the bodies, one a waist."""
    n = _ROUND
    polar, around = np.meshgrid(np.linspace(0, np.pi, n), np.arange(n) * 2 * np.pi / n)
    i, j = np.meshgrid(np.arange(n), np.arange(n - 1), indexing="ij")
    a, b = i * n + j, (i + 1) % n * n + j
    faces = np.stack([a, a + 1, b, b, a + 1, b + 1], axis=-1).reshape(-1, 3).astype(np.int32)
    for number, waist in enumerate(WAISTS, 1):
        z = np.cos(polar)
        radius = np.sin(polar) * np.where(np.abs(z) < 0.15, waist, np.sqrt(np.abs(z)) + 0.1)
        vertices = np.stack(
            [radius * np.cos(around), radius * np.sin(around), 2 * z], axis=-1
        ).reshape(-1, 3)
        height = vertices[faces].mean(axis=1)[:, 2]
        people = tuple(np.digitize(height, cuts).astype(np.int32) for cuts in _PEOPLE)
        yield Model(number, f"waist {waist}", vertices, faces, people, 3, 3)
