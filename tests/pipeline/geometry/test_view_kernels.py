"""Small parts of the photo choice, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.view_kernels import (
    QUALITY_STEPS,
    SLOTS,
    place_of_view,
    quality_level,
    sort_slots,
)


def test_a_level_is_a_logarithm_in_steps() -> None:
    assert quality_level(4.0) - quality_level(2.0) == QUALITY_STEPS
    assert quality_level(2.0**-12) == quality_level(0.0) == 1  # 0 stands for an empty place
    assert quality_level(1e30) == 65535
    levels = [quality_level(value) for value in np.geomspace(1e-3, 1e5, 500)]
    assert (np.diff(levels) > 0).all()


@pytest.mark.parametrize(("view", "place"), [(7, 0), (-1, 1), (3, 2), (9, 3), (5, 3)])
def test_a_view_is_found_among_those_seen(view: int, place: int) -> None:
    seen = np.array([7, -1, 3, 5, 9], np.int64)
    assert place_of_view(seen, 3, view) == place  # what lies behind the first three is left over


def test_places_are_sorted_with_what_belongs_to_them_and_empty_ones_last() -> None:
    rng = np.random.default_rng(0)
    views = np.full((50, SLOTS), -1, np.int16)
    for row in views:
        row[rng.permutation(SLOTS)[: rng.integers(0, SLOTS + 1)]] = 1
        row[row > 0] = rng.permutation(300)[: (row > 0).sum()]
    qualities = (views.astype(np.uint16) + 7).astype(np.uint16)
    colours = np.repeat((views % 251).astype(np.uint8)[..., None], 3, axis=2)
    before = views.copy()
    sort_slots(views, qualities, colours, 0, 40)
    expected = np.sort(before.view(np.uint16), axis=1).view(np.int16)
    assert (views[:40] == expected[:40]).all()
    assert (views[40:] == before[40:]).all()
    assert (qualities == (views.astype(np.uint16) + 7).astype(np.uint16)).all()
    assert (colours[..., 1] == (views % 251).astype(np.uint8)).all()
