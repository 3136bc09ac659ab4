"""The column grid against brute-force geometry."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.cover.columns import fit_grid, rasterise, segment_runs
from terraport_pipeline.geometry.mesh.adjacency import as_kernel_input


def arrays_of(mesh):
    """Vertices and faces as the kernels take them."""
    return as_kernel_input(mesh.vertices, np.float64), as_kernel_input(mesh.faces, np.int32)


def entered(starts, entries, cell):
    """Faces that are entered in one cell of the columns."""
    return set(entries[starts[cell] : starts[cell + 1]].tolist())


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("grow", [0.0, 1.3])
def test_every_column_a_face_meets_holds_it(soup, seed, grow):
    """Points sampled on faces, moved by up to `grow`, fall into columns that hold the face."""
    vertices, faces = arrays_of(soup(seed))
    grid = fit_grid([(vertices, faces)], 1.7, grow)
    starts, entries = rasterise(vertices, faces, grid, grow)
    rng = np.random.default_rng(seed)
    for f, face in enumerate(faces):
        weight = rng.dirichlet([0.4] * 3, 40)  # many samples near edges and corners
        points = weight @ vertices[face] + rng.uniform(-grow, grow, (40, 3))
        i = ((points[:, 0] - grid.x) / grid.cell_m).astype(int)
        j = ((points[:, 2] - grid.z) / grid.cell_m).astype(int)
        for cell in set((i * grid.nz + j).tolist()):
            assert f in entered(starts, entries, cell)


@pytest.mark.parametrize("seed", range(10))
def test_columns_hold_no_face_that_is_far(soup, seed):
    """The test is exact: a face in a column comes within rounding of its square."""
    vertices, faces = arrays_of(soup(seed))
    grid = fit_grid([(vertices, faces)], 1.7, 0.0)
    starts, entries = rasterise(vertices, faces, grid, 0.0)
    weights = np.array([(a, b, 60 - a - b) for a in range(61) for b in range(61 - a)]) / 60
    for cell in range(grid.nx * grid.nz):
        centre = np.array(divmod(cell, grid.nz)) + 0.5
        centre = centre * grid.cell_m + [grid.x, grid.z]
        for f in entered(starts, entries, cell):
            points = (weights @ vertices[faces[f]])[:, ::2]
            # samples lie at most one sixtieth of the longest edge (18 m) apart
            assert np.abs(points - centre).max(axis=1).min() <= 0.5 * grid.cell_m + 0.31


def test_runs_are_the_heights_per_segment(terrain):
    """Per column each segment once, with the lowest and highest corner of its faces there."""
    mesh = terrain(3, cells=8)
    vertices, faces = arrays_of(mesh)
    segment = np.random.default_rng(3).integers(0, 4, len(faces)).astype(np.int32)
    grid = fit_grid([(vertices, faces)], 5.0, 0.0)
    starts, entries = rasterise(vertices, faces, grid, 0.0)
    runs = segment_runs(starts, entries, vertices, faces, as_kernel_input(segment, np.int32))
    for cell in range(grid.nx * grid.nz):
        row = slice(runs.offsets[cell], runs.offsets[cell + 1])
        here = np.array(sorted(entered(starts, entries, cell)), int)
        assert sorted(runs.segment[row].tolist()) == sorted(set(segment[here].tolist()))
        for s, low, high in zip(runs.segment[row], runs.low[row], runs.high[row], strict=True):
            heights = vertices[faces[here[segment[here] == s]], 1]
            assert (low, high) == (heights.min(), heights.max())


def test_grid_is_bounded_and_ignores_stray_vertices():
    """A vertex of no face does not widen the grid; tiny cells grow until the grid is small."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [1e9, 0, 1e9]], np.float64)
    faces = np.array([[0, 1, 2]], np.int32)
    assert fit_grid([(vertices, faces)], 0.5, 0.0).nx < 10
    grid = fit_grid([(vertices, faces)], 1e-6, 0.0)
    assert grid.nx * grid.nz <= 2**24
    assert grid.cell_m > 1e-6
