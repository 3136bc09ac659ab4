"""Regions over tiles are the regions of the whole."""

from __future__ import annotations

import numpy as np
import pytest
from coloured_ground import cut_mesh, ground
from numpy.testing import assert_array_equal

from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.mesh.face_measures import longest_edge
from terraport_pipeline.geometry.regions.mean_colour import MeanColourSegmenter
from terraport_pipeline.geometry.regions.mean_scale import ColourTotals
from terraport_pipeline.geometry.regions.segmenter import SegmenterMesh
from terraport_pipeline.geometry.tiles.tile_seams import match_seams, open_edges
from terraport_pipeline.geometry.tiles.tiled_means import (
    MeansScale,
    colours_of_faces,
    join_tiles,
    tile_units,
)


def regions_by_tiles(mesh, along: int):
    pieces = cut_mesh(mesh, along)
    pairs = [face_pairs(piece.faces, len(piece.vertices)) for piece, _ in pieces]
    seams = match_seams(
        [open_edges(m.vertices, m.faces, p) for (m, _), p in zip(pieces, pairs, strict=True)]
    )
    totals = ColourTotals.of(colours_of_faces(pieces[0][0].colours, pieces[0][0].faces))
    for piece, _ in pieces[1:]:
        totals = totals.plus(ColourTotals.of(colours_of_faces(piece.colours, piece.faces)))
    longest = max(longest_edge(m.vertices, p[1]) for (m, _), p in zip(pieces, pairs, strict=True))
    longest = max(longest, float(seams.length_m.max(initial=0.0)))
    scale = MeansScale(MeanColourSegmenter(), totals, longest)
    units_of_tiles = [
        tile_units(m.vertices, m.faces, m.colours, p, seams.of(i), scale)
        for i, ((m, _), p) in enumerate(zip(pieces, pairs, strict=True))
    ]
    at_seams = np.array(
        [
            [units_of_tiles[t].labels[f] for t, f in zip(tiles, faces, strict=True)]
            for tiles, faces in zip(seams.tiles, seams.faces, strict=True)
        ],
        np.int32,
    ).reshape(-1, 2)
    joined = join_tiles(units_of_tiles, at_seams, seams, scale)
    regions = np.empty(len(mesh.faces), np.int32)
    for (_, rows), units, region in zip(pieces, units_of_tiles, joined.region, strict=True):
        regions[rows] = region[units.labels]
    return regions, joined


@pytest.fixture(scope="module")
def mesh():
    return ground(90)


@pytest.fixture(scope="module")
def whole(mesh):
    return MeanColourSegmenter().segment(SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours))


def test_one_tile_gives_the_whole_to_the_last_bit(mesh, whole) -> None:
    regions, joined = regions_by_tiles(mesh, 1)
    assert_array_equal(regions, whole.regions)
    assert joined.count == whole.region_count
    assert joined.pools == whole.facts["region_pools"]


@pytest.mark.parametrize("along", [2, 4])
def test_regions_run_across_the_borders_of_tiles(mesh, whole, along: int) -> None:
    regions, joined = regions_by_tiles(mesh, along)
    assert joined.count == whole.region_count == 3
    # The same partition but for a few faces: each region's main partner holds nearly all of it.
    table = np.zeros((3, 3))
    np.add.at(table, (regions, whole.regions), 1)
    assert table.max(axis=1).sum() / len(regions) > 0.998


def test_an_island_joins_the_nearest_region() -> None:
    mesh = ground(60)
    # A loose patch of another colour: its faces move up, away from all others.
    rows = np.arange(3)
    island = mesh.vertices[mesh.faces[rows]].reshape(-1, 3) + np.array([0, 30, 0], np.float32)
    n = len(mesh.vertices)
    faces = np.concatenate([mesh.faces, np.arange(n, n + 9, dtype=np.int32).reshape(-1, 3)])
    vertices = np.concatenate([mesh.vertices, island]).astype(np.float32)
    colours = np.concatenate([mesh.colours, np.full((9, 3), 250, np.uint8)])
    loose = type(mesh)(vertices, faces, np.zeros_like(vertices), colours, {})
    regions, joined = regions_by_tiles(loose, 2)
    assert joined.islands >= 1
    assert joined.count == 3
    assert set(regions[-3:]) <= set(regions[rows])
