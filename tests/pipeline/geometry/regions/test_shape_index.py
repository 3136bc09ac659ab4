"""The index made of shape diameters."""

from __future__ import annotations

import numpy as np
import pytest

from terraport_pipeline.geometry.regions.shape_index import cone_directions, shape_index

ROW = np.array([[0, 1], [1, 2], [2, 3]], np.int32)


def test_cone_is_filled_evenly_and_no_wider_than_asked():
    directions, weights = cone_directions(200, 120.0)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    assert directions[:, 2].min() > 0.5
    assert abs(directions[:, :2].mean(axis=0)).max() < 0.02
    assert (np.diff(weights) < 0).all()


@pytest.mark.parametrize(("rays", "opening"), [(0, 90.0), (3, 0.0), (3, 180.0)])
def test_cones_that_are_none_are_refused(rays, opening):
    with pytest.raises(ValueError, match="expected 1 or more"):
        cone_directions(rays, opening)


def test_thin_and_thick_stay_apart():
    index = shape_index(np.array([1.0, 1.1, 9.0, 9.1]), ROW)
    assert index[0] < 0.1
    assert index[3] > 0.9
    assert index[0] <= index[1] < index[2] <= index[3]


def test_faces_without_a_diameter_count_as_the_thickest():
    index = shape_index(np.array([1.0, np.nan, 5.0]), np.zeros((0, 2), np.int32))
    assert index.tolist() == [0.0, 1.0, 1.0]


@pytest.mark.parametrize("values", [[np.nan, np.nan], [2.0, 2.0], []])
def test_nothing_to_tell_apart(values):
    assert shape_index(np.array(values), np.zeros((0, 2), np.int32)).tolist() == [0.0] * len(values)
