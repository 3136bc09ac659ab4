"""Meshes that the look tests share: a rolling terrain at two resolutions, in tiles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest


def terrain_height(
    x: npt.NDArray[np.float64], z: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Rolling ground with a bench: heights in metres over a 100 m square."""
    bench = 6.0 / (1.0 + np.exp(-(x - 60.0) / 1.5))
    return (
        bench + 2.0 * np.sin(x / 9.0) * np.cos(z / 11.0) + 0.15 * np.sin(x * 1.3) * np.sin(z * 1.1)
    )


@dataclass(frozen=True)
class Terrain:
    """One grid mesh; scene frame, metres."""

    vertices: npt.NDArray[np.float32]
    faces: npt.NDArray[np.int32]
    colours: npt.NDArray[np.uint8]


def make_terrain(cells: int, low: float = 0.0, high: float = 100.0) -> Terrain:
    """Sample the ground on (cells + 1)^2 vertices over [low, high]^2."""
    line = np.linspace(low, high, cells + 1)
    x, z = np.meshgrid(line, line, indexing="ij")
    y = terrain_height(x, z)
    index = np.arange((cells + 1) ** 2, dtype=np.int32).reshape(cells + 1, cells + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    shade = np.clip((y + 2) / 10, 0, 1)[..., None]
    colours = (np.array([150, 120, 90]) * (0.5 + 0.5 * shade)).astype(np.uint8)
    return Terrain(
        np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32), faces, colours.reshape(-1, 3)
    )


@pytest.fixture(scope="session")
def detail() -> Terrain:
    """The ground at 0.5 m."""
    return make_terrain(200)


@pytest.fixture(scope="session")
def base() -> Terrain:
    """The ground at 5 m, 2 m larger on each side so that it covers the detail."""
    return make_terrain(21, -2.5, 102.5)
