"""Facts of regions on meshes whose answers can be written out."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pipeline.mesh_facts import region_facts


def two_squares():
    """A level square of 2 m and a wall of 2 m x 1 m standing on its edge x = 2."""
    vertices = np.array(
        [[0, 5, 0], [0, 5, 2], [2, 5, 0], [2, 5, 2], [2, 6, 0], [2, 6, 2]], np.float32
    )
    faces = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]], np.int32)
    colours = np.array([[30, 60, 90]] * 4 + [[90, 60, 30]] * 2, np.uint8)
    grade = np.array([1.0, 1, 1, 1, 3, np.nan], np.float32)
    return vertices, faces, colours, grade


def test_facts_written_out():
    """Area, slope, colour, height, attribute, border."""
    vertices, faces, colours, grade = two_squares()
    regions = np.array([0, 0, 1, 1], np.int32)
    facts = region_facts(vertices, faces, colours, regions, attributes={"grade": grade})
    level, wall = facts["regions"]
    assert (level["id"], level["faces"]) == (0, 2)
    assert (level["roughness_m"], wall["roughness_m"]) == (0.0, 0.0)
    assert (level["area_m2"], level["plan_area_m2"]) == (4.0, 4.0)
    assert (wall["area_m2"], wall["plan_area_m2"]) == (2.0, 0.0)
    assert level["slope_deg"] == {"mean": 0.0, "p90": 0.0}
    assert wall["slope_deg"] == {"mean": 90.0, "p90": 90.0}
    assert level["height_m"] == {"min": 5.0, "mean": 5.0, "max": 5.0}
    assert wall["height_m"] == {"min": 5.0, "mean": 5.5, "max": 6.0}
    assert level["centroid"] == [1.0, 5.0, 1.0]
    assert wall["bounds"] == {"min": [2.0, 5.0, 0.0], "max": [2.0, 6.0, 2.0]}
    assert level["mean_colour"] == [30.0, 60.0, 90.0]
    assert wall["mean_colour"] == [60.0, 60.0, 60.0]
    assert level["attributes"]["grade"] == {"min": 1.0, "mean": 1.0, "max": 1.0, "deviation": 0.0}
    assert wall["attributes"]["grade"]["mean"] == pytest.approx((3 * 1 + 2 * 3) / 5)
    assert level["neighbours"] == [{"region": 1, "border_m": 2.0}]
    assert wall["neighbours"] == [{"region": 0, "border_m": 2.0}]
    json.dumps(facts, allow_nan=False)


def test_means_are_weighted_by_area():
    """A large dark and a small light face: the mean is nearer to the large one."""
    vertices = np.array(
        [[0, 0, 0], [0, 0, 3], [3, 0, 0], [9, 0, 0], [9, 0, 1], [10, 0, 0]], np.float32
    )
    faces = np.array([[0, 1, 2], [3, 4, 5]], np.int32)
    colours = np.array([[0, 0, 0]] * 3 + [[100, 100, 100]] * 3, np.uint8)
    region = region_facts(vertices, faces, colours, np.zeros(2, np.int32))["regions"][0]
    assert region["mean_colour"] == [10.0, 10.0, 10.0]
    assert region["neighbours"] == []


def test_zero_area_and_unknown_attribute():
    """A region of collapsed faces has finite facts; an attribute of NaNs only is left out."""
    vertices = np.ones((3, 3), np.float32)
    facts = region_facts(
        vertices, np.array([[0, 1, 2]]), np.full((3, 3), 7, np.uint8), np.zeros(1, np.int32),
        attributes={"grade": np.full(3, np.nan), "depth": np.full(3, 2.0)},
    )  # fmt: skip
    region = facts["regions"][0]
    assert (region["area_m2"], region["mean_colour"]) == (0.0, [7.0, 7.0, 7.0])
    assert list(region["attributes"]) == ["depth"]
    json.dumps(facts, allow_nan=False)


def test_bad_input_is_named():
    """What was received, what was expected."""
    vertices, faces, colours, grade = two_squares()
    regions = np.zeros(4, np.int32)
    with pytest.raises(ValueError, match=r"regions have shape \(3,\), expected \(4,\)"):
        region_facts(vertices, faces, colours, regions[:3])
    with pytest.raises(ValueError, match=r"colours have shape \(5, 3\), expected \(6, 3\)"):
        region_facts(vertices, faces, colours[:5], regions)
    with pytest.raises(ValueError, match=r"attribute 'grade' has shape \(2,\), expected \(6,\)"):
        region_facts(vertices, faces, colours, regions, attributes={"grade": grade[:2]})
    with pytest.raises(ValueError, match=r"region 1 has no face, expected numbers without gaps"):
        region_facts(vertices, faces, colours, np.array([0, 0, 2, 2], np.int32))


def literal_facts(vertices, faces, colours, regions, values):
    """Face by face, as the docstring says it: areas and means."""
    rows = []
    for region in range(regions.max() + 1):
        weights, slopes, tints, samples, shares = [], [], [], [], []
        for face in faces[regions == region]:
            a, b, c = vertices[face].astype(float)
            normal = 0.5 * np.cross(b - a, c - a)
            area = np.linalg.norm(normal)
            weights.append(area)
            cosine = max(normal[1] / area, 0.0) if area > 0 else 1.0
            slopes.append(np.degrees(np.arccos(min(cosine, 1.0))))
            tints.append(colours[face].astype(float).mean(axis=0))
            for vertex in face:
                if np.isfinite(values[vertex]):
                    samples.append(values[vertex])
                    shares.append(area)
        total = sum(weights)
        if total == 0:
            weights = [1.0] * len(weights)
        if sum(shares) == 0:
            shares = [1.0] * len(shares)
        rows.append(
            {
                "area": total,
                "colour": np.average(tints, axis=0, weights=weights),
                "slope": np.average(slopes, weights=weights),
                "mean": np.average(samples, weights=shares) if samples else None,
            }
        )
    return rows


@given(st.integers(0, 2**32 - 1), st.integers(1, 30), st.integers(1, 4))
@settings(max_examples=60)
def test_equal_to_a_literal_loop(seed, n_faces, n_regions):
    """Repeated corners, zero areas, gaps and regions of one face included."""
    rng = np.random.default_rng(seed)
    vertices = rng.integers(-3, 4, (12, 3)).astype(np.float32)
    faces = rng.integers(0, 12, (n_faces, 3)).astype(np.int32)
    colours = rng.integers(0, 256, (12, 3)).astype(np.uint8)
    values = np.where(rng.random(12) < 0.3, np.nan, rng.normal(size=12))
    regions = np.unique(rng.integers(0, n_regions, n_faces), return_inverse=True)[1]
    regions = regions.astype(np.int32)
    for array in (vertices, faces, colours, values, regions):
        array.flags.writeable = False
    document = region_facts(vertices, faces, colours, regions, attributes={"grade": values})
    expected = literal_facts(vertices, faces, colours, regions, values)
    for row, truth in zip(document["regions"], expected, strict=True):
        assert row["area_m2"] == pytest.approx(truth["area"], abs=0.00051)
        assert row["mean_colour"] == pytest.approx(list(truth["colour"]), abs=0.051)
        assert row["slope_deg"]["mean"] == pytest.approx(truth["slope"], abs=0.051)
        if truth["mean"] is None:
            assert row["attributes"] == {}
        else:
            assert row["attributes"]["grade"]["mean"] == pytest.approx(truth["mean"])
    json.dumps(document, allow_nan=False)


def test_slopes_of_one_region_in_order():
    """Eleven faces of equal area, slopes 8, 16, ..., 88: 90 % is reached within the tenth."""
    tilt = np.radians(np.arange(8.0, 89.0, 8.0))
    across = np.stack([np.cos(tilt), np.sin(tilt), np.zeros(11)], axis=1)
    start = np.outer(np.arange(11.0), [0, 0, 3])
    along = start + np.array([0, 0, 1])
    vertices = np.concatenate([start, along, start + across]).astype(np.float32)
    faces = np.arange(11)[:, None] + [0, 11, 22]
    order = np.random.default_rng(1).permutation(11)
    facts = region_facts(
        vertices, faces[order], np.zeros((33, 3), np.uint8), np.zeros(11, np.int32)
    )
    assert facts["regions"][0]["slope_deg"] == {"mean": 48.0, "p90": 80.0}
