"""Places of a scene that is open in a viewer: the scene's box, its ground, chosen places on it."""

from __future__ import annotations

import random

from browser.driven_viewer import DrivenViewer

__all__ = ["corners", "ground_height_m", "random_place"]

Position = tuple[float, float, float]


def corners(viewer: DrivenViewer) -> tuple[Position, Position]:
    """Return least and greatest x, y, z of the scene, metres of its frame."""
    x0, y0, z0, x1, y1, z1 = viewer.run("[...terraport.state.manifest.bounds]")
    return (x0, y0, z0), (x1, y1, z1)


def ground_height_m(viewer: DrivenViewer, x: float, z: float) -> float | None:
    """Return the height of what is shown at (x, z); None where nothing is."""
    top = corners(viewer)[1][1] + 5
    height_m: float | None = viewer.run(
        "([x, y, z]) => terraport.cast([x, y, z], [0, -1, 0])?.position[1] ?? null",
        [x, top, z],
    )
    return height_m


def random_place(viewer: DrivenViewer, chance: random.Random) -> Position:
    """Choose a place on the ground, in the inner nine tenths of the scene."""
    low, high = corners(viewer)
    while True:
        x = low[0] + (high[0] - low[0]) * chance.uniform(0.05, 0.95)
        z = low[2] + (high[2] - low[2]) * chance.uniform(0.05, 0.95)
        height_m = ground_height_m(viewer, x, z)
        if height_m is not None:
            return x, height_m, z
