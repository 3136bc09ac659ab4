"""The hand-drawn regions: well-formed everywhere, and a mesh where the surveys are."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from pipeline.geometry.truth.crops import CROPS, SHARED_DATA, inside_polygon, load_crop


@pytest.mark.parametrize("name", CROPS)
def test_polygons_are_closed_and_within_their_box(name):
    """Labels only, at a decimetre: nothing of the survey is in the file."""
    drawn = json.loads((Path(__file__).parent / f"{name}.geojson").read_text(encoding="utf-8"))
    west, south, east, north = drawn["box"]
    names = [feature["properties"]["region"] for feature in drawn["features"]]
    assert len(set(names)) == len(names) >= 6
    for feature in drawn["features"]:
        ring = np.array(feature["geometry"]["coordinates"][0])
        assert (ring[0] == ring[-1]).all()
        assert len(ring) >= 5
        assert ((ring >= (west, south)) & (ring <= (east, north))).all()


def test_even_odd():
    """A square with its middle, its outside and a notch."""
    ring = np.array([[0, 0], [4, 0], [4, 4], [2, 1], [0, 4], [0, 0]], float)
    points = np.array([[1, 1], [2, 3], [3.5, 2], [5, 1], [-1, 1]], float)
    assert inside_polygon(points, ring).tolist() == [True, False, True, False, False]


@pytest.mark.shared_data
@pytest.mark.parametrize("name", CROPS)
def test_meshes_have_truth(name):
    """Every region has faces; most truth is one polygon's; y is up."""
    crop = load_crop(name)
    if crop is None:
        pytest.skip(f"{SHARED_DATA} does not hold the survey of {name}")
    counts = np.bincount(crop.truth + 1, minlength=len(crop.names) + 1)
    assert (counts[1:] > 200).all()
    assert 0.15 < counts[1:].sum() / counts.sum() < 0.9
    corners = crop.vertices[crop.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normal[:, 1] > 0).all()


def test_no_survey_no_mesh(tmp_path):
    """Absent data is told by None, so that tests and benchmarks can skip."""
    assert load_crop(CROPS[0], tmp_path) is None
