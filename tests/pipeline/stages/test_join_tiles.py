"""What is decided for all tiles together, on tiles that are written out."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
from pipeline.two_tiles import CORE, joined, piece

from terraport_pipeline.geometry.clouds.edges import EdgeRule
from terraport_pipeline.geometry.clouds.footprint import Footprint
from terraport_pipeline.stages.tiles.join_tiles import (
    Look,
    Weak,
    cut_ids,
    forgive,
    from_stored,
    settle,
    to_stored,
)


def weak(farthest: list[float], touch: list[tuple[int, int]]) -> Weak:
    return Weak(np.array(farthest, np.float32), np.array(touch, np.int64).reshape(-1, 2))


def test_a_weak_place_across_walls_stays_or_goes_as_one() -> None:
    join = joined([piece(0), piece(1)]).join
    chain = forgive(join, [weak([3.0, 3.0], [(0, 1), (1, 2)]), weak([3.9, 5.0], [(0, 1), (1, 7)])])
    assert [each.tolist() for each in chain.forgiven] == [[True, True], [True, False]]
    linked = forgive(join, [weak([3.0, 3.0], [(0, 1), (0, 7)]), weak([3.9, 5.0], [(0, 1), (1, 7)])])
    assert [each.tolist() for each in linked.forgiven] == [[False, True], [False, False]]


def test_without_weak_places_nothing_is_forgiven() -> None:
    join = joined([piece(0), piece(1)]).join
    assert [len(each) for each in forgive(join, [weak([], []), weak([], [])]).forgiven] == [0, 0]


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
        np.array(edges, np.int64).reshape(-1, 4),
        np.array(middles, np.float64).reshape(-1, 3),
    )


def test_pieces_are_counted_over_all_tiles() -> None:
    looks = [
        seen([60, 10], [(0, (0, 0)), (1, (1, 1))]),
        seen([60, 10, 5], [(0, (0, 0)), (1, (1, 1))]),
    ]
    settled = settle(looks, 2, min_faces=15)
    # 60 + 60 and 10 + 10 stay, the lone 5 goes
    assert [each.tolist() for each in settled.dropped] == [[], [2]]
    assert settled.islands == 1
    assert settled.normals.tolist() == [[0, 1, 0], [0, 1, 0]]


def test_the_largest_piece_stays_however_small() -> None:
    settled = settle([seen([3, 9]), seen([4])], 0, min_faces=1000)
    assert [each.tolist() for each in settled.dropped] == [[0], [0]]
    assert settled.islands == 2


def test_vertices_that_the_cut_made_are_shared_too() -> None:
    looks = [seen([5], [(0, (4, 7)), (0, (4, 4))]), seen([6], [(0, (4, 7)), (0, (2, 9))])]
    settled = settle(looks, 10, min_faces=11)
    assert settled.pairs.tolist() == [[2, 9], [4, 7]]
    assert settled.islands == 0  # joined by what the cut made alone
    assert settled.normals.shape == (12, 3)
    assert cut_ids(looks[1].pairs, settled.pairs, 10).tolist() == [11, 10]
    assert cut_ids(looks[0].pairs, settled.pairs, 10).tolist() == [11, 4]


def test_open_edges_are_seams_cracks_or_rims() -> None:
    a, b = [3, 3], [4, 4]
    here = [[0.0, 0.0, 0.0]]
    seam = settle(
        [seen([1], edges=[a + b], middles=here), seen([1], edges=[b + a], middles=here)],
        5,
        min_faces=1,
    )
    assert (seam.seam_edges, seam.cracks, seam.rims) == (1, 0, 0)
    own, other = [-1, -1, -2, -2], [-7, -7, -8, -8]
    crack = settle(
        [seen([1], edges=[own], middles=here), seen([1], edges=[other], middles=[[0.9, 0.0, 0.0]])],
        5, min_faces=1,
    )  # fmt: skip
    assert (crack.seam_edges, crack.cracks, crack.rims) == (0, 2, 0)
    rim = settle(
        [seen([1], edges=[own], middles=here), seen([1], edges=[other], middles=[[1.1, 0.0, 0.0]])],
        5, min_faces=1,
    )  # fmt: skip
    assert (rim.seam_edges, rim.cracks, rim.rims) == (0, 0, 2)


def test_a_sheet_over_two_tiles_has_a_seam_and_no_crack() -> None:
    settled = joined([piece(0), piece(1, lift_cells=0.1)]).settled
    assert (settled.seam_edges, settled.cracks) == (CORE, 0)


@pytest.mark.parametrize(
    "outline", [None, Footprint((90.0, 30.0), 0.5, np.ones((9, 7), np.float32))]
)
def test_the_join_comes_back_from_its_arrays(outline: Footprint | None) -> None:
    result = joined([piece(0), piece(1)])
    rule, base_rule = (
        dataclasses.replace(each, footprint=outline)
        for each in (result.join.rule, result.join.base_rule)
    )
    join = dataclasses.replace(result.join, rule=rule, base_rule=base_rule)
    again, settled = from_stored(to_stored(join, result.settled))
    for original, restored in ((join, again), (result.settled, settled)):
        for item in dataclasses.fields(original):
            before, after = getattr(original, item.name), getattr(restored, item.name)
            if isinstance(before, EdgeRule):
                plain = [dataclasses.replace(each, footprint=None) for each in (before, after)]
                assert dataclasses.astuple(plain[0]) == dataclasses.astuple(plain[1])
                assert (after.footprint is None) == (outline is None)
                if outline is not None:
                    assert (after.footprint.low, after.footprint.cell_m) == ((90.0, 30.0), 0.5)
                    assert (after.footprint.field_m == outline.field_m).all()
            elif isinstance(before, tuple):
                assert len(before) == len(after)
                assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
            else:
                np.testing.assert_array_equal(before, after)
