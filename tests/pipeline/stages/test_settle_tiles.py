"""What only all tiles settle: weak places, loose pieces, open edges along walls."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from pipeline.two_tiles import CORE, joined, piece

from terraport_pipeline.stages.tiles.join_tiles import Join
from terraport_pipeline.stages.tiles.settle_tiles import (
    Look,
    Weak,
    forgive,
    settle,
)


def numbered(ids: Sequence[Sequence[int]]) -> Join:
    """Two joined tiles, whose shared vertices have these numbers over all tiles."""
    join = joined([piece(0), piece(1)]).join
    return dataclasses.replace(
        join,
        cells=np.zeros((max((max(each, default=-1) for each in ids), default=-1) + 1, 3)),
        ids=tuple(np.array(each, np.int64) for each in ids),
    )


def weak(farthest: list[float], touch: list[tuple[int, int]]) -> Weak:
    return Weak(np.array(farthest, np.float32), np.array(touch, np.int64).reshape(-1, 2))


def test_a_weak_place_across_walls_stays_or_goes_as_one() -> None:
    # The second tile's own numbers run the other way.
    join = numbered([range(9), range(8, -1, -1)])
    chain = forgive(join, [weak([3.0, 3.0], [(0, 1), (1, 2)]), weak([3.9, 5.0], [(0, 7), (1, 1)])])
    assert [each.detail.tolist() for each in chain] == [[True, True], [True, False]]
    linked = forgive(join, [weak([3.0, 3.0], [(0, 1), (0, 7)]), weak([3.9, 5.0], [(0, 7), (1, 1)])])
    assert [each.detail.tolist() for each in linked] == [[False, True], [False, False]]
    assert [each.base.tolist() for each in linked] == [[True, True], [True, True]]


def test_without_weak_places_nothing_is_forgiven() -> None:
    join = joined([piece(0), piece(1)]).join
    assert [len(each.detail) for each in forgive(join, [weak([], []), weak([], [])])] == [0, 0]


def seen(
    sizes: list[int],
    shared: Sequence[tuple[int, tuple[int, int]]] = (),
    edges: Sequence[Sequence[int]] = (),
    middles: Sequence[Sequence[float]] = (),
) -> Look:
    return Look(
        np.array(sizes, np.int64),
        np.array([vertex for vertex, _ in shared], np.int64),
        np.array([ends for _, ends in shared], np.int64).reshape(-1, 2),
        np.tile([0.0, 2.0, 0.0], (len(shared), 1)),
        np.array(edges, np.int64).reshape(-1, 2, 2),
        np.array(middles, np.float64).reshape(-1, 3),
    )


def test_pieces_are_counted_over_all_tiles() -> None:
    looks = [
        seen([60, 10], [(0, (0, 0)), (1, (1, 1))]),
        seen([60, 10, 5], [(0, (0, 0)), (1, (1, 1))]),
    ]
    settled = settle(numbered([[0, 1], [0, 1]]), looks, min_faces=15)
    # 60 + 60 and 10 + 10 stay, the lone 5 goes
    assert [tile.dropped.tolist() for tile in settled.tiles] == [[], [2]]
    assert settled.islands == 1
    assert settled.tiles[1].normals.tolist() == [[0, 1, 0], [0, 1, 0]]


def test_the_largest_piece_stays_however_small() -> None:
    settled = settle(numbered([[], []]), [seen([3, 9]), seen([4])], min_faces=1000)
    assert [tile.dropped.tolist() for tile in settled.tiles] == [[0], [0]]
    assert settled.islands == 2


def test_vertices_that_the_cut_made_are_shared_too() -> None:
    # The second tile's numbers 0, 1, 2, 3 are 9, 7, 4, 2 over all tiles.
    looks = [seen([5], [(0, (4, 7)), (0, (4, 4))]), seen([6], [(0, (1, 2)), (0, (3, 0))])]
    settled = settle(numbered([range(10), [9, 7, 4, 2]]), looks, min_faces=11)
    assert settled.islands == 0  # joined by what the cut made alone
    assert settled.count == 12
    assert [each.tolist() for each in settled.ids] == [[11, 4], [11, 10]]
    assert [tile.normals.shape for tile in settled.tiles] == [(2, 3), (2, 3)]


def test_open_edges_are_seams_cracks_or_rims() -> None:
    a, b = [3, 3], [4, 4]
    here = [[0.0, 0.0, 0.0]]
    join = numbered([range(5), [0, 1, 2, 4, 3]])
    seam = settle(
        join,
        [seen([1], edges=[a + b], middles=here), seen([1], edges=[a + b], middles=here)],
        min_faces=1,
    )
    assert (seam.seam_edges, seam.cracks, seam.rims) == (1, 0, 0)
    own, other = [-1, -1, -2, -2], [-7, -7, -8, -8]
    crack = settle(
        join,
        [seen([1], edges=[own], middles=here), seen([1], edges=[other], middles=[[0.9, 0.0, 0.0]])],
        min_faces=1,
    )
    assert (crack.seam_edges, crack.cracks, crack.rims) == (0, 2, 0)
    rim = settle(
        join,
        [seen([1], edges=[own], middles=here), seen([1], edges=[other], middles=[[1.1, 0.0, 0.0]])],
        min_faces=1,
    )
    assert (rim.seam_edges, rim.cracks, rim.rims) == (0, 0, 2)
    # Between two vertices that the cut made lies the cut itself.
    cut, beside = [0, 3, 0, 4], [1, 3, 1, 4]
    ends = settle(
        join,
        [seen([1], edges=[cut], middles=here), seen([1], edges=[beside], middles=here)],
        min_faces=1,
    )
    assert (ends.seam_edges, ends.cracks, ends.rims) == (0, 0, 2)


def test_a_sheet_over_two_tiles_has_a_seam_and_no_crack() -> None:
    settled = joined([piece(0), piece(1, lift_cells=0.1)]).settled
    assert (settled.seam_edges, settled.cracks) == (CORE, 0)
