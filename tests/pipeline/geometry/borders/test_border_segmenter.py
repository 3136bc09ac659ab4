"""Regions by their borders: what they follow, and what they do not depend on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from coloured_ground import cut_mesh, ground
from numpy.testing import assert_array_equal

from terraport_pipeline.geometry.borders.border_segmenter import (
    BorderSegmenter,
    RegionsBefore,
    compared_steps,
)
from terraport_pipeline.geometry.borders.cells import (
    CellGraph,
    cells_of_faces,
    joined_cells,
    length_steps,
)
from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.mesh.face_measures import face_centres
from terraport_pipeline.geometry.regions.pool_refine import number_by_first
from terraport_pipeline.geometry.regions.segmenter import SegmenterMesh
from terraport_pipeline.geometry.tiles.tile_seams import match_seams, open_edges


def field(side: int, spacing_m: float, colour_of, noise: float = 0.0, seed: int = 0):
    """Level ground of side x side vertices; colour_of(x, z) gives grey levels (N, 3)."""
    line = np.arange(side, dtype=np.float32) * np.float32(spacing_m)
    x, z = (axis.ravel() for axis in np.meshgrid(line, line, indexing="ij"))
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.stack(
        [corner, corner + 1, corner + side, corner + side, corner + 1, corner + side + 1], axis=1
    ).reshape(-1, 3)
    rng = np.random.default_rng(seed)
    colours = colour_of(x, z) + rng.normal(0.0, noise, (len(x), 3))
    vertices = np.stack([x, np.zeros_like(x), z], axis=1)
    return SegmenterMesh(
        vertices, faces.astype(np.int32), np.clip(np.rint(colours), 0, 255).astype(np.uint8)
    )


def striped(x, z):
    """Green, brown and grey stripes, 20 m wide."""
    palette = np.array([[70, 110, 60], [140, 105, 75], [150, 150, 150]])
    return palette[np.minimum((x // 20).astype(int), 2)]


def of_middles(mesh, regions):
    """Region of the faces of each stripe, the metre at its rim left out."""
    x = face_centres(mesh.vertices, mesh.faces)[:, 0]
    return [np.unique(regions[(x > 20 * k + 2) & (x < 20 * k + 18)]) for k in range(3)]


@pytest.fixture(scope="module")
def stripes():
    return field(121, 0.5, striped, noise=4.0)


@pytest.mark.parametrize("noise", [0.0, 4.0, 12.0])
def test_stripes_are_regions_whatever_the_noise(noise):
    mesh = field(121, 0.5, striped, noise=noise)
    result = BorderSegmenter().segment(mesh)
    assert result.region_count == 3
    assert [len(found) for found in of_middles(mesh, result.regions)] == [1, 1, 1]


def test_texture_alone_makes_a_border():
    def gravel_beside_sand(x, z):
        rough = np.random.default_rng(1).normal(0.0, 30.0, len(x)) * (x > 30)
        return (150 + rough)[:, None] * np.ones(3)

    mesh = field(121, 0.5, gravel_beside_sand)
    result = BorderSegmenter().segment(mesh)
    x = face_centres(mesh.vertices, mesh.faces)[:, 0]
    sides = [np.bincount(result.regions[side]).argmax() for side in (x < 26, x > 34)]
    assert sides[0] != sides[1]


def test_one_material_is_one_region_and_so_is_a_slow_change_of_light():
    grey = field(121, 0.5, lambda x, z: np.full((len(x), 3), 120.0), 6.0)
    assert BorderSegmenter().segment(grey).region_count == 1
    shade = field(121, 0.5, lambda x, z: (110 + 0.3 * x)[:, None] * np.ones(3), 2.0)
    assert BorderSegmenter().segment(shade).region_count == 1


def test_a_region_size_is_in_metres(stripes):
    small = replace(stripes, vertices=stripes.vertices / np.float32(4))
    assert BorderSegmenter(15.0).segment(stripes).region_count == 3
    assert BorderSegmenter(15.0 / 4).segment(small).region_count == 3
    assert BorderSegmenter(60.0).segment(stripes).region_count < 3


def test_regions_do_not_depend_on_what_else_was_flown(stripes):
    """The same 60 m alone, and with 40 m of other ground beside them."""

    def wider(x, z):
        colours = striped(x, z).astype(float)
        colours[x >= 60] = [200, 190, 120]
        return colours

    wide = field(201, 0.5, wider)
    narrow = field(121, 0.5, striped)
    x, _, z = face_centres(wide.vertices, wide.faces).T
    inside = np.flatnonzero((x < 60) & (z < 60))
    assert len(inside) == len(narrow.faces)
    large = BorderSegmenter().segment(wide).regions[inside]
    alone = BorderSegmenter().segment(narrow).regions
    assert of_middles(narrow, number_by_first(large)[0]) == of_middles(narrow, alone)


@pytest.mark.parametrize("along", [1, 2, 4])
def test_any_number_of_tiles_gives_the_same_to_the_last_bit(along):
    mesh = ground(60)
    whole_mesh = SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours)
    engine = BorderSegmenter(8.0)
    whole = engine.segment(whole_mesh)
    pieces = cut_mesh(mesh, along)
    pairs = [face_pairs(piece.faces, len(piece.vertices)) for piece, _ in pieces]
    seams = match_seams(
        [open_edges(m.vertices, m.faces, p) for (m, _), p in zip(pieces, pairs, strict=True)]
    )
    graphs = [
        cells_of_faces(
            m.vertices, m.faces,
            compared_steps(SegmenterMesh(m.vertices, m.faces, m.colours)), p, engine.cell_m,
        )
        for (m, _), p in zip(pieces, pairs, strict=True)
    ]  # fmt: skip
    starts = np.cumsum([0, *(graph.count for graph in graphs)])[:-1]
    across = np.array(
        [
            [graphs[t].labels[f] + starts[t] for t, f in zip(tiles, faces, strict=True)]
            for tiles, faces in zip(seams.tiles, seams.faces, strict=True)
        ],
        np.int32,
    ).reshape(-1, 2)
    joined, cells = joined_cells(graphs, across, length_steps(seams.length_m))
    alone, _ = joined_cells(
        [
            cells_of_faces(
                mesh.vertices, mesh.faces, compared_steps(whole_mesh),
                whole_mesh.edge_pairs(), engine.cell_m,
            )
        ],
        np.zeros((0, 2), np.int32), np.zeros(0, np.int64),
    )  # fmt: skip
    for name in ("keys", "sums", "pairs", "border"):
        assert_array_equal(getattr(joined, name), getattr(alone, name))
    cut = engine.cut(joined)
    regions = np.empty(len(mesh.faces), np.int32)
    for (_, rows), graph, of_tile in zip(pieces, graphs, cells, strict=True):
        regions[rows] = cut.regions[of_tile][graph.labels]
    assert_array_equal(number_by_first(regions)[0], whole.regions)


def test_the_version_before_decides_what_nothing_else_does():
    """A border that noise could tip stays where it stood, and one that is gone goes."""

    def faint(x, z):
        return np.where(x < 30, 120.0, 127.0)[:, None] * np.ones(3)

    mesh = field(121, 0.5, faint, noise=3.0)
    engine = BorderSegmenter()
    cells = cells_of_faces(
        mesh.vertices, mesh.faces, compared_steps(mesh), mesh.edge_pairs(), engine.cell_m
    )
    middles = cells.middles(engine.cell_m)
    stood = RegionsBefore(middles, (middles[:, 0] > 30).astype(np.int32))
    was_one = RegionsBefore(middles, np.zeros(len(middles), np.int32))
    counts = [int(engine.cut(cells, b).regions.max()) + 1 for b in (stood, was_one)]
    assert counts == [2, 1]
    elsewhere = RegionsBefore(middles + 500.0, stood.regions)
    assert_array_equal(engine.cut(cells, elsewhere).regions, engine.cut(cells).regions)


def test_any_granularity_is_read_from_one_tree(stripes):
    engine = BorderSegmenter()
    cells = cells_of_faces(
        stripes.vertices, stripes.faces, compared_steps(stripes), stripes.edge_pairs(),
        engine.cell_m,
    )  # fmt: skip
    cut = engine.cut(cells)
    counts = [cut.tree.cut_by_cost(cost)[1] for cost in (0.25, 0.5, 1.0, 2.0, np.inf)]
    assert counts == sorted(counts, reverse=True)
    assert counts[2] == 3
    assert counts[-1] == cut.tree.root_count == 1
    fine, coarse = (cut.tree.cut_by_cost(cost)[0] for cost in (0.5, 1.0))
    assert len(np.unique(np.stack([fine, coarse]), axis=1).T) == counts[1]  # nested
    two = BorderSegmenter(count=2).segment(stripes)
    assert two.region_count == 2


def test_what_touches_nothing_joins_the_nearest(stripes):
    stone = np.array([[10, 0, 70], [10.5, 0, 70], [10, 0, 70.5]], np.float32)
    mesh = SegmenterMesh(
        np.concatenate([stripes.vertices, stone]),
        np.concatenate([stripes.faces, len(stripes.vertices) + np.array([[0, 2, 1]])]).astype(
            np.int32
        ),
        np.concatenate([stripes.colours, np.full((3, 3), 255, np.uint8)]),
    )
    result = BorderSegmenter().segment(mesh)
    assert result.region_count == 3
    assert result.regions[-1] == of_middles(mesh, result.regions)[0][0]


def test_a_scalar_counts_as_lightness_and_bare_ground_is_one_region(stripes):
    x = face_centres(stripes.vertices, stripes.faces)[:, 0]
    noise = np.random.default_rng(2).normal(0.0, 0.05, len(x))
    by_number = replace(stripes, colours=None, scalar=(x > 30) + noise)
    assert BorderSegmenter().segment(by_number).region_count == 2
    assert BorderSegmenter().segment(replace(stripes, colours=None)).region_count == 1
    values = np.zeros(len(x))
    values[3] = np.nan
    with pytest.raises(ValueError, match="scalar of face 3 is nan"):
        BorderSegmenter().segment(replace(by_number, scalar=values))


def test_no_faces_and_bad_sizes():
    none = SegmenterMesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    assert BorderSegmenter().segment(none).region_count == 0
    with pytest.raises(ValueError, match="region_size_m is 0"):
        BorderSegmenter(0.0)


def test_ground_too_far_away_for_cells_is_refused():
    far = np.array([[1e7, 0, 0], [1e7, 0, 1], [1e7 + 1, 0, 0]], np.float32)
    faces = np.array([[0, 1, 2]], np.int32)
    with pytest.raises(ValueError, match="a face lies beyond"):
        cells_of_faces(far, faces, np.zeros((1, 3), np.int32), face_pairs(faces, 3), 0.75)


def test_two_sheets_in_one_column_are_two_cells():
    sheet = np.array([[0, 0, 0], [0, 0, 0.5], [0.5, 0, 0]], np.float32)
    faces = np.array([[0, 1, 2], [3, 4, 5]], np.int32)
    vertices = np.concatenate([sheet, sheet + np.float32([0, 3, 0])])
    cells = cells_of_faces(vertices, faces, np.zeros((2, 3), np.int32), face_pairs(faces, 6), 1.0)
    assert isinstance(cells, CellGraph)
    assert cells.count == 2
    assert cells.middles(1.0).tolist() == [[0.5, 0.5, 0.5], [0.5, 3.5, 0.5]]
    assert cells.sums[:, 0].tolist() == [125_000, 125_000]


def test_regions_unite_to_nested_coarser_pieces():
    """What the unions say is what the tree says, cut anew at every cost."""
    mesh = ground(60)
    engine = BorderSegmenter(4.0)
    cells = cells_of_faces(
        mesh.vertices, mesh.faces,
        compared_steps(SegmenterMesh(mesh.vertices, mesh.faces, mesh.colours)),
        face_pairs(mesh.faces, len(mesh.vertices)), engine.cell_m,
    )  # fmt: skip
    cut = engine.cut(cells)
    count = int(cut.regions.max()) + 1
    assert count > 2
    assert 0 < len(cut.unions) < count
    assert (np.diff(cut.union_costs) >= 0).all()
    assert (cut.union_costs > 1).all()
    assert np.isfinite(cut.union_costs).all()
    places = count + np.arange(len(cut.unions))
    assert (cut.unions[:, 0] < cut.unions[:, 1]).all()
    assert (cut.unions[:, 1] < places).all(), "of pieces before"
    assert len(np.unique(cut.unions)) == cut.unions.size, "each once"
    for cost in np.unique(cut.union_costs):
        piece = np.arange(count + len(cut.unions))
        for place in range(int(np.searchsorted(cut.union_costs, cost, side="right"))):
            piece[np.isin(piece, piece[cut.unions[place]])] = count + place
        by_unions = number_by_first(piece[cut.regions].astype(np.int32))[0]
        by_tree = number_by_first(cut.tree.cut_by_cost(cost)[0][cut.seeds])[0]
        assert_array_equal(by_unions, by_tree)
