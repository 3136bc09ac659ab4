"""Height differences at vertices: the last that a survey found, and no other."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_payload.grid import decode_attribute, encode_attribute
from terraport_pipeline.geometry.clouds.change_raster import ChangeRaster
from terraport_pipeline.geometry.clouds.height_changes import (
    HEIGHT_CHANGE_SCALE,
    HeightChanges,
)

COLUMNS = 4
"""Along a block."""


def raster(
    dz_m: list[list[float]], *, low: tuple[float, float] = (0.0, 0.0), cell: int = 1
) -> ChangeRaster:
    """Cells of so many cubes, all of which moved where they have a number."""
    steps = np.array(dz_m, np.float32)
    return ChangeRaster(low, 0.5, 0.5 * cell, steps, np.ones_like(steps), steps != 0.0, (0, 0))


def block(*index: int) -> np.ndarray:
    return np.array([index], np.int64)


def at(changes: HeightChanges, *positions: tuple[float, float, float]) -> list[float]:
    return changes.at(np.array(positions, np.float64)).tolist()


def plain(value: float = -2.0) -> HeightChanges:
    """One block that sank throughout."""
    cells = raster([[value] * COLUMNS] * COLUMNS)
    return HeightChanges.none(COLUMNS).renewed(cells, 1, block(0, 0, 0))


def test_ground_that_never_changed_has_no_value() -> None:
    empty = HeightChanges.none(COLUMNS)
    assert np.isnan(at(empty, (0.5, 0.5, 0.5), (-3.0, 0.0, 9.9))).all()
    assert len(empty.within(np.zeros(3), np.ones(3)).keys) == 0


def test_a_block_that_sank_and_none_beside_it() -> None:
    changes = plain()
    assert at(changes, (0.0, 0.5, 0.0), (0.99, 0.5, 0.5)) == [-2.0, -2.0]
    assert np.isnan(at(changes, (1.01, 0.5, 0.5), (0.5, 0.5, -0.01), (0.5, 1.5, 0.5))).all()


def test_between_middles_it_is_interpolated() -> None:
    steps = [[1.0] * 4, [2.0] * 4, [3.0] * 4, [4.0] * 4]
    changes = HeightChanges.none(COLUMNS).renewed(raster(steps), 1, block(0, 0, 0))
    # Middles lie at an eighth of a block, three eighths and so on; level beyond the last.
    found = at(changes, (0.125, 0, 0.5), (0.25, 0, 0.5), (0.5, 0, 0.5), (0.01, 0, 0.5))
    assert found == [1.0, 1.5, 2.5, 1.0]


def test_only_blocks_with_new_samples_count() -> None:
    cells = raster([[-1.0] * COLUMNS] * (2 * COLUMNS))
    changes = HeightChanges.none(COLUMNS).renewed(cells, 1, block(1, 0, 0))
    assert at(changes, (1.5, 0.5, 0.5)) == [-1.0]
    assert np.isnan(at(changes, (0.5, 0.5, 0.5))).all()


def test_a_surface_just_above_its_samples_takes_their_value() -> None:
    changes = plain()
    near, far = 0.9 / COLUMNS, 1.1 / COLUMNS
    assert at(changes, (0.5, 1.0 + near, 0.5), (0.5, -near, 0.5)) == [-2.0, -2.0]
    assert np.isnan(at(changes, (0.5, 1.0 + far, 0.5), (0.5, -far, 0.5))).all()


def test_ground_without_a_height_before_has_no_value() -> None:
    steps = np.full((COLUMNS, COLUMNS), -1.0)
    steps[2, :] = np.nan
    cells = raster(steps.tolist())
    changes = HeightChanges.none(COLUMNS).renewed(cells, 1, block(0, 0, 0))
    assert np.isnan(at(changes, (0.6, 0.5, 0.5))).all()
    # Its neighbours are not drawn towards it.
    assert at(changes, (0.45, 0.5, 0.5)) == [-1.0]


def test_a_later_survey_replaces_what_it_finds_moved_and_no_more() -> None:
    later = [[0.0] * COLUMNS, [0.0] * COLUMNS, [3.0] * COLUMNS, [3.0] * COLUMNS]
    changes = plain().renewed(raster(later), 1, block(0, 0, 0))
    assert at(changes, (0.1, 0.5, 0.5), (0.9, 0.5, 0.5)) == [-2.0, 3.0]
    elsewhere = plain().renewed(
        raster([[5.0] * COLUMNS] * COLUMNS, low=(8.0, 0.0)), 1, block(2, 0, 0)
    )
    before = plain().within(np.zeros(3), np.ones(3))
    assert elsewhere.within(np.zeros(3), np.ones(3)).digest() == before.digest()
    assert elsewhere.digest() != before.digest()


@pytest.mark.parametrize("cube_columns", [1, 2])
def test_a_coarser_raster_gives_all_columns_of_a_cell_its_value(cube_columns: int) -> None:
    """Cells of four columns: two cubes of two columns each, or four of one."""
    cell = 4 // cube_columns
    low = (-4.0 / cube_columns, 0.0)
    cells = raster([[-1.0], [2.0]], low=low, cell=cell)
    changes = HeightChanges.none(COLUMNS).renewed(
        cells, cube_columns, np.array([[-1, 0, 0], [0, 0, 0]], np.int64)
    )
    assert len(changes.keys) == 2 * COLUMNS**2
    assert at(changes, (-0.9, 0.5, 0.5), (0.9, 0.5, 0.5)) == [-1.0, 2.0]


def test_many_blocks_are_looked_up_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    cells = raster([[-1.0] * COLUMNS] * (3 * COLUMNS))
    blocks = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], np.int64)
    whole = HeightChanges.none(COLUMNS).renewed(cells, 1, blocks)
    monkeypatch.setattr(
        "terraport_pipeline.geometry.clouds.height_changes._COLUMNS_AT_ONCE", COLUMNS**2
    )
    assert HeightChanges.none(COLUMNS).renewed(cells, 1, blocks).digest() == whole.digest()


def test_a_box_takes_the_columns_that_reach_into_it_and_none_that_touch() -> None:
    cells = raster([[-1.0] * 16] * 16)
    blocks = np.stack(np.meshgrid(range(4), [0, 1], range(4)), axis=-1).reshape(-1, 3)
    changes = HeightChanges.none(COLUMNS).renewed(cells, 1, blocks.astype(np.int64))
    inner = changes.within(np.array([1.0, 0.0, 1.0]), np.array([2.0, 1.0, 2.5]))
    assert len(inner.keys) == 4 * 6
    wider = changes.within(np.array([0.99, 0.0, 1.0]), np.array([2.0, 1.01, 2.51]))
    assert len(wider.keys) == 5 * 2 * 7
    # A box without width is in one column.
    assert len(changes.within(np.full(3, 1.1), np.full(3, 1.1)).keys) == 1


def test_the_scale_is_exact_at_zero_and_leaves_out_what_it_cannot_hold() -> None:
    values = np.array([0.0, -1.5, 255.98, -256.0], np.float32)
    codes = encode_attribute(values, HEIGHT_CHANGE_SCALE)
    np.testing.assert_allclose(decode_attribute(codes, HEIGHT_CHANGE_SCALE), values, atol=0.004)
    assert decode_attribute(codes, HEIGHT_CHANGE_SCALE)[0] == 0.0
    assert np.isnan(at(plain(-300.0), (0.5, 0.5, 0.5))).all()
