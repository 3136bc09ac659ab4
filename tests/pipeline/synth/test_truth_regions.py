"""True regions: families by colour, the smallest piece, islands."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.synth.materials import Material
from terraport_pipeline.synth.options import QuarryOptions
from terraport_pipeline.synth.truth_mesh import TruthMesh, truth_mesh
from terraport_pipeline.synth.truth_regions import families, true_regions


def test_families_are_what_the_eye_tells_apart():
    """Bare rock is one, green plants are one, everything else stands alone."""
    family = families("visible")
    rock = {Material.BENCH, Material.ROCK_FACE, Material.ROAD, Material.BOULDER}
    plants = {Material.GRASSLAND, Material.TREE, Material.BUSH}
    for material in set(Material) - {Material.OUTLIER}:
        for other in set(Material) - {Material.OUTLIER}:
            together = material == other or {material, other} <= rock or {material, other} <= plants
            assert (family[material] == family[other]) == together, (material, other)
    assert families("material").tolist() == list(range(256))


def strip(materials, *, gap=None):
    """Squares of two faces in a row, one per material; after ``gap`` squares a hole of one."""
    x = np.arange(len(materials) + 2.0)
    vertices = np.stack([np.tile(x, 2), np.zeros(2 * len(x)), np.repeat([0.0, 1.0], len(x))], 1)
    cells = [i if gap is None or i < gap else i + 1 for i in range(len(materials))]
    n = len(x)
    faces = [f for i in cells for f in ([i, n + i, i + 1], [i + 1, n + i, n + i + 1])]
    mesh = TruthMesh(
        vertices.astype(np.float32),
        np.array(faces, np.int32),
        np.zeros((len(vertices), 3), np.uint8),
        np.repeat(np.array(materials, np.uint8), 2),
    )
    return mesh, *face_pairs(mesh.faces, len(vertices))


def test_small_pieces_join_along_the_longest_border():
    """One square of road between five of bench and three of water goes to one of them; never 0."""
    row = [Material.GRASSLAND] * 5 + [Material.ROAD] + [Material.WATER] * 3
    mesh, pairs, edges = strip(row)
    assert len(np.unique(true_regions(mesh, pairs, edges, "material", least_share=0.0))) == 3
    regions = true_regions(mesh, pairs, edges, "material", least_share=0.2)
    assert regions.tolist() == [0] * 12 + [1] * 6  # equal borders: the lower piece


def test_islands_join_what_stands_nearest():
    """A tree that touches nothing is no region."""
    row = [Material.SAND_PILE] * 4 + [Material.WATER] * 4 + [Material.TREE]
    mesh, pairs, edges = strip(row, gap=8)
    assert true_regions(mesh, pairs, edges, least_share=0.2).tolist() == [0] * 8 + [1] * 10


@pytest.mark.parametrize("kind", ["visible", "material"])
def test_regions_of_a_quarry(kind):
    """None below the least share; every face has one; finer with more materials."""
    mesh = truth_mesh(QuarryOptions(seed=5, size_m=120.0), 3.0)
    pairs, edges = face_pairs(mesh.faces, len(mesh.vertices))
    regions = true_regions(mesh, pairs, edges, kind)
    corners = mesh.vertices[mesh.faces].astype(float)
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    share = np.bincount(regions, weights=area) / area.sum()
    assert share.min() >= 0.002
    assert 5 <= len(share) <= 60
    assert components(len(regions), pairs, labels=regions)[1] >= len(share)
