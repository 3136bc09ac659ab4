"""Feet on the ground that is shown: 200 m over detail and base, beside the Python SDK."""

from __future__ import annotations

import math

import numpy as np
from engines import cores
from engines.programs import Client
from faults.service import Service
from numpy.typing import NDArray

import terraport.sync

WALK_M = 200.0
STEPS = 100
LANDING = (30.0, 1.0, 30.0, 9.0)
BOUND_M = 0.02
"""Issue 23, item 5."""


def places() -> NDArray[np.float64]:
    """A spiral of `WALK_M` around the landing, out of its detail and onto the base: x, z."""
    turn = np.linspace(0.0, 5.5 * math.pi, STEPS)
    radius = 1.0 + turn * 1.25
    return np.stack(
        [LANDING[0] + radius * np.cos(turn), LANDING[2] + radius * np.sin(turn)], axis=1
    )


def highest_m(corners: NDArray[np.float64], x: float, z: float) -> float | None:
    """Return the height of the highest face over a place; corners (faces, 3, xyz), metres."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    u, v = b - a, c - a
    area = u[:, 0] * v[:, 2] - u[:, 2] * v[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        beta = ((x - a[:, 0]) * v[:, 2] - (z - a[:, 2]) * v[:, 0]) / area
        gamma = (u[:, 0] * (z - a[:, 2]) - u[:, 2] * (x - a[:, 0])) / area
        inside = (beta >= -1e-9) & (gamma >= -1e-9) & (beta + gamma <= 1 + 1e-9)
        heights = (a[:, 1] + beta * u[:, 1] + gamma * v[:, 1])[inside]
    return float(heights.max()) if len(heights) else None


def test_feet_stand_on_what_is_shown(csharp: cores.CsCore, server: Service) -> None:
    url = f"{server.url}/scenes/grid"
    with terraport.sync.connect(url) as session:
        landing = session.land(LANDING[:3], LANDING[3])
        segments = landing.ready()
        base = session.base()
        hidden = base.hidden_faces(session.visible)
        shown = [base.mesh.positions[base.mesh.faces[~hidden]].astype(float)]
        assert len(segments) == len(session.visible)
        for segment in segments:
            mesh = segment.arrays()
            shown.append(mesh.positions[mesh.faces].astype(float))
    corners = np.concatenate(shown)
    walk = places()
    length_m = float(np.linalg.norm(np.diff(walk, axis=0), axis=1).sum())
    assert length_m >= WALK_M, length_m
    steps = [f"stand:{x!r},100,{z!r}" for x, z in walk.tolist()]
    landed = Client("csharp", csharp).land(
        url, "land:" + ",".join(map(str, LANDING)), *steps, staged=1
    )
    assert landed.exit_code == 0, landed.output
    feet = landed.stage["feet"]
    assert len(feet) == STEPS
    apart_m, on_detail = [], 0
    for (x, z), foot in zip(walk.tolist(), feet, strict=True):
        expected = highest_m(corners, x, z)
        assert (foot is None) == (expected is None), (x, z)
        if foot is not None and expected is not None:
            apart_m.append(abs(foot[0] - expected))
            on_detail += foot[1] >= 0
    assert 20 < on_detail < len(apart_m) - 20, "the walk is on detail, and on the base"
    assert max(apart_m) <= BOUND_M, max(apart_m)
