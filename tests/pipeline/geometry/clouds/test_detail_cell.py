"""Cells follow density and noise without steps; what was asked for goes where it can."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.clouds.detail_cell import (
    choose_cell,
    detail_cell_m,
    smoothing_radius_m,
)
from terraport_pipeline.geometry.clouds.smooth import REACH_RADII
from terraport_pipeline.geometry.tiles.tile_plan import MARGIN_CELLS, REACH_CELLS

NOISES = np.linspace(0.0, 20.0, 2001)


def test_cells_follow_the_spacing_in_proportion() -> None:
    """Twice the points, half the area of a cell: never four times the faces."""
    spacings = np.geomspace(0.05, 5.0, 200)
    cells = np.array([detail_cell_m(s, 0.1 * s) for s in spacings])
    assert cells / spacings == pytest.approx(cells[0] / spacings[0])


def test_cells_grow_with_noise_without_steps() -> None:
    cells = np.array([detail_cell_m(1.0, noise) for noise in NOISES])
    assert (np.diff(cells) >= 0).all()
    assert np.diff(cells).max() < 0.01
    assert detail_cell_m(1.0, 0.0) == detail_cell_m(1.0, 0.29)
    assert detail_cell_m(1.0, 2.0) > 1.5 * detail_cell_m(1.0, 0.0)


def test_clean_clouds_are_not_smoothed_and_noisy_ones_wider() -> None:
    radii = np.array([smoothing_radius_m(1.0, noise) for noise in NOISES])
    assert (radii[NOISES < 0.299] == 0).all()
    assert (np.diff(radii[NOISES > 0.3]) >= 0).all()
    assert smoothing_radius_m(0.1, 0.2) == pytest.approx(0.1 * smoothing_radius_m(1.0, 2.0))


def test_smoothing_stays_within_what_two_tiles_both_see() -> None:
    """Surface near a wall depends on samples some cells beyond it, those on their neighbours."""
    for noise in NOISES:
        reach = REACH_RADII * smoothing_radius_m(1.0, noise) / detail_cell_m(1.0, noise)
        assert reach < MARGIN_CELLS - REACH_CELLS


def test_a_depth_that_was_asked_for_is_taken_where_the_survey_supports_it() -> None:
    cell, warnings = choose_cell(8, 440.0, 0.5, 0.0)
    assert cell == 440 / 2**8
    assert warnings == []


def test_more_than_the_survey_supports_is_lowered_and_told() -> None:
    cell, (warning,) = choose_cell(13, 440.0, 0.5, 0.6)
    assert cell == detail_cell_m(0.5, 0.6)
    assert warning == (
        "cells of 0.789 m instead of 0.0537 m (--detail-depth 13): the samples stand 0.5 m apart "
        "with a noise of 0.6 m; finer cells would only add noise"
    )


def test_what_nobody_asked_for_is_no_news() -> None:
    assert choose_cell(None, 440.0, 0.5, 0.6) == (detail_cell_m(0.5, 0.6), [])
