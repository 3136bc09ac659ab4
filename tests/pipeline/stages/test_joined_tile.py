"""Two tiles of a sheet become one, vertex for vertex."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from pipeline.two_tiles import CORE, RULE, Joined, join_of, joined, piece, task, tile_joins

from terraport_pipeline.stages.tiles.joined_tile import finish, weak_places
from terraport_pipeline.stages.tiles.settle_tiles import settle


def border(result: Joined, tile: int) -> dict[int, int]:
    """Row of each shared vertex by its id."""
    arrays = result.tiles[tile]
    ids = result.settled.ids[tile][arrays["border-shared"]]
    return dict(zip(ids.tolist(), arrays["border-rows"].tolist(), strict=True))


def test_shared_vertices_are_the_same_in_both_to_the_last_bit() -> None:
    result = joined([piece(0), piece(1, lift_cells=0.04)])
    first_tile, second_tile = result.tiles
    first, second = border(result, 0), border(result, 1)
    assert len(first) == CORE + 1
    assert first.keys() == second.keys()
    for name in ("vertices", "normals", "colours", "attribute-0", "attribute-1"):
        for number, row in first.items():
            assert first_tile[name][row].tobytes() == second_tile[name][second[number]].tobytes()


def test_what_is_not_shared_stays_where_it_was() -> None:
    pieces = [piece(0), piece(1, lift_cells=0.04)]
    tiles = joined(pieces).tiles
    for tile, (before, after) in enumerate(zip(pieces, tiles, strict=True)):
        own = np.setdiff1d(np.arange(len(before["vertices"])), after["border-rows"])
        expected = before["vertices"].astype(np.float64) + task(tile).centre_m
        assert (after["vertices"][own] == expected.astype(np.float32)[own]).all()
        assert (after["faces"] == before["faces"]).all()
        for name in ("colours", "attribute-0", "attribute-1"):
            assert (after[name][own] == before[name][own]).all()


def test_normals_run_on_across_the_wall() -> None:
    # a plane: both tiles' halves of the fans must give the normal of the whole
    pieces = [piece(0), piece(1)]
    for tile, each in enumerate(pieces):
        each["vertices"][:, 1] = 0.25 * (each["vertices"][:, 0] + task(tile).centre_m[0] - 104.0)
        each["border-cells"][:, 1] = 4.0
    expected = np.array([-0.25, 1.0, 0.0]) / np.hypot(0.25, 1.0)
    for each in joined(pieces).tiles:
        middle = (np.abs(each["vertices"][:, 2] - 42.0) < 1.0) & (
            np.abs(each["vertices"][:, 0] - 104.0) > 0.6
        )
        assert np.abs(each["normals"][middle] - expected).max() < 1e-6


def test_the_cut_is_the_same_on_both_sides() -> None:
    pieces = [piece(0), piece(1)]
    for each in pieces:  # support ends across the sheet, at z of 3.3 cells
        z = each["vertices"][:, 2] / 0.5 + CORE / 2
        each["ratio"] = (5.3 - z).astype(np.float32)
        each["ratio"][z > 4.5] = 0.5
        rows = each["border-rows"]
        each["border-ratio"] = each["ratio"][rows]
    result = joined(pieces)
    assert result.settled.count == result.join.count + 1  # the cut crosses the wall on one edge
    assert result.settled.cracks == 0
    first_border, second_border = (border(result, tile) for tile in range(2))
    new = len(result.join.cells)
    assert new in first_border
    assert new in second_border
    places = [
        each["vertices"][at[new]]
        for each, at in zip(result.tiles, (first_border, second_border), strict=True)
    ]
    assert places[0].tobytes() == places[1].tobytes()
    for each in result.tiles:
        assert each["vertices"][:, 2].min() == pytest.approx(40.0 + 0.5 * 3.3, abs=1e-5)
        # the surface that the base is made from ends so much farther out, in metres of support
        assert each["base-vertices"][:, 2].min() == pytest.approx(40.0 + 0.5 * 2.3, abs=1e-5)
        # a code is never mixed
        assert set(np.unique(each["attribute-1"]).tolist()) <= {2.0, 6.0}


def test_the_border_is_cut_at_the_threshold_and_a_gap_between_samples_stays() -> None:
    pieces = [piece(0), piece(1)]
    # along z: the way out, sampled, a gap that nowhere passes the largest ratio of 4, sampled
    ratio_of_row = np.array([7, 5, 3, 1, 1, 3, 3, 1, 1], np.float32)
    for each in pieces:
        each["ratio"] = ratio_of_row[np.rint(each["vertices"][:, 2] / 0.5 + CORE / 2).astype(int)]
        each["border-ratio"] = each["ratio"][each["border-rows"]]
    for each in joined(pieces).tiles:
        # ratio 2 lies between rows 2 and 3; nothing is missing beyond
        assert each["vertices"][:, 2].min() == 40.0 + 0.5 * 2.5
        a, b, c = (each["vertices"][each["faces"][:, corner]] for corner in range(3))
        plan_m2 = 0.5 * np.abs(np.cross(b - a, c - a)[:, 1]).sum()
        assert plan_m2 == pytest.approx(0.25 * 5.5 * CORE, rel=1e-5)
        # the hem of the surface for the base: ratio 3, a spacing beyond the threshold
        assert each["base-vertices"][:, 2].min() == 40.0 + 0.5 * 2.0


def test_a_weak_place_on_both_sides_of_the_wall_is_told_with_its_ids() -> None:
    pieces = [piece(0), piece(1)]
    for each, x in zip(pieces, (CORE, 0), strict=True):
        near = np.abs(each["vertices"][:, 0] / 0.5 + CORE / 2 - x) < 1.5
        each["ratio"][near] = 3.0
        each["border-ratio"] = each["ratio"][each["border-rows"]]
    join = join_of(pieces, RULE)
    joins = tile_joins(join)
    weak = [weak_places(task(t), each, joins[t]) for t, each in enumerate(pieces)]
    assert [each.farthest.tolist() for each in weak] == [[3.0], [3.0]]
    touched = [set(join.ids[t][each.touch[:, 1]].tolist()) for t, each in enumerate(weak)]
    assert touched[0] == touched[1] == set(range(CORE + 1))


def test_a_dropped_piece_takes_its_vertices_along() -> None:
    pieces = [piece(0), piece(1)]
    for each in pieces:  # a strip of weak ground parts the first rows from the rest
        z = each["vertices"][:, 2] / 0.5 + CORE / 2
        each["ratio"][(z > 1.5) & (z < 3.5)] = 9.0
        each["border-ratio"] = each["ratio"][each["border-rows"]]
    whole = joined(pieces, min_faces=1)
    assert [len(each.sizes) for each in whole.looks] == [2, 2]
    cut = joined(pieces, min_faces=80)
    assert cut.settled.islands == 1  # one strip over both tiles
    for before, after in zip(whole.tiles, cut.tiles, strict=True):
        assert after["vertices"][:, 2].min() > 41.5 > before["vertices"][:, 2].min()
        assert len(np.unique(after["faces"])) == len(after["vertices"])


def test_a_tile_without_surface_stays_empty() -> None:
    empty = piece(1)
    for name in ("vertices", "faces", "ratio", "colours", "attribute-0", "attribute-1"):
        empty[name] = empty[name][:0]
    for name in ("rows", "cells", "ratio", "edges", "walls"):
        empty[f"border-{name}"] = empty[f"border-{name}"][:0]
    result = joined([piece(0), empty])
    arrays, box = finish(
        task(1), empty, result.joins[1], result.forgiven[1], result.settled.tiles[1]
    )
    assert len(arrays["faces"]) == len(arrays["vertices"]) == len(arrays["border-shared"]) == 0
    assert (box == 0).all()
    assert result.settled.seam_edges == 0


def test_what_is_computed_of_a_tile_does_not_depend_on_numbers_over_all_tiles() -> None:
    result = joined([piece(0), piece(1, lift_cells=0.04)])
    join = result.join
    # The same seam behind seven vertices that other tiles share.
    first = np.arange(7)
    moved = dataclasses.replace(
        join,
        cells=np.concatenate([join.cells[first] + 50.0, join.cells]),
        ratio=np.concatenate([join.ratio[first], join.ratio]),
        colours=np.concatenate([join.colours[first], join.colours]),
        attributes=tuple(np.concatenate([each[first], each]) for each in join.attributes),
        ids=tuple(ids + 7 for ids in join.ids),
        fillers=tuple(fillers + 7 for fillers in join.fillers),
    )
    for before, after in zip(result.joins, tile_joins(moved), strict=True):
        assert before.digest() == after.digest()
    settled = settle(moved, result.looks, min_faces=1)
    for before, after in zip(result.settled.tiles, settled.tiles, strict=True):
        assert before.digest() == after.digest()
    assert settled.ids[0].min() == 7
