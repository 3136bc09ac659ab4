"""Histograms: nothing lost, round steps, tallest bar full."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from terraport_pipeline.report.histogram import histogram


@given(st.lists(st.integers(0, 10**9), min_size=1, max_size=60))
def test_every_value_is_in_its_bar(values) -> None:
    shown = histogram(np.array(values))
    assert shown is not None
    assert sum(bar.count for bar in shown.bars) == len(values)
    assert max(bar.share for bar in shown.bars) == 1.0
    assert len(shown.bars) <= 26
    for bar in shown.bars:
        assert bar.count == sum(bar.low <= value < bar.high for value in values)
    assert (shown.minimum, shown.maximum) == (min(values), max(values))


def test_no_values_no_histogram() -> None:
    assert histogram(np.array([])) is None


def test_steps_are_round() -> None:
    shown = histogram(np.array([20_000]))
    assert shown is not None
    assert shown.bars[0].high == 1_000.0
