"""Regions of the next survey on tiles of a few units: which are held, and which are matched."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from terraport_pipeline.geometry.tiles.tiled_means import JoinedRegions
from terraport_pipeline.stages.contract import Context, Facts, Stored
from terraport_pipeline.stages.tiles import numbered_regions
from terraport_pipeline.stages.tiles.numbered_regions import (
    NUMBERS_FORM,
    NumberedRegions,
    number,
    samples_of,
)

CONTEXT = Context(Path())


def units(*lengths_m: int, start: float = 0.0) -> Stored:
    """Units one behind the other along x, with a sample on every metre."""
    unit = np.repeat(np.arange(len(lengths_m)), lengths_m)
    x = start + np.arange(len(unit))
    return Stored(
        {
            "sample_point": np.stack([x, 0 * x, 0 * x], axis=1).astype(np.float32),
            "sample_unit": unit.astype(np.int32),
            "sample_area": np.ones(len(unit), np.float32),
        },
        {},
    )


def joined(*regions: list[int], fine: tuple[list[int], ...] | None = None) -> JoinedRegions:
    arrays = tuple(np.array(tile, np.int32) for tile in regions)
    pools = arrays if fine is None else tuple(np.array(tile, np.int32) for tile in fine)
    return JoinedRegions(arrays, pools, int(np.concatenate(arrays).max()) + 1, 9, 9, 0)


def kept(tiles: list[Stored], result: NumberedRegions) -> tuple[Stored, Stored]:
    return NUMBERS_FORM.store(result), samples_of(tiles, result)


FIRST = [units(10, 20), units(30, start=30.0), units(10, 10, start=60.0)]


@pytest.fixture
def before() -> tuple[Stored, Stored]:
    """Region 0 is 10 m, 1 is 50 m over two tiles, 2 the same again in the third, 3 the last 10."""
    result = number(
        ("tile-0", "tile-1", "tile-2"), ("a", "b", "c"), FIRST,
        joined([0, 1], [1], [2, 3], fine=([7, 3], [3], [5, 5])), None, CONTEXT,
    )  # fmt: skip
    assert [tile.tolist() for tile in result.region] == [[0, 1], [1], [2, 3]]
    assert [tile.tolist() for tile in result.fine] == [[0, 1], [0], [0, 0]]
    assert result.before.tolist() == [-1] * 4
    return kept(FIRST, result)


def test_a_tile_that_did_not_change_keeps_regions_and_pools(before) -> None:
    """The join numbers from the other end, and unites in the first tile what was two."""
    tiles = [FIRST[0], units(14, 16, start=30.0), FIRST[2]]
    result = number(
        ("tile-0", "tile-1", "tile-2"), ("a", "new", "c"), tiles,
        joined([2, 2], [2, 3], [1, 0], fine=([4, 4], [4, 6], [8, 9])), before, CONTEXT,
    )  # fmt: skip
    assert [tile.tolist() for tile in result.region] == [[0, 1], [1, 4], [2, 3]]
    assert [tile.tolist() for tile in result.fine] == [[0, 1], [0, 1], [0, 0]]
    assert result.before.tolist() == [0, 1, 2, 3, -1]
    assert result.in_joined(joined([0, 0], [0, 1], [1, 0])).count == 5


def test_unions_of_the_join_are_those_of_the_numbers(before) -> None:
    """Region 2 of the join has the numbers 0 and 1: they are united first."""
    tiles = [FIRST[0], units(14, 16, start=30.0), FIRST[2]]
    join = replace(
        joined([2, 2], [2, 3], [1, 0], fine=([4, 4], [4, 6], [8, 9])),
        unions=np.array([[1, 2], [0, 4], [3, 5]], np.int32),
        union_costs=np.array([1.25, 2.0, 4.0]),
    )
    result = number(("tile-0", "tile-1", "tile-2"), ("a", "new", "c"), tiles, join, before, CONTEXT)
    assert [tile.tolist() for tile in result.region] == [[0, 1], [1, 4], [2, 3]]
    numbered = result.in_joined(join)
    # 0 and 1 to 5; the join's 1 is 2, its 0 is 3, its 3 is 4.
    assert numbered.unions.tolist() == [[0, 1], [2, 5], [3, 6], [4, 7]]
    assert numbered.union_costs.tolist() == [1.0, 1.25, 2.0, 4.0]


def test_a_tile_that_changed_is_matched_by_its_ground(before) -> None:
    tiles = [FIRST[0], FIRST[1], units(3, 7, 10, start=60.0)]
    result = number(
        ("tile-0", "tile-1", "tile-2"), ("a", "b", "new"), tiles,
        joined([0, 1], [1], [3, 2, 4]), before, CONTEXT,
    )  # fmt: skip
    # 7 of 10 m are the old region 2; 10 m the old 3; 3 m are new.
    assert [tile.tolist() for tile in result.region] == [[0, 1], [1], [4, 2, 3]]


def test_ground_that_is_gone_gives_its_number_back(before) -> None:
    """Region 0 has no unit any more, so the last number moves to its place."""
    tiles = [FIRST[1], FIRST[2]]
    result = number(("tile-1", "tile-2"), ("b", "c"), tiles, joined([0], [1, 2]), before, CONTEXT)
    assert [tile.tolist() for tile in result.region] == [[1], [2, 0]]
    assert result.before.tolist() == [3, 1, 2]


def test_too_many_regions_are_those_of_the_join(before, monkeypatch) -> None:
    """Two held and three of the join would be five; the join alone has four."""
    monkeypatch.setattr(numbered_regions, "MAX_REGIONS", 4)
    tiles = [FIRST[0], units(14, 16, start=30.0), FIRST[2]]
    result = number(
        ("tile-0", "tile-1", "tile-2"), ("a", "new", "c"), tiles,
        joined([2, 2], [2, 3], [1, 0]), before, CONTEXT,
    )  # fmt: skip
    assert [tile.tolist() for tile in result.region] == [[1, 1], [1, 0], [2, 3]]


def test_the_form_gives_back_what_was_stored(before) -> None:
    back = NUMBERS_FORM.restore(before[0], Facts())
    assert back.tiles == ("tile-0", "tile-1", "tile-2")
    assert back.units == ("a", "b", "c")
    assert [tile.tolist() for tile in back.region] == [[0, 1], [1], [2, 3]]
    assert before[1].arrays["starts"].tolist() == [0, 30, 60, 80]
    assert np.bincount(before[1].arrays["region"]).tolist() == [10, 50, 10, 10]
