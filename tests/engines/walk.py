"""A walk of 200 m over detail and base, and the height of the ground there by the Python SDK."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

import terraport.sync

__all__ = ["BOUND_M", "LANDING", "STEPS", "Ground", "places", "shown_by_the_sdk"]

WALK_M: Final = 200.0
STEPS: Final = 100
LANDING: Final = (30.0, 1.0, 30.0, 9.0)
"""In the grid scene: x, y, z, radius, metres."""
BOUND_M: Final = 0.02
"""Issue 23, item 5."""


def places() -> NDArray[np.float64]:
    """A spiral of `WALK_M` around the landing, out of its detail and onto the base: x, z."""
    turn = np.linspace(0.0, 5.5 * math.pi, STEPS)
    radius = 1.0 + turn * 1.25
    walk = np.stack([LANDING[0] + radius * np.cos(turn), LANDING[2] + radius * np.sin(turn)], 1)
    length_m = float(np.linalg.norm(np.diff(walk, axis=0), axis=1).sum())
    assert length_m >= WALK_M, length_m
    return walk


@dataclass(frozen=True)
class Ground:
    """What is shown after `LANDING`: corners (faces, 3, xyz), metres."""

    detail: NDArray[np.float64]
    base: NDArray[np.float64]
    """Without the faces that are hidden."""

    def height_m(self, x: float, z: float, push_m: float = 0.0) -> tuple[float, bool] | None:
        """Return the height of the ground over a place, and whether it is detail's.

        Base that lies less than ``push_m`` above detail does not count: it is drawn behind it.
        """
        detail, base = _highest_m(self.detail, x, z), _highest_m(self.base, x, z)
        if detail is None:
            return None if base is None else (base, False)
        if base is None or base - push_m <= detail:
            return detail, True
        return base, False


def shown_by_the_sdk(scene_url: str) -> Ground:
    """Land with the Python SDK."""
    with terraport.sync.connect(scene_url) as session:
        segments = session.land(LANDING[:3], LANDING[3]).ready()
        assert len(segments) == len(session.visible)
        base = session.base()
        hidden = session.hidden_faces
        meshes = [segment.arrays() for segment in segments]
    return Ground(
        np.concatenate([mesh.positions[mesh.faces].astype(float) for mesh in meshes]),
        base.mesh.positions[base.mesh.faces[~hidden]].astype(float),
    )


def _highest_m(corners: NDArray[np.float64], x: float, z: float) -> float | None:
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    u, v = b - a, c - a
    area = u[:, 0] * v[:, 2] - u[:, 2] * v[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        beta = ((x - a[:, 0]) * v[:, 2] - (z - a[:, 2]) * v[:, 0]) / area
        gamma = (u[:, 0] * (z - a[:, 2]) - u[:, 2] * (x - a[:, 0])) / area
        inside = (beta >= -1e-9) & (gamma >= -1e-9) & (beta + gamma <= 1 + 1e-9)
        heights = (a[:, 1] + beta * u[:, 1] + gamma * v[:, 1])[inside]
    return float(heights.max()) if len(heights) else None
