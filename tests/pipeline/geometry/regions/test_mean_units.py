"""The rounds that unite units of like colour."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_array_equal

from terraport_pipeline.geometry.mesh.unit_rows import rows_of_pairs
from terraport_pipeline.geometry.regions.mean_units import MeanUnits, unite


def row_of(colours: list[int], outer: list[int] | None = None) -> MeanUnits:
    """Units in a row, each touching the next over 10 steps."""
    n = len(colours)
    pairs = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1).astype(np.int32)
    return MeanUnits(
        np.arange(n, dtype=np.int32),
        rows_of_pairs(n, pairs, np.full(n - 1, 10)),
        np.array(colours, np.int64)[:, None],
        np.ones(n, np.int64),
        np.arange(n, dtype=np.int32),
        None if outer is None else np.array(outer, np.int64),
    )


ONE_WEIGHT = np.ones(1)


def test_alike_units_are_united_and_the_limit_holds() -> None:
    units = unite(row_of([0, 1, 50, 51, 0]), ONE_WEIGHT, 5.0, 1, 0.0, 0)
    assert_array_equal(units.labels, [0, 0, 1, 1, 2])
    assert_array_equal(units.faces, [2, 2, 1])
    assert_array_equal(units.sums[:, 0], [1, 101, 0])
    assert_array_equal(units.name, [0, 2, 4])


def test_a_long_border_elsewhere_keeps_units_apart() -> None:
    assert len(unite(row_of([0, 4]), ONE_WEIGHT, 5.0, 1, 0.5, 0).faces) == 1
    units = unite(row_of([0, 4], [90, 90]), ONE_WEIGHT, 5.0, 1, 0.5, 0)
    assert len(units.faces) == 2  # ten times the common border: 4 counts as 12
    assert units.outer is not None
    assert_array_equal(units.outer, [90, 90])


def test_outer_borders_add_up() -> None:
    units = unite(row_of([0, 0, 90], [1, 2, 4]), ONE_WEIGHT, 5.0, 1, 0.0, 0)
    assert units.outer is not None
    assert_array_equal(units.outer, [3, 4])
