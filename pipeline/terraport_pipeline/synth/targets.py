"""Where the surveyor's targets lie: black and white squares that show how sharp a picture is.

Frame: design metres (see :mod:`.terrain`). PURE.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from terraport_payload.types import Float64
from terraport_pipeline.synth.options import HALF_X, HALF_Y
from terraport_pipeline.synth.terrain import Terrain

__all__ = ["TARGETS", "TARGET_HALF", "place_targets"]

TARGETS: Final = 14
"""Targets put out on one site."""

TARGET_HALF: Final = 0.75
"""Half side of a target: 15 pixels at a ground sampling distance of 0.1."""

_TRIES: Final = 600
_STREAM: Final = 4
"""Number of the random stream: others of the quarry must not move when targets are placed."""


def place_targets(seed: int, terrain: Terrain) -> Float64:
    """Choose where the targets lie: on level dry ground, apart from each other.

    Parameters
    ----------
    seed : int
        Of the quarry.
    terrain : Terrain
        The ground.

    Returns
    -------
    ndarray of shape (T, 2), float64
        Middles (x, y), T <= :data:`TARGETS`; T is smaller where level ground is rare.
    """
    rng = np.random.default_rng([seed, _STREAM])
    tries = rng.uniform(-0.9, 0.9, (_TRIES, 2)) * (HALF_X, HALF_Y)
    ground = terrain.sample(tries[:, 0], tries[:, 1])
    reach = 2.0 * TARGET_HALF
    rise = np.zeros(len(tries))
    for du, dv in ((reach, 0.0), (-reach, 0.0), (0.0, reach), (0.0, -reach)):
        other = terrain.positions(tries[:, 0] + du, tries[:, 1] + dv)
        np.maximum(rise, np.abs(other[:, 2] - ground.positions[:, 2]), out=rise)
    good = np.flatnonzero((rise < 0.45) & (ground.water == 0.0) & (ground.pile < 0))
    chosen: list[int] = []
    for row in good.tolist():
        away = ground.positions[chosen, :2] - ground.positions[row, :2]
        if (np.hypot(away[:, 0], away[:, 1]) > 25.0).all():
            chosen.append(row)
        if len(chosen) == TARGETS:
            break
    return ground.positions[chosen, :2].copy()
