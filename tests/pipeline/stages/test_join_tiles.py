"""What the join says of all tiles comes back from where it is kept."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from pipeline.two_tiles import joined, piece

from terraport_pipeline.geometry.clouds.edges import EdgeRule
from terraport_pipeline.geometry.clouds.footprint import Footprint
from terraport_pipeline.stages.contract import Facts
from terraport_pipeline.stages.tiles.join_tiles import JOIN_FORM
from terraport_pipeline.stages.tiles.settle_tiles import (
    SETTLED_FORM,
    SettledTile,
)


@pytest.mark.parametrize(
    "outline", [None, Footprint((90.0, 30.0), 0.5, np.ones((9, 7), np.float32), (-3, 2))]
)
def test_the_join_comes_back_from_its_arrays(outline: Footprint | None) -> None:
    result = joined([piece(0), piece(1)])
    rule, base_rule = (
        dataclasses.replace(each, footprint=outline)
        for each in (result.join.rule, result.join.base_rule)
    )
    join = dataclasses.replace(result.join, rule=rule, base_rule=base_rule)
    facts = Facts({"seam_fillers": 3})
    again = JOIN_FORM.restore(JOIN_FORM.store(join), facts)
    assert again.facts is facts
    settled = SETTLED_FORM.restore(SETTLED_FORM.store(result.settled), facts)
    for original, restored in ((join, again), (result.settled, settled)):
        for item in dataclasses.fields(original):
            before, after = getattr(original, item.name), getattr(restored, item.name)
            if isinstance(before, EdgeRule):
                plain = [dataclasses.replace(each, footprint=None) for each in (before, after)]
                assert dataclasses.astuple(plain[0]) == dataclasses.astuple(plain[1])
                assert (after.footprint is None) == (outline is None)
                if outline is not None:
                    assert (after.footprint.low, after.footprint.cell_m) == ((90.0, 30.0), 0.5)
                    assert after.footprint.first == outline.first
                    assert (after.footprint.field_m == outline.field_m).all()
            elif isinstance(before, tuple):
                assert len(before) == len(after)
                for one, other in zip(before, after, strict=True):
                    if isinstance(one, SettledTile):
                        assert one.digest() == other.digest()
                    else:
                        assert np.array_equal(one, other)
            elif not isinstance(before, Facts):
                np.testing.assert_array_equal(before, after)
