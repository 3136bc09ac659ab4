"""Roughness on surfaces whose answer can be written out, and against quadrature face by face."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terraport_pipeline.geometry.regions.region_roughness import (
    automatic_roughness_scale,
    roughness_moments,
    roughness_of,
)


def region_roughness(vertices, faces, regions, scale_m):
    """Roughness of the regions of one mesh."""
    _, region, moments = roughness_moments(vertices, faces, regions, scale_m)
    return roughness_of(region, moments, int(regions.max()) + 1)


def tiles(heights):
    """Unit squares at integer places (x, z), each level at its own height, not connected."""
    vertices, faces = [], []
    for (x, z), height in np.ndenumerate(heights):
        n = len(vertices)
        vertices += [[x, height, z], [x, height, z + 1], [x + 1, height, z], [x + 1, height, z + 1]]
        faces += [[n, n + 1, n + 2], [n + 2, n + 1, n + 3]]
    return np.array(vertices, np.float32), np.array(faces, np.int32)


def test_checkerboard_of_two_heights():
    """Tiles 0.5 m above and below the mean: 0.5 m, whatever the place."""
    board = 1.0 + 0.5 * (-1.0) ** np.add.outer(np.arange(4), np.arange(4))
    vertices, faces = tiles(board)
    regions = np.zeros(len(faces), np.int32)
    assert region_roughness(vertices, faces, regions, 4.0) == pytest.approx([0.5])
    moved = vertices + np.float32([-400, 20, 8])
    assert region_roughness(moved, faces, regions, 4.0) == pytest.approx([0.5])


def test_at_a_smaller_scale_the_same_tiles_are_flat():
    """One tile per cube: nothing is left but the plane of the tile."""
    vertices, faces = tiles(1.25 + 0.5 * np.random.default_rng(0).random((4, 4)))
    assert region_roughness(vertices, faces, np.zeros(32, np.int32), 1.0) == pytest.approx(
        [0.0], abs=1e-7
    )


@pytest.mark.parametrize("normal", [(0, 1, 0), (1, 0, 0), (1, 2, 3), (0, -1, 0.001)])
def test_planes_of_any_slope_are_smooth(normal):
    """Walls and overhangs too: distances are measured across the plane, not upwards."""
    rng = np.random.default_rng(2)
    across = np.linalg.svd(np.array([normal], float))[2][1:]
    vertices = (rng.uniform(-5, 5, (200, 2)) @ across).astype(np.float32)
    faces = rng.integers(0, 200, (300, 3)).astype(np.int32)
    rough = region_roughness(vertices, faces, np.zeros(300, np.int32), 2.0)
    assert rough[0] < 1e-5


def test_each_region_has_its_own_plane():
    """Two level regions at two heights in one cube: as one region 0.5 m, as two none."""
    vertices, faces = tiles(1.0 + 0.5 * (-1.0) ** np.add.outer(np.arange(4), np.arange(4)))
    upper = (vertices[faces[:, 0], 1] > 1.0).astype(np.int32)
    assert region_roughness(vertices, faces, upper, 4.0) == pytest.approx([0, 0], abs=1e-7)


def literal(vertices, faces, regions, scale_m):
    """The edge-midpoint rule, exact for squares, in a dictionary of pieces."""
    pieces: dict[tuple[int, ...], list] = {}
    for face, region in zip(faces, regions, strict=True):
        corner = vertices[face].astype(float)
        cell = np.floor(corner.mean(axis=0) / scale_m).astype(int)
        pieces.setdefault((int(region), *cell.tolist()), []).append(corner)
    square, total = np.zeros(regions.max() + 1), np.zeros(regions.max() + 1)
    for (region, *_), corners in pieces.items():
        points, weights = [], []
        for a, b, c in corners:
            area = 0.5 * np.linalg.norm(np.cross(b - a, c - a))
            points += [(a + b) / 2, (b + c) / 2, (c + a) / 2]
            weights += [area / 3] * 3
        if sum(weights) == 0:
            continue
        covariance = np.cov(np.array(points).T, aweights=weights, bias=True)
        square[region] += sum(weights) * max(np.linalg.eigvalsh(covariance)[0], 0)
        total[region] += sum(weights)
    return np.sqrt(np.divide(square, total, out=np.zeros_like(square), where=total > 0))


@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.sampled_from([0.5, 1.0, 3.0]))
@settings(max_examples=60)
def test_equal_to_quadrature(seed, n_faces, scale_m):
    rng = np.random.default_rng(seed)
    vertices = rng.normal(scale=2, size=(20, 3)).astype(np.float32)
    faces = rng.integers(0, 20, (n_faces, 3)).astype(np.int32)
    regions = rng.integers(0, 3, n_faces).astype(np.int32)
    for array in (vertices, faces, regions):
        array.flags.writeable = False
    roughness = region_roughness(vertices, faces, regions, scale_m)
    assert roughness == pytest.approx(literal(vertices, faces, regions, scale_m), abs=1e-6)
    half = region_roughness(vertices * np.float32(0.5), faces, regions, scale_m / 2)
    assert half == pytest.approx(roughness / 2, abs=1e-9)


def test_many_cubes():
    """The table of cubes grows beyond its first size; the result is the same as without regions."""
    rng = np.random.default_rng(3)
    vertices = rng.uniform(0, 400, (90_000, 3)).astype(np.float32)
    faces = np.arange(90_000, dtype=np.int32).reshape(-1, 3) % 90_000
    regions = np.arange(30_000, dtype=np.int32)
    rough = region_roughness(vertices, np.tile(faces, (3, 1)), np.tile(regions, 3), 1.0)
    assert rough.shape == (30_000,)
    assert rough.max() < 1e-4, "every triangle is flat"


def test_a_region_without_area_is_flat():
    flat = region_roughness(np.ones((3, 3)), np.array([[0, 1, 2]]), np.zeros(1, np.int32), 1.0)
    assert flat.tolist() == [0.0]


def test_automatic_scale():
    """Eight edges, rounded up to a power of two."""
    assert automatic_roughness_scale(0.0, 0, 0.0) == 1.0
    assert automatic_roughness_scale(0.0, 5, 3.0) == 1.0
    edge = np.sqrt(4 / np.sqrt(3))
    assert automatic_roughness_scale(1e6, 1_000_000, 1e3) == 16.0 >= 8 * edge
    assert automatic_roughness_scale(1e6 / 16.0, 1_000_000, 1e3) == 4.0
    assert automatic_roughness_scale(1e-6, 1_000_000, 2.0**21) == 2.0
