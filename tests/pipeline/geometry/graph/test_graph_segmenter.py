"""The graph engine behind the segmenter's interface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from terraport_pipeline.geometry.graph.graph_options import (
    COLOUR_GRAPH,
    OPEN_SHAPE_GRAPH,
    SHAPE_GRAPH,
    EdgeWeights,
    GraphOptions,
)
from terraport_pipeline.geometry.graph.graph_segmenter import (
    GraphSegmenter,
    automatic_seeds,
    seed_levels,
)
from terraport_pipeline.geometry.mesh.adjacency import components, face_pairs
from terraport_pipeline.geometry.mesh.face_measures import face_areas
from terraport_pipeline.geometry.regions.segmenter import SegmenterMesh

CELLS = 40
COARSE = replace(COLOUR_GRAPH, small_share=0.04)
"""The column of faces in which two colours blend is 2.5 % of this small ground."""


def ground(colour_of, height_of=lambda x, z: 0.0 * x):
    """Grid over 0..1 x 0..1; colours and heights as functions of place."""
    axis = np.linspace(0.0, 1.0, CELLS + 1)
    x, z = (a.ravel() for a in np.meshgrid(axis, axis, indexing="ij"))
    i, j = np.divmod(np.arange(CELLS * CELLS), CELLS)
    a = i * (CELLS + 1) + j
    b = a + CELLS + 1
    faces = np.stack([a, a + 1, b, b, a + 1, b + 1], axis=1).reshape(-1, 3).astype(np.int32)
    vertices = np.stack([x, height_of(x, z), z], axis=1).astype(np.float32)
    colours = np.clip(colour_of(x, z), 0, 255).astype(np.uint8)
    return SegmenterMesh(vertices, faces, colours)


def two_colours(first, second, noise=0.0):
    rng = np.random.default_rng(1)
    return lambda x, z: (
        np.where((x < 0.5)[:, None], first, second) + rng.normal(0.0, noise, (len(x), 3))
    )


def halves_agree(mesh, regions):
    """Share of faces that lie in the region of their half."""
    left = mesh.vertices[mesh.faces].mean(axis=1)[:, 0] < 0.5
    share = np.mean(regions[left] == np.bincount(regions[left]).argmax())
    other = np.mean(regions[~left] == np.bincount(regions[~left]).argmax())
    return min(share, other)


@pytest.mark.parametrize("noise", [0.0, 6.0, 12.0])
def test_red_and_green_of_one_lightness_are_told_apart(noise):
    # Both are 42.5 from white: the Triangle Pool Algorithm cannot see this border.
    mesh = ground(two_colours([166, 102, 98], [93, 131, 78], noise))
    segmentation = GraphSegmenter(COARSE).segment(mesh)
    assert segmentation.region_count == 2
    assert halves_agree(mesh, segmentation.regions) > 0.94


def test_a_shadow_does_not_part_the_ground():
    mesh = ground(two_colours([150, 130, 100], [105, 91, 70]))
    assert GraphSegmenter(COARSE).segment(mesh).region_count == 1
    weights = replace(COLOUR_GRAPH.weights, lightness=1.0)
    strict = GraphSegmenter(replace(COARSE, weights=weights, smooth_rounds=0)).segment(mesh)
    assert strict.region_count == 2, "with lightness in full it does"


def test_shape_alone_parts_at_the_fold():
    mesh = ground(two_colours([128] * 3, [128] * 3), lambda x, z: np.abs(x - 0.5))
    shape = SegmenterMesh(mesh.vertices, mesh.faces)
    segmentation = GraphSegmenter(OPEN_SHAPE_GRAPH).segment(shape)
    assert segmentation.region_count == 2
    assert halves_agree(mesh, segmentation.regions) == 1.0
    ridge = replace(shape, vertices=mesh.vertices * np.array([1, -1, 1], np.float32))
    assert GraphSegmenter(OPEN_SHAPE_GRAPH).segment(ridge).region_count == 1, "a ridge is no border"


def test_small_regions_join_and_islands_join_the_nearest(terrain):
    mesh = terrain(5, 30, holes=0.35)
    subject = SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours)
    options = replace(COLOUR_GRAPH, small_share=0.05)
    segmentation = GraphSegmenter(options).segment(subject)
    assert segmentation.facts["region_islands"] > 0
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    share = np.bincount(segmentation.regions, weights=area) / area.sum()
    assert share.min() >= 0.05 * (1 - 1e-6)


def test_fine_pools_lie_in_regions_and_keep_their_bound(terrain):
    mesh = terrain(6, 30, holes=0.1)
    segmentation = GraphSegmenter(replace(COLOUR_GRAPH, fine_faces=50)).segment(
        SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours)
    )
    assert np.bincount(segmentation.fine).max() <= 50
    both = set(zip(segmentation.fine.tolist(), segmentation.regions.tolist(), strict=True))
    assert len(both) == segmentation.fine_count
    pairs, _ = face_pairs(mesh.faces, len(mesh.vertices))
    assert (
        components(len(mesh.faces), pairs, labels=segmentation.fine)[1] == segmentation.fine_count
    )


def test_renumbering_vertices_changes_nothing(terrain):
    mesh = terrain(8, 24, holes=0.1)
    order = np.random.default_rng(0).permutation(len(mesh.vertices))
    back = np.argsort(order).astype(np.int32)
    first = GraphSegmenter().segment(SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours))
    second = GraphSegmenter().segment(
        SegmenterMesh(mesh.vertices[order], back[mesh.faces], mesh.colours[order])
    )
    assert first.regions.tobytes() == second.regions.tobytes()
    assert first.fine.tobytes() == second.fine.tobytes()


def test_seeds_are_bounded_both_ways():
    assert automatic_seeds(100, by_colour=True) == 1
    assert automatic_seeds(20_000, by_colour=True) == 10
    assert automatic_seeds(147_000, by_colour=True) == 32
    assert automatic_seeds(4_600_000, by_colour=True) == 1000
    assert automatic_seeds(10_000_000, by_colour=False) == 32
    assert automatic_seeds(100_000, by_colour=False) == 1


def test_levels_of_seeds():
    assert [seed_levels(n) for n in (1, 5, 32, 33, 1000)] == [
        (),
        (5,),
        (32,),
        (32, 33),
        (32, 256, 1000),
    ]


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"threshold": 0.0}, "threshold is 0.0, expected a finite number above 0"),
        ({"small_share": 1.0}, "small_share is 1.0, expected 0 to below 1"),
        ({"fine_faces": 0}, "fine_faces is 0, expected 1 or more"),
        ({"seed_faces": 0}, "seed_faces is 0, expected 1 or more"),
        ({"smooth_rounds": 65}, "smooth_rounds is 65, expected 0..64"),
    ],
)
def test_options_out_of_range_are_refused(wrong, text):
    with pytest.raises(ValueError, match=text):
        GraphOptions(**wrong)


def test_shape_preset_leaves_colour_out():
    assert SHAPE_GRAPH.weights.colour_scale == 0.0
    assert isinstance(SHAPE_GRAPH.weights, EdgeWeights)


def test_a_told_number_of_regions_is_not_spent_on_crumbs() -> None:
    """Two bodies that meet in a waist, with deep dents: two regions are the bodies."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    vertices = np.array(ball.vertices)
    vertices[:, 0] *= 2.0
    vertices[:, 1:] *= 0.25 + 0.75 * np.minimum(1.0, np.abs(vertices[:, :1])) ** 2
    dented = np.random.default_rng(4).choice(len(vertices), 12, replace=False)
    vertices[dented] *= 0.6
    mesh = SegmenterMesh(vertices.astype(np.float32), np.array(ball.faces, np.int32))
    area = face_areas(mesh.vertices, mesh.faces)
    for options, least in ((SHAPE_GRAPH, 0.01), (replace(SHAPE_GRAPH, small_share=0.0), 0.0)):
        for count in (2, 3, 5):
            made = GraphSegmenter(options, count).segment(mesh)
            share = np.bincount(made.regions, weights=area) / area.sum()
            assert made.region_count == len(share) == count
            assert share.min() >= least
    crumbs = GraphSegmenter(replace(SHAPE_GRAPH, small_share=0.0), 2).segment(mesh)
    assert np.bincount(crumbs.regions, weights=area).min() < 0.01 * area.sum()
    parts = GraphSegmenter(SHAPE_GRAPH, 2).segment(mesh)
    middle = mesh.vertices[mesh.faces].mean(axis=1)[:, 0]
    assert len(np.unique(parts.regions[middle > 0.3])) == 1
    assert len(np.unique(parts.regions[middle < -0.3])) == 1
