"""Small meshes for the geometry tests, made by seeded functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest

from terraport_payload.types import AnyFloat, AnyInt, Bool, Float32, Float64, Int32, UInt8


@dataclass(frozen=True)
class TestMesh:
    """A mesh with read-only arrays: no function may write into its inputs."""

    __test__ = False
    vertices: Float32
    faces: Int32
    colours: UInt8


def _frozen(
    vertices: npt.NDArray[np.generic],
    faces: npt.NDArray[np.generic],
    colours: npt.NDArray[np.generic],
) -> TestMesh:
    arrays = (
        np.ascontiguousarray(vertices, np.float32),
        np.ascontiguousarray(faces, np.int32).reshape(-1, 3),
        np.ascontiguousarray(colours, np.uint8),
    )
    for array in arrays:
        array.flags.writeable = False
    return TestMesh(*arrays)


def make_soup(seed: int) -> TestMesh:
    """Random faces over few vertices: non-manifold edges, repeated, flipped and collapsed faces."""
    rng = np.random.default_rng(seed)
    n_vertices = int(rng.integers(1, 24))
    n_faces = int(rng.integers(1, 55))
    # Centres are whole numbers, so squared distances between them are exact and ties are real ties.
    vertices = 3 * rng.integers(0, 6, (n_vertices, 3))
    faces = rng.integers(0, n_vertices, (n_faces, 3))
    repeated = rng.integers(0, n_faces, n_faces // 6)
    faces = np.concatenate([faces, faces[repeated][:, rng.permutation(3)]])
    palette = rng.integers(0, 256, (int(rng.integers(1, 5)), 3))
    return _frozen(vertices, faces, palette[rng.integers(0, len(palette), n_vertices)])


def make_terrain(
    seed: int, cells: int = 12, *, size_m: float = 32.0, noise: float = 8.0, holes: float = 0.0
) -> TestMesh:
    """Hilly grid with patches of colour; with holes it falls into islands."""
    rng = np.random.default_rng(seed)
    axis = np.linspace(0.0, size_m, cells + 1)
    x, z = np.meshgrid(axis, axis, indexing="ij")
    phase = rng.uniform(0.0, 6.28, 6)
    wave = 6.28 / size_m
    y = 0.04 * size_m * np.sin(wave * x + phase[0]) * np.cos(2 * wave * z + phase[1])
    y += 0.02 * size_m * np.sin(3 * wave * (x + z) + phase[2])
    kind = np.digitize(np.sin(wave * x + phase[3]) + np.cos(1.5 * wave * z + phase[4]), [-0.5, 0.7])
    colours = np.array([[60, 80, 50], [140, 120, 95], [200, 190, 170]])[kind.ravel()]
    colours = np.clip(colours + rng.normal(0.0, noise, colours.shape), 0, 255)
    i, j = np.divmod(np.arange(cells * cells), cells)
    a = i * (cells + 1) + j
    b = a + cells + 1
    faces = np.stack([a, a + 1, b, b, a + 1, b + 1], axis=1).reshape(-1, 3)
    faces = faces[rng.random(len(faces)) >= holes]
    vertices = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    return _frozen(np.round(vertices * 64) / 64, faces, colours)


def cast_rays(
    vertices: AnyFloat,
    faces: AnyInt,
    origins: Float64,
    directions: Float64,
) -> Bool:
    """Which rays (R) meet which faces (F): (R, F). Moller-Trumbore, both sides, edges included."""
    a, b, c = (vertices[faces[:, i]].astype(np.float64) for i in range(3))
    ab, ac = b - a, c - a
    meets = np.zeros((len(origins), len(faces)), np.bool_)
    for r, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
        p = np.cross(direction, ac)
        det = (ab * p).sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / det
            t = origin - a
            u = (t * p).sum(axis=1) * inverse
            q = np.cross(t, ab)
            v = (q @ direction) * inverse
            distance = (ac * q).sum(axis=1) * inverse
            meets[r] = (det != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 1e-9)
    return meets


@pytest.fixture(scope="session")
def soup() -> Callable[[int], TestMesh]:
    """The maker of random face soups."""
    return make_soup


@pytest.fixture(scope="session")
def terrain() -> Callable[..., TestMesh]:
    """The maker of small coloured terrains."""
    return make_terrain


@pytest.fixture(scope="session")
def rays() -> Callable[..., Bool]:
    """The brute-force ray caster."""
    return cast_rays
