"""Two polylines in one wall become one; what lies between them is filled."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from terraport_pipeline.geometry.tiles.tile_weld import (
    HeldBorder,
    Seams,
    TileBorder,
    weld_tiles,
)

LOW, HIGH = 1, 0  # wall codes along x: the high wall of the tile below, the low wall of the other


def polyline(places: list[tuple[float, float]], *, wall: int, backwards: bool) -> TileBorder:
    """A border along the wall x = 16 through (y, z) places."""
    count = len(places)
    cells = np.array([(16.0, y, z) for y, z in places])
    edges = np.array([(i, i + 1) for i in range(count - 1)], dtype=np.int32).reshape(-1, 2)
    if backwards:
        edges = edges[:, ::-1].copy()
    return TileBorder(
        np.arange(count, dtype=np.int32) * 2,
        cells,
        np.linspace(0.1, 0.2, count, dtype=np.float32),
        edges,
        np.full(len(edges), wall, dtype=np.uint8),
    )


PLACES = [(5.3, 0.0), (5.4, 1.0), (5.6, 2.0), (5.5, 3.0), (5.2, 4.0)]
PAIR = [(0, 1, 0)]


def weld(second: list[tuple[float, float]]) -> Seams:
    return weld_tiles(
        [
            polyline(PLACES, wall=LOW, backwards=False),
            polyline(second, wall=HIGH, backwards=True),
        ],
        PAIR,
    )


def test_vertices_on_the_same_lattice_lines_become_one_in_the_middle() -> None:
    seams = weld([(y + 0.02, z) for y, z in PLACES])
    assert len(seams.cells) == 5
    assert seams.cells[:, 0].tolist() == [16.0] * 5
    assert seams.cells[:, 1] == pytest.approx([y + 0.01 for y, _ in PLACES])
    assert seams.tile_rows[0].tolist() == seams.tile_rows[1].tolist() == [0, 2, 4, 6, 8]
    assert seams.tile_ids[0].tolist() == seams.tile_ids[1].tolist() == [0, 1, 2, 3, 4]
    assert [len(filler) for filler in seams.fillers] == [0, 0]
    assert seams.gaps == pytest.approx([0.02] * 5)
    assert (seams.unmatched, seams.open_edges) == (0, 0)
    assert seams.owner_tile.tolist() == [0] * 5


def test_a_crossing_may_be_nearly_a_cell_off_on_its_own_line() -> None:
    seams = weld([(y + 0.35, z) for y, z in PLACES])
    assert len(seams.cells) == 5
    assert seams.unmatched == 0


def test_crossings_on_both_sides_of_a_lattice_corner_keep_their_order() -> None:
    """The corner (139, 59) lies above the surface below the wall, and under it beyond."""
    below = [(139.05, 58.0), (139.01, 59.0), (139.0, 59.14), (138.95, 60.0)]
    beyond = [(139.05, 58.0), (139.0, 58.87), (138.99, 59.0), (138.95, 60.0)]
    seams = weld_tiles(
        [
            polyline(below, wall=LOW, backwards=False),
            polyline(beyond, wall=HIGH, backwards=True),
        ],
        PAIR,
    )
    first, second = (ids.tolist() for ids in seams.tile_ids)
    edges = list(itertools.pairwise(first[:4])) + list(itertools.pairwise(second[3::-1]))
    for a, b, c in seams.fillers[0].tolist():
        edges += [(a, b), (b, c), (c, a)]
    # Every edge once, and once the other way: no crack, no edge of four faces.
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)
    assert seams.open_edges == 0


def test_the_least_support_ratio_of_a_class_counts() -> None:
    seams = weld([(y, z) for y, z in PLACES])
    assert seams.ratio == pytest.approx(np.linspace(0.1, 0.2, 5), rel=1e-6)


def test_a_vertex_that_one_side_lacks_is_bridged_by_a_triangle() -> None:
    seams = weld([point for point in PLACES if point != (5.6, 2.0)])
    assert [len(filler) for filler in seams.fillers] == [1, 0]
    assert seams.open_edges == 0
    assert seams.unmatched == 1
    # Tile 0 runs 0-1-2-3-4 along z; the filler must run against it: 2 after 3 after 1.
    ids = seams.fillers[0][0].tolist()
    own = seams.tile_ids[0].tolist()
    around = {(ids[i], ids[(i + 1) % 3]) for i in range(3)}
    assert (own[2], own[1]) in around
    assert (own[3], own[2]) in around
    assert (own[1], own[3]) in around


def test_fillers_bring_vertices_of_the_other_tile() -> None:
    places = list(PLACES)
    places[2:3] = [(5.9, 1.6), (5.9, 2.4)]  # off every line: cannot be matched
    seams = weld(places)
    assert len(seams.fillers[0]) == 3  # a loop of 1, 2, 3 below and 3, b, a, 1 above
    guests = set(seams.tile_ids[0].tolist()) - set(seams.tile_ids[0][: len(seams.tile_rows[0])])
    assert len(guests) == 2
    assert guests <= set(seams.tile_ids[1].tolist())
    assert seams.open_edges == 0


def test_where_one_side_ends_the_rest_is_a_rim() -> None:
    seams = weld(PLACES[:3])
    assert [len(filler) for filler in seams.fillers] == [0, 0]
    assert seams.open_edges == 2
    assert seams.unmatched == 2


def test_surfaces_that_part_for_good_are_closed_between_them() -> None:
    """Away from all samples each solver's surface runs on alone: they part from z = 2 on."""
    parting = [(y + 1.5 * max(0.0, z - 2.0), z) for y, z in PLACES]
    seams = weld(parting)
    own, other = (ids.tolist() for ids in seams.tile_ids)
    assert own[:3] == other[:3]
    # The gap is bound by 2-3-4 below and 4-3-2 beyond, and closed between both ends.
    assert len(seams.fillers[0]) == 3
    assert seams.open_edges == 0
    ends = {(own[4], other[4]), (other[4], own[4])}
    sides = {(f[i], f[(i + 1) % 3]) for f in seams.fillers[0].tolist() for i in range(3)}
    assert {(own[3], own[2]), (own[4], own[3])} <= sides
    assert {(other[2], other[3]), (other[3], other[4])} <= sides
    assert len(ends & sides) == 1


def test_a_small_bubble_of_one_side_is_capped() -> None:
    ring = [(1.0, 0.5), (1.5, 1.0), (1.0, 1.5), (0.5, 1.0)]
    border = polyline(ring, wall=LOW, backwards=False)
    edges = np.concatenate([border.edges, [[3, 0]]]).astype(np.int32)
    border = TileBorder(
        border.rows, border.cells, border.ratio, edges, np.full(4, LOW, dtype=np.uint8)
    )
    nothing = polyline([(9.0, 9.0)], wall=HIGH, backwards=True)
    seams = weld_tiles([border, nothing], PAIR)
    assert [len(filler) for filler in seams.fillers] == [2, 0]


def test_two_vertices_of_one_tile_never_become_one() -> None:
    # Two sheets 0.3 cells apart below, one above: only the nearer may join it.
    sheets = [(5.0, 0.0), (5.0, 1.0), (5.3, 1.0), (5.3, 0.0)]
    seams = weld_tiles(
        [
            polyline(sheets, wall=LOW, backwards=False),
            polyline([(5.05, 0.0), (5.05, 1.0)], wall=HIGH, backwards=True),
        ],
        PAIR,
    )
    for rows in seams.tile_rows:
        assert len(set(rows.tolist())) == len(rows)
    assert len(set(seams.tile_ids[0].tolist())) == len(seams.tile_ids[0])


def test_four_tiles_that_meet_in_a_line_share_its_vertex() -> None:
    """Walls x = 16 and z = 16; a flat surface at y = 5.5 crosses the line where they meet."""
    borders = []
    for x, z in ((0, 0), (1, 0), (0, 1), (1, 1)):
        other_x, other_z = (16.0 + (1 if x else -1)), (16.0 + (1 if z else -1))
        cells = np.array([[16.0, 5.5 + 0.01 * (x + 2 * z), 16.0]] * 3)
        cells[1, 2] = other_z  # along the wall x = 16
        cells[2, 0] = other_x  # along the wall z = 16
        edges = np.array([[1, 0], [0, 2]], dtype=np.int32)
        if x != z:
            edges = edges[:, ::-1].copy()
        walls = np.array([1 - x, 4 + 1 - z], dtype=np.uint8)
        ratio = np.zeros(3, dtype=np.float32)
        borders.append(TileBorder(np.arange(3, dtype=np.int32), cells, ratio, edges, walls))
    neighbours = [(0, 1, 0), (2, 3, 0), (0, 2, 2), (1, 3, 2)]
    seams = weld_tiles(borders, neighbours)
    assert len(seams.cells) == 5
    shared = [
        ids[rows.tolist().index(0)]
        for rows, ids in zip(seams.tile_rows, seams.tile_ids, strict=True)
    ]
    assert len(set(shared)) == 1
    assert seams.cells[shared[0]] == pytest.approx([16.0, 5.515, 16.0])
    assert (seams.open_edges, seams.unmatched) == (0, 0)


def test_gaps_go_on_around_the_line_where_four_tiles_meet() -> None:
    """At the line they are cells apart, a cell off they meet: four slivers, each closed there."""
    borders = []
    for x, z in ((0, 0), (1, 0), (0, 1), (1, 1)):
        other_x, other_z = (16.0 + (1 if x else -1)), (16.0 + (1 if z else -1))
        cells = np.array([[16.0, 5.5 + 3.0 * (x + 2 * z), 16.0], [16, 5.5, 16], [16, 5.5, 16]])
        cells[1, 2] = other_z  # along the wall x = 16
        cells[2, 0] = other_x  # along the wall z = 16
        edges = np.array([[1, 0], [0, 2]], dtype=np.int32)
        if x != z:
            edges = edges[:, ::-1].copy()
        walls = np.array([1 - x, 4 + 1 - z], dtype=np.uint8)
        ratio = np.zeros(3, dtype=np.float32)
        borders.append(TileBorder(np.arange(3, dtype=np.int32), cells, ratio, edges, walls))
    seams = weld_tiles(borders, [(0, 1, 0), (2, 3, 0), (0, 2, 2), (1, 3, 2)])
    assert [len(filler) for filler in seams.fillers] == [2, 1, 1, 0]
    assert seams.open_edges == 0
    # What is left open lies on the line, and runs as often up as down over each of its parts.
    edges = []
    for border, rows, ids in zip(borders, seams.tile_rows, seams.tile_ids, strict=True):
        own = np.full(3, -1)
        own[rows] = ids[: len(rows)]
        edges += [tuple(edge) for edge in own[border.edges].tolist()]
    for a, b, c in np.concatenate(seams.fillers).tolist():
        edges += [(a, b), (b, c), (c, a)]
    left = np.array([edge for edge in edges if edge[::-1] not in edges])
    assert (seams.cells[left][:, :, [0, 2]] == 16.0).all()
    assert np.array_equal(np.sort(left[:, 0]), np.sort(left[:, 1]))


def test_the_order_of_walls_does_not_matter() -> None:
    first = weld([(y + 0.02, z) for y, z in PLACES])
    again = weld_tiles(
        [
            polyline(PLACES, wall=LOW, backwards=False),
            polyline([(y + 0.02, z) for y, z in PLACES], wall=HIGH, backwards=True),
        ],
        list(reversed(PAIR)),
    )
    assert np.array_equal(first.cells, again.cells)


def test_no_neighbours_share_nothing() -> None:
    seams = weld_tiles([polyline(PLACES, wall=LOW, backwards=False)], [])
    assert len(seams.cells) == 0
    assert seams.tile_rows[0].tolist() == []


CORES = (
    (np.array([0, 0, 0]), np.array([16, 16, 16])),
    (np.array([16, 0, 0]), np.array([32, 16, 16])),
)


def left_of(seams: Seams, tile: int) -> HeldBorder:
    """What a join said of a tile."""
    ids = seams.tile_ids[tile]
    order = np.argsort(ids)
    fillers = order[np.searchsorted(ids[order], seams.fillers[tile])].astype(np.int32)
    return HeldBorder(
        seams.tile_rows[tile], seams.cells[ids], seams.ratio[ids], fillers.reshape(-1, 3),
        CORES[tile], 4.0,
    )  # fmt: skip


def pair(first: list[tuple[float, float]], second: list[tuple[float, float]]) -> list[TileBorder]:
    return [
        polyline(first, wall=LOW, backwards=False),
        polyline(second, wall=HIGH, backwards=True),
    ]


def uncancelled(seams: Seams, borders: list[TileBorder]) -> list[tuple[int, int]]:
    """Edges along the wall without one the other way, over tiles and fillers."""
    edges = []
    for tile, border in enumerate(borders):
        id_of = dict(
            zip(seams.tile_rows[tile].tolist(), seams.tile_ids[tile].tolist(), strict=False)
        )
        edges += [tuple(id_of[border.rows[v]] for v in edge) for edge in border.edges.tolist()]
        for a, b, c in seams.fillers[tile].tolist():
            edges += [(a, b), (b, c), (c, a)]
    return [(a, b) for a, b in edges if (b, a) not in edges and a != b]


OFF_EVERY_LINE = [*PLACES[:2], (5.9, 1.6), (5.9, 2.4), *PLACES[3:]]


@pytest.mark.parametrize("still", [0, 1])
@pytest.mark.parametrize(
    ("first", "second"),
    [
        (PLACES, [(y + 0.02, z) for y, z in PLACES]),
        (PLACES, OFF_EVERY_LINE),  # fillers with vertices of the other tile
        (PLACES, [place for place in PLACES if place != (5.6, 2.0)]),
    ],
)
def test_a_tile_that_is_as_it_was_stays_so_and_its_neighbour_comes_to_it(
    still: int, first: list[tuple[float, float]], second: list[tuple[float, float]]
) -> None:
    held = {still: left_of(weld_tiles(pair(first, second), PAIR), still)}
    moved = [[(y + 0.1 + 0.05 * z, z) for y, z in side] for side in (first, second)]
    now = [first, second]
    now[1 - still] = moved[1 - still]
    seams = weld_tiles(pair(*now), PAIR, held)
    assert seams.held == {still}
    again = left_of(seams, still)
    for name in ("rows", "cells", "ratio", "fillers"):
        np.testing.assert_array_equal(getattr(again, name), getattr(held[still], name))
    assert uncancelled(seams, pair(*now)) == []
    # The neighbour moves: its own position would be a tenth of a cell off.
    assert not np.array_equal(seams.cells, weld_tiles(pair(*now), PAIR).cells)


def test_all_tiles_as_they_were_are_joined_as_they_were() -> None:
    borders = pair(PLACES, OFF_EVERY_LINE)
    before = weld_tiles(borders, PAIR)
    seams = weld_tiles(borders, PAIR, {tile: left_of(before, tile) for tile in (0, 1)})
    assert seams.held == {0, 1}
    for tile in (0, 1):
        again, first = left_of(seams, tile), left_of(before, tile)
        for name in ("rows", "cells", "ratio", "fillers"):
            np.testing.assert_array_equal(getattr(again, name), getattr(first, name))


def test_a_rim_that_gets_a_neighbour_is_let_go() -> None:
    """Its vertices there were not shared and are now: the tile cannot be what it was."""
    held = {0: left_of(weld_tiles(pair(PLACES, PLACES[:3]), PAIR), 0)}
    seams = weld_tiles(pair(PLACES, PLACES), PAIR, held)
    assert seams.held == frozenset()
    assert seams.tile_rows[0].tolist() == [0, 2, 4, 6, 8]
    assert (seams.unmatched, seams.open_edges) == (0, 0)


def test_a_rim_far_from_all_samples_is_nobodys_neighbour() -> None:
    """It is cut away, whatever it is joined to: a chance match there leaves the tile as it was."""

    def faint(places: list[tuple[float, float]], *, wall: int, backwards: bool) -> TileBorder:
        border = polyline(places, wall=wall, backwards=backwards)
        ratio = np.linspace(0.1, 8.1, len(PLACES), dtype=np.float32)[: len(places)]
        return replace(border, ratio=ratio)

    def sides(beyond: int) -> list[TileBorder]:
        return [
            faint(PLACES, wall=LOW, backwards=False),
            faint(PLACES[:beyond], wall=HIGH, backwards=True),
        ]

    held = {0: left_of(weld_tiles(sides(3), PAIR), 0)}
    seams = weld_tiles(sides(5), PAIR, held)
    assert seams.held == {0}
    assert seams.tile_rows[0].tolist() == seams.tile_rows[1].tolist() == [0, 2, 4]
    assert seams.tile_ids[0].tolist() == seams.tile_ids[1].tolist()
